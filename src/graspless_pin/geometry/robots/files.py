"""Finding a robot: a URDF, a robot file in ``robots/`` or an example-robot-data model.

Also the schema of robot files (``robots/*.yaml``); unknown keys are refused.
"""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from functools import lru_cache
from pathlib import Path
from typing import Annotated, Any

from pydantic import Field, model_validator

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.bodies.decomposition import (
    DEFAULT_CONCAVITY,
    DEFAULT_TIME_LIMIT,
    Concavity,
    Convex,
    DecomposeTimeLimit,
    MaxPieces,
)
from graspless_pin.geometry.robots.description import (
    FingerSpec,
    JointCoupling,
    LinkMeshes,
    RobotDescription,
)
from graspless_pin.intake.fields import (
    ByName,
    Entry,
    Few,
    FilePath,
    Finite,
    Many,
    Name,
    NotNegative,
    Signed,
)
from graspless_pin.intake.files import (
    FileKind,
    is_file,
    kind_of_file,
    read_bytes,
    read_text,
    refuse_other_kind,
)
from graspless_pin.intake.yaml_source import YamlSource, validated

Source = Annotated[str, Field(max_length=2000)]


class FingerEntry(Entry):
    """A finger: its joints, and the links whose contacts are its own (default: all it moves)."""

    joints: Many[Name] = Field(min_length=1, description="its joints, from the palm outwards")
    links: Many[Name] = Field(
        default=[],
        description="links whose contacts belong to the finger; default: all links that it moves",
    )
    tip: Name | None = Field(
        default=None, description="its fingertip link, which touches first when the finger closes"
    )

    def spec(self) -> FingerSpec:
        """Return the finger as a record."""
        return FingerSpec(tuple(self.joints), tuple(self.links), self.tip)


class EffortEntry(Entry):
    """A limit and where it comes from, or what is known while the real limit is not."""

    limit: Signed | tuple[Signed, Signed] | None = Field(
        default=None,
        description="[N m, N] largest absolute effort, or the smallest and largest effort",
    )
    source: Source | None = Field(
        default=None, min_length=1, description="where the limit comes from, such as a data sheet"
    )
    unknown: Source | None = Field(
        default=None,
        min_length=1,
        description="instead of limit and source: what is known about the limit",
    )

    @model_validator(mode="after")
    def _check_one_form(self) -> EffortEntry:
        stated = self.limit is not None and self.source is not None and self.unknown is None
        open_ = self.limit is None and self.source is None and self.unknown is not None
        if not (stated or open_):
            raise ValueError(
                "give 'limit' and 'source' (where it comes from), or only 'unknown' (what is known)"
            )
        return self


class CouplingEntry(Entry):
    """A coupled joint: it follows one joint with a multiplier, or several by name."""

    follows: Name | ByName[Finite] = Field(
        min_length=1, description="[1] the leading joint, or multipliers by leading joint"
    )
    multiplier: Finite = Field(default=1.0, description="[1] multiplier of the one leading joint")
    offset: Finite = Field(
        default=0.0,
        description="[rad, m] added to the sum of leading positions times multipliers",
    )

    @model_validator(mode="after")
    def _check_one_multiplier(self) -> CouplingEntry:
        if isinstance(self.follows, dict) and "multiplier" in self.model_fields_set:
            raise ValueError(
                "'multiplier' requires a single leader; write {leader: multiplier} for several"
            )
        return self

    def coupling(self, joint: str) -> JointCoupling:
        """Return the coupling of ``joint``."""
        follows = (
            self.follows if isinstance(self.follows, dict) else {self.follows: self.multiplier}
        )
        return JointCoupling(joint, follows, self.offset)


class TendonEntry(Entry):
    """A tendon: torque on each joint per newton of tension, that is its moment arm in metres."""

    moment_arms: ByName[Finite] = Field(
        min_length=1, description="[m] torque per newton of tension, by joint"
    )


class GainsEntry(Entry):
    """Position feedback at the joints beside the torques."""

    stiffness: NotNegative | ByName[NotNegative] = Field(
        description="[N m/rad] of all joints, or by joint (N/m if prismatic), finger or "
        "'default'; unless given by joint, it is divided by (0.1 m)^2 for prismatic joints"
    )
    damping: NotNegative | ByName[NotNegative] | None = Field(
        default=None,
        description="[N m s/rad] likewise, including that of joints and motors themselves",
    )


class RobotFile(Entry):
    """A robot file."""

    name: Name = Field(min_length=1, description="name of the robot in messages")
    urdf: FilePath | None = Field(
        default=None, description="URDF, xacro file or MJCF; path relative to this file"
    )
    model: Name | None = Field(
        default=None, description="instead of urdf: name of an example-robot-data model"
    )
    package_dirs: Few[FilePath] = Field(
        default=[],
        description="folders with the packages of package:// addresses; relative to this file",
    )
    root_link: Name | None = Field(
        default=None, description="link to keep, with all links below it; default: the whole model"
    )
    xacro_args: ByName[Name] = Field(
        default={}, description="values of a xacro file's <xacro:arg>, by name"
    )
    srdf: FilePath | None = Field(
        default=None,
        description="its SRDF, relative to this file; default: one in the URDF's folder, or in a "
        "folder srdf next to that folder",
    )
    palm: Name | Few[Name] = Field(
        default=[],
        description="link or links from which the fingers branch; default: found in the model",
    )
    fingers: ByName[FingerEntry] = Field(
        default={}, description="the fingers by name; default: the branches below the palm"
    )
    couplings: ByName[CouplingEntry] = Field(
        default={}, description="joints that follow others, in addition to the URDF's mimic joints"
    )
    tendons: ByName[TendonEntry] = Field(
        default={}, description="tendons by name, each one motor for several joints"
    )
    effort_limits: ByName[EffortEntry] = Field(
        default={}, description="effort limits by joint, finger or tendon; default: the URDF's"
    )
    controller: GainsEntry | None = Field(
        default=None, description="default controller of the joints; a scene may replace it"
    )
    visuals_collide: bool = Field(
        default=False, description="whether links without collision shapes use their visual shapes"
    )
    convex: Convex | ByName[Convex] = Field(
        default="hull", description="how collision meshes are made convex, for all or by link"
    )
    concavity: Concavity = DEFAULT_CONCAVITY
    decompose_time_limit: DecomposeTimeLimit = DEFAULT_TIME_LIMIT
    max_pieces: MaxPieces | None = None

    @model_validator(mode="after")
    def _check_one_source(self) -> RobotFile:
        if (self.urdf is None) == (self.model is None):
            raise ValueError(
                "give either 'urdf' (a path relative to this file) or 'model' (the name of an "
                "example-robot-data model)"
            )
        return self


_MOST_CACHED_FILES = 32
ROBOT_FILE = FileKind("robot file", 4, RobotError)


@lru_cache(maxsize=_MOST_CACHED_FILES)
def _validated_robot_file(file: Path, text: str) -> RobotFile:
    """Validate the text of a robot file; cached, since a study needs its hand in every sample.

    Raises:
        RobotError: If it is not plain YAML or not valid; names file, line, key and value.
    """
    return validated(YamlSource.parsed(file, text, ROBOT_FILE), RobotFile)


_PACKAGE_ROBOTS = Path(__file__).resolve().parents[2] / "robots"
_SOURCE_ROBOTS = Path(__file__).resolve().parents[4] / "robots"
_ROBOTS = _PACKAGE_ROBOTS if _PACKAGE_ROBOTS.is_dir() else _SOURCE_ROBOTS
"""The folder of robot files, inside the installed package or beside its source."""


_ENDINGS = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
"""File name endings of robots' own files."""


def _model_loaders() -> Mapping[str, Any]:
    """Return the loaders of example-robot-data by name; importing them takes a while."""
    from example_robot_data import ROBOTS  # pyright: ignore[reportMissingImports]

    return ROBOTS


def describe_urdf(path: str | Path, package_dirs: Sequence[str | Path] = ()) -> RobotDescription:
    """Describe a plain URDF or MJCF, without known fingers or effort limits."""
    file = Path(path)
    return RobotDescription(file.stem, file, tuple(Path(folder) for folder in package_dirs))


def describe_model(name: str) -> RobotDescription:
    """Describe a model of example-robot-data by its name there, e.g. ``allegro_right_hand``.

    Raises:
        RobotError: If there is no such model or it has no URDF; names similar ones.
    """
    from example_robot_data import getModelPath  # pyright: ignore[reportMissingImports]

    models = _model_loaders()
    loader = models.get(name)
    if loader is None:
        raise RobotError(
            f"unknown model {name!r} of example-robot-data; {_similar_names_text(name, models)}"
        )
    if not loader.urdf_filename:
        raise RobotError(f"model {name!r} of example-robot-data is not a URDF; choose another one")
    relative_path = Path(loader.path) / loader.urdf_subpath / loader.urdf_filename
    model_folder = Path(getModelPath(str(relative_path))).resolve()
    return RobotDescription(
        name, model_folder / relative_path, (model_folder.parents[1],), model=name
    )


def robot_names() -> tuple[str, ...]:
    """Return the names of the robot files that come with this package, sorted."""
    return tuple(sorted(file.stem for file in _ROBOTS.glob("*.yaml")))


def load_robot(name_or_path: str | Path) -> RobotDescription:
    """Load a robot file: one of this package's by name, or any by path.

    Args:
        name_or_path: A name out of ``robot_names()``, or a path that ends in .yaml or .yml.

    Returns:
        The description.

    Raises:
        RobotError: If there is no such robot or its file is not valid; the message names the
            file, the key and what was found.
    """
    text = str(name_or_path)
    if text.endswith((".yaml", ".yml")):
        file = Path(text)
    elif text in robot_names():
        file = _ROBOTS / f"{text}.yaml"
    else:
        raise RobotError(f"unknown robot {text!r}; {_similar_names_text(text, robot_names())}")
    entry = _validated_robot_file(file, read_text(file, ROBOT_FILE))
    efforts = entry.effort_limits
    if entry.model is not None:
        try:
            model_description = describe_model(entry.model)
        except RobotError as error:
            raise RobotError(f"{file}: model: {error}") from error
    else:
        model_description = describe_urdf(file.parent / str(entry.urdf))
    return RobotDescription(
        name=entry.name,
        urdf_path=model_description.urdf_path,
        package_dirs=(
            *model_description.package_dirs,
            *(file.parent / item for item in entry.package_dirs),
        ),
        root_link=entry.root_link,
        xacro_args=entry.xacro_args,
        srdf=None if entry.srdf is None else file.parent / entry.srdf,
        palms=(entry.palm,) if isinstance(entry.palm, str) else tuple(entry.palm),
        fingers={name: item.spec() for name, item in entry.fingers.items()},
        couplings=tuple(item.coupling(joint) for joint, item in entry.couplings.items()),
        tendons={name: item.moment_arms for name, item in entry.tendons.items()},
        effort_limits={name: e.limit for name, e in efforts.items() if e.limit is not None},
        effort_sources={name: e.source for name, e in efforts.items() if e.source is not None},
        effort_unknown={name: e.unknown for name, e in efforts.items() if e.unknown is not None},
        meshes=LinkMeshes(
            entry.convex, entry.concavity, entry.decompose_time_limit, entry.max_pieces
        ),
        visuals_collide=entry.visuals_collide,
        stiffness=None if entry.controller is None else entry.controller.stiffness,
        damping=None if entry.controller is None else entry.controller.damping,
        file=file,
        model=entry.model,
    )


def find_robot(
    source: RobotDescription | str | Path, package_dirs: Sequence[str | Path] = ()
) -> RobotDescription:
    """Return the description of the robot that ``source`` denotes.

    Args:
        source: A description; a path to a URDF or MJCF (.urdf, .xacro, .xml, .mjcf) or a robot file
            (.yaml, .yml); the name of a robot file; or the name of an example-robot-data model.
            Robot files take precedence over models.
        package_dirs: For the ``package://`` addresses of a URDF given by path.

    Raises:
        RobotError: If it denotes no robot; names similar robots.
        ArgumentError: If ``package_dirs`` is given for anything but a URDF.
    """
    if not isinstance(source, RobotDescription) and Path(source).suffix.lower() in _ENDINGS:
        return describe_urdf(str(source), package_dirs)
    if package_dirs:
        raise ArgumentError(
            "package_dirs", f"is only available with a URDF file, not with {source!r}"
        )
    if isinstance(source, RobotDescription):
        return source
    text = str(source)
    if text.endswith((".yaml", ".yml")) or text in robot_names():
        return load_robot(text)
    if text in _model_loaders():
        return describe_model(text)
    if is_file(Path(text)):
        refuse_other_kind(
            Path(text), ROBOT_FILE, kind_of_file(Path(text), read_bytes(Path(text), ROBOT_FILE))
        )
        raise RobotError(
            f"{text}: is neither a URDF nor an MJCF ({', '.join(_ENDINGS[:4])}) nor a robot file "
            "(.yaml, .yml)"
        )
    raise RobotError(
        f"unknown robot {text!r}: give a .urdf file, a robot file or a model's name; "
        f"{_similar_names_text(text, [*robot_names(), *_model_loaders()])}"
    )


def _similar_names_text(name: str, known: Sequence[str] | Mapping[str, Any]) -> str:
    """Return a text with the known names similar to ``name``, or all of them if none is."""
    names = sorted(set(known))
    similar = difflib.get_close_matches(name, names, n=5, cutoff=0.5)
    similar += [other for other in names if name and name in other and other not in similar]
    return f"near: {', '.join(similar)}" if similar else f"known: {', '.join(names)}"
