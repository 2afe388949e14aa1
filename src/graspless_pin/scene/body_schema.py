"""What may stand in a scene file for poses, shapes, the object and its supports."""

from __future__ import annotations

from typing import Annotated, Literal, Union

from pydantic import AfterValidator, Field, GetPydanticSchema, model_validator

from graspless_pin.geometry.bodies.shapes import SHAPES, HalfSpace
from graspless_pin.intake.fields import (
    Entry,
    Finite,
    Friction,
    Many,
    Name,
    Positive,
)


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError(f"found {list(vector)}; needs a direction, so one of them not zero")
    return vector


Vector = tuple[Finite, Finite, Finite]
Moments = tuple[Positive, Positive, Positive]
Direction = Annotated[Vector, AfterValidator(_not_zero)]

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


def _one_of(*entries: type[Entry]) -> GetPydanticSchema:
    several = Annotated[Union[*entries], Field(discriminator="type")]
    return GetPydanticSchema(lambda _, handler: handler(several))


_SOLIDS = tuple(one.entry() for one in SHAPES.values() if one is not HalfSpace)


class PartEntry(Entry):
    """A part of a compound: a shape, and where it is."""

    shape: Annotated[Entry, _one_of(*_SOLIDS)] = Field(
        description="one of the shapes below, but for a half-space and a compound"
    )
    pose: PoseEntry = Field(
        default=PoseEntry(), description="of the shape's frame in that of the compound"
    )


class CompoundEntry(Entry):
    """Several shapes as one body."""

    type: Literal["compound"] = Field(description="says that it is a compound")
    parts: Annotated[Many[PartEntry], Field(min_length=1)] = Field(
        description="at least one; where parts overlap, both count for volume and inertia"
    )


SolidEntry = Annotated[Entry, _one_of(*_SOLIDS, CompoundEntry)]
ShapeEntry = Annotated[Entry, _one_of(*_SOLIDS, CompoundEntry, HalfSpace.entry())]


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
