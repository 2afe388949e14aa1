"""Parts of which a mistake rarely shows in an answer, one by one."""

import time
from collections import Counter
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import scene

from graspless_pin import SlidingMode
from graspless_pin.algorithms import branch_and_bound as searching
from graspless_pin.algorithms import search
from graspless_pin.algorithms.branch_and_bound import _children, _deciding, _Node
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_oracle import ModeOracle, Opposition
from graspless_pin.algorithms.options import NO_LIMITS, Limits, SolveOptions
from graspless_pin.algorithms.search import SearchState
from graspless_pin.algorithms.searching import search_modes
from graspless_pin.errors import ArgumentError
from graspless_pin.modes.enumeration import _refinements
from graspless_pin.modes.fastest_sliding import Sliding, _evened
from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.propagation import Decisions
from graspless_pin.modes.rules import Rules, SignRule
from graspless_pin.problem.arguments import _checked_tangents
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.programs.objectives import Margin, Torque
from graspless_pin.programs.program import FARTHEST, Program
from graspless_pin.programs.reductions import near_multipliers, without_fixed

RULES = Rules.parse()


def state() -> SearchState:
    return SearchState(formulate(scene("rest"), Margin()), RULES, "piqp")


def test_friction_of_opposite_signs_splits_a_node_by_the_way_of_sliding(monkeypatch):
    one = state()
    answer = one.relax()
    monkeypatch.setattr(searching, "_guess", lambda *_: None)
    monkeypatch.setattr(ModeOracle, "mode_for", lambda *_: Opposition(3, 1))
    program = one.formulation.program
    root = _Node(program.lb, program.ub, {}, Decisions.none(6))
    children = _children(one, root, answer)
    assert children is not None
    assert [child.decisions.signs[3, 1] for child in children] == [1, -1]
    assert [np.count_nonzero(child.decisions.signs) for child in children] == [1, 1]


def test_two_sets_of_forces_oppose_each_other_where_one_component_differs_in_sign():
    one = state()
    size = one.formulation.coordinates.layout.size
    two = replace(one.formulation, layers=(0, size))
    x = np.concatenate([np.ones(size), np.ones(size)])
    for contact, component in ((0, 1), (2, 0), (4, 1)):
        spoilt = x.copy()
        spoilt[size + one.formulation.coordinates.tangent[contact, component]] = -1.0
        found = ModeOracle(two, RULES)._friction(spoilt)
        assert found == Opposition(contact, component)
    signs = ModeOracle(two, RULES)._friction(x)
    assert isinstance(signs, dict) and set(signs.values()) == {(1, 1)}


def test_a_mode_at_once_is_none_of_one_set_of_forces_alone():
    one = state()
    found = search_modes(one, SolveOptions(), NO_LIMITS).state.best
    assert found is not None
    assert isinstance(ModeOracle(one.formulation, RULES).mode_for(found.x, {}), SlidingMode)
    size = one.formulation.coordinates.layout.size
    two = replace(one.formulation, layers=(0, size))
    opposed = found.x[:size].copy()
    opposed[one.formulation.coordinates.tangent[0, 0]] *= -1.0
    x = np.concatenate([found.x[:size], opposed])
    assert ModeOracle(two, RULES).mode_for(x, {}) == Opposition(0, 0)


@pytest.mark.parametrize("make", [lambda _: scene("rest"), lambda seed: slope_scene(seed, 6)])
def test_a_component_rests_where_neither_sign_of_it_has_a_motion(make):
    """A conflict that names this component alone is asked for once, and holds both ways."""
    rng, seen = np.random.default_rng(1), Counter[int]()
    for seed in range(6):
        reader = ModeOracle(formulate(make(seed), Margin()), RULES)
        kinematics, count = reader.formulation.kinematics, len(reader.formulation.problem.normals)
        for _ in range(20):
            chosen = sorted(rng.choice(count, 4, replace=False).tolist())
            drawn = rng.integers(-1, 2, (4, 2)).tolist()
            known = [Requirement(c, (a, b)) for c, (a, b) in zip(chosen, drawn, strict=True)]
            if not kinematics.feasible(known, SignRule.STRICT):
                continue
            for index, (contact, signs) in enumerate(known):
                for component in {0, 1} - set(np.flatnonzero(signs)):
                    rests = True
                    for sign in (1, -1):
                        pair = (sign, signs[1]) if component == 0 else (signs[0], sign)
                        tried = known.copy()
                        tried[index] = Requirement(contact, pair)
                        rests &= not kinematics.feasible(tried, SignRule.STRICT)
                    conflicts = reader._resting(known, index, component)
                    assert bool(conflicts) is rests
                    seen[len(conflicts)] += 1
    assert seen[0] and seen[1] and not seen[2]


def test_an_open_sign_is_refined_both_ways_and_the_other_stays():
    assert _refinements((0, -1)) == [(1, -1), (-1, -1)]
    assert _refinements((0, 1)) == [(1, 1), (-1, 1)]
    assert _refinements((1, 0)) == [(1, 1), (1, -1)]
    assert _refinements((-1, 0)) == [(-1, 1), (-1, -1)]
    assert _refinements((1, -1)) == []


def program(low, high, bounds) -> Program:
    rows, count = np.ones((len(low), len(bounds))), len(bounds)
    lb, ub = np.array(bounds, dtype=float).T
    return Program(
        P=np.zeros(count), c=np.ones(count), A=np.zeros((0, count)), b=np.zeros(0), G=rows,
        l=np.array(low, dtype=float), u=np.array(high, dtype=float), lb=lb, ub=ub,
        box=np.vstack([-np.ones(count), np.ones(count)]),
    )  # fmt: skip


def test_only_multipliers_of_far_sides_are_left_out():
    far = 2.0 * FARTHEST
    one = program([-far, -1.0, -far, -1.0], [far, 1.0, 1.0, far], [(-1, 1)])
    for sign, kept in ((1.0, [0, 1, 1, 0]), (-1.0, [0, 1, 0, 1])):
        near = near_multipliers(one, np.full(4, sign))
        np.testing.assert_array_equal(near, sign * np.array(kept))


def test_only_variables_that_are_fixed_at_zero_are_dropped():
    one = program([0.0], [1.0], [(0, 0), (0, 1), (-1, 0), (1, 1), (-1, -1), (0, 2)])
    _, kept = without_fixed(one)
    assert kept is not None
    np.testing.assert_array_equal(kept, [False, True, True, True, True, True])
    assert without_fixed(program([0.0], [1.0], [(0, 1), (1, 1)]))[1] is None


@pytest.mark.parametrize(("slowest", "slow"), [(0.99e-5, True), (1.01e-5, False), (1.0, False)])
def test_a_motion_is_slow_below_ten_times_the_threshold(monkeypatch, slowest, slow):
    one = state()
    monkeypatch.setattr(type(one.formulation.kinematics), "slowest", lambda *_: slowest)
    monkeypatch.setattr(search, "requirements_of", lambda _: [])
    one.mode, one.mode_is_clear = object(), False  # type: ignore[assignment]
    assert search._is_slow(SimpleNamespace(state=one)) == slow  # type: ignore[arg-type]
    one.mode_is_clear = True
    assert not search._is_slow(SimpleNamespace(state=one))  # type: ignore[arg-type]


def test_limits_that_nothing_meets_are_refused_of_own_arrays_too():
    problem = scene("rest")
    given = {
        name: getattr(problem, name).copy()
        for name in ("positions", "normals", "external_wrench", "jacobian", "friction", "tangents",
                     "sliding", "gravity_torques")
    }  # fmt: skip
    rest = {
        "max_normal_force": 50.0, "joint_names": problem.joint_names,
        "joint_units": problem.joint_units,
    }  # fmt: skip
    same = np.full(problem.joint_count, 0.1)
    for edges in (3, 4, 8):
        made = problem_of_own_arrays(
            **given, **rest, cone_edges=edges, torque_limits=(same.copy(), same.copy())
        )
        # Taken as it is: nothing made the constructor look for a mistake.
        assert made.cone_edges == edges and made.positions is given["positions"]
    for bad in (-np.inf, np.inf):
        limits = np.full(problem.joint_count, bad)
        with pytest.raises(ArgumentError):
            problem_of_own_arrays(**given, **rest, cone_edges=8, torque_limits=(limits, limits))


@pytest.mark.parametrize("pair", [(0, 1), (0, 2), (1, 2)])
def test_any_two_axes_of_a_contact_that_are_not_orthogonal_are_refused(pair):
    axes = np.eye(3)[[2, 0, 1]]
    assert _checked_tangents(axes[None, 1:].transpose(0, 2, 1), axes[None, 0]).shape == (1, 3, 2)
    first, second = pair
    axes[second] = (axes[second] + 1e-3 * axes[first]) / np.sqrt(1.0 + 1e-6)
    with pytest.raises(ArgumentError, match="orthogonal"):
        _checked_tangents(axes[None, 1:].transpose(0, 2, 1), axes[None, 0])


def test_joints_without_any_lever_count_the_load_at_the_scenes_length():
    problem = scene("rest")
    scales = problem.with_changes(jacobian=np.zeros_like(problem.jacobian)).scales
    expected = np.full(problem.joint_count, scales.force * scales.length)
    np.testing.assert_allclose(scales.joints, expected, rtol=1e-12)


@pytest.mark.parametrize(("rule", "pairs"), [
    ("strict", {(1, 1), (1, -1), (-1, 1), (-1, -1)}),
    ("nonzero", {(1, 1), (1, -1), (-1, 1), (-1, -1)}),
])  # fmt: skip
def test_a_contact_is_decided_by_one_child_for_each_of_its_modes(rule, pairs):
    one = SearchState(formulate(scene("rest"), Margin()), Rules.parse(rule), "piqp")
    answer, program = one.relax(), one.formulation.program
    children = _deciding(one, _Node(program.lb, program.ub, {}, Decisions.none(6)), answer)
    assert children is not None
    (contact,) = {contact for child in children for contact in child.decided}
    forces = np.abs(answer.x[one.formulation.coordinates.layout.tangent]).sum(axis=1)
    assert forces[contact] == forces.max()
    released, *others = children
    assert released.decisions.released[contact] and not released.decided
    assert all(child.decisions.selected[contact] for child in others)
    known = {tuple(child.decisions.signs[contact].tolist()) for child in others}
    assert pairs <= known and len(known) == len(others)
    assert known == {child.decided[contact] for child in others}


def test_friction_vanishes_along_a_tangent_that_an_exact_mode_does_not_slide_along():
    one = SearchState(formulate(scene("rest"), Margin()), Rules.parse("exact"), "piqp")
    answer, program = one.relax(), one.formulation.program
    children = _deciding(one, _Node(program.lb, program.ub, {}, Decisions.none(6)), answer)
    assert children is not None
    seen = set()
    for child in children[1:]:
        ((contact, pair),) = child.decided.items()
        (columns,) = one.formulation.friction_columns(contact)
        held = (child.lb[columns] == 0.0) & (child.ub[columns] == 0.0)
        assert held.tolist() == [sign == 0 for sign in pair]
        seen.add(pair)
    assert len(seen) == 8


def test_a_motion_is_evened_where_that_makes_its_slowest_sliding_faster():
    weights = np.array([0.5, 0.5])
    moving, strict = np.eye(2), np.ones(2)
    uneven = Sliding(np.array([1.0, 0.1]), 0.1 / np.hypot(1.0, 0.1), weights)
    assert _evened(moving, strict, uneven).slowest == pytest.approx(np.sqrt(0.5))
    even = Sliding(np.array([1.0, 1.0]), np.sqrt(0.5) + 1e-9, weights)
    assert _evened(moving, strict, even) is even


def test_a_negative_margin_is_no_solution_but_with_a_regularization_any_value_may_be_one():
    assert Margin().cutoff == 0.0
    assert Margin(1e-3).cutoff == np.inf


def test_what_is_left_of_a_time_limit_goes_to_the_searches_that_follow():
    options = SolveOptions(time_limit=60.0)
    assert NO_LIMITS.within(options) is options
    left = Limits(None, time.monotonic() + 5.0).within(options).time_limit
    assert left is not None and 0.0 < left <= 5.0
    assert Limits(None, time.monotonic() - 1.0).within(options).time_limit == 0.0


@pytest.mark.parametrize("regularization", [0.0, 1e-2, 10.0])
@pytest.mark.parametrize("make", [Margin, lambda regularization: Torque(0.1, regularization)])
def test_no_point_of_a_box_has_a_worse_value_than_the_worst(regularization, make):
    program = formulate(scene("rest"), make(regularization=regularization)).program
    box = program.box if program.whole_box is None else program.whole_box
    ends = np.random.default_rng(0).integers(0, 2, (200, len(program.c)))
    values = [program.value(np.where(end == 1, *box)) for end in ends]
    assert 0.0 <= max(values) <= program.worst + 1e-9 * abs(program.worst)
    # No larger than what each variable makes at its farther end.
    alone = [max(program.value(np.where(np.arange(len(row)) == i, end, 0.0)) for end in box)
             for i, row in enumerate(np.eye(len(program.c)))]  # fmt: skip
    assert program.worst <= 1.01 * sum(max(one, 0.0) for one in alone) + 1e-9


def test_far_limits_leave_a_box_for_proofs_within_that_of_all_forces():
    near = formulate(scene("rest"), Margin()).program
    assert near.whole_box is None
    far = formulate(scene("rest").with_changes(max_normal_force=1e15), Margin()).program
    assert far.whole_box is not None
    assert (far.whole_box[0] <= far.box[0]).all() and (far.box[1] <= far.whole_box[1]).all()
    assert far.whole_box[1].max() > 1e3 * far.box[1].max()
