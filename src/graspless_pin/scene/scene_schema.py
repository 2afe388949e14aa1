"""The scene file's schema: what may stand in a YAML scene, with types, units and bounds.

Lengths are metres, angles radians, masses kilograms, torques newton metres. Unknown keys are
errors, so that a misspelt one is not silently ignored.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import (
    BeforeValidator,
    Field,
)

from graspless_pin.holding.stability import NODE_LIMIT
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
    no_truth_value,
)
from graspless_pin.magnitudes import MOST_CONE_EDGES
from graspless_pin.scene.body_schema import Direction, ObjectEntry, SupportEntry, TwistEntry, Vector
from graspless_pin.scene.hand_schema import HandEntry

ConeEdges = Annotated[int, Field(ge=3, le=MOST_CONE_EDGES), BeforeValidator(no_truth_value)]
NodeLimit = Annotated[int, Field(ge=1), BeforeValidator(no_truth_value)]
PatchPoints = Annotated[int, Field(ge=3, le=64), BeforeValidator(no_truth_value)]


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
    sign_rule: Literal["strict", "exact", "nonzero", "direction"] = "strict"
    sliding_rule: Literal["exempt", "constrained"] = "exempt"
    static_friction: Literal["virtual_sliding", "coulomb"] = "virtual_sliding"
    solver: Name = "auto"
    regularization: Regularization = 0.0
    search: Literal["auto", "enumerate"] = "auto"
    node_limit: NodeLimit | None = Field(default=None, description="nodes of the search; no limit")
    time_limit: NotNegative | None = Field(default=None, description="s; no limit")
    direction_gap: Positive = Field(
        default=1e-4, ge=1e-6, description="relative gap of sign_rule: direction"
    )
    stability: Literal["weak", "strong"] = Field(
        default="weak", description="strong: torques of which rest is the only outcome"
    )
    verdict_nodes: NodeLimit = Field(
        default=NODE_LIMIT, description="sets of outcomes that each verdict may look at"
    )


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
    cone: Literal["edges", "round"] = Field(
        default="edges", description="pyramids of cone_edges edges, or Coulomb's round cones"
    )
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
