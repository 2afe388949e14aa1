"""What may stand in a scene file for the hand: robots, how they are mounted and controlled."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, field_validator, model_validator

from graspless_pin.geometry.bodies.decomposition import (
    Concavity,
    Convex,
    DecomposeTimeLimit,
    MaxPieces,
)
from graspless_pin.geometry.robots.files import FingerEntry
from graspless_pin.intake.fields import (
    ByName,
    Entry,
    Few,
    FilePath,
    Finite,
    Name,
    NotNegative,
    Positive,
    Signed,
    listed,
)
from graspless_pin.scene.body_schema import PoseEntry
from graspless_pin.scene.units import merged_angles

LinkConvex = Annotated[
    Convex | ByName[Convex] | None,
    Field(
        description="how the links' collision meshes are made convex, for all or by link; default: "
        "as in the robot file, else hull",
    ),
]


class MountEntry(Entry):
    """One robot fixed to the world; one of ``robot`` or ``urdf``."""

    robot: FilePath | None = Field(
        default=None,
        description="a robot file of this package or by path, or an example-robot-data model",
    )
    urdf: FilePath | None = Field(
        default=None, description="path of a URDF, relative to the scene file"
    )
    package_dirs: Few[FilePath] = Field(
        default=[], description="folders in which the URDF's package:// addresses are looked for"
    )
    srdf: FilePath | None = Field(
        default=None,
        description="path of its SRDF (groups, states, pairs of links that may be in each other); "
        "default: the one beside the URDF, or in the folder srdf beside its folder",
    )
    root_link: Name | None = Field(
        default=None,
        description="link to mount with all that hangs on it, such as the palm of a whole robot; "
        "default: the robot file's, else the root",
    )
    base_pose: PoseEntry = Field(
        default=PoseEntry(), description="of the robot's root link in the world"
    )
    fingers: ByName[FingerEntry] | None = Field(
        default=None,
        description="the fingers by name; default: the robot file's, else the branches below the "
        "palm",
    )
    visuals_collide: bool | None = Field(
        default=None,
        description="whether links without collision shapes take their visual ones; default: as in "
        "the robot file, else no",
    )
    convex: LinkConvex = None
    concavity: Concavity | None = None
    decompose_time_limit: DecomposeTimeLimit | None = None
    max_pieces: MaxPieces | None = None

    @model_validator(mode="after")
    def _one_source(self) -> MountEntry:
        if (self.robot is None) == (self.urdf is None):
            raise ValueError("needs either 'robot' (a name or robot file) or 'urdf' (a path)")
        return self


class PrefixedMountEntry(MountEntry):
    """One of several robots: the prefix goes before the names of its joints, links, fingers."""

    prefix: Name = Field(description="such as left/")


ModeName = Literal["force", "position", "hybrid"]


class HandEntry(MountEntry):
    """The hand: one robot, or several under ``mounts``."""

    mounts: Annotated[list[PrefixedMountEntry], Field(max_length=16)] = Field(
        default=[], description="several robots, each with a prefix; instead of robot or urdf"
    )
    group_states: Annotated[Few[Name], BeforeValidator(listed)] = Field(
        default=[],
        description="a state of the SRDF, or a list of them, GROUP/STATE or STATE: positions of "
        "the joints that q does not name",
    )
    q: ByName[Finite] = Field(
        default={}, description="[rad, m] positions by joint name, those left out are 0"
    )
    q_deg: ByName[Finite] = Field(
        default={}, description="[deg] positions of turning joints by name, instead of q"
    )
    control: ModeName | ByName[ModeName] | None = Field(
        default=None,
        description="one mode for all joints, or modes by finger or joint; default: force, and "
        "position for the joints of an arm that carries the hand",
    )
    effort_limits: ByName[NotNegative | tuple[Signed, Signed]] = Field(
        default={},
        description="[N m, N] by joint or finger; a number means -x to x",
    )
    armature: NotNegative | ByName[NotNegative] | None = Field(
        default=None,
        description="[kg m^2, kg] inertia of the motors' rotors at the joints, "
        "gear ratio squared included: one number, or by joint or finger; default: the URDF's",
    )
    hybrid_force_limit: Positive | None = Field(
        default=None,
        description="[N] largest commanded force of a hybrid finger; default: max_normal_force",
    )
    material: Name | None = Field(default=None, description="of all its links")
    count_own_weight: bool = Field(
        default=True, description="whether g(q), the links' own weight, counts against the limits"
    )

    @model_validator(mode="after")
    def _one_source(self) -> HandEntry:
        given = [name for name in ("robot", "urdf") if getattr(self, name) is not None]
        given += ["mounts"] if self.mounts else []
        if len(given) != 1:
            found = " and ".join(given) or "none of them"
            raise ValueError(f"found {found}; needs exactly one of 'robot', 'urdf' and 'mounts'")
        of_one = sorted(MountEntry.model_fields.keys() & self.model_fields_set)
        if self.mounts and of_one:
            raise ValueError(
                f"found mounts and {' and '.join(of_one)}; with several robots each entry of "
                "'mounts' has its own"
            )
        for name in self.q.keys() & self.q_deg.keys():
            raise ValueError(f"found joint {name!r} in q and in q_deg; needs one of them")
        return self

    @field_validator("effort_limits", mode="before")
    @classmethod
    def _none_left_open(cls, limits: Any) -> Any:
        named = limits.items() if isinstance(limits, dict) else ()
        if open_ := [str(name) for name, value in named if value is None]:
            raise ValueError(
                f"is left empty for {', '.join(open_)}; fill in the most that each motor gives "
                "(N m, or N for a linear joint or tendon), as its data sheet says"
            )
        return limits

    def positions(self) -> dict[str, float]:
        """Return the positions of joints by name, rad or m."""
        return merged_angles(self.q, self.q_deg)

    def mount_entries(self) -> list[tuple[str, MountEntry]]:
        """Return the robots with their prefixes."""
        if self.mounts:
            return [(mount.prefix, mount) for mount in self.mounts]
        return [("", self)]
