"""The schema of YAML scene files: keys with types, units and bounds.

Lengths are metres, angles radians, masses kilograms, torques newton metres. Unknown keys are
errors, so that a misspelt one is not silently ignored.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar

from pydantic import BeforeValidator, Field, create_model, model_validator

from graspless_pin.algorithms.options import AIMS, OBJECTIVES, figure_types
from graspless_pin.bounds import MOST_CONE_EDGES
from graspless_pin.errors import SceneError
from graspless_pin.holding.controller import DAMPING
from graspless_pin.holding.verdict import NODE_LIMIT
from graspless_pin.intake.fields import (
    ByName,
    Description,
    Entry,
    Few,
    Finite,
    Friction,
    Length,
    Many,
    Name,
    NotNegative,
    Positive,
    Regularization,
    Share,
    no_truth_value,
)
from graspless_pin.intake.files import FileKind
from graspless_pin.problem.cones import CONE_MODELS
from graspless_pin.scene.body_schema import (
    Direction,
    HandEntry,
    ObjectEntry,
    SupportEntry,
    TwistEntry,
    Vector,
)
from graspless_pin.scene.units import si_advice

SCENE = FileKind("scene", 4, SceneError, si_advice)
ConeEdges = Annotated[int, Field(ge=3, le=MOST_CONE_EDGES), BeforeValidator(no_truth_value)]
if TYPE_CHECKING:
    AlgorithmName = ConeName = str
else:
    AlgorithmName = Literal[tuple(OBJECTIVES)]
    ConeName = Literal[tuple(CONE_MODELS)]
NodeLimit = Annotated[int, Field(ge=1), BeforeValidator(no_truth_value)]
PatchPoints = Annotated[int, Field(ge=3, le=64), BeforeValidator(no_truth_value)]


class ContactEntry(Entry):
    """A given contact: what touches the object (a hand link or support), where, and the normal."""

    body: Name = Field(description="the hand's link or the support that touches the object")
    position: Vector = Field(description="[m] position of the contact in the world")
    normal: Direction = Field(
        description="[1] normal that points into the object, world axes; of any length"
    )


class HandMotionEntry(Entry):
    """The hand's own motion; without it, its contacts follow the object and stick."""

    base_twist: TwistEntry = Field(default=TwistEntry(), description="twist of the hand's base")
    joint_velocities: ByName[Finite] = Field(
        default={}, description="[rad/s, m/s] velocities by joint name; other joints do not move"
    )


class MotionEntry(Entry):
    """The declared motion: the object's twist about its centre of mass, and the hand's own."""

    object_twist: TwistEntry = Field(description="twist of the object about its centre of mass")
    hand: HandMotionEntry | None = Field(
        default=None,
        description="motion of the hand; default: its contacts move with the object and stick",
    )


class LoadEntry(Entry):
    """Something that bears on the object: a force and moment, a payload, a field."""

    name: Name = Field(description="name, unique among the loads")
    force: Vector = Field(default=(0.0, 0.0, 0.0), description="[N] force at the point")
    moment: Vector = Field(default=(0.0, 0.0, 0.0), description="[N m] moment on the object")
    mass: NotNegative = Field(
        default=0.0, description="[kg] mass of a payload at the point; it adds weight and inertia"
    )
    field: Vector = Field(
        default=(0.0, 0.0, 0.0),
        description="[m/s^2] acceleration of a field that acts on the mass of object and payloads "
        "in addition to gravity, world axes",
    )
    at: Vector | None = Field(
        default=None,
        description="[m] the point in the object's frame; default: the object's centre of mass",
    )
    axes: Literal["world", "object"] = Field(
        default="world", description="axes of force and moment; object: they turn with the object"
    )

    @model_validator(mode="after")
    def _refuse_empty(self) -> LoadEntry:
        if not self.model_fields_set & {"force", "moment", "mass", "field"}:
            raise ValueError("found none of 'force', 'moment', 'mass' and 'field'; needs one")
        return self


class AccelerationEntry(Entry):
    """How object and hand accelerate: the moment at which an arm starts, turns or stops."""

    linear: Vector = Field(
        default=(0.0, 0.0, 0.0), description="[m/s^2] linear acceleration of the point, world axes"
    )
    angular: Vector = Field(
        default=(0.0, 0.0, 0.0), description="[rad/s^2] angular acceleration, world axes"
    )
    angular_velocity: Vector = Field(
        default=(0.0, 0.0, 0.0), description="[rad/s] angular velocity, world axes"
    )
    at: Vector | None = Field(
        default=None,
        description="[m] the point in the world; default: the object's centre of mass",
    )
    joint_velocities: ByName[Finite] = Field(
        default={},
        description="[rad/s, m/s] velocities by joint name; the object moves with the links",
    )
    joint_accelerations: ByName[Finite] = Field(
        default={}, description="[rad/s^2, m/s^2] accelerations by joint name"
    )
    of: Literal["base", "object"] = Field(
        default="base",
        description="what accelerates; base: the hand's base, with hand, object and supports as "
        "one body; object: the object alone",
    )

    @model_validator(mode="after")
    def _refuse_empty(self) -> AccelerationEntry:
        if self.model_fields_set <= {"of", "at"}:
            raise ValueError(
                "found only 'of' and 'at'; needs at least one of 'linear', 'angular', "
                "'angular_velocity', 'joint_velocities', 'joint_accelerations'"
            )
        return self


_Entry = TypeVar("_Entry", bound=Entry)


def with_figures(entry: type[_Entry]) -> type[_Entry]:
    """Return an entry class with a key added for each objective's figure that it does not have."""
    missing: dict[str, Any] = {
        key: (kind | None, None)
        for key, kind in figure_types().items()
        if key not in entry.model_fields
    }
    if not missing:  # a second model of the same keys would take as long to make
        return entry
    return create_model(
        entry.__name__,
        __base__=entry,
        __doc__=entry.__doc__,
        __module__=entry.__module__,
        **missing,
    )


@with_figures
class SolveEntry(Entry):
    """What to solve, unless the caller says otherwise."""

    algorithm: AlgorithmName = Field(default="margin", description=AIMS)
    margin: NotNegative = Field(default=0.1, description="[N] required margin e_0 of Algorithm 2")
    scale: Literal["absolute", "limits"] = Field(
        default="absolute",
        description="objective of Algorithm 2: the largest torque, or the largest share of the "
        "effort limits",
    )
    sign_rule: Literal["strict", "exact", "nonzero", "direction"] = Field(
        default="strict", description="which virtual slidings of a selected contact count"
    )
    sliding_rule: Literal["exempt", "constrained"] = Field(
        default="exempt",
        description="whether contacts that slide in the declared motion constrain virtual motions",
    )
    static_friction: Literal["virtual_sliding", "coulomb"] = Field(
        default="virtual_sliding",
        description="coulomb: all forces inside the cones are admissible; no virtual sliding",
    )
    solver: Name = Field(default="auto", description="auto, or the name of an installed solver")
    regularization: Regularization = Field(
        default=0.0,
        description="[1] weight of the sum of squared forces, which makes forces small and evenly "
        "distributed",
    )
    search: Literal["auto", "enumerate"] = Field(
        default="auto",
        description="enumerate: solve all maximal modes instead of branch and bound",
    )
    node_limit: NodeLimit | None = Field(
        default=None, description="node limit of the search; default: no limit"
    )
    time_limit: NotNegative | None = Field(
        default=None, description="[s] time limit; default: no limit"
    )
    direction_gap: Positive = Field(
        default=1e-4,
        ge=1e-6,
        description="[1] relative gap at which the search of sign_rule: direction ends",
    )
    stability: Literal["weak", "strong"] = Field(
        default="weak", description="strong: torques under which rest is the only outcome"
    )
    verdict_nodes: NodeLimit = Field(
        default=NODE_LIMIT, description="node limit (sets of outcomes) of each verdict"
    )


FeedbackName = Literal["any", "torque", "position"]


class ControllerEntry(Entry):
    """What runs on the robot's joints beside the torques: position feedback."""

    stiffness: FeedbackName | NotNegative | ByName[NotNegative] = Field(
        default="any",
        description="[N m/rad] stiffness of all joints, or by joint (N/m if prismatic), finger or "
        "'default'; unless given by joint, it is divided by (0.1 m)^2 for prismatic "
        "joints; torque: constant torques; position: joints keep their positions; any: "
        "verdicts tell the smallest stiffness that is needed",
    )
    damping: NotNegative | ByName[NotNegative] = Field(
        default=DAMPING,
        description="[N m s/rad] damping, given like the stiffness, including that of joints and "
        "motors themselves",
    )


Widths = NotNegative | tuple[NotNegative, NotNegative, NotNegative]
Figures = NotNegative | ByName[NotNegative]
Shares = Share | ByName[Share]


class UncertaintyEntry(Entry):
    """What is not known exactly, each by itself: `solve` finds torques for the whole set.

    The stiffness that adds to torques is that of the controller.
    """

    mass: Share = Field(
        default=0.0, description="[1] share by which the object's mass may be smaller or larger"
    )
    mass_offset: NotNegative = Field(
        default=0.0,
        description="[kg] by which the object's mass may be smaller or larger, in addition to that "
        "share",
    )
    center_of_mass: Widths = Field(
        default=0.0,
        description="[m] how far the centre of mass may be off along each axis of the object",
    )
    tilt: NotNegative = Field(
        default=0.0,
        description="[rad] how far the direction of gravity may be off, to all sides; below pi/4",
    )
    force: Widths = Field(
        default=0.0,
        description="[N] force that may act at the centre of mass along each world axis, in both "
        "directions",
    )
    moment: Widths = Field(
        default=0.0,
        description="[N m] moment that may act about each world axis, in both directions",
    )
    center_of_mass_radius: NotNegative = Field(
        default=0.0,
        description="[m] how far the centre of mass may be off in any direction, in addition to "
        "center_of_mass",
    )
    force_radius: NotNegative = Field(
        default=0.0,
        description="[N] force that may act at the centre of mass in any direction, in addition to "
        "force",
    )
    moment_radius: NotNegative = Field(
        default=0.0, description="[N m] moment that may act about any axis, in addition to moment"
    )
    contact_position: Figures = Field(
        default=0.0,
        description="[m] how far contacts may be off within their tangent planes: one number, or "
        "by hand link, support, 'hand', 'supports', 'default'; these deviations are "
        "sampled",
    )
    friction: Share | ByName[Share | ByName[Share]] = Field(
        default=0.0,
        description="[1] share by which coefficients of friction may be smaller or larger: one "
        "number, or by hand link, support, material, pair of materials, e.g. {rubber: "
        "{steel: 0.1}}, 'hand', 'supports', 'default'; other coefficients are exact",
    )
    torque: Shares = Field(
        default=0.0,
        description="[1] share by which joint torques may be smaller or larger than commanded: one "
        "number, or by joint, finger or 'default'",
    )
    torque_offset: Figures = Field(
        default=0.0,
        description="[N m] (N if prismatic) by which each joint's torque may be smaller or larger: "
        "one number, or by joint, finger or 'default'",
    )
    effort: Shares = Field(
        default=0.0,
        description="[1] share by which effort limits may be smaller: one number, or by joint, "
        "finger or 'default'",
    )

    @model_validator(mode="before")
    @classmethod
    def _refuse_feedback_key(cls, data: Any) -> Any:
        if isinstance(data, dict) and "feedback" in data:
            raise ValueError(
                "found feedback; the stiffness that adds to the torques is that of the scene's key "
                "'controller'"
            )
        return data


class SceneEntry(Entry):
    """A whole scene."""

    name: Name = Field(default="", description="title of printed results")
    description: Description = Field(
        default="", description="text for readers of the file and the report"
    )
    gravity: Vector = Field(default=(0.0, 0.0, -9.81), description="[m/s^2] gravity, world axes")
    hand: HandEntry | None = Field(
        default=None, description="the hand; default: supports alone hold the object"
    )
    object: ObjectEntry = Field(description="the manipulated object")
    supports: Few[SupportEntry] = Field(
        default=[], description="bodies that the object may touch besides the hand"
    )
    friction: Friction | ByName[Friction] = Field(
        description="[1] one coefficient of friction, or by hand link, support, 'hand', "
        "'supports', 'default'"
    )
    materials: Annotated[dict[Name, ByName[Friction]], Field(max_length=1000)] = Field(
        default={},
        description="[1] coefficient of friction by pair of materials: {rubber: {steel: 0.6}}",
    )
    contacts: Many[ContactEntry] | None = Field(
        default=None, description="given contacts; without this key they are found from the shapes"
    )
    motion: MotionEntry | None = Field(
        default=None, description="the declared slow motion; default: everything is at rest"
    )
    loads: Few[LoadEntry] = Field(
        default=[], description="loads on the object in addition to gravity"
    )
    acceleration: AccelerationEntry | None = Field(
        default=None,
        description="acceleration of object and hand, for inertial forces; default: none",
    )
    max_normal_force: Positive = Field(
        default=50.0, description="[N] largest admissible normal force of a contact"
    )
    cone_edges: ConeEdges = Field(
        default=32,
        description="number of edges of the pyramid that approximates each friction cone",
    )
    cone: ConeName = Field(
        default="edges",
        description="; ".join(f"{name}: {model.about}" for name, model in CONE_MODELS.items()),
    )
    contact_tolerance: Length = Field(
        default=1e-3, description="[m] largest gap that counts as contact"
    )
    max_penetration: Length = Field(
        default=5e-3, description="[m] deepest overlap that counts as contact"
    )
    points_per_patch: PatchPoints = Field(
        default=8, description="largest number of contact points for a face on a face"
    )
    tangent_axes: Few[Direction] = Field(
        default=[],
        description="[1] t1 is the projection of the first of these axes that is not parallel to "
        "the normal",
    )
    warnings: Literal["show", "error"] = Field(
        default="show", description="error: findings on the scene are errors"
    )
    controller: FeedbackName | NotNegative | ControllerEntry = Field(
        default="any",
        description="[N m/rad] position feedback at the joints that adds to the torques: the "
        "stiffness of all joints, gains, or a word as for the stiffness",
    )
    uncertainty: UncertaintyEntry | None = Field(
        default=None, description="what is not known exactly; default: everything is known"
    )
    solve: SolveEntry = Field(default=SolveEntry(), description="algorithm and options of `solve`")


PLAIN_FIGURES = (
    "max_normal_force", "cone_edges", "cone", "contact_tolerance", "max_penetration",
    "points_per_patch",
)  # fmt: skip
"""Keys whose values are taken as fields of a scene without conversion."""


def scene_json_schema() -> dict[str, Any]:
    """Return the JSON schema of a scene file.

    Examples:
        >>> from graspless_pin.scene import scene_json_schema
        >>> scene_json_schema()["required"]
        ['object', 'friction']
    """
    document = SceneEntry.model_json_schema()
    document["$defs"]["ObjectEntry"]["oneOf"] = [{"required": ["mass"]}, {"required": ["density"]}]
    return document
