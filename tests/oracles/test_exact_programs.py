"""Exact programs: answers that prove themselves, on programs that floats decide badly."""

from dataclasses import replace
from fractions import Fraction

import numpy as np
import pytest
from tests.oracles import exact_programs
from tests.oracles.exact_programs import Infeasible, Optimum, Rows, assert_proven, solve

THIRD = Fraction(1, 3)


def random_rows(seed: int) -> tuple[Rows, list[Fraction]]:
    """Rows in a box: small whole numbers for odd seeds, else of sizes 1e-6 to 1e6."""
    rng = np.random.default_rng(seed)
    size = int(rng.integers(1, 8))

    def numbers(count: int) -> list[Fraction]:
        if seed % 2:
            return [Fraction(int(entry)) for entry in rng.integers(-2, 3, count)]
        sizes = 10.0 ** rng.integers(-6, 7, count)
        return [Fraction(entry) for entry in (rng.normal(size=count) * sizes).tolist()]

    box = [
        ([Fraction(sign * (i == j)) for j in range(size)], Fraction(10))
        for i in range(size)
        for sign in (1, -1)
    ]
    equations = [(numbers(size), numbers(1)[0]) for _ in range(int(rng.integers(0, 3)))]
    others = [(numbers(size), numbers(1)[0]) for _ in range(int(rng.integers(1, 12)))]
    return Rows.of(equations, others + box), numbers(size)


@pytest.mark.parametrize("guess", ["HiGHS", "none", "any"])
def test_random_programs_are_proven_whatever_the_guess(guess, monkeypatch):
    if guess == "none":
        monkeypatch.setattr(exact_programs, "_guess", lambda rows, cost: [])
    if guess == "any":
        monkeypatch.setattr(
            exact_programs, "_guess", lambda rows, cost: np.flatnonzero(~rows.equal)
        )
    kinds = set()
    for seed in range(40):
        rows, cost = random_rows(seed)
        answer = solve(rows, cost)
        assert_proven(rows, cost, answer)
        kinds.add((type(answer), seed % 2))
    assert len(kinds) == 4


def test_a_vertex_is_exact():
    """Minimise x + y over 3 x + y >= 1, x + 3 y >= 1: both are 1/4."""
    rows = Rows.of([], [([-3, -1], -1), ([-1, -3], -1)])
    answer = solve(rows, [1, 1])
    assert isinstance(answer, Optimum)
    assert answer.x == (Fraction(1, 4), Fraction(1, 4)) and answer.value == Fraction(1, 2)


def test_a_hair_below_what_floats_see_decides():
    """x <= 1/3 - 1e-30 and x >= 1/3 exclude each other; 1/3 + 1e-30 leaves x = 1/3."""
    hair = Fraction(1, 10**30)
    for side, kind in ((THIRD - hair, Infeasible), (THIRD + hair, Optimum)):
        rows = Rows.of([], [([1], side), ([-1], -THIRD)])
        answer = solve(rows, [1])
        assert isinstance(answer, kind)
        assert_proven(rows, [1], answer)


def test_equations_that_repeat_each_other():
    rows = Rows.of([([1, 1], 1), ([2, 2], 2)], [([-1, 0], 0), ([0, -1], 0)])
    answer = solve(rows, [1, 2])
    assert isinstance(answer, Optimum) and answer.x == (1, 0)
    contradiction = Rows.of([([1, 1], 1), ([2, 2], 3)], [([-1, 0], 0), ([0, -1], 0)])
    answer = solve(contradiction, [1, 2])
    assert isinstance(answer, Infeasible)
    assert_proven(contradiction, [1, 2], answer)


def test_a_variable_in_no_row_is_zero_or_unbounded():
    rows = Rows.of([], [([1, 0], 1), ([-1, 0], 1)])
    answer = solve(rows, [1, 0])
    assert isinstance(answer, Optimum) and answer.x == (-1, 0)
    with pytest.raises(exact_programs.UnboundedError):
        solve(rows, [1, 1])
    with pytest.raises(exact_programs.UnboundedError):
        solve(Rows.of([], [([1], 1)]), [1])


def test_forged_answers_are_not_proven():
    rows = Rows.of([], [([-3, -1], -1), ([-1, -3], -1)])
    answer = solve(rows, [1, 1])
    assert isinstance(answer, Optimum)
    hair = Fraction(1, 10**30)
    forged = [
        replace(answer, value=answer.value - hair),
        replace(answer, x=(answer.x[0] + hair, answer.x[1] - hair)),
        replace(answer, x=(answer.x[0] + hair, answer.x[1])),
        replace(answer, weights=(answer.weights[0] + hair, answer.weights[1])),
        Infeasible(answer.weights),
    ]
    for one in forged:
        with pytest.raises(AssertionError):
            assert_proven(rows, [1, 1], one)
