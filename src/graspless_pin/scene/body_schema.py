"""What may stand in a scene file for poses, shapes, the object and its supports."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from graspless_pin.geometry.robots.robot_schema import Convex, MaxPieces
from graspless_pin.intake.fields import (
    Entry,
    FilePath,
    Finite,
    Friction,
    Length,
    Name,
    Positive,
    Seconds,
    no_truth_value,
)


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError(f"found {list(vector)}; needs a direction, so one of them not zero")
    return vector


Vector = tuple[Finite, Finite, Finite]
Moments = tuple[Positive, Positive, Positive]
Direction = Annotated[Vector, AfterValidator(_not_zero)]
DecomposeTimeLimit = Annotated[
    Seconds, Field(description="[s] time that the cut of each mesh may take")
]
Concavity = Annotated[
    float,
    Field(
        ge=0.01,
        le=1.0,
        description="[1] coarseness of the cut into convex pieces: smaller is finer",
    ),
    BeforeValidator(no_truth_value),
]


ROTATION_FORMS = ("rpy", "rpy_deg", "quaternion", "matrix")
"""Keys of a pose that say how it is turned, one of which may stand."""


class PoseEntry(Entry):
    """A pose: where the frame's origin is, and at most one form of its rotation."""

    position: Vector = Field(default=(0.0, 0.0, 0.0), description="[m] of the frame's origin")
    rpy: Vector | None = Field(
        default=None,
        description="[rad] roll, pitch, yaw, R = Rz(yaw) Ry(pitch) Rx(roll) as in URDF",
    )
    rpy_deg: Vector | None = Field(default=None, description="[deg] the same in degrees")
    quaternion: tuple[Finite, Finite, Finite, Finite] | None = Field(
        default=None, description="[1] x, y, z, w"
    )
    matrix: tuple[Vector, Vector, Vector] | None = Field(
        default=None, description="[1] rows of the rotation matrix R"
    )

    @model_validator(mode="after")
    def _one_rotation(self) -> PoseEntry:
        forms = [name for name in ROTATION_FORMS if getattr(self, name)]
        if len(forms) > 1:
            raise ValueError(f"found {' and '.join(forms)}; give one form of the rotation")
        return self


class BoxEntry(Entry):
    """A box with full edge lengths."""

    type: Literal["box"] = Field(description="says that it is a box")
    size: tuple[Length, Length, Length] = Field(description="[m] full edge lengths along x, y, z")


class SphereEntry(Entry):
    """A sphere."""

    type: Literal["sphere"] = Field(description="says that it is a sphere")
    radius: Length = Field(description="[m] from the origin of its frame")


class CylinderEntry(Entry):
    """A cylinder along z, its full height."""

    type: Literal["cylinder"] = Field(description="says that it is a cylinder")
    radius: Length = Field(description="[m] about z")
    length: Length = Field(description="[m] full height, half of it on each side of the origin")


class CapsuleEntry(Entry):
    """A capsule along z; the length is the cylinder's without its ends."""

    type: Literal["capsule"] = Field(description="says that it is a capsule")
    radius: Length = Field(description="[m] of the cylinder and of its round ends")
    length: Length = Field(description="[m] of the cylinder, without its ends")


class ConeEntry(Entry):
    """A cone, tip up along z."""

    type: Literal["cone"] = Field(description="says that it is a cone")
    radius: Length = Field(description="[m] of the base")
    length: Length = Field(description="[m] from the base to the tip, the origin in its middle")


class MeshEntry(Entry):
    """A mesh file, as its convex hull or cut into convex pieces; relative to the scene file."""

    type: Literal["mesh"] = Field(description="says that it is a mesh")
    path: FilePath = Field(description="STL, OBJ, DAE or PLY file")
    scale: Length | tuple[Length, Length, Length] = Field(
        default=1.0,
        description="[m] length of one unit of the file: 0.001 for millimetres; a DAE that states "
        "its unit is in metres already, and its axis that is up becomes z",
    )
    convex: Convex = Field(
        default="hull",
        description="hull: its convex hull; decompose: convex pieces of a non-convex mesh, cached",
    )
    concavity: Concavity = 0.02
    decompose_time_limit: DecomposeTimeLimit = 60.0
    max_pieces: MaxPieces | None = None


class HalfSpaceEntry(Entry):
    """Everything at z <= 0 of its frame: a floor, table or slope."""

    type: Literal["half_space"] = Field(description="says that it is a half-space")


SolidEntry = Annotated[
    BoxEntry | SphereEntry | CylinderEntry | CapsuleEntry | ConeEntry | MeshEntry,
    Field(discriminator="type"),
]
ShapeEntry = Annotated[
    BoxEntry | SphereEntry | CylinderEntry | CapsuleEntry | ConeEntry | MeshEntry | HalfSpaceEntry,
    Field(discriminator="type"),
]


class ObjectEntry(Entry):
    """The manipulated object, with its mass or its density."""

    name: Name = Field(default="object", description="how results call it")
    shape: SolidEntry = Field(description="one of the shapes below, but for a half-space")
    mass: Positive | None = Field(default=None, description="[kg] or give density")
    density: Positive | None = Field(default=None, description="[kg/m^3] or give mass")
    center_of_mass: Vector | None = Field(
        default=None, description="[m] in the object's frame; default: the centroid of the shape"
    )
    inertia: Moments | tuple[Vector, Vector, Vector] | None = Field(
        default=None,
        description="[kg m^2] about the centre of mass, the object's axes: three moments, or the "
        "rows of the matrix; default: that of the shape filled evenly with the mass",
    )
    material: Name | None = Field(default=None, description="its name in materials")
    pose: PoseEntry = Field(default=PoseEntry(), description="of the object's frame in the world")

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

    name: Name = Field(description="unique among the supports")
    shape: ShapeEntry = Field(description="one of the shapes below")
    pose: PoseEntry = Field(default=PoseEntry(), description="of the shape's frame in the world")
    friction: Friction | None = Field(
        default=None, description="[1] coefficient to the object; default: as friction says"
    )
    velocity: TwistEntry = Field(
        default=TwistEntry(),
        description="of the support frame's origin: a conveyor, a turntable",
    )
    material: Name | None = Field(default=None, description="its name in materials")
