"""Where a hand comes from: a URDF, a robot file in ``robots/`` or an example-robot-data model."""

from __future__ import annotations

import difflib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.robots.description import LinkMeshes, RobotDescription
from graspless_pin.geometry.robots.robot_schema import ROBOT_FILE, read_robot_file
from graspless_pin.intake.files import is_file, kind_of_file, read_bytes, refuse_other_kind

_PACKAGE_ROBOTS = Path(__file__).resolve().parents[2] / "robots"
_SOURCE_ROBOTS = Path(__file__).resolve().parents[4] / "robots"


_MODELS = (".urdf", ".xacro", ".xml", ".mjcf", ".sdf")
"""How the names of hands' own files end."""


def _models() -> Mapping[str, Any]:
    """Return the loaders of example-robot-data by name; reading them takes a while."""
    from example_robot_data import ROBOTS  # pyright: ignore[reportMissingImports]

    return ROBOTS


def describe_urdf(path: str | Path, package_dirs: Sequence[str | Path] = ()) -> RobotDescription:
    """Describe a plain URDF or MJCF, of which no fingers or honest limits are known."""
    file = Path(path)
    return RobotDescription(file.stem, file, tuple(Path(folder) for folder in package_dirs))


def describe_model(name: str) -> RobotDescription:
    """Describe a model of example-robot-data by its name there, e.g. ``allegro_right_hand``.

    Raises:
        RobotError: If there is no such model or it has no URDF; names similar ones.
    """
    from example_robot_data import getModelPath  # pyright: ignore[reportMissingImports]

    models = _models()
    loader = models.get(name)
    if loader is None:
        raise RobotError(f"unknown model {name!r} of example-robot-data; {_similar(name, models)}")
    if not loader.urdf_filename:
        raise RobotError(f"model {name!r} of example-robot-data is not a URDF; choose another one")
    inside = Path(loader.path) / loader.urdf_subpath / loader.urdf_filename
    folder = Path(getModelPath(str(inside))).resolve()
    return RobotDescription(name, folder / inside, (folder.parents[1],), model=name)


def robot_names() -> tuple[str, ...]:
    """Return the names of the robot files that come with this package, sorted."""
    return tuple(sorted(file.stem for file in _robots_folder().glob("*.yaml")))


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
        file = _robots_folder() / f"{text}.yaml"
    else:
        raise RobotError(f"unknown robot {text!r}; {_similar(text, robot_names())}")
    entry = read_robot_file(file)
    efforts = entry.effort_limits
    if entry.model is not None:
        try:
            base = describe_model(entry.model)
        except RobotError as error:
            raise RobotError(f"{file}: model: {error}") from error
    else:
        base = describe_urdf(file.parent / str(entry.urdf))
    return RobotDescription(
        name=entry.name,
        urdf_path=base.urdf_path,
        package_dirs=(*base.package_dirs, *(file.parent / item for item in entry.package_dirs)),
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
    """Find out what ``source`` means.

    Args:
        source: A description; a path to a URDF or MJCF (.urdf, .xacro, .xml, .mjcf) or a robot file
            (.yaml, .yml); the name of a robot file; or the name of an example-robot-data model.
            Robot files win over models.
        package_dirs: For the ``package://`` addresses of a URDF given by path.

    Raises:
        RobotError: If it means nothing; names similar robots.
        ArgumentError: If ``package_dirs`` is given for anything but a URDF.
    """
    is_urdf = not isinstance(source, RobotDescription) and Path(source).suffix in _MODELS
    if is_urdf:
        return describe_urdf(str(source), package_dirs)
    if package_dirs:
        raise ArgumentError("package_dirs", f"only goes with a URDF file, not with {source!r}")
    if isinstance(source, RobotDescription):
        return source
    text = str(source)
    if text.endswith((".yaml", ".yml")) or text in robot_names():
        return load_robot(text)
    if text in _models():
        return describe_model(text)
    if is_file(Path(text)):
        refuse_other_kind(
            Path(text), ROBOT_FILE, kind_of_file(Path(text), read_bytes(Path(text), ROBOT_FILE))
        )
        raise RobotError(
            f"{text}: is neither a URDF nor an MJCF ({', '.join(_MODELS[:4])}) nor a robot file "
            "(.yaml, .yml)"
        )
    raise RobotError(
        f"unknown robot {text!r}: give a .urdf file, a robot file or a model's name; "
        f"{_similar(text, [*robot_names(), *_models()])}"
    )


def _robots_folder() -> Path:
    """Return the folder of robot files, inside the installed package or beside its source."""
    return _PACKAGE_ROBOTS if _PACKAGE_ROBOTS.is_dir() else _SOURCE_ROBOTS


def _similar(name: str, known: Sequence[str] | Mapping[str, Any]) -> str:
    """Say which known names are near ``name``, or all of them if none is."""
    names = sorted(set(known))
    near = difflib.get_close_matches(name, names, n=5, cutoff=0.5)
    near += [other for other in names if name and name in other and other not in near]
    return f"near: {', '.join(near)}" if near else f"known: {', '.join(names)}"
