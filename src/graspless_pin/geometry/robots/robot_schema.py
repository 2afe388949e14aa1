"""The schema of robot files (``robots/*.yaml``): what may stand in one, unknown keys refused."""

from __future__ import annotations

import reprlib
from functools import lru_cache
from pathlib import Path
from typing import Annotated

from pydantic import Field, ValidationError, model_validator

from graspless_pin.errors import RobotError
from graspless_pin.geometry.bodies.decomposition import (
    DEFAULT_CONCAVITY,
    DEFAULT_TIME_LIMIT,
    Concavity,
    Convex,
    DecomposeTimeLimit,
    MaxPieces,
)
from graspless_pin.geometry.robots.description import FingerSpec, JointCoupling
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
    errors_of_text,
    kind_of_data,
    read_text,
    refuse_other_kind,
)
from graspless_pin.intake.yaml_text import parse_yaml
from graspless_pin.suggestions import names_in_words

Source = Annotated[str, Field(max_length=2000)]


class FingerEntry(Entry):
    """A finger: its joints, and the links whose contacts are its own (default: all it moves)."""

    joints: Many[Name] = Field(min_length=1, description="its joints, from the palm outwards")
    links: Many[Name] = Field(
        default=[], description="links whose contacts are its own; default: all that it moves"
    )
    tip: Name | None = Field(default=None, description="its last link, which touches first")

    def spec(self) -> FingerSpec:
        """Return the finger as a record."""
        return FingerSpec(tuple(self.joints), tuple(self.links), self.tip)


class EffortEntry(Entry):
    """A limit and where it comes from, or what is known while the real limit is not."""

    limit: Signed | tuple[Signed, Signed] | None = Field(
        default=None, description="[N m, N] largest effort, or the lowest and the highest"
    )
    source: Source | None = Field(
        default=None, min_length=1, description="where the limit comes from, such as a data sheet"
    )
    unknown: Source | None = Field(
        default=None, min_length=1, description="instead of both: what is known"
    )

    @model_validator(mode="after")
    def _one_form(self) -> EffortEntry:
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
    multiplier: Finite = Field(default=1.0, description="[1] of the one leading joint")
    offset: Finite = Field(default=0.0, description="[rad, m] added to what follows from that")

    @model_validator(mode="after")
    def _one_multiplier(self) -> CouplingEntry:
        if isinstance(self.follows, dict) and "multiplier" in self.model_fields_set:
            raise ValueError("'multiplier' goes with one leader; write {leader: multiplier}")
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
        description="[N m/rad] of all joints, or by joint (N/m where it slides), finger or "
        "'default', these over (0.1 m)^2 where joints slide"
    )
    damping: NotNegative | ByName[NotNegative] | None = Field(
        default=None, description="[N m s/rad] likewise, of joints and motors themselves, too"
    )


class RobotFile(Entry):
    """A robot file."""

    name: Name = Field(min_length=1, description="how messages call the robot")
    urdf: FilePath | None = Field(
        default=None, description="URDF, xacro file or MJCF; path relative to this file"
    )
    model: Name | None = Field(
        default=None, description="instead of urdf: name of an example-robot-data model"
    )
    package_dirs: Few[FilePath] = Field(
        default=[],
        description="folders in which package:// addresses are looked for; relative to this file",
    )
    root_link: Name | None = Field(
        default=None, description="link to keep with all below it; default: the whole model"
    )
    xacro_args: ByName[Name] = Field(
        default={}, description="values of a xacro file's <xacro:arg>, by name"
    )
    srdf: FilePath | None = Field(
        default=None,
        description="its SRDF, relative to this file; default: the one beside the URDF, or in the "
        "folder srdf beside its folder",
    )
    palm: Name | Few[Name] = Field(
        default=[], description="link or links from which the fingers branch; default: found"
    )
    fingers: ByName[FingerEntry] = Field(
        default={}, description="the fingers by name; default: the branches below the palm"
    )
    couplings: ByName[CouplingEntry] = Field(
        default={}, description="joints that follow others, beside the URDF's mimic joints"
    )
    tendons: ByName[TendonEntry] = Field(
        default={}, description="tendons by name, each one motor for several joints"
    )
    effort_limits: ByName[EffortEntry] = Field(
        default={}, description="limits by joint, finger or tendon; default: the URDF's"
    )
    controller: GainsEntry | None = Field(
        default=None, description="what runs on the joints unless a scene says otherwise"
    )
    visuals_collide: bool = Field(
        default=False, description="whether links without collision shapes take their visual ones"
    )
    convex: Convex | ByName[Convex] = Field(
        default="hull", description="how collision meshes are made convex, for all or by link"
    )
    concavity: Concavity = DEFAULT_CONCAVITY
    decompose_time_limit: DecomposeTimeLimit = DEFAULT_TIME_LIMIT
    max_pieces: MaxPieces | None = None

    @model_validator(mode="after")
    def _one_source(self) -> RobotFile:
        if (self.urdf is None) == (self.model is None):
            raise ValueError(
                "give either 'urdf' (a path relative to this file) or 'model' (the name of an "
                "example-robot-data model)"
            )
        return self


_MOST_KEPT = 32
ROBOT_FILE = FileKind("robot file", 4, RobotError)


def read_robot_file(file: Path) -> RobotFile:
    """Read and validate one robot file.

    Raises:
        RobotError: If it cannot be read, is not plain YAML or not valid; names file, key and what
            was found.
    """
    return _robot_file(file, read_text(file, ROBOT_FILE))


@lru_cache(maxsize=_MOST_KEPT)
def _robot_file(file: Path, text: str) -> RobotFile:
    """Validate the text of a robot file, once: a study asks for its hand in every sample."""
    with errors_of_text(file, ROBOT_FILE):
        content = parse_yaml(text).data
    if not isinstance(content, dict):
        raise RobotError(
            f"{file}: a robot file is a mapping with the keys name, urdf or model, ..."
        )
    refuse_other_kind(file, ROBOT_FILE, kind_of_data(content))
    try:
        return RobotFile.model_validate(content)
    except ValidationError as error:
        # A value that may be of several kinds has errors of each: the deepest is of the one meant.
        errors = error.errors()
        about = [one for one in errors if one["loc"][:1] == errors[0]["loc"][:1]]
        first = max(about, key=lambda one: len(one["loc"]))
        found = reprlib.repr(first["input"])
        # Of a key that may be of several kinds the kind is named in brackets.
        key = ".".join(str(part) for part in first["loc"] if "[" not in str(part)) or "file"
        if first["type"] == "extra_forbidden":
            parts = {"controller": GainsEntry, "fingers": FingerEntry, "couplings": CouplingEntry,
                     "tendons": TendonEntry, "effort_limits": EffortEntry}  # fmt: skip
            kind = parts.get(str(first["loc"][0]), RobotFile) if first["loc"][1:] else RobotFile
            words = names_in_words(str(first["loc"][-1]), kind.model_fields)
            raise RobotError(f"{file}: {key}: unknown key (found {found}); {words}") from error
        raise RobotError(
            f"{file}: {key}: {first['msg']} (found {reprlib.repr(first['input'])})"
        ) from error
