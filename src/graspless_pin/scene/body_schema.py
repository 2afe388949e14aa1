"""What may stand in a scene file for poses, shapes, the object and its supports."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import AfterValidator, BeforeValidator, Field, model_validator

from graspless_pin.geometry.robots.robot_schema import Convex
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
DecomposeTimeLimit = Annotated[Seconds, Field(description="s that the cut of each mesh may take")]
Concavity = Annotated[
    float,
    Field(ge=0.01, le=1.0, description="coarseness of the cut"),
    BeforeValidator(no_truth_value),
]


class PoseEntry(Entry):
    """A pose: where the frame's origin is, and at most one form of its rotation."""

    position: Vector = (0.0, 0.0, 0.0)
    rpy: Vector | None = Field(
        default=None,
        description="roll, pitch, yaw in radians, R = Rz(yaw) Ry(pitch) Rx(roll) as in URDF",
    )
    quaternion: tuple[Finite, Finite, Finite, Finite] | None = Field(
        default=None, description="x, y, z, w"
    )
    matrix: tuple[Vector, Vector, Vector] | None = Field(default=None, description="rows of R")

    @model_validator(mode="after")
    def _one_rotation(self) -> PoseEntry:
        forms = [name for name in ("rpy", "quaternion", "matrix") if getattr(self, name)]
        if len(forms) > 1:
            raise ValueError(f"found {' and '.join(forms)}; give one form of the rotation")
        return self


class BoxEntry(Entry):
    """A box with full edge lengths."""

    type: Literal["box"]
    size: tuple[Length, Length, Length]


class SphereEntry(Entry):
    """A sphere."""

    type: Literal["sphere"]
    radius: Length


class CylinderEntry(Entry):
    """A cylinder along z, its full height."""

    type: Literal["cylinder"]
    radius: Length
    length: Length


class CapsuleEntry(Entry):
    """A capsule along z; the length is the cylinder's without its ends."""

    type: Literal["capsule"]
    radius: Length
    length: Length


class ConeEntry(Entry):
    """A cone, tip up along z."""

    type: Literal["cone"]
    radius: Length
    length: Length


class MeshEntry(Entry):
    """A mesh file, as its convex hull or cut into convex pieces; relative to the scene file."""

    type: Literal["mesh"]
    path: FilePath
    scale: Length | tuple[Length, Length, Length] = 1.0
    convex: Convex = Field(
        default="hull", description="decompose: cut a non-convex mesh into convex pieces, cached"
    )
    concavity: Concavity = 0.02
    decompose_time_limit: DecomposeTimeLimit = 60.0


class HalfSpaceEntry(Entry):
    """Everything at z <= 0 of its frame: a floor, table or slope."""

    type: Literal["half_space"]


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

    name: Name = "object"
    shape: SolidEntry
    mass: Positive | None = Field(default=None, description="kg; or density")
    density: Positive | None = Field(default=None, description="kg/m^3; or mass")
    center_of_mass: Vector | None = Field(
        default=None, description="in the object's frame, m; default: the centroid of the shape"
    )
    inertia: Moments | tuple[Vector, Vector, Vector] | None = Field(
        default=None,
        description="kg m^2 about the centre of mass, the object's axes: three moments, or the "
        "rows of the matrix; default: that of the shape filled evenly with the mass",
    )
    material: Name | None = None
    pose: PoseEntry = PoseEntry()

    @model_validator(mode="after")
    def _mass_or_density(self) -> ObjectEntry:
        if (self.mass is None) == (self.density is None):
            found = "neither" if self.mass is None else "both"
            raise ValueError(f"found {found} of 'mass' (kg) and 'density' (kg/m^3); needs one")
        return self


class TwistEntry(Entry):
    """A velocity: linear (m/s) and angular (rad/s), world axes."""

    linear: Vector = (0.0, 0.0, 0.0)
    angular: Vector = (0.0, 0.0, 0.0)


class SupportEntry(Entry):
    """Something that the object may touch: fixed, or moving with a velocity of its own."""

    name: Name
    shape: ShapeEntry
    pose: PoseEntry = PoseEntry()
    friction: Friction | None = None
    velocity: TwistEntry = Field(
        default=TwistEntry(),
        description="about the support frame's origin: a conveyor, a turntable",
    )
    material: Name | None = None
