"""The scene file's schema: what may stand in a YAML scene, with types, units and bounds.

Lengths are metres, angles radians, masses kilograms, torques newton metres. Unknown keys are
errors, so that a misspelt one is not silently ignored.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    AfterValidator,
    BaseModel,
    BeforeValidator,
    ConfigDict,
    Field,
    model_validator,
)

from graspless_pin.intake.fields import (
    ByName,
    Description,
    Few,
    FilePath,
    Finite,
    Friction,
    Length,
    Many,
    Name,
    NotNegative,
    Positive,
    Regularization,
    Seconds,
    Signed,
    no_truth_value,
)
from graspless_pin.magnitudes import MOST_CONE_EDGES


def _not_zero(vector: tuple[float, float, float]) -> tuple[float, float, float]:
    if not any(vector):
        raise ValueError(f"found {list(vector)}; needs a direction, so one of them not zero")
    return vector


ConeEdges = Annotated[int, Field(ge=3, le=MOST_CONE_EDGES), BeforeValidator(no_truth_value)]
PatchPoints = Annotated[int, Field(ge=3, le=64), BeforeValidator(no_truth_value)]
Vector = tuple[Finite, Finite, Finite]
Direction = Annotated[Vector, AfterValidator(_not_zero)]
Convex = Literal["hull", "decompose"]
LinkConvex = Annotated[
    Convex | ByName[Convex] | None,
    Field(
        description="how the links' collision meshes are made convex, for all or by link; default: "
        "as in the robot file, else hull",
    ),
]
DecomposeTimeLimit = Annotated[Seconds, Field(description="s that the cut of each mesh may take")]
Concavity = Annotated[
    float,
    Field(ge=0.01, le=1.0, description="coarseness of the cut"),
    BeforeValidator(no_truth_value),
]


class Entry(BaseModel):
    """A part of a scene; unknown keys are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True)


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


class FingerEntry(Entry):
    """A finger: its joints, and the links whose contacts are its own (default: all it moves)."""

    joints: Many[Name] = Field(min_length=1)
    links: Many[Name] = []
    tip: Name | None = None


class MountEntry(Entry):
    """One robot fixed to the world; one of ``robot`` or ``urdf``."""

    robot: FilePath | None = Field(
        default=None,
        description="a robot file of this package or by path, or an example-robot-data model",
    )
    urdf: FilePath | None = Field(
        default=None, description="path of a URDF, relative to the scene file"
    )
    package_dirs: Few[FilePath] = []
    base_pose: PoseEntry = PoseEntry()
    fingers: ByName[FingerEntry] | None = None
    convex: LinkConvex = None
    concavity: Concavity | None = None
    decompose_time_limit: DecomposeTimeLimit | None = None

    @model_validator(mode="after")
    def _one_source(self) -> MountEntry:
        if (self.robot is None) == (self.urdf is None):
            raise ValueError("needs either 'robot' (a name or robot file) or 'urdf' (a path)")
        return self


class PrefixedMountEntry(MountEntry):
    """One of several robots: the prefix goes before the names of its joints, links, fingers."""

    prefix: Name


ModeName = Literal["force", "position", "hybrid"]


class HandEntry(Entry):
    """The hand: one robot, or several under ``mounts``."""

    robot: FilePath | None = None
    urdf: FilePath | None = None
    package_dirs: Few[FilePath] = []
    base_pose: PoseEntry = PoseEntry()
    fingers: ByName[FingerEntry] | None = None
    convex: LinkConvex = None
    concavity: Concavity | None = None
    decompose_time_limit: DecomposeTimeLimit | None = None
    mounts: Annotated[list[PrefixedMountEntry], Field(max_length=16)] = []
    q: ByName[Finite] = Field(default={}, description="rad or m by joint name")
    control: ModeName | ByName[ModeName] | None = Field(
        default=None,
        description="one mode for all joints, or modes by finger or joint; default: force, and "
        "position for the joints of an arm that carries the hand",
    )
    effort_limits: ByName[NotNegative | tuple[Signed, Signed]] = Field(
        default={},
        description="N m, or N for linear joints, by joint or finger; a number means -x to x",
    )
    hybrid_force_limit: Positive | None = Field(
        default=None,
        description="largest commanded force of a hybrid finger, N; default max_normal_force",
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
        single = {
            "package_dirs",
            "base_pose",
            "fingers",
            "convex",
            "concavity",
            "decompose_time_limit",
        }
        of_one = sorted(single & self.model_fields_set)
        if self.mounts and of_one:
            raise ValueError(
                f"found mounts and {' and '.join(of_one)}; with several robots each entry of "
                "'mounts' has its own"
            )
        return self

    def mount_entries(self) -> list[tuple[str, MountEntry]]:
        """The robots with their prefixes."""
        if self.mounts:
            return [(mount.prefix, mount) for mount in self.mounts]
        single = MountEntry(
            robot=self.robot,
            urdf=self.urdf,
            package_dirs=self.package_dirs,
            base_pose=self.base_pose,
            fingers=self.fingers,
            convex=self.convex,
            concavity=self.concavity,
            decompose_time_limit=self.decompose_time_limit,
        )
        return [("", single)]


class ObjectEntry(Entry):
    """The manipulated object, with its mass or its density."""

    name: Name = "object"
    shape: SolidEntry
    mass: Positive | None = Field(default=None, description="kg; or density")
    density: Positive | None = Field(default=None, description="kg/m^3; or mass")
    center_of_mass: Vector | None = Field(
        default=None, description="in the object's frame, m; default: the centroid of the shape"
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


class ContactEntry(Entry):
    """A given contact: what touches the object (a hand link or support), where, and the normal."""

    body: Name
    position: Vector = Field(description="world frame, m")
    normal: Direction = Field(description="into the object, world axes; any length")


class HandMotionEntry(Entry):
    """The hand's own motion; without it, its contacts follow the object and stick."""

    base_twist: TwistEntry = TwistEntry()
    joint_velocities: ByName[Finite] = {}


class MotionEntry(Entry):
    """The declared motion: the object's twist about its centre of mass, and the hand's own."""

    object_twist: TwistEntry
    hand: HandMotionEntry | None = None


class SolveEntry(Entry):
    """What to solve, unless the caller says otherwise."""

    algorithm: Literal["margin", "torque"] = "margin"
    margin: NotNegative = Field(default=0.1, description="required margin e_0 of Algorithm 2, N")
    scale: Literal["absolute", "limits"] = "absolute"
    sign_rule: Literal["strict", "exact", "nonzero"] = "strict"
    sliding_rule: Literal["exempt", "constrained"] = "exempt"
    static_friction: Literal["virtual_sliding", "coulomb"] = "virtual_sliding"
    solver: Name = "piqp"
    regularization: Regularization = 0.0


class SceneEntry(Entry):
    """A whole scene."""

    name: Name = ""
    description: Description = ""
    gravity: Vector = (0.0, 0.0, -9.81)
    hand: HandEntry | None = None
    object: ObjectEntry
    supports: Few[SupportEntry] = []
    friction: Friction | ByName[Friction] = Field(
        description="one coefficient, or by hand link, support, 'hand', 'supports' and 'default'"
    )
    materials: Annotated[dict[Name, ByName[Friction]], Field(max_length=1000)] = Field(
        default={}, description="coefficient per pair of materials, e.g. {rubber: {steel: 0.6}}"
    )
    contacts: Many[ContactEntry] | None = Field(
        default=None, description="given contacts; without this key they are found from the shapes"
    )
    motion: MotionEntry | None = None
    max_normal_force: Positive = Field(default=50.0, description="N")
    cone_edges: ConeEdges = 32
    contact_tolerance: Length = Field(default=1e-3, description="m")
    points_per_patch: PatchPoints = Field(
        default=8, description="most contacts that stand for one face on a face"
    )
    tangent_axes: Few[Direction] = Field(
        default=[],
        description="t1 is the projection of the first of these axes that is not along the normal",
    )
    solve: SolveEntry = SolveEntry()


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file."""
    document = SceneEntry.model_json_schema()
    document["$defs"]["ObjectEntry"]["oneOf"] = [{"required": ["mass"]}, {"required": ["density"]}]
    return document
