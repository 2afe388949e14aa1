"""The dictionary of small programs against HiGHS: random ones that grow, shrink and tie."""

from __future__ import annotations

import itertools
from types import SimpleNamespace

import numpy as np
import pytest

from graspless_pin.compiled import core
from graspless_pin.solvers import simplex
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer, SimplexOutcome

Array = np.ndarray
Program = tuple[Array, Array, Array, Array, Array, Array]

pytestmark = pytest.mark.skipif(core is None, reason="nothing is compiled")


def random_program(rng: np.random.Generator, *, whole: bool) -> Program:
    """Return R, low, high, c, lb, ub of a program; with whole numbers it has many ties."""
    n, m = rng.integers(2, 14), rng.integers(6, 40)
    rows = rng.normal(size=(m, n)) * (rng.random((m, n)) < 0.5)
    point, cost = rng.normal(size=n), rng.normal(size=n) * (rng.random(n) < 0.6)
    if whole:
        rows, point, cost = np.round(2.0 * rows), np.round(point), np.round(cost)
    at = rows @ point
    room = rng.exponential(size=(2, m + n)) * (rng.random((2, m + n)) < 0.6)
    room = np.where(rng.random((2, m + n)) < 0.4, np.inf, np.round(room) if whole else room)
    low, high = at - room[0, :m], at + room[1, :m]
    lb, ub = point - room[0, m:], point + room[1, m:]
    if rng.random() < 0.15:
        low[0] = high[0] = at[0] + 10.0
    return rows, low, high, cost, lb, ub


def made(program: Program) -> Simplex:
    own = Simplex(*program[3:])
    own.add_rows(*program[:3])
    return own


def by_highs(monkeypatch: pytest.MonkeyPatch, program: Program) -> SimplexAnswer:
    with monkeypatch.context() as patched:
        patched.setattr(simplex, "core", None)
        return made(program).solve()


def check(answer: SimplexAnswer, expected: SimplexAnswer, program: Program) -> None:
    """The same outcome and value, at a point that is allowed, proven by the marginals."""
    rows, low, high, cost, lb, ub = program
    assert answer.outcome is expected.outcome
    if answer.outcome is not SimplexOutcome.OPTIMAL:
        return
    value = float(cost @ expected.x)
    size = max(1.0, abs(value), float(np.abs(answer.x).max()))
    np.testing.assert_allclose(cost @ answer.x, value, atol=1e-8 * size)
    at = rows @ answer.x
    outside = max(np.max(low - at), np.max(at - high), np.max(lb - answer.x), np.max(answer.x - ub))
    assert outside < 1e-8 * size
    left = cost - rows.T @ answer.rows
    proven = 0.0
    for slope, least, most in ((answer.rows, low, high), (left, lb, ub)):
        counted = np.abs(slope) > 1e-9
        proven += float(slope[counted] @ np.where(slope > 0.0, least, most)[counted])
    np.testing.assert_allclose(proven, value, atol=1e-6 * size)


@pytest.mark.parametrize("whole", [False, True])
def test_programs_that_change_have_the_answers_of_highs(
    monkeypatch: pytest.MonkeyPatch, whole: bool
) -> None:
    rng, seen = np.random.default_rng(int(whole)), set[SimplexOutcome]()
    for _ in range(100):
        rows, low, high, cost, lb, ub = random_program(rng, whole=whole)
        own = Simplex(rng.permutation(cost), lb - 1.0, ub + 1.0)
        first = int(rng.integers(1, len(rows)))
        own.add_rows(rows[:first], low[:first] - 1.0, high[:first])
        own.solve()
        own.add_rows(rows[first:], low[first:], high[first:])
        own.solve()
        start, stop = sorted(rng.choice(len(rows) + 1, 2, replace=False).tolist())
        own.drop_rows(start, stop)
        kept = np.r_[:start, stop : len(rows)]
        assert own.row_count == len(kept)
        program = rows[kept], low[kept], high[kept], cost, lb, ub
        own.set_sides(np.arange(len(kept), dtype=np.int32), low[kept], high[kept])
        own.set_bounds(lb, ub)
        own.set_cost(cost)
        answer = own.solve()
        check(answer, by_highs(monkeypatch, program), program)
        seen.add(answer.outcome)
    assert seen == {
        SimplexOutcome.OPTIMAL, SimplexOutcome.INFEASIBLE, SimplexOutcome.UNBOUNDED,
    }  # fmt: skip


@pytest.mark.parametrize("whole", [False, True])
def test_the_dictionary_leaves_no_small_program_to_highs(whole: bool) -> None:
    """A mistake may hide behind the other solver's answer."""
    rng = np.random.default_rng(3)
    for _ in range(50):
        own = made(random_program(rng, whole=whole))
        assert simplex._OUTCOMES[own._engine.solve()[0]] != SimplexOutcome.FAILED


def test_a_hundred_changes_leave_no_rounding(monkeypatch: pytest.MonkeyPatch) -> None:
    rng = np.random.default_rng(5)
    rows, low, high, cost, lb, ub = random_program(rng, whole=False)
    lb, ub = np.maximum(lb, -50.0), np.minimum(ub, 50.0)
    own = made((rows, low - 5.0, high + 5.0, cost, lb, ub))
    for _ in range(100):
        cost = rng.normal(size=len(cost))
        own.set_cost(cost)
        own.solve()
    answer = own.solve()
    program = rows, low - 5.0, high + 5.0, cost, lb, ub
    check(answer, by_highs(monkeypatch, program), program)


def test_a_corner_where_many_rows_meet_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """All faces of a cone in four dimensions meet at zero: each pivot there is a tie."""
    signs = np.array(list(itertools.product((-1.0, 1.0), repeat=3)))
    faces = np.column_stack([signs, -np.ones(len(signs))])
    below = np.full(len(faces), -np.inf)
    rng, most = np.random.default_rng(2), np.full(4, np.inf)
    for _ in range(50):
        cost = rng.normal(size=4)
        bounds = np.array([np.inf, np.inf, np.inf, 1.0])
        program = faces, below, np.zeros(len(faces)), cost, -most, bounds
        check(made(program).solve(), by_highs(monkeypatch, program), program)


def test_what_the_dictionary_gives_up_is_solved_by_highs(monkeypatch: pytest.MonkeyPatch) -> None:
    assert core is not None

    class GivesUp(core.DenseSimplex):
        def solve(self) -> tuple[int, Array, Array]:
            return 3, np.zeros(0), np.zeros(0)

    program = random_program(np.random.default_rng(1), whole=False)
    monkeypatch.setattr(simplex, "core", SimpleNamespace(DenseSimplex=GivesUp))
    answer = made(program).solve()
    assert answer.outcome is SimplexOutcome.OPTIMAL
    check(answer, by_highs(monkeypatch, program), program)


def test_arrays_of_other_sizes_are_refused() -> None:
    assert core is not None
    with pytest.raises(ValueError, match="shape"):
        core.DenseSimplex(np.ones(2), np.zeros(3), np.ones(2))
    own = core.DenseSimplex(np.ones(2), np.zeros(2), np.ones(2))
    with pytest.raises(ValueError, match="shape"):
        own.add_rows(np.ones((1, 3)), np.ones(1), np.ones(1))
    with pytest.raises(ValueError, match="exist"):
        own.drop_rows(0, 1)
    with pytest.raises(ValueError, match="exist"):
        own.set_sides(np.array([0], dtype=np.int32), np.ones(1), np.ones(1))
