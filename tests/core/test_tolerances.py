"""What the tolerances of a proof let pass: each is tried on both of its sides."""

from dataclasses import replace

import numpy as np
import pytest

from graspless_pin.programs import answers
from graspless_pin.programs.active_set import active_set_of, optimum_on_active_set
from graspless_pin.programs.active_set_polish import polished_answer
from graspless_pin.programs.answers import (
    UNREACHED,
    checked_answer,
    proven_answer,
    without_far_limits,
)
from graspless_pin.programs.program import FARTHEST, Program
from graspless_pin.solvers import Outcome

NONE = np.zeros(0)


def program(
    cost: float = 1.0,
    rows: tuple[tuple[float, float, float], ...] = (),
    bounds: tuple[float, float] = (0.0, 1.0),
    box: tuple[float, float] | None = None,
) -> Program:
    """Minimise cost x over bounds, with rows of coefficient, lower and upper side."""
    table = np.array(rows, dtype=float).reshape(-1, 3)
    implied = np.array([bounds if box is None else box]).T
    return Program(
        np.zeros(1), np.array([cost]), np.zeros((0, 1)), NONE, table[:, :1], table[:, 1],
        table[:, 2], np.array([bounds[0]]), np.array([bounds[1]]), implied,
    )  # fmt: skip


def outcome(one: Program, x: float, z: tuple[float, ...] = (), cutoff: float = np.inf) -> Outcome:
    return proven_answer(one, (np.array([x]), NONE, np.array(z)), "", cutoff).outcome


@pytest.mark.parametrize(("off", "passes"), [(0.9e-7, True), (1.1e-7, False), (1e-5, False)])
def test_a_value_above_its_bound(off, passes):
    assert outcome(program(), off) is (Outcome.SOLVED if passes else Outcome.FAILED)


@pytest.mark.parametrize(("off", "passes"), [(0.9e-8, True), (1.1e-8, False), (9e-8, False)])
def test_a_value_below_its_bound(off, passes):
    """Every constraint holds to 1e-7, and yet the value is better than any can be."""
    assert outcome(program(10.0), -off) is (Outcome.SOLVED if passes else Outcome.FAILED)


@pytest.mark.parametrize("cost", [1.0, 1e3, 1e6])
def test_the_gap_is_relative_to_large_values(cost):
    one = program(cost, bounds=(1.0, 2.0))
    assert outcome(one, 1.0 + 0.9e-7) is Outcome.SOLVED
    assert outcome(one, 1.0 + 1.2e-7) is Outcome.FAILED


@pytest.mark.parametrize("x", [-1.1e-7, 1.0 + 1.1e-7, -1e-5])
def test_a_point_beyond_a_bound(x):
    one = program(0.0)
    assert outcome(one, x) is Outcome.FAILED
    assert outcome(one, float(np.clip(x, -0.9e-7, 1.0 + 0.9e-7))) is Outcome.SOLVED


@pytest.mark.parametrize("cutoff", [0.5, -3.0, 2e3])
def test_a_bound_is_above_the_cutoff_when_it_clearly_is(cutoff):
    one = program(1.0, bounds=(cutoff, 3e3))
    size = max(1.0, abs(cutoff))
    for off, out in ((0.9e-8, False), (1.1e-8, True), (1e-6, True)):
        found = outcome(one, cutoff, cutoff=cutoff - off * size)
        assert found is (Outcome.INFEASIBLE if out else Outcome.SOLVED)


@pytest.mark.parametrize("farthest", [10.0, 1e6])
def test_a_bound_is_above_the_cutoff_by_more_than_its_multipliers_may_round(farthest):
    """Of two rows that are apart, 1e-14 of the farthest variable counts for each multiplier."""
    rounding = 2e-14 * farthest
    for apart, out in ((0.9 * rounding, False), (1.1 * rounding, True)):
        one = program(rows=((1.0, -np.inf, 0.0), (1.0, apart, np.inf)), bounds=(0.0, farthest))
        multiplier = 1.0 / apart
        found = outcome(one, 0.0, z=(multiplier, -multiplier), cutoff=0.0)
        assert (found is Outcome.INFEASIBLE) == out


@pytest.mark.parametrize(("apart", "proof"), [(0.9e-8, False), (1.1e-8, True), (1e-6, True)])
def test_a_violation_that_no_point_avoids_is_a_proof_if_it_is_larger_than_rounding(
    apart, proof, monkeypatch
):
    # Otherwise the point would be put right to within the tolerance.
    monkeypatch.setattr(answers, "polished_answer", lambda *_: None)
    one = program(rows=((1.0, -np.inf, -apart),))

    def backend(asked: Program):
        if len(asked.c) > 1:
            return None  # the elastic program is not answered
        return np.ones(1), NONE, np.array([7.0])

    answer = checked_answer(one, backend, "", np.inf)
    assert answer.outcome is (Outcome.INFEASIBLE if proof else Outcome.FAILED)
    if proof:
        assert answer.proof == pytest.approx(apart)


@pytest.mark.parametrize("size", [10.0, 5e4, 5e7])
def test_a_solver_that_bears_no_large_figures_is_asked_for_a_shrunk_program(size):
    one = program(rows=((1.0, 0.7 * size, size),), bounds=(0.0, 2.0 * size))

    def backend(asked: Program):
        if max(np.abs(asked.u).max(), asked.ub.max()) > 101.0:
            return None
        return asked.l.copy(), NONE, np.array([-1.0])

    answer = checked_answer(one, backend, "", np.inf)
    assert answer.outcome is Outcome.SOLVED
    assert answer.x == pytest.approx([0.7 * size])


def test_limits_that_no_double_resolves_are_kept_from_solvers():
    near, far = 0.9e8, 1.1e8
    one = program(rows=((1.0, -far, near), (1.0, -near, far), (1.0, -far, far)), bounds=(-far, far))
    easier = without_far_limits(one)
    np.testing.assert_array_equal(easier.l, [-np.inf, -near, -np.inf])
    np.testing.assert_array_equal(easier.u, [near, np.inf, UNREACHED])
    assert (easier.lb[0], easier.ub[0]) == (-np.inf, np.inf)
    # A thousand variables stay below it that are as large as proofs reach, and beside it solvers
    # still see the load.
    assert UNREACHED >= 1e3 * FARTHEST
    assert UNREACHED * np.finfo(float).eps <= 1e-3


def test_active_constraints_that_contradict_each_other_by_a_hair_are_not_carried_over():
    first = program(rows=((1.0, 0.0, np.inf), (1.0, -np.inf, 0.0)), bounds=(-1.0, 1.0))
    answer = proven_answer(first, (np.zeros(1), NONE, np.array([-1.5, 0.5])), "", np.inf)
    near = active_set_of(first, answer)
    assert near is not None
    assert len(near.rows) == 2
    for apart, exact in ((1e-9, True), (4e-9, False), (1e-8, False), (1e-7, False)):
        other = program(rows=((1.0, 0.0, np.inf), (1.0, -np.inf, -apart)), bounds=(-1.0, 1.0))
        assert (optimum_on_active_set(other, near, np.inf) is not None) == exact


def vertex(seed: int, *, apart: float | None = None) -> tuple[Program, np.ndarray, tuple]:
    """A linear program with one optimum, which is known with its multipliers.

    Three equalities and the first five rows are active there; the second of these is the first but
    for a part, if one is given.
    """
    rng = np.random.default_rng(seed)
    optimum = rng.uniform(-0.5, 0.5, 8)
    A, G = rng.normal(size=(3, 8)), rng.normal(size=(16, 8))
    if apart is not None:
        G[1] = G[0] + apart * rng.normal(size=8)
    u = G @ optimum
    u[5:] += rng.uniform(0.1, 1.0, 11)
    y, z = rng.normal(size=3), np.append(rng.uniform(0.5, 2.0, 5), np.zeros(11))
    far = 10.0 * np.ones(8)
    one = Program(
        np.zeros(8), -(y @ A + z @ G), A, A @ optimum, G, np.full(16, -np.inf), u, -far, far,
        np.array([-far, far]),
    )  # fmt: skip
    return one, optimum, (y, z)


@pytest.mark.parametrize("apart", [None, 0.0, 1e-15, 1e-13, 1e-10, 1e-9, 3e-8, 1e-7, 1e-5])
def test_an_answer_near_the_optimum_is_brought_to_rounding(apart):
    """Also where two active rows are all but the same, or the same up to rounding."""
    for seed in range(20):
        one, optimum, (y, z) = vertex(seed, apart=apart)
        rng = np.random.default_rng(seed)
        rough = z + 1e-6 * rng.normal(size=16) * (z > 0.0)
        found = polished_answer(one, (optimum + 1e-6 * rng.normal(size=8), y + 1e-6, rough))
        assert found is not None
        bound, value, residual = one.assess(*found)
        assert residual <= 2e-15
        assert abs(value - bound) <= 2e-13


@pytest.mark.parametrize("size", [1e2, 1e4, 1e6])
def test_multipliers_between_rows_that_say_the_same_take_nothing_from_a_proof(size):
    """Two equal rows whose sides differ by rounding: their multipliers may cancel at any size."""
    one, optimum, (y, z) = vertex(3)
    off = 1e-10
    twice = replace(one, A=np.vstack([one.A, one.A[0]]), b=np.append(one.b, one.b[0] + off))
    found = optimum, np.append(y + np.array([size, 0.0, 0.0]), -size), z
    assert proven_answer(twice, found, "", np.inf).outcome is (
        Outcome.SOLVED if size * off < 1e-7 else Outcome.FAILED
    )
    nearer = polished_answer(twice, found)
    assert nearer is not None
    assert proven_answer(twice, nearer, "", np.inf).outcome is Outcome.SOLVED
    bound, value, _ = twice.assess(*nearer)
    assert abs(value - bound) <= 10.0 * off


def test_multipliers_that_cancel_but_for_a_variable_at_its_limit_take_nothing_from_a_proof():
    one, optimum, (y, z) = vertex(3)
    off, size = 1e-10, 1e4
    A, held = np.vstack([one.A, one.A[0]]), optimum[0]
    A[3, 0] += 0.5
    upper = one.ub.copy()
    upper[0] = held
    beside = replace(one, A=A, b=np.append(one.b, one.b[0] + 0.5 * held + off), ub=upper)
    found = optimum, np.append(y + np.array([size, 0.0, 0.0]), -size), z
    assert proven_answer(beside, found, "", np.inf).outcome is Outcome.FAILED
    nearer = polished_answer(beside, found)
    assert nearer is not None
    assert proven_answer(beside, nearer, "", np.inf).outcome is Outcome.SOLVED


@pytest.mark.parametrize(("near", "seed"), [(1, 0), (2, 6), (3, 0), (3, 69), (4, 6), (5, 19)])
def test_rows_that_pass_by_an_optimum_are_told_from_those_that_hold_it(near, seed):
    """An answer in front of them gives them small multipliers, which there turn out negative.

    Without these rows the multipliers of others may turn out negative, too: four times here.
    """
    rng = np.random.default_rng(seed)
    one, optimum, (y, z) = vertex(seed)
    by, upper = slice(5, 5 + near), one.u.copy()
    upper[by] = one.G[by] @ optimum + 1e-6 * rng.uniform(0.1, 1.0, near)
    z[by] = 1e-3 * rng.uniform(0.1, 1.0, near)
    one = replace(one, u=upper)
    rough = np.maximum(z + 3e-3 * rng.normal(size=16) * (z > 0.1), 0.0)
    near_by = optimum + 1e-6 * rng.normal(size=8), y + 3e-3 * rng.normal(size=3), rough
    found = polished_answer(one, near_by)
    assert found is not None
    bound, value, residual = one.assess(*found)
    assert residual <= 1e-9
    assert abs(value - bound) <= 1e-9
