"""Parts of the searches: what counts as equal, what a failed node leaves, how nodes are split."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from random_scenes import general_scene
from scenes import random_problem, scene, structured_arguments

from graspless_pin import (
    QuasistaticProblem,
    Status,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms import branch_and_bound as searching
from graspless_pin.algorithms import search
from graspless_pin.algorithms.branch_and_bound import (
    _level,
    _Node,
    _resolving,
    branch_and_bound,
)
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_oracle import ModeOracle
from graspless_pin.algorithms.mode_sets import ModePart
from graspless_pin.algorithms.search import SearchState, closeness
from graspless_pin.modes.feasibility import Conflict, Requirement
from graspless_pin.modes.propagation import Decisions
from graspless_pin.modes.rules import Rules, SignRule, SlidingMode, SlidingRule
from graspless_pin.modes.witness_heuristics import NearestMotions
from graspless_pin.problem.scales import scales_of
from graspless_pin.programs.answers import Answer, failed
from graspless_pin.programs.objectives import Margin
from graspless_pin.solvers import Outcome

RULES = Rules.parse()
SPLIT = [
    QuasistaticProblem(**structured_arguments(seed, kind, 4))
    for kind, seed in (("slab", 2), ("slab", 4), ("slab", 9), ("planar", 0))
]
"""Problems in which the relaxation's friction has no motion behind it."""


def state_of(problem: QuasistaticProblem) -> SearchState:
    return SearchState(formulate(problem, Margin()), RULES, "piqp")


def test_values_count_as_equal_where_they_are_so_to_a_tenth_of_a_gap():
    assert closeness(0.0) == closeness(-0.5) == closeness(1.0) == 2e-8
    assert closeness(50.0) == closeness(-50.0) == pytest.approx(1e-6)
    assert closeness(np.inf) == 2e-8


@pytest.mark.parametrize("value", [-0.3, -1.0, -40.0])
def test_a_search_is_closed_where_no_node_can_be_better(value):
    state = state_of(scene("rest"))
    assert not state.closed(-1e9)
    answer = state.relax()
    state.best = answer.moved(answer.x, value, 0.0)
    size = max(1.0, abs(value))
    assert state.closed(value + 1e-3)
    assert state.closed(value - 1.9e-8 * size)
    for below in (2.1e-8, 1e-7, 1e-5):
        assert not state.closed(value - below * size)


def test_an_answer_whose_forbidden_friction_costs_something_is_not_the_modes_own():
    problem = SPLIT[0]
    best = maximize_margin(problem)
    state = state_of(problem)
    relaxed = state.relax()
    assert relaxed.value < -best.margin / problem.scales.force - 1e-3
    # The relaxation's friction is not all of this mode's: its own program is solved instead.
    assert not state.accept(relaxed, best.mode)
    assert state.best is not None
    assert -state.best.value * problem.scales.force == pytest.approx(best.margin, abs=1e-6)
    assert (state.formulation.program.residual(state.best.x)) <= 1e-7


@pytest.mark.parametrize("index", range(len(SPLIT)))
def test_what_a_failed_node_may_hold_stays_in_the_bound(index, monkeypatch):
    """Whichever node no solver answers, the bound holds for the optimum that may be in it."""
    problem = SPLIT[index]
    best = maximize_margin(problem)
    honest = SearchState.solve
    assert best.found
    for number in range(1, best.certificate.force_programs + 3):
        calls = iter(range(10**6))

        def solve(state, lb, ub, number=number, calls=calls):
            if next(calls) == number:
                state.unproven_bound = -np.inf
                return failed(-np.inf)
            return honest(state, lb, ub)

        monkeypatch.setattr(SearchState, "solve", solve)
        # A guess would find the best mode before the search does.
        monkeypatch.setattr(searching, "_guess", lambda *_: None)
        result = branch_and_bound(state_of(problem))
        bound = result.state.bound * result.state.formulation.unit
        assert bound >= best.margin - 1e-6
        failed_there = next(calls) > number
        assert (result.status is Status.OPTIMAL) == (not failed_there)
        if result.state.best is not None:
            assert -result.state.best.value * problem.scales.force <= best.margin + 1e-6


@pytest.mark.parametrize(("below", "proven"), [(-1e-3, False), (1e-3, True)])
def test_a_program_without_an_answer_counts_by_its_bound(below, proven):
    """Where what is proven of it is no better than the best, nothing is left open."""
    state = state_of(SPLIT[0])
    best = branch_and_bound(state).state.best_value
    assert not state.unproven
    state.unproven_bound = best + below
    assert state.unproven is not proven
    assert (search.finished(state).status is Status.OPTIMAL) == proven


def admitted(decisions: Decisions, mode: tuple[tuple[int, int] | None, ...]) -> bool:
    """Whether a mode agrees with decisions."""
    for contact, signs in enumerate(mode):
        if signs is None:
            if decisions.selected[contact]:
                return False
            continue
        if decisions.released[contact]:
            return False
        known = decisions.signs[contact]
        if any(k not in (0, s) for k, s in zip(known, signs, strict=True)):
            return False
    return True


PAIRS: list[tuple[int, int]] = [(a, b) for a in (-1, 1) for b in (-1, 1)]


@pytest.mark.parametrize("seed", range(12))
def test_the_children_of_a_node_share_no_mode_and_lose_none(seed):
    """Each mode but those of the conflict is in one child and in no other."""
    rng = np.random.default_rng(seed)
    problem = random_problem(seed, 4)
    state = state_of(problem)
    program = state.formulation.program
    root = _Node(program.lb, program.ub, {}, Decisions.none(4))
    node = root
    if seed % 2:
        chosen = Decisions.none(4).sign(int(rng.integers(4)), 1, int(rng.choice((-1, 1))))
        assert chosen is not None
        node = _Node(program.lb, program.ub, {}, chosen)
    contacts = rng.permutation(4)
    count = int(rng.integers(1, 4))
    items = [(int(c), int(k)) for c in contacts[:count] for k in range(2) if k == 0 or c % 2]
    signs = tuple((c, k, int(rng.choice((-1, 1)))) for c, k in items)
    also = tuple(sorted(int(c) for c in contacts[count : count + seed % 3]))
    conflict = Conflict(signs, also, None)
    x = rng.normal(size=len(program.c))
    children = [child.decisions for child in _resolving(state, node, conflict, x)]
    for mode in product((None, *PAIRS), repeat=4):
        if not admitted(node.decisions, mode):
            continue
        excluded = all(mode[c] is not None for c in also)
        for c, k, sign in signs:
            pair = mode[c]
            excluded = excluded and pair is not None and pair[k] == sign
        holding = sum(admitted(child, mode) for child in children)
        assert holding == (0 if excluded else 1)


def test_what_can_only_be_flipped_is_flipped_first_and_frictionless_contacts_have_no_part():
    problem = random_problem(0, 4)
    friction = problem.friction * [1.0, 0.0, 1.0, 0.0]
    state = state_of(problem.with_changes(friction=friction))
    program = state.formulation.program
    chosen = Decisions.none(4).select(2)
    assert chosen is not None
    node = _Node(program.lb, program.ub, {}, chosen)
    x = np.zeros(len(program.c))
    x[state.formulation.friction_columns(0)] = 5.0
    signs = ((0, 0, 1), (1, 0, 1), (2, 1, -1), (3, 1, -1))
    first, second = (c.decisions for c in _resolving(state, node, Conflict(signs, (), None), x))
    assert (first.signs[2].tolist(), first.signs[0].tolist()) == ([0, 1], [0, 0])
    assert (second.signs[2].tolist(), second.signs[0].tolist()) == ([0, -1], [-1, 0])


def test_signs_of_a_part_are_those_that_all_its_modes_have():
    problem = scene("rest")
    mode = maximize_margin(problem).mode
    one, every = ModePart.one_mode(mode), ModePart.every_mode(problem, RULES)
    assert {sign for pair in mode.signs.tolist() for sign in pair} == {-1, 0, 1}
    for contact, signs in enumerate(mode.signs.tolist()):
        assert one.signs(contact) == tuple(signs)
        assert every.signs(contact) == (0, 0)


@pytest.mark.parametrize("sliding", SlidingRule)
def test_contacts_in_actual_sliding_are_selected_always_or_never(sliding):
    problem = scene("up")
    part = ModePart.every_mode(problem, Rules(sliding=sliding))
    constrained = sliding is SlidingRule.CONSTRAINED
    np.testing.assert_array_equal(part.selected, problem.is_sliding & constrained)
    np.testing.assert_array_equal(part.released, problem.is_sliding & (not constrained))


@pytest.mark.parametrize("sign", SignRule)
@pytest.mark.parametrize("seed", range(5))
def test_parts_hold_the_modes_that_have_or_lack_items(seed, sign):
    """Step by step against a list of all modes of three contacts, one of which may not slide."""
    rng, count = np.random.default_rng(seed), 3
    ways = (-1, 1) if sign is not SignRule.EXACT else (-1, 0, 1)
    pairs = [None, *((a, b) for a in ways for b in ways if a or b)]
    base = random_problem(seed, count)
    problem = base.with_changes(friction=[0.5, 0.0, 0.5], sliding=None)
    part, modes = ModePart.every_mode(problem, Rules(sign=sign)), set(product(pairs, repeat=count))
    modes = {mode for mode in modes if mode[1] is None}
    for _ in range(12):
        contact, component = int(rng.integers(count)), int(rng.integers(2))
        item = contact, component, int(rng.integers(-1, 2))
        has = {
            mode for mode in modes
            if (pair := mode[contact]) is not None and item[2] in (0, pair[component])
        }  # fmt: skip
        holding, breaking = part.holding(item), part.breaking(item)
        assert (holding is not None) == bool(has)
        assert (breaking is not None) == bool(modes - has)
        part, modes = (holding, has) if rng.random() < 0.4 else (breaking, modes - has)
        if part is None:
            return
        for one in range(count):
            left = {mode[one] for mode in modes}
            if part.selected[one]:
                assert None not in left
            assert part.released[one] == (left == {None})
            known = [{pair[k] for pair in left if pair is not None} for k in range(2)]
            if part.selected[one]:
                assert part.pairs(one) == sorted(left)
                assert part.knows(one) == (len(left) == 1)
                alone = tuple(one.pop() if len(one) == 1 else 0 for one in known)
                assert sign is SignRule.EXACT or part.signs(one) == alone


def test_one_given_mode_takes_one_program_of_motions_and_counts_as_one():
    problem = scene("rest")
    certificate = maximize_margin(problem, mode=maximize_margin(problem).mode).certificate
    counts = certificate.nodes, certificate.modes_examined, certificate.kinematic_programs
    assert counts == (1, 1, 1)


def test_a_search_by_listing_solves_maximal_modes_alone():
    problem = SPLIT[0]
    counts = [len(list(enumerate_modes(problem, maximal=maximal))) for maximal in (True, False)]
    listed = maximize_margin(problem, search="enumerate").certificate
    assert listed.modes_examined == 1 + counts[0] < counts[1]
    assert listed.nodes == listed.modes_examined == listed.force_programs


@pytest.mark.parametrize("name", ["sphere", "rest", "up"])
@pytest.mark.parametrize("sign_rule", ["strict", "exact", "nonzero"])
def test_no_node_has_more_than_one_mode_and_each_has_a_program(name, sign_rule):
    problem = scene(name).with_changes(cone="round")  # no compiled loop answers it
    certificate = minimize_torque(problem, 0.1, sign_rule=sign_rule).certificate
    assert 1 <= certificate.modes_examined <= certificate.nodes <= certificate.force_programs


@pytest.mark.parametrize(("size", "is_friction"), [(0.9e-8, False), (1.1e-8, True), (1e-6, True)])
def test_the_least_friction_that_counts(size, is_friction):
    state = state_of(scene("rest"))
    reader: ModeOracle = state.oracle
    x = np.zeros(len(state.formulation.program.c))
    column = state.formulation.cone_columns[0][1, 0]
    x[column] = -size
    friction = reader._friction(x)
    assert isinstance(friction, dict)
    contact = state.formulation.cone_contacts[1]
    assert friction[contact] == ((-1, 0) if is_friction else (0, 0))
    assert all(pair == (0, 0) for other, pair in friction.items() if other != contact)
    assert reader.describe(x).selection[contact] == is_friction


def slider(turned: float) -> QuasistaticProblem:
    """A block on a floor and a wall whose first tangents are turned from the one way it slides."""
    points = [[0.1, 0.1, -0.1], [-0.1, 0.1, -0.1], [0, -0.05, -0.1], [0.1, -0.1, -0.1]]
    points.append([-0.1, -0.1, -0.1])
    normals = np.array([[0, 0, 1.0]] * 3 + [[0, 1.0, 0]] * 2)
    first = np.array([1.0, 0.0, 0.0])
    c, s = np.cos(turned), np.sin(turned)
    tangents = []
    for normal in normals:
        other = np.cross(normal, first)
        tangents.append(np.column_stack([c * first + s * other, -s * first + c * other]))
    return QuasistaticProblem(
        points, normals, [6, -5, -10, -0.5, -0.6, 0], friction=0.5, tangents=tangents, cone_edges=8
    )


def share_of(turned: float) -> float:
    """How fast the block slides along its second tangents, over all contact velocities.

    All five contacts move along x alike.
    """
    return float(np.sin(turned) / np.sqrt(5.0))


@pytest.mark.parametrize(
    ("times", "counts"), [(0.99, False), (1.005, True), (1.1, True), (0.5, False), (30.0, True)]
)
def test_a_sliding_counts_from_a_millionth_of_the_motion_on(times, counts):
    """The same in a search for a motion, in its nearest ones, and for a given motion."""
    turned = float(np.arcsin(1e-6 * times * np.sqrt(5.0)))
    assert share_of(turned) == pytest.approx(1e-6 * times)
    state = state_of(slider(turned))
    kinematics = state.formulation.kinematics
    asked = [Requirement(contact, (1, -1)) for contact in range(5)]
    assert kinematics.feasible(asked, SignRule.STRICT) == counts
    assert (kinematics.witness(asked, SignRule.STRICT) is not None) == counts
    along = np.array([[0.0, np.cos(turned), -np.sin(turned)]] * 5)
    assert kinematics.counts(along, asked, SignRule.STRICT) == counts


@pytest.mark.parametrize(("times", "seen"), [(0.9, False), (1.1, True), (9.0, False), (11.0, True)])
def test_a_sliding_that_is_clear_needs_no_search(times, seen):
    """Ten times the threshold is clear; between them a search has to tell."""
    clearly = 10.0 if times > 5.0 else 1.0
    turned = float(np.arcsin(1e-6 * times * np.sqrt(5.0)))
    kinematics = state_of(slider(turned)).formulation.kinematics
    nearest = kinematics.nearest if clearly == 10.0 else NearestMotions(kinematics.rows, 1e-6)
    signs = np.array([1.0, -1.0] * 5)
    assert (nearest.guessed_witness((0, 1, 2, 3, 4), signs) is not None) == seen


@pytest.mark.parametrize(("times", "clear"), [(1.1, False), (9.0, False), (11.0, True)])
def test_a_mode_that_a_search_has_found_is_clear_by_the_same_rule(times, clear):
    """It is not asked for once more then, to tell whether the answer hangs on the threshold."""
    state = state_of(slider(float(np.arcsin(1e-6 * times * np.sqrt(5.0)))))
    friction = np.zeros(len(state.formulation.program.c))
    friction[state.formulation.cone_columns[0]] = -1.0, 1.0
    mode = state.oracle.mode_for(friction, {0: (1, -1)})
    assert isinstance(mode, SlidingMode) and mode.contacts == (0, 1, 2, 3, 4)
    assert state.oracle.is_clear == clear


@pytest.mark.parametrize(("tilt", "shared"), [(1e-9, True), (5e-9, True), (1e-7, False)])
def test_normals_that_differ_by_rounding_share_a_motion(tilt, shared):
    """Four corners on one plane, one normal of which is off."""
    corners = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]]
    normals = np.array([[0.0, 0.0, 1.0]] * 4)
    normals[0] = np.array([tilt, 0.7 * tilt, 1.0])
    problem = QuasistaticProblem(corners, normals, [0, 0, -1, 0, 0, 0], friction=0.5)
    kinematics = state_of(problem).formulation.kinematics
    assert kinematics.touching((0, 1, 2, 3)).basis.shape[1] == (3 if shared else 2)


def test_outcomes_are_told_apart():
    assert {one.value for one in Outcome} == {"solved", "infeasible", "failed"}


def test_a_lever_of_no_length_has_the_scale_of_a_very_short_one():
    jacobian = np.zeros((3, 4))
    jacobian[0] = [0.2, 0.2 * 3e-12, 0.2 * 1e-15, 0.0]
    problem = QuasistaticProblem(
        [[0.1, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [0, 0, -5.0, 0, 0, 0], jacobian=jacobian, friction=0.5
    )
    scales = problem.scales
    assert scales.force == 5.0
    np.testing.assert_allclose(scales.joints, [1.0, 3e-12, 1e-12, 1e-12], rtol=1e-12)


@pytest.mark.parametrize("seed", range(4))
def test_the_length_of_one_contact_is_the_lever_of_the_load(seed):
    rng = np.random.default_rng(seed)
    position, wrench = rng.normal(size=(1, 3)), rng.normal(size=6)
    found = scales_of(position, wrench, np.zeros((3, 1)), np.ones(1))
    moment = wrench[3:] - np.cross(position[0], wrench[:3])
    pull = np.linalg.norm(wrench[:3])
    assert found.force == pytest.approx(pull)
    assert found.length == pytest.approx(np.linalg.norm(moment) / pull)


@pytest.mark.parametrize("seed", [5, 8, 90, 166])
def test_rounding_of_equal_bounds_does_not_lead_the_search_about(
    seed: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """A plateau: many nodes prove what the relaxation does, and the deepest comes next."""
    problem = general_scene(seed, 24)
    solve, rng = SearchState.solve, np.random.default_rng(seed)

    def proves_less(noise: float) -> int:
        def solved(state: SearchState, lb: np.ndarray, ub: np.ndarray) -> Answer:
            answer = solve(state, lb, ub)
            return replace(answer, bound=answer.bound - noise * rng.uniform())

        monkeypatch.setattr(SearchState, "solve", solved)
        solution = maximize_margin(problem)
        assert solution.status is Status.OPTIMAL
        return solution.certificate.nodes

    nodes = proves_less(0.0)
    assert {proves_less(1e-9) for _ in range(4)} == {nodes}


def test_children_come_in_turn_by_what_their_parent_proves_beyond_rounding():
    for before in (-0.5, -1.0, 30.0):
        step = 0.5 * closeness(before)
        assert _level(before, before + 0.99 * step) == before
        assert _level(before, before + 1.01 * step) == before + 1.01 * step
        assert _level(before, before - 1.0) == before


@pytest.mark.parametrize("number", [4, 8])
def test_a_guess_near_the_first_optimum_ends_the_search(number, monkeypatch):
    problem = random_problem(number)
    assert minimize_torque(problem, 0.05).certificate.nodes == 1
    monkeypatch.setattr(searching, "_guess", lambda *_: None)
    assert minimize_torque(problem, 0.05).certificate.nodes > 1
