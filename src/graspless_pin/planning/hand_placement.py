"""Places of a hand: the best of what was tried, and why the rest is none."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from textwrap import fill

from graspless_pin.findings import capture
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.holding.verdict_words import parted
from graspless_pin.planning.placing_candidates import NODES, PlacingFault
from graspless_pin.planning.placing_plan import PlacingAim
from graspless_pin.records import Brief
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import COLUMNS, Table


@dataclass(frozen=True, eq=False, repr=False)
class PlacedHand(Brief):
    """A place of a hand. See the example of `place_hand`.

    Attributes:
        scene: The scene with the hand there.
        margin: Of Algorithm 1, N.
        carrying_margin: The same without the supports and at rest, N; NaN: the hand cannot carry
            the object by itself.
        touching: The hand's links that touch the object.
        verdict: Whether the object stays with the torques of `solution`; None where that was not
            asked, or cannot be told of this hand.
    """

    scene: Scene
    margin: float
    carrying_margin: float
    touching: tuple[str, ...]
    verdict: StabilityVerdict | None

    @cached_property
    def solution(self) -> TorqueSolution:
        """The torques of Algorithm 1, solved for when they are first asked for."""
        with capture():
            return self.scene.solve("margin", node_limit=NODES)

    @property
    def holds(self) -> bool:
        """Whether rest is proven to be the only outcome, and to last under a stated controller."""
        stated = self.scene.controller.is_stated
        return self.verdict is not None and self.verdict.keeps_rest(lasting=stated)

    def __str__(self) -> str:
        """Margins, links and verdict."""
        lines = [f"{self._margins}; touches with {', '.join(self.touching)}"]
        lines += [] if self.verdict is None else [self.verdict.full_message("--verdict-nodes {}")]
        return "\n".join(fill(line, COLUMNS) for line in lines)

    @property
    def _margins(self) -> str:
        """The margins in words."""
        if not self.scene.supports:
            return f"margin {self.margin:.3g} N"
        alone = f"{self.carrying_margin:.3g} N" if self.carrying_margin >= 0.0 else "none"
        return f"margin {self.margin:.3g} N, without supports {alone}"


@dataclass(frozen=True, eq=False, repr=False)
class HandPlacement(Brief):
    """Places of a hand. See the example of `place_hand`.

    Attributes:
        places: All places by rank, as `place_hand` sorts them.
        tried: How many candidates were tried.
        faults: How many were none, by reason, in the order in which reasons are found out.
        errors: What was raised inside this package and left a candidate, or its verdict, out, and
            how often, the commonest first.
        aim: What the places are good for; it decides their ranks.
        complete: Whether all candidates were tried; a time limit may have ended it before.
        seconds: What it took, s.
    """

    places: tuple[PlacedHand, ...]
    tried: int
    faults: Mapping[PlacingFault, int]
    errors: Mapping[str, int]
    aim: PlacingAim
    complete: bool
    seconds: float

    @property
    def found(self) -> int:
        """How many candidates are places."""
        return len(self.places)

    @property
    def scene(self) -> Scene | None:
        """The scene with the hand at the best place; None: there is none."""
        return self.places[0].scene if self.places else None

    @property
    def table(self) -> Table:
        """All places: print it, or take its `rows` and `headers`."""
        rows = [
            (
                rank,
                place.margin,
                place.carrying_margin if place.carrying_margin >= 0.0 else "none",
                "-" if place.verdict is None else place.verdict.status.value,
                ", ".join(place.touching),
            )
            for rank, place in enumerate(self.places, 1)
        ]
        headers = ["rank", "margin", "alone", "rest", "links"]
        legend = "margins in N; alone: without the supports; rest: the verdict, - not asked"
        return Table(rows, headers, legend, ".3g", (4,))

    def __str__(self) -> str:
        """Return the best places, and why the other candidates are none."""
        lines = [str(place) for place in self.places[:1]]
        for rank, place in enumerate(self.places[1:_SHOWN], 2):
            verdict = "" if place.verdict is None else f"; {parted(place.verdict.message)[0]}"
            lines.append(f"rank {rank}: {place._margins}; {len(place.touching)} links{verdict}")
        if self.found > _SHOWN:
            lines.append(f"and {self.found - _SHOWN} more")
        if self.found > 1:
            lines.append(f"ranked by: {_RANKED_BY[self.aim]}")
        ended = "" if self.complete else "; the time limit ended it"
        lines.append(
            f"{self.found} of {self.tried} candidates hold the object ({self.seconds:.1f} s{ended})"
        )
        width = len(str(max(self.faults.values(), default=0)))
        lines += [f"{count:{width + 2}} {fault.words}" for fault, count in self.faults.items()]
        bugs = list(self.errors.items())
        lines += [f"{error} (x {count}); please report it" for error, count in bugs[:_MOST_ERRORS]]
        if len(bugs) > _MOST_ERRORS:
            lines.append(f"... and {len(bugs) - _MOST_ERRORS} other internal errors")
        if not self.places:
            lines.append(self.advice)
        return "\n".join(lines)

    @property
    def advice(self) -> str:
        """What to try where no place was found, judging by how far the candidates came."""
        return _ADVICE[max(self.faults, key=list(PlacingFault).index)] if self.faults else ""


_RANKED_BY = {
    PlacingAim.GRIP: "carrying it without supports, verdict, margin without supports",
    PlacingAim.CARRY: "verdict, margin without supports",
    PlacingAim.PRESS: "verdict, margin with supports",
}
_MOST_ERRORS = 3
_SHOWN = 5
_LARGER = (
    "the object may be too large or too small for the hand: compare its size (m), and the scale of "
    "its mesh if it has one, with the fingers"
)
_OTHERS = "try more candidates, other fingers or an approach of your own"
_ADVICE = {
    PlacingFault.INTERNAL_ERROR: "this is our fault: please report it with the scene",
    PlacingFault.OUT_OF_REACH: "the arm does not reach the object from its base: set base_pose, or "
    "let the base move with move_base (--move-base)",
    PlacingFault.SUPPORT_IN_THE_WAY: f"nowhere is the open hand clear of the supports; {_OTHERS}",
    PlacingFault.OBJECT_IN_THE_WAY: f"nowhere is the open hand clear of the object; {_LARGER}",
    PlacingFault.TOUCHES_NOTHING: f"no finger reaches the object; {_LARGER}",
    PlacingFault.HAND_ON_SUPPORT: f"each closed hand touches a support; {_OTHERS}",
    PlacingFault.HAND_THROUGH_ITSELF: f"each closed hand collides with itself; {_OTHERS}",
    PlacingFault.ONE_FINGER_ONLY: f"never do two fingers touch the object; {_LARGER}",
    PlacingFault.UNUSABLE_CONTACTS: "put the hand there with close_fingers to see what is wrong",
    PlacingFault.NOTHING_OPPOSES: "no two links squeeze the object between them; aim='press' "
    "(--press) takes hands that press it onto a support",
    PlacingFault.CANNOT_CARRY: "no hand carries the object by itself with that margin: raise the "
    "effort limits or the friction, lower the mass, or ask for less than 'carry'",
    PlacingFault.INFEASIBLE: "raise the effort limits or the friction if they are too low, or "
    "lower the mass",
    PlacingFault.LOAD_TOO_LARGE: "look at the object's mass (kg), sizes (m) and effort limits",
    PlacingFault.UNDECIDED: "raise node_limit in the scene's solve",
    PlacingFault.MARGIN_TOO_SMALL: "ask for a smaller margin, or raise the effort limits",
}
