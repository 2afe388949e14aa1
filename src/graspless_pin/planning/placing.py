"""Placing a hand at an object: a search for poses and postures that hold it."""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from textwrap import fill

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.child_process import ChildProcesses, shared_work, usable_cores
from graspless_pin.errors import (
    ArgumentError,
    GrasplessPinError,
    SceneError,
    StateError,
    StateFault,
    internal_error,
)
from graspless_pin.findings import capture
from graspless_pin.geometry.hand.model import displaced_hand
from graspless_pin.geometry.posing.opposing import fingers_that_close
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT, Stability, StabilityVerdict
from graspless_pin.holding.verdict_words import lead_and_words
from graspless_pin.planning.placing_candidates import (
    CANDIDATE_NODES,
    PlacingFault,
    TriedCandidate,
    try_candidate,
)
from graspless_pin.planning.placing_plan import ClosedHand, PlacingAim, PlacingPlan, hand_parts
from graspless_pin.problem.checks import (
    check_callback,
    choice,
    finite_array,
    real_number,
    truth_values,
    unit_vector,
    whole_number,
)
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.records import Brief
from graspless_pin.scene import Scene, settle
from graspless_pin.scene.fields import checked_scene, label_of
from graspless_pin.scene.saving import scene_as_written
from graspless_pin.solution import Status, TorqueSolution
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
        verdict: Whether the object stays with the torques of `solution`; None: there is no verdict,
            or it cannot be computed for this hand.
    """

    scene: Scene
    margin: float
    carrying_margin: float
    touching: tuple[str, ...]
    verdict: StabilityVerdict | None

    @cached_property
    def solution(self) -> TorqueSolution:
        """The torques of Algorithm 1, computed when they are first read."""
        with capture():
            return self.scene.solve("margin", node_limit=CANDIDATE_NODES)

    @property
    def holds(self) -> bool:
        """Whether rest is proven to be the only outcome, and to last under a stated controller."""
        stated = self.scene.controller.is_given
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
        tried: Number of candidates that were tried.
        faults: Numbers of candidates that are no places, by reason, in the order of the checks.
        errors: Internal errors that cost a candidate or its verdict, with their numbers, the
            commonest first.
        aim: The purpose of the places; it decides their ranks.
        complete: Whether all candidates were tried, before the time limit.
        seconds: Duration of the search, s.
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
        """Number of candidates that are places."""
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
                f"{place.carrying_margin:.3g}" if place.carrying_margin >= 0.0 else "none",
                "-" if place.verdict is None else place.verdict.status.value,
                ", ".join(place.touching),
            )
            for rank, place in enumerate(self.places, 1)
        ]
        headers = ["rank", "margin", "alone", "rest", "links"]
        legend = "margins in N; alone: margin without the supports; rest: the verdict (-: none)"
        return Table(rows, headers, legend, ".3g", (4,))

    def __str__(self) -> str:
        """Return the best places, and the faults of the other candidates."""
        lines = [str(place) for place in self.places[:1]]
        for rank, place in enumerate(self.places[1:_PLACES_SHOWN], 2):
            lead = "" if place.verdict is None else lead_and_words(place.verdict.message)[0]
            verdict = lead and f"; {lead}"
            lines.append(f"rank {rank}: {place._margins}; {len(place.touching)} links{verdict}")
        if self.found > _PLACES_SHOWN:
            lines.append(f"and {self.found - _PLACES_SHOWN} more")
        if self.found > 1:
            lines.append(f"ranked by: {_RANKED_BY[self.aim]}")
        ended = "" if self.complete else "; ended by the time limit"
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
        """Advice for a search without places, on the fault of most candidates or the last check."""
        order, most = list(PlacingFault), _MOST_BY_FAR * self.tried
        ranks = {fault: (n >= most, order.index(fault)) for fault, n in self.faults.items()}
        return _ADVICE[max(ranks, key=lambda fault: ranks[fault])] if ranks else ""


_RANKED_BY = {
    PlacingAim.GRIP: "carrying it without supports, verdict, margin without supports",
    PlacingAim.CARRY: "verdict, margin without supports",
    PlacingAim.PRESS: "verdict, margin with supports",
}
_MOST_ERRORS = 3
_PLACES_SHOWN = 5
_MOST_BY_FAR = 0.8  # share of the candidates
_LARGER = (
    "the object may be too large or too small for the hand: compare its size (m), and the scale of "
    "its mesh if it has one, with the fingers"
)
_OTHERS = "try more candidates, other fingers or an approach of your own"
_ADVICE = {
    PlacingFault.INTERNAL_ERROR: "this is our fault: please report it with the scene",
    PlacingFault.OUT_OF_REACH: "the arm does not reach the object from its base: set base_pose, or "
    "let the base move with move_base (--move-base)",
    PlacingFault.SUPPORT_IN_THE_WAY: "almost everywhere the open hand or its arm touches a support"
    f"; {_OTHERS}; with an arm, a base_pose without move_base, or the hand alone (root_link)",
    PlacingFault.OBJECT_IN_THE_WAY: "almost everywhere the open hand touches the object; "
    f"{_LARGER}",
    PlacingFault.TOUCHES_NOTHING: f"no finger reaches the object; {_LARGER}",
    PlacingFault.HAND_ON_SUPPORT: f"almost every closed hand touches a support; {_OTHERS}",
    PlacingFault.HAND_THROUGH_ITSELF: f"almost every closed hand collides with itself; {_OTHERS}",
    PlacingFault.ONE_FINGER_ONLY: f"only one finger at a time touches the object; {_LARGER}",
    PlacingFault.UNUSABLE_CONTACTS: "put the hand there with close_fingers to see what is wrong",
    PlacingFault.NOTHING_OPPOSES: "no two links squeeze the object between them; aim='press' "
    "(--press) accepts hands that press it onto a support",
    PlacingFault.CANNOT_CARRY: "no hand carries the object by itself with that margin: raise the "
    "effort limits or the friction, lower the mass, or use an aim other than 'carry'",
    PlacingFault.INFEASIBLE: "raise the effort limits or the friction if they are too low, or "
    "lower the mass",
    PlacingFault.LOAD_TOO_LARGE: "check the object's mass (kg), sizes (m) and the effort limits",
    PlacingFault.UNDECIDED: "raise node_limit in the scene's solve",
    PlacingFault.MARGIN_TOO_SMALL: "require a smaller margin, or raise the effort limits",
}


PlacingProgress = Callable[[int, int, int], object]
"""Called with the numbers of candidates that are done, of all, and of those that are places."""

_MOST_PARENTS = 8
_SEARCH_SHARE = 0.75  # share of the time limit for the search; the rest is for verdicts
_ORDER = Stability.STRONG, Stability.UNDECIDED, Stability.WEAK, Stability.NONE


def place_hand(
    scene: Scene,
    *,
    approach: ArrayLike | None = None,
    point: ArrayLike | None = None,
    fingers: Sequence[str] | None = None,
    margin: float | None = None,
    aim: str = PlacingAim.GRIP,
    together: bool = False,
    move_base: bool = False,
    seed: int = 0,
    candidates: int = 600,
    time_limit: float | None = 60.0,
    verdict_nodes: int = BRIEF_NODE_LIMIT,
    verdicts: int | None = 5,
    workers: int | None = None,
    progress: PlacingProgress | None = None,
) -> HandPlacement:
    """Search places at which a hand holds the scene's object, wherever the hand is now.

    An object that touches no support is put down along gravity first, if a support lies below it.
    Each candidate opens the fingers from a posture in which their tips meet, moves towards a point
    in the object, backs off until the open hand is clear, and closes. A gripper whose jaws have one
    motor is shifted until both touch. Fingers that touch nothing open again. Algorithm 1 computes
    the margin of this grip, with the supports and without them. Two thirds of the candidates are
    drawn anew, the others near the best eight of these.

    A place is a grip: at least two links squeeze the object. Those that can carry it without its
    supports rank first, among these those with a verdict that proves rest, and then those with the
    larger margin without the supports. ``aim="carry"`` accepts only grips that can carry it;
    ``aim="press"`` accepts all that hold it and ranks by the margin with the supports, which may be
    largest where the hand presses the object onto one.

    A candidate depends on the seed and its number alone: the same call finds the same places with
    any number of processes, unless the time limit ends it.

    Args:
        scene: A scene with a hand, no matter where; its contacts are found, not given.
        approach: (3,) direction in which the palm approaches, world axes, of any length; None: all.
        point: (3,) target of the palm, world, m; None: points inside the object.
        fingers: Fingers that may close; None: all. The others stay as they are.
        margin: Smallest margin of a place, N; None: the scene's own, 0.1 N if it has none.
        aim: ``grip``, ``carry`` or ``press``.
        together: Whether several mounts move as one body; else each is placed by itself.
        move_base: Whether the bases of arms move; else they stay, and the arms move the palms as
            near to their goals as they can. An arm has more than three joints.
        seed: Of all random choices.
        candidates: Number of candidates.
        time_limit: Seconds after which it returns what was found, the last quarter of them for
            verdicts; None: no limit.
        verdict_nodes: Most sets of outcomes that each verdict searches; 0: there are no verdicts.
        verdicts: Number of the best places that get a verdict; None: all.
        workers: Processes; 1: this one; None: as many as there are cores.
        progress: Called after each candidate: see `PlacingProgress`.

    Returns:
        All places by rank, and the faults of the other candidates. There may be no place. An
        exception that is none of this package's costs the candidate that raised it, and is listed.

    Raises:
        SceneError: If the scene has no hand or gives its contacts, cannot be used, or the object is
            in a support.
        ArgumentError: If a finger is unknown, or an argument out of range.
        CrashError: If a process dies.

    Examples:
        >>> from graspless_pin import load_scene, place_hand
        >>> scene = load_scene("examples/trihand_push_box.yaml")
        >>> found = place_hand(scene, aim="press", candidates=60, verdict_nodes=0, workers=1)
        >>> found.scene is not None and found.places[0].margin > 0.1
        True
    """
    begin = time.monotonic()
    truth_values(together=together, move_base=move_base)
    check_callback("progress", progress)
    plan = _placing_plan(
        scene, approach, point, fingers, margin, aim, seed, together=together, move_base=move_base
    )
    count = whole_number("candidates", candidates, 1)
    limit = np.inf if time_limit is None else real_number("time_limit", time_limit, 0.0)
    crew = whole_number("workers", usable_cores() if workers is None else workers, 1)
    nodes = whole_number("verdict_nodes", verdict_nodes, 0)
    most = count if verdicts is None else whole_number("verdicts", verdicts, 0)
    first = -(-2 * count // 3)
    tried: list[TriedCandidate] = []
    children = ChildProcesses()
    try:
        for numbers in (range(first), range(first, count)):
            varied = replace(plan, parents=_closed_by_rank(plan, tried)[:_MOST_PARENTS])
            for last in _try_all(varied, numbers, children, crew, begin + _SEARCH_SHARE * limit):
                tried.append(last)
                if progress is not None:
                    progress(len(tried), count, sum(own.fault is None for own in tried))
    finally:
        children.stop()
    good = _closed_by_rank(plan, [candidate for candidate in tried if candidate.fault is None])
    errors = Counter(candidate.error for candidate in tried if candidate.error)
    counts = Counter(candidate.fault for candidate in tried if candidate.fault is not None)
    return HandPlacement(
        places=_ranked_places(plan, good, nodes, most if nodes else 0, begin + limit, errors),
        tried=len(tried),
        faults={fault: counts[fault] for fault in PlacingFault if counts[fault]},
        errors=dict(errors.most_common()),
        aim=plan.aim,
        complete=len(tried) == count,
        seconds=time.monotonic() - begin,
    )


def _placing_plan(
    scene: Scene,
    approach: ArrayLike | None,
    point: ArrayLike | None,
    fingers: Sequence[str] | None,
    margin: float | None,
    aim: str,
    seed: int,
    *,
    together: bool,
    move_base: bool,
) -> PlacingPlan:
    """Check the arguments of `place_hand` and return the plan of all candidates."""
    checked_scene(scene)
    if scene.hand is None:
        raise SceneError(f"{label_of(scene)}: the scene has no hand to be placed; add one")
    if scene.given_contacts is not None:
        raise SceneError(
            f"{label_of(scene)}: contacts are given, but would not move with the hand; leave the "
            "key out"
        )
    names = fingers_that_close(scene.hand, fingers)
    required = scene.solve_options.get("margin", 0.1) if margin is None else margin
    rng = np.random.default_rng(whole_number("seed", seed, 0))
    resting = _settled_scene(scene)
    surface = resting.object.shape.surface().moved(resting.object.T_world_object)
    corners = surface.vertices[surface.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    sizes = np.linalg.norm(areas, axis=1)
    return PlacingPlan(
        scene=resting,
        hand=scene.hand,
        parts=hand_parts(scene.hand, names, rng, together=together, move_base=move_base),
        normals=areas[sizes > 0.0] / sizes[sizes > 0.0, None],
        areas=sizes[sizes > 0.0],
        direction=None if approach is None else unit_vector("approach", approach),
        point=None if point is None else finite_array("point", point, (3,)),
        margin=real_number("margin", required, 0.0),
        aim=choice(PlacingAim, "aim", aim),
        seed=seed,
    )


def _settled_scene(scene: Scene) -> Scene:
    """Return the scene with its object put down on a support, if one lies below it.

    Raises:
        StateError: If the object is in a support.
    """
    try:
        if len(scene.with_changes(hand=None, motion=None).contacts.arrays):
            return scene
    except StateError as error:
        if error.kind is not StateFault.NO_CONTACT:
            raise
    try:
        return settle(scene)
    except SceneError:
        return scene


def _try_all(
    plan: PlacingPlan,
    numbers: Sequence[int],
    children: ChildProcesses,
    workers: int,
    deadline: float,
) -> Iterator[TriedCandidate]:
    """Yield results of candidates, until the deadline."""
    results: Iterator[TriedCandidate] = map(partial(try_candidate, plan), numbers)
    if workers > 1:
        results = shared_work(try_candidate, plan, numbers, workers, children)
    while time.monotonic() <= deadline and (result := next(results, None)) is not None:
        yield result


def _closed_by_rank(plan: PlacingPlan, tried: Sequence[TriedCandidate]) -> tuple[ClosedHand, ...]:
    """Return the closed hands among candidates, the best for the aim first."""
    closed = [(one.number, one.closed) for one in tried if one.closed]
    return tuple(
        one for _, one in sorted(closed, key=lambda pair: (*_rank(plan, pair[1], None), pair[0]))
    )


def _rank(
    plan: PlacingPlan, closed: ClosedHand, verdict: StabilityVerdict | None
) -> tuple[float, ...]:
    """Return the sort key of a place: smaller is better."""
    status = _ORDER.index(Stability.UNDECIDED)
    if verdict is not None:
        kept = verdict.keeps_rest(lasting=plan.scene.controller.is_given)
        lost = verdict.status is Stability.STRONG and not kept
        status = _ORDER.index(Stability.WEAK if lost else verdict.status)
    if plan.aim is PlacingAim.PRESS:
        return status, -closed.margin
    alone = closed.carrying_margin >= plan.margin
    return not alone, status, -closed.carrying_margin if alone else 0.0, -closed.margin


def _ranked_places(
    plan: PlacingPlan,
    good: Sequence[ClosedHand],
    nodes: int,
    asked: int,
    deadline: float,
    errors: Counter[str],
) -> tuple[PlacedHand, ...]:
    """Return places by rank, the first ``asked`` ones with verdicts.

    Internal errors of verdicts are added to ``errors``.
    """
    places = dict(enumerate(_placed_hand(plan, one) for one in good))
    asked_already: set[int] = set()
    while True:
        ranks = sorted(
            places, key=lambda index: (*_rank(plan, good[index], places[index].verdict), index)
        )
        unasked = [index for index in ranks[:asked] if index not in asked_already]
        if not unasked or time.monotonic() > deadline:
            return tuple(places[index] for index in ranks)
        asked_already.add(unasked[0])
        places[unasked[0]] = _with_verdict(places[unasked[0]], nodes, deadline, errors)


def _placed_hand(plan: PlacingPlan, closed: ClosedHand) -> PlacedHand:
    hand = displaced_hand(plan.hand.with_configuration(closed.positions), closed.displacements)
    scene = plan.scene.with_changes(hand=hand)
    return PlacedHand(scene, closed.margin, closed.carrying_margin, closed.touching, None)


def _with_verdict(
    place: PlacedHand, nodes: int, deadline: float, errors: Counter[str]
) -> PlacedHand:
    """Return a place with its verdict, if it can be computed for this hand."""
    with suppress(SceneError):  # a scene that cannot be written to a file
        place = replace(place, scene=scene_as_written(place.scene))
    try:
        with capture():
            verdict = _place_verdict(place.scene, place.solution, nodes, deadline)
        return replace(place, verdict=verdict)
    except ArgumentError:  # a link without mass
        pass
    except GrasplessPinError:
        raise
    except Exception as error:
        errors[f"no verdict: {internal_error(error)}"] += 1
    return place


def _place_verdict(
    scene: Scene, solution: TorqueSolution, nodes: int, deadline: float
) -> StabilityVerdict | None:
    """Return the verdict on the torques of the scene's own algorithm; None: there are none."""
    algorithm = scene.solve_options.get("algorithm", Algorithm.MARGIN)
    if algorithm != Algorithm.MARGIN or solution.status is not Status.OPTIMAL:
        remaining = None if np.isinf(deadline) else deadline - time.monotonic()
        solution = scene.solve(time_limit=remaining)
    if not solution.found:
        return None
    return scene.stability(solution.torques, node_limit=nodes)
