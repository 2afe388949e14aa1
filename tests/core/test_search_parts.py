"""Parts of the searches: what counts as equal, what a failed node leaves, how nodes are split."""

import time
from dataclasses import replace
from itertools import islice

import numpy as np
import pytest
from random_scenes import general_scene
from scenes import scene, structured_arguments

from graspless_pin import (
    QuasistaticProblem,
    Status,
    enumerate_modes,
    maximize_margin,
)
from graspless_pin.algorithms import branch_and_bound as searching
from graspless_pin.algorithms.branch_and_bound import branch_and_bound, search_modes
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_oracle import FoundMode, ModeOracle
from graspless_pin.algorithms.mode_tree import ModePart, ModeTree
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import SearchState
from graspless_pin.modes.rules import Rules
from graspless_pin.programs.answers import Answer, failed_answer
from graspless_pin.programs.objectives import Margin, Torque
from graspless_pin.solution.certificate import ContactSplit
from graspless_pin.solvers import Outcome
from graspless_pin.tree_search import NO_LIMITS, Limits

RULES = Rules.parse()
SPLIT = [
    QuasistaticProblem(**structured_arguments(seed, kind, 4))
    for kind, seed in (("slab", 2), ("slab", 4), ("slab", 9), ("planar", 0))
]
"""Problems in which the relaxation's friction has no motion behind it."""


def state_of(problem: QuasistaticProblem) -> SearchState:
    return SearchState(formulate(problem, Margin()), SolveOptions(RULES, "piqp"))


@pytest.mark.parametrize("value", [-0.3, -1.0, -40.0])
def test_a_search_is_closed_where_no_node_can_be_better(value):
    state = state_of(scene("rest"))
    assert not state.is_closed(-1e9)
    answer = state.relax()
    state.best = answer.at_point(answer.x, value, 0.0)
    size = max(1.0, abs(value))
    assert state.is_closed(value + 1e-3)
    assert state.is_closed(value - 1.9e-8 * size)
    for below in (2.1e-8, 1e-7, 1e-5):
        assert not state.is_closed(value - below * size)


def test_a_guessed_mode_near_the_relaxations_friction_spares_nodes():
    """No motion is behind that friction, but the guessed mode's own program is as good."""
    solution = maximize_margin(general_scene(31, 6, joints=(1, 2)))
    assert solution.status is Status.OPTIMAL
    assert (solution.certificate.nodes, solution.certificate.force_programs) == (1, 2)


def test_an_answer_whose_forbidden_friction_costs_something_is_not_the_modes_own():
    problem = SPLIT[0]
    best = maximize_margin(problem)
    state = state_of(problem)
    relaxed = state.relax()
    assert relaxed.value < -best.margin / problem.scales.force - 1e-3
    # The relaxation's friction is not all of this mode's: its own program is solved instead.
    assert not state.offer(relaxed, FoundMode(best.mode))
    assert state.best is not None
    assert -state.best.value * problem.scales.force == pytest.approx(best.margin, abs=1e-6)
    assert (state.formulation.program.residual(state.best.x)) <= 1e-7


@pytest.mark.sampled(2)
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
                return failed_answer(-np.inf)
            return honest(state, lb, ub)

        monkeypatch.setattr(SearchState, "solve", solve)
        # A guess would find the best mode before the search does.
        monkeypatch.setattr(searching, "_try_guessed_modes", lambda *_: None)
        state = state_of(problem)
        status = branch_and_bound(state)
        bound = state.bound * state.formulation.signed_unit
        assert bound >= best.margin - 1e-6
        failed_there = next(calls) > number
        assert (status is Status.OPTIMAL) == (not failed_there)
        if state.best is not None:
            assert -state.best.value * problem.scales.force <= best.margin + 1e-6


@pytest.mark.parametrize(("below", "proven"), [(-1e-3, False), (1e-3, True)])
def test_a_program_without_an_answer_counts_by_its_bound(below, proven):
    """Where what is proven of it is no better than the best, nothing is left open."""
    state = state_of(SPLIT[0])
    branch_and_bound(state)
    best = state.best_value
    assert not state.unproven
    state.unproven_bound = best + below
    assert state.unproven is not proven
    assert (state.final_status() is Status.OPTIMAL) == proven


@pytest.mark.parametrize(("size", "is_friction"), [(0.9e-8, False), (1.1e-8, True), (1e-6, True)])
def test_the_least_friction_that_counts(size, is_friction):
    state = state_of(scene("rest"))
    reader: ModeOracle = state.oracle
    x = np.zeros(len(state.formulation.program.c))
    column = state.formulation.cone_columns[0][1, 0]
    x[column] = -size
    friction = reader._friction_signs(x)
    assert friction is not None
    contact = state.formulation.coordinates.layout.cones.tolist()[1]
    assert tuple(friction[contact]) == ((-1, 0) if is_friction else (0, 0))
    assert not np.delete(friction, contact, axis=0).any()
    assert reader.mode_of_friction(x).selection[contact] == is_friction


@pytest.mark.parametrize(("tilt", "shared"), [(1e-9, True), (5e-9, True), (1e-7, False)])
def test_normals_that_differ_by_rounding_share_a_motion(tilt, shared):
    """Four corners on one plane, one normal of which is off."""
    corners = [[0.1, 0.1, 0.0], [-0.1, 0.1, 0.0], [-0.1, -0.1, 0.0], [0.1, -0.1, 0.0]]
    normals = np.array([[0.0, 0.0, 1.0]] * 4)
    normals[0] = np.array([tilt, 0.7 * tilt, 1.0])
    problem = QuasistaticProblem(corners, normals, [0, 0, -1, 0, 0, 0], friction=0.5)
    kinematics = state_of(problem).formulation.kinematics
    assert kinematics.touching((0, 1, 2, 3)).basis.shape[1] == (3 if shared else 2)


def test_a_lever_of_no_length_has_the_scale_of_a_very_short_one():
    jacobian = np.zeros((3, 4))
    jacobian[0] = [0.2, 0.2 * 3e-12, 0.2 * 1e-15, 0.0]
    problem = QuasistaticProblem(
        [[0.1, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [0, 0, -5.0, 0, 0, 0], jacobian=jacobian, friction=0.5
    )
    scales = problem.scales
    assert scales.force == 5.0
    np.testing.assert_allclose(scales.joints, [1.0, 3e-12, 1e-12, 1e-12], rtol=1e-12)
    # Without any, joints count the load at the scene's length.
    scales = scene("rest").with_changes(jacobian=np.zeros((18, 2))).scales
    np.testing.assert_allclose(scales.joints, scales.force * scales.length, rtol=1e-12)


@pytest.mark.sampled(2)
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


@pytest.mark.parametrize("index", range(len(SPLIT)))
def test_traces_of_forbidden_friction_lead_nowhere(index, monkeypatch):
    """A solver may leave more than counts as none where a part of the modes allows none."""
    problem, honest = SPLIT[index], SearchState.solve
    best = maximize_margin(problem)

    def solve(state, lb, ub):
        answer = honest(state, lb, ub)
        if answer.outcome is not Outcome.SOLVED:
            return answer
        x = answer.x.copy()
        columns = state.formulation.cone_columns[0]
        x[columns] += 3e-8 * ((ub[columns] == 0.0) * 1.0 - (lb[columns] == 0.0))
        return answer.at_point(x, answer.value, answer.residual)

    monkeypatch.setattr(SearchState, "solve", solve)
    state = replace(state_of(problem), limits=Limits(node_limit=1000))
    assert branch_and_bound(state) is Status.OPTIMAL
    assert state.best is not None
    found = -state.best.value * problem.scales.force
    assert found == pytest.approx(best.margin, abs=1e-6)


def test_friction_that_hardly_counts_is_friction_where_no_rule_forbids_it():
    """Forty contacts share what none of them alone has enough of to count."""
    angles = np.linspace(0.0, 2.0 * np.pi, 40, endpoint=False)
    places = np.column_stack([np.cos(angles), np.sin(angles), np.zeros(40)])
    problem = QuasistaticProblem(
        places, np.tile([0.0, 0.0, 1.0], (40, 1)), [3e-7, 0, -1, 0, 0, 0], friction=0.5
    )
    found = maximize_margin(problem, static_friction="coulomb")
    assert found.status is Status.OPTIMAL
    balance = problem.W @ found.contact_forces.ravel() + problem.external_wrench
    assert np.abs(balance).max() < 1e-8


def test_two_sets_of_forces_that_oppose_each_other_split_that_contact():
    """Each set alone has a mode behind it; both together have none."""
    one = state_of(scene("rest"))
    search_modes(one)
    found = one.best
    assert found is not None
    assert isinstance(ModeOracle(one.formulation, RULES).mode_for(found.x), FoundMode)
    size = one.formulation.coordinates.layout.size
    two = replace(one.formulation, layers=(0, size))
    tree, oracle = ModeTree(two, RULES), ModeOracle(two, RULES)
    every = ModePart.every_mode(two.problem, RULES)
    for contact, component in ((0, 1), (2, 0), (4, 1)):
        x = np.concatenate([found.x[:size], found.x[:size]])
        column = one.formulation.coordinates.tangent_columns[contact, component]
        x[[column, size + column]] = 0.01, -0.01
        assert oracle.mode_for(x) is None and oracle.conflict_for(x, every) is None
        split = tree.split(every, x, None)
        assert split is not None and split[0] == ContactSplit(contact)
        assert len(split[1]) == 5  # released, or one of four pairs of signs


@pytest.mark.parametrize("sets", [1, 2])
@pytest.mark.parametrize("sign", ["strict", "nonzero", "exact"])
def test_friction_along_one_tangent_has_a_mode_behind_it_that_opposes_it(sign, sets):
    """Signs along the other tangent are open, and any mode that is listed has some."""
    problem, rules = scene("rest"), Rules.parse(sign)
    one = formulate(problem, Margin())
    size, cones = len(one.program.c), one.coordinates.layout.cones
    oracle = ModeOracle(replace(one, layers=tuple(size * k for k in range(sets))), rules)
    for listed in islice(enumerate_modes(problem, sign_rule=sign), 0, 300, 10):
        for component in (0, 1):
            friction = -0.1 * listed.signs[cones, component]
            x = np.zeros(size)
            x[one.cone_columns[0][:, component]] = friction
            found = oracle.mode_for(np.tile(x, sets))
            assert isinstance(found, FoundMode)
            opposed = found.mode.signs[cones, component] == -np.sign(friction)
            assert opposed[friction != 0.0].all()


def test_what_is_left_of_a_time_limit_goes_to_the_searches_that_follow():
    options = SolveOptions(time_limit=60.0)
    assert NO_LIMITS.with_time_left(options) is options
    left = Limits(None, time.monotonic() + 5.0).with_time_left(options).time_limit
    assert left is not None and 0.0 < left <= 5.0
    assert Limits(None, time.monotonic() - 1.0).with_time_left(options).time_limit == 0.0


@pytest.mark.parametrize("regularization", [0.0, 1e-2, 10.0])
@pytest.mark.parametrize("make", [Margin, lambda regularization: Torque(0.1, regularization)])
def test_no_point_of_a_box_has_a_worse_value_than_the_worst(regularization, make):
    program = formulate(scene("rest"), make(regularization=regularization)).program
    box = program.box if program.whole_box is None else program.whole_box
    ends = np.random.default_rng(0).integers(0, 2, (200, len(program.c)))
    values = [program.value(np.where(end == 1, *box)) for end in ends]
    assert 0.0 <= max(values) <= program.cutoff + 1e-9 * abs(program.cutoff)
    # No larger than what each variable makes at its farther end.
    alone = [max(program.value(np.where(np.arange(len(row)) == i, end, 0.0)) for end in box)
             for i, row in enumerate(np.eye(len(program.c)))]  # fmt: skip
    assert program.cutoff <= 1.01 * sum(max(one, 0.0) for one in alone) + 1e-9


def test_far_limits_leave_a_box_for_proofs_within_that_of_all_forces():
    near = formulate(scene("rest"), Margin()).program
    assert near.whole_box is None
    far = formulate(scene("rest").with_changes(max_normal_force=1e15), Margin()).program
    assert far.whole_box is not None
    assert (far.whole_box[0] <= far.box[0]).all() and (far.box[1] <= far.whole_box[1]).all()
    assert far.whole_box[1].max() > 1e3 * far.box[1].max()
