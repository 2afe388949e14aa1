"""The schema of study files: a scene, its variables, the sampling and the computation.

The hand may be placed at the object, or closed on it, in each sample.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BeforeValidator, Field, model_validator

from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT
from graspless_pin.intake.fields import (
    ByName,
    Count,
    Description,
    Entry,
    Few,
    FilePath,
    Finite,
    Halvings,
    Name,
    NotNegative,
    Regularization,
    Seconds,
    Signed,
    Whole,
    as_list,
)
from graspless_pin.scene.body_schema import Direction, Vector
from graspless_pin.scene.scene_schema import AlgorithmName, SolveEntry, with_figures

Fingers = Annotated[
    Few[Name] | None,
    BeforeValidator(as_list),
    Field(description="fingers that close; default: all"),
]


class PlaceEntry(Entry):
    """How the hand is placed, as `place_hand` does it, and which of its places is computed."""

    rank: Count = Field(default=1, description="rank of the place that is computed; 1: the best")
    seed: Whole = Field(default=0, description="seed of all random choices")
    candidates: Count = Field(default=600, description="number of candidates that are tried")
    approach: Direction | None = Field(
        default=None,
        description="[1] direction in which the palm approaches, world axes; default: all",
    )
    point: Vector | None = Field(
        default=None,
        description="[m] target of the palm, world axes; default: points inside the object",
    )
    fingers: Fingers = None
    margin: NotNegative | None = Field(
        default=None, description="[N] margin that a place must have; default: the scene's, or 0.1"
    )
    aim: Literal["grip", "carry", "press"] = Field(
        default="grip",
        description="grip: places that squeeze the object; carry: only grips that carry it without "
        "its supports; press: all places that hold it",
    )
    together: bool = Field(default=False, description="whether all mounts move as one body")
    move_base: bool = Field(
        default=False, description="whether the bases of arms move, instead of their joints"
    )
    verdict_nodes: Whole = Field(
        default=BRIEF_NODE_LIMIT,
        description="node limit (sets of outcomes) of each verdict; 0: no verdicts",
    )
    verdicts: Whole | None = Field(
        default=5, description="number of the best places that get a verdict; null: all"
    )


class CloseEntry(Entry):
    """How fingers close until they touch, from the configuration of the sample's scene."""

    fingers: Fingers = None
    wrap: bool = Field(
        default=False, description="whether joints beyond a link that touches continue to close"
    )
    rates: ByName[Finite] = Field(
        default={},
        description="[1] speed by joint, relative to 1 of the others; its sign is the direction",
    )


class PosingEntry(Entry):
    """Where the hand of each sample goes before it is computed."""

    place: PlaceEntry | None = Field(
        default=None, description="places the hand at the object of each sample"
    )
    close: CloseEntry | None = Field(default=None, description="closes the fingers in each sample")

    @model_validator(mode="after")
    def _not_place_and_close(self) -> PosingEntry:
        if self.place is not None and self.close is not None:
            raise ValueError(
                "found place and close; place closes the fingers, too: leave out 'close'"
            )
        return self


_COUNTS = ("count", "number", "num", "n", "points", "samples")
_AS_SOLVE = "as in the scene's solve"
Scalar = bool | int | float | str
What = Annotated[
    Few[Name],
    BeforeValidator(as_list),
    Field(
        min_length=1,
        description="object, hand, a support or a mount's prefix; for a turn also gravity, "
        "tangent_axes, motion, loads, acceleration; all: all bodies, tangent_axes and motion",
    ),
]


class SetEntry(Entry):
    """A scene key that gets factor * value + offset, in SI units."""

    key: Name = Field(description="the scene key, its levels joined by dots")
    factor: Signed = Field(default=1.0, description="[1] factor on the value")
    offset: Signed = Field(default=0.0, description="[SI] added to factor * value")


class TurnEntry(Entry):
    """Turns bodies by the value about an axis through a point."""

    what: What
    axis: Direction = Field(description="[1] direction, of any length")
    point: Vector = Field(default=(0.0, 0.0, 0.0), description="[m] a point on the axis")
    frame: Name | None = Field(
        default=None, description="body in whose frame axis and point are given; default: the world"
    )
    as_in_scene: Finite = Field(
        default=0.0,
        description="[rad, m] the value to which the poses in the scene file correspond",
    )


class MoveEntry(Entry):
    """Moves bodies by the value along a direction."""

    what: What
    along: Direction = Field(description="[1] direction, of any length")
    frame: Name | None = Field(
        default=None, description="body in whose frame the direction is given; default: the world"
    )
    as_in_scene: Finite = Field(
        default=0.0,
        description="[rad, m] the value to which the poses in the scene file correspond",
    )


class VariableEntry(Entry):
    """One thing that varies: its values, and what they change in the scene."""

    values: Annotated[list[Scalar], Field(min_length=1, max_length=10_000)] | ByName[Any] | None = (
        Field(
            default=None,
            description="[SI] the values; by label if they are not single numbers",
        )
    )
    start: Signed | None = Field(
        default=None,
        alias="from",
        description="[SI] first value of a range, in 'unit' if that is given",
    )
    to: Signed | None = Field(
        default=None, description="[SI] last value of the range, in 'unit' if that is given"
    )
    steps: Count | None = Field(
        default=None, description="number of values on a grid, ends included"
    )
    scale: Literal["linear", "log"] = Field(
        default="linear", description="spacing of the values in the range"
    )
    unit: Name | None = Field(
        default=None, description="unit of the values, such as deg or mm; default: SI"
    )
    key: Name | None = Field(
        default=None, description="the scene key that gets the value; default: the variable's name"
    )
    set: Few[SetEntry] | None = Field(
        default=None, min_length=1, description="several scene keys that get the value"
    )
    turn: TurnEntry | None = Field(default=None, description="turns bodies by the value")
    move: MoveEntry | None = Field(default=None, description="moves bodies by the value")

    @model_validator(mode="before")
    @classmethod
    def _refuse_count_keys(cls, data: Any) -> Any:
        found = next((name for name in _COUNTS if isinstance(data, dict) and name in data), None)
        if found is not None:
            raise ValueError(
                f"found {found}; the key for the number of values of a range is 'steps'"
            )
        return data

    @model_validator(mode="after")
    def _check_values_and_targets(self) -> VariableEntry:
        ranged = {"start", "to", "steps", "scale"} & self.model_fields_set
        if self.values is not None and ranged:
            raise ValueError("found values and a range; give either 'values' or 'from' and 'to'")
        if self.values is None and (self.start is None or self.to is None):
            raise ValueError("needs either 'values', or both 'from' and 'to'")
        if self.values is not None and len(self.values) == 0:
            raise ValueError("found no value; 'values' needs at least one")
        if self.start is not None and self.to is not None:
            self._check_range(self.start, self.to)
        targets = [name for name in ("key", "set", "turn", "move") if getattr(self, name)]
        if len(targets) > 1:
            raise ValueError(f"found {' and '.join(targets)}; give only one of them")
        return self

    def _check_range(self, start: float, to: float) -> None:
        if start > to:
            raise ValueError(f"the range from {start:g} to {to:g} is empty; 'from' must be smaller")
        if start == to and self.steps not in (None, 1):
            raise ValueError(
                f"from {start:g} to {to:g} is one value; 'steps' must not be {self.steps}"
            )
        if start < to and self.steps == 1:
            raise ValueError("one step gives one value: use more steps, or 'values' with one value")
        if self.scale == "log" and start <= 0.0:
            raise ValueError(f"a log scale needs positive values, but 'from' is {start:g}")


class SamplingEntry(Entry):
    """How the samples are chosen."""

    method: Literal["grid", "latin_hypercube", "sobol", "adaptive"] = Field(
        default="grid",
        description="grid: all combinations; latin_hypercube, sobol: a number of well spread "
        "samples; adaptive: a grid that is refined where outcomes differ",
    )
    samples: Count | None = Field(
        default=None, description="number of samples; adaptive: largest number; not with a grid"
    )
    depth: Halvings | None = Field(
        default=None, description="adaptive: how often each interval of the grid may be halved"
    )
    border: (
        Literal["found", "robust_found", "status", "contacts", "verdict", "holding", "mode"] | None
    ) = Field(default=None, description="adaptive: column in which outcomes differ; default: found")
    seed: Whole = Field(
        default=0, description="seed of the random numbers; the same seed gives the same samples"
    )

    @model_validator(mode="after")
    def _check_method_options(self) -> SamplingEntry:
        if self.method == "grid" and self.samples is not None:
            raise ValueError(
                "'samples' has no effect on a grid, whose 'steps' decide; leave it out"
            )
        if self.method in ("latin_hypercube", "sobol") and self.samples is None:
            raise ValueError(f"{self.method} needs 'samples', the number of samples")
        if self.method == "adaptive" and self.samples is None and self.depth is None:
            raise ValueError("adaptive needs 'depth', the number of halvings, or 'samples'")
        for name in ("depth", "border"):
            if self.method != "adaptive" and getattr(self, name) is not None:
                raise ValueError(f"{name!r} has an effect only with adaptive; leave it out")
        return self


@with_figures
class ComputeEntry(Entry):
    """What is computed for each sample; what is not said is as in the scene."""

    algorithm: AlgorithmName | None = Field(default=None, description=_AS_SOLVE)
    margin: NotNegative | None = Field(
        default=None, description="[N] required margin e_0 of Algorithm 2"
    )
    scale: Literal["absolute", "limits"] | None = Field(default=None, description=_AS_SOLVE)
    sign_rule: Literal["strict", "exact", "nonzero", "direction"] | None = Field(
        default=None, description=_AS_SOLVE
    )
    sliding_rule: Literal["exempt", "constrained"] | None = Field(
        default=None, description=_AS_SOLVE
    )
    static_friction: Literal["virtual_sliding", "coulomb"] | None = Field(
        default=None, description=_AS_SOLVE
    )
    solver: Name | None = Field(default=None, description=_AS_SOLVE)
    regularization: Regularization | None = Field(default=None, description=f"[1] {_AS_SOLVE}")
    node_limit: Count | None = Field(
        default=None, description="node limit of each search over modes"
    )
    time_limit: Seconds | None = Field(
        default=None, description="[s] time limit of each search over modes"
    )
    stability: Literal["weak", "strong"] | None = Field(
        default=None, description="strong: torques under which rest is the only outcome"
    )
    verdict_nodes: Count | None = Field(
        default=None, description="node limit (sets of outcomes) of each verdict"
    )
    sample_time_limit: Seconds | None = Field(
        default=None,
        description="[s] time limit of each sample, from loading its scene to the last analysis",
    )
    force_bounds: bool = Field(
        default=False, description="whether to compute the margin at worst and at best, eq. (32)"
    )
    disturbance_margin: bool = Field(
        default=False,
        description="whether to compute the largest disturbance balanced in every direction",
    )
    minimum_friction: bool = Field(
        default=False,
        description="whether to compute the smallest sufficient factor on all friction",
    )
    verdict: bool = Field(default=False, description="whether to compute the verdict")
    mode: bool = Field(
        default=False, description="whether to add the mode of virtual sliding of the optimum"
    )
    collisions: bool = Field(
        default=True, description="whether links deep in supports or in each other are a finding"
    )
    need_hand: bool = Field(
        default=True, description="whether a hand that does not touch the object is a finding"
    )
    explain: bool = Field(
        default=False, description="whether to explain infeasible samples in full, which is slow"
    )

    def solve_options(self) -> dict[str, Any]:
        """Return the options that go into the scene's ``solve`` section."""
        return self.model_dump(exclude_none=True, include=set(SolveEntry.model_fields))


class StudyEntry(PosingEntry):
    """A whole study."""

    name: Name = Field(default="", description="title of the study")
    description: Description = Field(default="", description="for whoever reads the file")
    scene: FilePath = Field(description="path of the scene, relative to the study file")
    vary: dict[Name, VariableEntry] = Field(
        min_length=1, max_length=100, description="the variables, by name"
    )
    sampling: SamplingEntry = Field(
        default=SamplingEntry(), description="which combinations of values are computed"
    )
    compute: ComputeEntry = Field(
        default=ComputeEntry(), description="what is computed for each sample"
    )

    @model_validator(mode="after")
    def _border_is_computed(self) -> StudyEntry:
        border = self.sampling.border
        key = "verdict" if border == "holding" else border
        if key in ("verdict", "mode") and not getattr(self.compute, key):
            raise ValueError(f"the border of {border!r} needs compute: {{{key}: true}}")
        return self
