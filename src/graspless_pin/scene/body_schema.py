"""Schema of poses, shapes and bodies in a scene file: the object, its supports, the hand.

The hand consists of robots, each with its mounting and control.
"""

from __future__ import annotations

import math
from typing import Annotated, Any, Literal, Union

from pydantic import (
    AfterValidator,
    BeforeValidator,
    Field,
    GetPydanticSchema,
    field_validator,
    model_validator,
)

from graspless_pin.geometry.bodies.decomposition import (
    Concavity,
    Convex,
    DecomposeTimeLimit,
    MaxPieces,
)
from graspless_pin.geometry.bodies.shapes import SHAPES, HalfSpace
from graspless_pin.geometry.robots.files import FingerEntry
from graspless_pin.intake.fields import (
    ByName,
    Entry,
    Few,
    FilePath,
    Finite,
    Friction,
    Many,
    Name,
    NotNegative,
    Positive,
    Signed,
    as_list,
)


def _refuse_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError(f"found {list(vector)}; needs a direction, so one of them not zero")
    return vector


def _check_unit_length(quaternion: tuple[float, ...]) -> tuple[float, ...]:
    length = math.hypot(*quaternion)
    if length and abs(length - 1.0) > _QUATERNION_ROUNDING:  # zero is refused as a rotation
        raise ValueError(
            f"found {list(quaternion)}, of length {length:.4g}; needs x, y, z, w of length 1"
        )
    return quaternion


_QUATERNION_ROUNDING = 0.02
"""Largest deviation of a quaternion's length from 1: [0.7, 0, 0, 0.7] passes."""
Vector = tuple[Finite, Finite, Finite]
Moments = tuple[Positive, Positive, Positive]
Direction = Annotated[Vector, AfterValidator(_refuse_zero)]

ROTATION_FORMS = ("rpy", "rpy_deg", "quaternion", "matrix")
"""Keys of a pose for its rotation, at most one of which may be given."""


class PoseEntry(Entry):
    """A pose: where the frame's origin is, and at most one form of its rotation."""

    position: Vector = Field(
        default=(0.0, 0.0, 0.0), description="[m] position of the frame's origin"
    )
    rpy: Vector | None = Field(
        default=None,
        description="[rad] roll, pitch, yaw: R = Rz(yaw) Ry(pitch) Rx(roll), as in URDF",
    )
    rpy_deg: Vector | None = Field(default=None, description="[deg] roll, pitch, yaw in degrees")
    quaternion: (
        Annotated[tuple[Finite, Finite, Finite, Finite], AfterValidator(_check_unit_length)] | None
    ) = Field(default=None, description="[1] unit quaternion x, y, z, w")
    matrix: tuple[Vector, Vector, Vector] | None = Field(
        default=None, description="[1] rows of the rotation matrix R"
    )

    @model_validator(mode="after")
    def _one_rotation(self) -> PoseEntry:
        forms = [name for name in ROTATION_FORMS if getattr(self, name)]
        if len(forms) > 1:
            raise ValueError(f"found {' and '.join(forms)}; give one form of the rotation")
        return self


def _union_by_type(*entries: type[Entry]) -> GetPydanticSchema:
    several = Annotated[Union[*entries], Field(discriminator="type")]
    return GetPydanticSchema(lambda _, handler: handler(several))


_SOLIDS = tuple(one.entry() for one in SHAPES.values() if one.is_bounded)


class PartEntry(Entry):
    """A part of a compound: a shape, and where it is."""

    shape: Annotated[Entry, _union_by_type(*_SOLIDS)] = Field(
        description="one of the shapes below, except a half-space or a compound"
    )
    pose: PoseEntry = Field(
        default=PoseEntry(), description="pose of the shape's frame in the compound's frame"
    )


class CompoundEntry(Entry):
    """Several shapes as one body."""

    type: Literal["compound"] = Field(description="type of the shape: compound")
    parts: Annotated[Many[PartEntry], Field(min_length=1)] = Field(
        description="at least one part; where parts overlap, both count for volume and inertia"
    )


SolidEntry = Annotated[Entry, _union_by_type(*_SOLIDS, CompoundEntry)]
ShapeEntry = Annotated[Entry, _union_by_type(*_SOLIDS, CompoundEntry, HalfSpace.entry())]


class ObjectEntry(Entry):
    """The manipulated object, with its mass or its density."""

    name: Name = Field(default="object", description="name of the object in results")
    shape: SolidEntry = Field(description="one of the shapes below, except a half-space")
    mass: Positive | None = Field(default=None, description="[kg] mass; or give density")
    density: Positive | None = Field(default=None, description="[kg/m^3] density; or give mass")
    center_of_mass: Vector | None = Field(
        default=None,
        description="[m] centre of mass in the object's frame; default: the centroid of the shape",
    )
    inertia: Moments | tuple[Vector, Vector, Vector] | None = Field(
        default=None,
        description="[kg m^2] inertia about the centre of mass, in the object's axes: three "
        "principal moments, or the rows of the matrix; default: that of a homogeneous "
        "body of this shape and mass",
    )
    material: Name | None = Field(default=None, description="name of the material in 'materials'")
    pose: PoseEntry = Field(
        default=PoseEntry(), description="pose of the object's frame in the world"
    )

    @model_validator(mode="after")
    def _mass_or_density(self) -> ObjectEntry:
        if (self.mass is None) == (self.density is None):
            found = "neither" if self.mass is None else "both"
            raise ValueError(f"found {found} of 'mass' (kg) and 'density' (kg/m^3); needs one")
        return self


class TwistEntry(Entry):
    """A velocity: linear (m/s) and angular (rad/s), world axes."""

    linear: Vector = Field(default=(0.0, 0.0, 0.0), description="[m/s] linear velocity")
    angular: Vector = Field(default=(0.0, 0.0, 0.0), description="[rad/s] angular velocity")


class SupportEntry(Entry):
    """Something that the object may touch: fixed, or moving with a velocity of its own."""

    name: Name = Field(description="name, unique among the supports")
    shape: ShapeEntry = Field(description="one of the shapes below")
    pose: PoseEntry = Field(
        default=PoseEntry(), description="pose of the shape's frame in the world"
    )
    friction: Friction | None = Field(
        default=None,
        description="[1] coefficient of friction with the object; default: from 'friction'",
    )
    velocity: TwistEntry = Field(
        default=TwistEntry(),
        description="velocity of the support at its frame's origin, e.g. of a conveyor or a "
        "turntable",
    )
    material: Name | None = Field(default=None, description="name of the material in 'materials'")


LinkConvex = Annotated[
    Convex | ByName[Convex] | None,
    Field(
        description="how collision meshes of links are made convex, for all or by link; default: "
        "from the robot file, else hull",
    ),
]


class MountEntry(Entry):
    """One robot fixed to the world; one of ``robot`` or ``urdf``."""

    robot: FilePath | None = Field(
        default=None,
        description="name of a robot of this package, path of a robot file, or name of an "
        "example-robot-data model",
    )
    urdf: FilePath | None = Field(
        default=None, description="path of a URDF, xacro file or MJCF, relative to the scene file"
    )
    package_dirs: Few[FilePath] = Field(
        default=[], description="folders with the packages of the URDF's package:// addresses"
    )
    srdf: FilePath | None = Field(
        default=None,
        description="path of its SRDF (groups, states, disabled collision pairs); default: one in "
        "the URDF's folder, or in a folder srdf next to that folder",
    )
    root_link: Name | None = Field(
        default=None,
        description="link to mount, with all links below it, such as the palm of a whole robot; "
        "default: from the robot file, else the root",
    )
    base_pose: PoseEntry = Field(
        default=PoseEntry(), description="pose of the robot's root link in the world"
    )
    fingers: ByName[FingerEntry] | None = Field(
        default=None,
        description="the fingers by name; default: from the robot file, else the branches below "
        "the palm",
    )
    visuals_collide: bool | None = Field(
        default=None,
        description="whether links without collision shapes use their visual shapes; default: from "
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

    @model_validator(mode="before")
    @classmethod
    def _refuse_mjcf_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and "mjcf" in data:
            raise ValueError("found mjcf; use the key 'urdf' for an MJCF, too")
        return data


class PrefixedMountEntry(MountEntry):
    """One of several robots: the prefix goes before the names of its joints, links, fingers."""

    prefix: Name = Field(
        description="prefix of the names of its joints, links and fingers, such as left/"
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_hand_keys(cls, data: Any) -> Any:
        of_all = HandEntry.model_fields.keys() - cls.model_fields.keys()
        if isinstance(data, dict) and (found := sorted(of_all & data.keys())):
            raise ValueError(
                f"found {' and '.join(found)}; write that beside 'mounts', not in one, with "
                "the prefix before names of joints and fingers"
            )
        return data


ModeName = Literal["force", "position", "hybrid"]


class HandEntry(MountEntry):
    """The hand: one robot, or several under ``mounts``."""

    mounts: Annotated[list[PrefixedMountEntry], Field(max_length=16)] = Field(
        default=[], description="several robots, each with a prefix, instead of robot or urdf"
    )
    group_states: Annotated[Few[Name], BeforeValidator(as_list)] = Field(
        default=[],
        description="one or more states of the SRDF, as GROUP/STATE or STATE: positions of joints "
        "that q does not give",
    )
    q: ByName[Finite] = Field(
        default={}, description="[rad, m] positions by joint name; other joints are at 0"
    )
    q_deg: ByName[Finite] = Field(
        default={}, description="[deg] positions of revolute joints by name, instead of q"
    )
    control: ModeName | ByName[ModeName] | None = Field(
        default=None,
        description="one control mode for all joints, or modes by finger or joint; default: force, "
        "and position for joints of an arm that carries the hand",
    )
    effort_limits: ByName[NotNegative | tuple[Signed, Signed]] = Field(
        default={},
        description="[N m, N] limits by joint, finger or tendon; a number x means -x to x, or 0 to "
        "x for a tendon that only pulls",
    )
    armature: NotNegative | ByName[NotNegative] | None = Field(
        default=None,
        description="[kg m^2, kg] inertia of the motors' rotors at the joints, times the gear "
        "ratio squared: one number, or by joint or finger; default: from the URDF",
    )
    hybrid_force_limit: Positive | None = Field(
        default=None,
        description="[N] largest commanded force of a hybrid finger; default: max_normal_force",
    )
    material: Name | None = Field(
        default=None, description="name of the material of all links in 'materials'"
    )
    count_own_weight: bool = Field(
        default=True,
        description="whether the torques g(q) of the links' weight count against the effort limits",
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
    def _refuse_empty_limits(cls, limits: Any) -> Any:
        named = limits.items() if isinstance(limits, dict) else ()
        if empty := [str(name) for name, value in named if value is None]:
            raise ValueError(
                f"is left empty for {', '.join(empty)}; fill in the most that each motor gives "
                "(N m, or N for a prismatic joint or tendon), as its data sheet says"
            )
        return limits
