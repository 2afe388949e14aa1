"""Best-first branch and bound over parts of all modes, driven by kinematic conflicts.

Branch and bound as of Land and Doig (Econometrica 28(3), 1960). The conflicts play the part of
combinatorial Benders cuts (Codato and Fischetti, Oper. Res. 54(4), 2006): an infeasible set of
kinematic conditions shows which decisions exclude each other. A node is a part of all modes, and
its program is the relaxation with the friction that these modes allow. If no feasible mode admits
the friction of its optimum, the kinematics give a conflict: items "contact l virtually slides with
sign s along t_m" and "contact l is selected" that exclude each other. In every feasible mode at
least one item fails, and each child excludes another one. A document's proof bounds and splits the
same parts (`solution_proof`).

`search_modes` chooses among branch and bound, the search over directions, and enumeration: the
relaxation first, then every maximal mode.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from graspless_pin.algorithms.formulation import NO_FRICTION
from graspless_pin.algorithms.mode_oracle import FoundMode
from graspless_pin.algorithms.mode_tree import ModePart, ModeTree
from graspless_pin.algorithms.options import Search
from graspless_pin.algorithms.search_state import (
    Fathomed,
    SearchState,
    Split,
    best_first,
    optimality_tolerance,
    unsolved_status,
)
from graspless_pin.errors import ArgumentError, OverrunError, UndecidedMotionError
from graspless_pin.modes.kinematics import feasible_modes
from graspless_pin.modes.rules import SignRule, SlidingMode, required_contacts
from graspless_pin.modes.sectors import (
    WIDEST,
    Exclusion,
    Sector,
    SectorMotions,
    Sectors,
    other_directions,
)
from graspless_pin.modes.virtual_motions import CLEARLY, RANK_TOLERANCE
from graspless_pin.problem.checks import FloatArray
from graspless_pin.solution import Status
from graspless_pin.solvers import Answer, Outcome

_GUESS_EVERY = 8
"""A mode is guessed at the first conflict and at every eighth after it."""
_GUESSES = 2


def branch_and_bound(state: SearchState) -> Status:
    """Find the optimum over all feasible modes with a proven bound, starting at the relaxation."""
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return unsolved_status(answer, Status.INFEASIBLE_FORCES)
    tree = ModeTree(state.formulation, state.rules)

    def expand(part: ModePart, before: float) -> Fathomed | Split[ModePart]:
        state.oracle.kinematic_programs += int(part.selected.any())
        if tree.exclusion(part) is not None:
            return Split(before, [])  # no feasible mode is in it
        answer = state.solve(*tree.bounds(part))
        state.nodes += 1
        if answer.outcome is Outcome.FAILED:
            return Fathomed(max(before, answer.bound))
        return _keep_or_split(state, tree, part, answer, before)

    every = ModePart.every_mode(state.formulation.problem, state.rules)
    root = _keep_or_split(state, tree, every, answer, -np.inf)
    status, state.cover = best_first(state, root, expand, state.is_closed)
    return status


def _try_guessed_modes(state: SearchState, answer: Answer) -> None:
    """Try feasible modes near the friction of an answer, whose optima are often as good.

    An interior-point optimum has friction everywhere, so where many forces are optimal, a feasible
    mode rarely admits its own friction.
    """
    x = answer.x
    for _ in range(_GUESSES):
        found = state.oracle.heuristic_mode(x)
        if found is None or found.mode == state.mode:
            return  # it is the best already
        guess = state.solve(*state.formulation.bounds_of(found.mode))
        if guess.outcome is not Outcome.SOLVED or guess.value >= state.best_value:
            return
        state.keep(guess, found)
        if state.is_closed(answer.bound):
            return
        x = guess.x


def _keep_or_split(
    state: SearchState, tree: ModeTree, part: ModePart, answer: Answer, before: float
) -> Fathomed | Split[ModePart]:
    """Keep the optimum of a part if a mode admits it; otherwise split the part."""
    fathomed = Fathomed(answer.bound)
    if answer.outcome is not Outcome.SOLVED or state.is_closed(answer.bound):
        return fathomed
    x = tree.without_forbidden_friction(part, answer.x)
    found = state.oracle.mode_for(x, state.near)
    state.modes_examined += 1
    if isinstance(found, FoundMode):
        if state.offer(answer, found):
            return fathomed
        found = None
    elif state.modes_examined % _GUESS_EVERY == 1:
        _try_guessed_modes(state, answer)
        if state.is_closed(answer.bound):
            return fathomed
    # The signs that the part fixes may exclude its modes where the friction alone does not.
    conflict = state.oracle.conflict_for(x, part) if found is None else found
    split = tree.split(part, x, conflict)
    if split is None:
        # The part is one feasible mode, and the answer is that of its own program.
        state.offer(answer, FoundMode(part.mode), x)
        return fathomed
    children = split[1]
    if state.rules.sign is SignRule.EXACT:
        # Where a contact may slide along one tangent alone, children that release contacts rarely
        # help. Children that change a sign are visited before them: the last child comes first.
        children = sorted(children, key=lambda child: -np.count_nonzero(child.released))
    # Where a mode is as good as the relaxation, all bounds are equal up to rounding. Ignoring such
    # rises keeps the search going depth first.
    rises = answer.bound > before + 0.5 * optimality_tolerance(before)
    return Split(answer.bound if rises else before, children)


def search_exhaustively(state: SearchState) -> Status:
    """Find the optimum over all feasible modes by solving every maximal one.

    The relaxation's optimum is the answer if a feasible mode admits its friction. Otherwise the
    maximal modes are solved one by one: a smaller mode allows no further forces. They count as
    nodes.
    """
    answer, limits = state.relax(), state.limits
    if answer.outcome is not Outcome.SOLVED:
        return unsolved_status(answer, Status.INFEASIBLE_FORCES)
    found = state.oracle.mode_for(answer.x)
    state.modes_examined = 1
    if isinstance(found, FoundMode) and state.offer(answer, found):
        return state.final_status()
    smallest = np.inf
    modes = feasible_modes(
        state.formulation.problem, state.formulation.kinematics, state.rules, maximal=True,
        is_over=lambda _: limits.is_time_over,
    )  # fmt: skip
    try:
        for listed in modes:
            if limits.is_over(state.nodes):
                return state.final_status(interrupted=True)
            state.nodes += 1
            state.modes_examined += 1
            answer = state.solve(*state.formulation.bounds_of(listed))
            smallest = min(smallest, answer.bound)
            if answer.outcome is Outcome.SOLVED and answer.value < state.best_value:
                state.keep(answer, FoundMode(listed))
            if state.is_closed(state.bound):
                return state.final_status()
    except OverrunError:  # while modes were listed
        return state.final_status(interrupted=True)
    state.raise_bound(smallest)
    return state.final_status()


_LEAST_OPTIMUM = 0.01
"""Optima below this share of the load are found to the gap of an optimum of this size."""
_EXACT_HALF_WIDTH = 1e-8
"""Half the width of a sector that is one direction up to rounding, rad."""
_NARROWEST_SECTOR = 1e-7
"""Half the width below which sectors without a motion are no further refined, rad."""
_WIDTH_RATIO = 1.3
"""Factor up to which the widest sectors without a motion are found."""


@dataclass(frozen=True, eq=False)
class _Node:
    """A subset of all virtual motions with opposed friction.

    Attributes:
        sectors: Sectors of the contacts that virtually slide; None: any direction.
        released: Contacts without friction.
    """

    sectors: Sectors
    released: frozenset[int]

    def with_sector(self, contact: int, sector: Sector | None) -> _Node:
        """Return the subset of the node in which a contact slides in a sector."""
        return replace(self, sectors={**self.sectors, contact: sector})


def search_directions(state: SearchState) -> Status:
    """Find the optimum over all virtual motions, with friction opposite to each, to a proven gap.

    Args:
        state: The search to run, on a program with round cones.

    Raises:
        ArgumentError: If the program is not one of Algorithms 1 and 2, without a regularisation.
    """
    objective = state.formulation.objective
    if objective.algorithm is None or objective.regularization > 0.0:
        what = "a regularisation" if objective.algorithm else f"the objective {objective.name!r}"
        raise ArgumentError(
            "sign_rule",
            f"is 'direction', which is not supported together with {what}, only with the largest "
            "margin or the smallest torque without a regularisation; use 'strict', 'exact' or "
            "'nonzero'",
        )
    answer = state.relax()
    if answer.outcome is not Outcome.SOLVED:
        return unsolved_status(answer, Status.INFEASIBLE_FORCES)
    search = _DirectionSearch(state)
    try:
        return search.run(answer)
    finally:
        state.oracle.kinematic_programs += search.motions.programs


class _DirectionSearch:
    """Best-first branch and bound over sectors of directions, for the rule ``direction``.

    A node gives sectors to some contacts and no friction to others. In its program friction opposes
    any direction of the sector, which gives an outer value. A virtual motion has one direction at
    each contact at which it slides; the program with friction opposite to these gives an answer, an
    inner value. Where no motion opposes the friction of a node's optimum, sectors about that
    friction are widened as long as no motion slides in all of them. In every answer at least one of
    those contacts slides in another direction or has no friction: these cases are the children, and
    other contacts are not split. All sectors lie about friction, so tangents have no influence.

    Attributes:
        state: The best answer, the bound and the counters.
        motions: Virtual motions in sectors.
        always: Contacts in actual sliding that have to slide virtually, too.
    """

    def __init__(self, state: SearchState) -> None:
        self.state, self._gap = state, state.options.direction_gap
        self._formulation = state.formulation
        self._cones = self._formulation.coordinates.layout.cones.tolist()
        self.motions = SectorMotions(self._formulation.kinematics)
        required = required_contacts(self._formulation.problem, state.rules)
        self.always = np.flatnonzero(required).tolist()

    def run(self, answer: Answer) -> Status:
        """Search from the relaxation's answer on."""
        every = _Node(dict.fromkeys(self.always), frozenset())
        root = self._keep_or_split(every, answer, answer.bound)
        return best_first(self.state, root, self._expand, self._is_closed)[0]

    def _expand(self, node: _Node, before: float) -> Fathomed | Split[_Node]:
        """Fathom or split a node: the argument `expand` of `best_first`."""
        if isinstance(self.motions.find(node.sectors), Exclusion):
            return Split(before, [])  # no motion slides in these sectors
        self.state.nodes += 1
        answer = self._solve(self._friction_sectors(node))
        return self._keep_or_split(node, answer, max(before, answer.bound))

    def _is_closed(self, bound: float) -> bool:
        """Whether nothing at or above a bound beats the best answer by more than the gap."""
        return self._cutoff <= bound

    @property
    def _cutoff(self) -> float:
        """Values from this on are within the gap of the best answer, scaled."""
        best = self.state.best_value
        return best - self._gap * max(abs(best), _LEAST_OPTIMUM) if np.isfinite(best) else np.inf

    def _friction_sectors(self, node: _Node) -> Sectors:
        """Return the sectors of contacts with a cone that the node decides; None: no friction."""
        sectors = {contact: node.sectors.get(contact) for contact in self._cones}
        return {
            contact: sector
            for contact, sector in sectors.items()
            if sector is not None or contact in node.released
        }

    def _solve(self, friction: Sectors) -> Answer:
        """Solve the program with friction opposite to sectors; None: without friction."""
        state = self.state
        state.force_programs += 1
        answer = self._formulation.solve_along(friction, state.options.solver, cutoff=self._cutoff)
        if answer.outcome is Outcome.FAILED:
            state.unproven_bound = min(state.unproven_bound, answer.bound)
        return answer

    def _keep_or_split(self, node: _Node, answer: Answer, bound: float) -> Fathomed | Split[_Node]:
        """Keep answers found from the node's optimum; split the node where that is no answer.

        The node is fathomed where nothing in it is better than the best answer by more than the
        gap.
        """
        if answer.outcome is not Outcome.SOLVED or self._is_closed(bound):
            return Fathomed(bound)
        state = self.state
        state.modes_examined += 1
        sliding_angles = self._sliding_angles(answer.x)
        fixed = {contact: node.sectors[contact] for contact in self.always}
        exact = {
            contact: Sector(angle, _EXACT_HALF_WIDTH) for contact, angle in sliding_angles.items()
        }
        found = self.motions.find({**fixed, **exact})
        if isinstance(found, Exclusion):
            motion, sectors, exclusion, width = self._widest_excluded(
                node, sliding_angles, exact, found
            )
            if motion is None or not self.motions.opposes(motion, sliding_angles):
                if motion is not None:
                    self._keep_best_along(motion, sliding_angles)
                if motion is None or state.modes_examined % _GUESS_EVERY == 1:
                    self._try_nearest_motion(answer.x, sliding_angles)
                if self._is_closed(answer.bound):
                    return Fathomed(bound)
                if width < _NARROWEST_SECTOR:
                    state.unproven_bound = min(state.unproven_bound, answer.bound)
                    return Fathomed(bound)
                return Split(bound, self._exclusion_children(node, sectors, exclusion, answer.x))
        else:
            motion = found
        still = [one for one in self.always if one not in self.motions.directions(motion)]
        if still:
            return Split(bound, self._sliding_children(node, still[0]))
        self._keep_if_better(answer, motion, sliding_angles)
        return Fathomed(bound)

    def _sliding_angles(self, x: FloatArray) -> dict[int, float]:
        """Return the angles of the sliding, rad, that the friction in x opposes, by contact."""
        friction = x[self._formulation.cone_columns[0]]
        with_friction = np.hypot(friction[:, 0], friction[:, 1]) > NO_FRICTION
        angles = np.arctan2(-friction[:, 1], -friction[:, 0]).tolist()
        return {contact: angles[i] for i, contact in enumerate(self._cones) if with_friction[i]}

    def _widest_excluded(
        self, node: _Node, sliding_angles: dict[int, float], exact: Sectors, exclusion: Exclusion
    ) -> tuple[FloatArray | None, Sectors, Exclusion, float]:
        """Return the widest sectors about the friction in which no motion slides.

        Returns:
            A motion in slightly wider sectors, None if none slides in the widest ones; the sectors,
            the proof that no motion slides in them, and half the width of the slightly wider ones.
        """
        sectors, motion, low, high = exact, None, _EXACT_HALF_WIDTH, WIDEST
        half = high
        while high > _WIDTH_RATIO * low:
            wider = dict(node.sectors)
            for contact, angle in sliding_angles.items():
                own = node.sectors.get(contact)
                wider[contact] = Sector(angle, half) if own is None else own.clipped(angle, half)
            found = self.motions.find(wider)
            if isinstance(found, Exclusion):
                low, sectors, exclusion = half, wider, found
            else:
                high, motion = half, found
            half = (low * high**2) ** (1.0 / 3.0)
        return motion, sectors, exclusion, high

    def _exclusion_children(
        self, node: _Node, sectors: Sectors, exclusion: Exclusion, x: FloatArray
    ) -> list[_Node]:
        """Return children that each exempt one contact from an exclusion.

        In a child the contacts before its own slide in their sectors, so that no two children
        overlap.
        """
        columns = self._formulation.coordinates.tangent_columns
        size = {
            contact: float(np.hypot(*x[columns[contact]])) if contact in self._cones else 0.0
            for contact in exclusion.touching
        }
        # First contacts with a sector, then the largest friction: these children bound highest.
        order = sorted(size, key=lambda one: (one not in node.sectors, -size[one]))
        children, remainder = [], node
        for contact in order:
            own, part = node.sectors.get(contact), sectors.get(contact)
            if contact not in node.sectors:
                children.append(replace(remainder, released=remainder.released | {contact}))
            if contact in exclusion.directed and part is not None:
                others = other_directions(part) if own is None else own.remainders(part)
                children += [remainder.with_sector(contact, other) for other in others]
                own = part
            remainder = remainder.with_sector(contact, own)
        return children

    def _sliding_children(self, node: _Node, contact: int) -> list[_Node]:
        """Return children in which a contact slides, by sectors about its actual sliding."""
        own, problem = node.sectors[contact], self._formulation.problem
        if own is not None:
            parts = own.halves
        else:
            along = problem.tangents[contact].T @ problem.sliding[contact]
            ahead = Sector(float(np.arctan2(along[1], along[0])), np.pi / 3.0)
            parts = (ahead, *other_directions(ahead))
        return [node.with_sector(contact, part) for part in parts]

    def _keep_best_along(self, motion: FloatArray, sliding_angles: dict[int, float]) -> None:
        """Keep the optimum with friction opposite to a motion, if it is the best so far.

        Where the motion opposes the given friction up to rounding, the given angle is used, since
        rounding turns slow slidings most.
        """
        angles, opposes = self.motions.directions(motion), self.motions.opposes
        angles |= {
            one: angle for one, angle in sliding_angles.items() if opposes(motion, {one: angle})
        }
        if not angles.keys() >= set(self.always):
            return
        sectors = {one: Sector(angles[one], 0.0) if one in angles else None for one in self._cones}
        answer = self._solve(sectors)
        if answer.outcome is Outcome.SOLVED:
            self._keep_if_better(answer, motion, self._sliding_angles(answer.x))

    def _try_nearest_motion(self, x: FloatArray, sliding_angles: dict[int, float]) -> None:
        """Keep the best answer along the least-squares motion to the friction in x."""
        contacts = [*sliding_angles, *self.always]
        wanted = np.zeros((len(contacts), 2))
        wanted[: len(sliding_angles)] = -x[
            self._formulation.coordinates.tangent_columns[[*sliding_angles]]
        ]
        sliding, motion = self.motions.kinematics.nearest.sliding(tuple(contacts), wanted)
        if sliding is not None:
            self._keep_best_along(motion, sliding_angles)

    def _keep_if_better(
        self, answer: Answer, motion: FloatArray, sliding_angles: dict[int, float]
    ) -> None:
        """Keep an answer with its motion, if it is the best so far."""
        state, kinematics = self.state, self.motions.kinematics
        if answer.value >= state.best_value:
            return
        velocities = kinematics.rows @ motion
        selection = np.zeros(len(velocities), dtype=bool)
        selection[[*sliding_angles, *self.always]] = True
        size, along = float(np.linalg.norm(velocities)), velocities[:, 1:]
        moves = selection[:, None] & (np.abs(along) > RANK_TOLERANCE * size)
        slowest = np.linalg.norm(along[selection], axis=1).min(initial=np.inf)
        is_clear = bool(slowest >= CLEARLY * kinematics.threshold * size)
        signs = np.where(moves, np.sign(along), 0.0).astype(np.int8)
        mode = SlidingMode.unchecked(selection, signs)
        state.keep(answer, FoundMode(mode, motion, is_clear))


def search_modes(state: SearchState) -> Status:
    """Find the optimum over all feasible modes, kept in the state, and return the status.

    Raises:
        ArgumentError: If the rule of directions does not take the objective or the search.
    """
    try:
        if state.options.search is Search.ENUMERATE:
            state.rules.need_signs("search='enumerate'")
            return search_exhaustively(state)
        return (search_directions if state.rules.by_direction else branch_and_bound)(state)
    except UndecidedMotionError:
        return state.undecided_status()
