"""Bounds that rows imply for an objective's own columns: row by row, and by linear programs."""

from dataclasses import replace
from itertools import product

import numpy as np
import pytest
from own_objectives import Helped
from scipy.optimize import linprog
from tests.core.scenes import scene
from verified_documents import documented

from graspless_pin import optimize
from graspless_pin.report.verify.bounds import implied_box
from graspless_pin.report.verify.own_objective import OwnRows
from graspless_pin.report.verify.reading import read_problem

REACH, FAR = 40.0, 7e3


def made_up(seed, name):
    """Three columns in all kinds of rows, and forces in a box: the problem and that box."""
    rng = np.random.default_rng(seed)
    problem = read_problem(documented(optimize(scene(name), Helped())))
    own, count = problem.own, problem.count
    assert own is not None

    def some(*shape):
        figures = rng.choice([-3.0, -1.0, -0.5, 0.5, 1.0, 2.5], shape)
        return np.where(rng.random(shape) < 0.4, figures, 0.0)

    def ends(size, far):
        """Where there is none, infinite."""
        return np.where(rng.random(size) < 0.4, np.inf, far)

    rows = OwnRows(
        (("made up", "either", (4,)),), np.ones(4), -ends(4, rng.uniform(5.0, 50.0, 4)),
        ends(4, rng.uniform(5.0, 50.0, 4)), 0.3 * rng.normal(size=(4, count, 3)), some(4, 3),
    )  # fmt: skip
    bare = ~problem.has_cone[:, None]
    own = replace(
        own, bounds=np.array([-ends(3, 1e3), ends(3, 1e3)]),
        boxes=np.array([[[-FAR] * 3, [FAR] * 3], [[-2.0 * FAR] * 3, [2.0 * FAR] * 3]]),
        balance=0.3 * some(6, 3), faces=some(count, 3), normal_upper=some(count, 3),
        normal_lower=bare * some(count, 3), margins=rng.uniform(0.0, 0.5, count), rows=rows,
    )  # fmt: skip
    low = np.column_stack([np.zeros(count), -rng.uniform(0.0, 5.0, (count, 2))])
    high = np.column_stack([rng.uniform(5.0, 20.0, count), rng.uniform(0.0, 5.0, (count, 2))])
    low[~problem.has_cone, 1:] = high[~problem.has_cone, 1:] = 0.0
    return problem, own, low, high


def rows_of(problem, own):
    """(A, C, low, high) of each row low <= A f + C y <= high, f along n, t1, t2."""
    n, found = np.eye(3)[0], []
    for c in range(problem.count):
        own_force = np.zeros((problem.count, 3))
        own_force[c] = n
        found.append((own_force, own.normal_upper[c], -np.inf, problem.limit[c]))
        if not problem.has_cone[c]:
            found.append((-own_force, own.normal_lower[c], -np.inf, 0.0))
            continue
        for face in problem.faces(c):
            force = np.zeros((problem.count, 3))
            force[c] = face
            found.append((force, own.faces[c], -np.inf, -own.margins[c]))
    for i in range(6):
        force = np.zeros((problem.count, 3))
        for c, axis in product(range(problem.count), range(3)):
            along = (
                problem.frames[c, axis]
                if axis or problem.has_cone[c]
                else problem.kinetic_directions[c]
            )
            force[c, axis] = [*along, *np.cross(problem.p[c], along)][i]
        found.append((force, own.balance[i], -problem.w[i], -problem.w[i]))
    found += zip(own.rows.forces, own.rows.columns, own.rows.low, own.rows.high, strict=True)
    return [one for one in found if one[1].any()]


def row_by_row(problem, own, low, high):
    """Three rounds over all rows: what is left for each column where all else is at its end."""
    first, last = own.bounds.copy()
    rows = rows_of(problem, own)
    for _, upper in product(range(3), (True, False)):
        new_first, new_last = first.copy(), last.copy()
        for A, C, least, most in rows:
            force = (
                np.where(A > 0.0, A * low, A * high).sum()
                if upper
                else np.where(A > 0.0, A * high, A * low).sum()
            )
            side = most if upper else least
            for j in np.flatnonzero(C):
                rest = side - force
                for i in np.flatnonzero(C):
                    if i != j:
                        smallest = (C[i] > 0.0) == upper
                        rest -= C[i] * (first[i] if smallest else last[i])
                if not np.isfinite(rest):
                    continue
                if (C[j] > 0.0) == upper:
                    new_last[j] = min(new_last[j], rest / C[j])
                else:
                    new_first[j] = max(new_first[j], rest / C[j])
        first, last = new_first, new_last
    return first, last


SEEDS = range(12)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", ["rest", "up"])
@pytest.mark.parametrize("seed", SEEDS)
def test_each_row_bounds_each_of_its_columns(seed, name):
    problem, own, low, high = made_up(seed, name)
    first, last = row_by_row(problem, own, low, high)
    found = implied_box(problem, own, low, high, REACH)
    unbounded = np.isinf(first) | np.isinf(last)
    np.testing.assert_array_equal(found[2], unbounded)
    size = np.abs(np.concatenate([first, last]))
    room = 1e-6 * size[np.isfinite(size)].max(initial=1.0)
    known = np.isfinite(first)
    np.testing.assert_allclose(found[0][known], first[known], atol=room)
    np.testing.assert_allclose(found[0][~known], np.minimum(-FAR, last[~known]), atol=room)
    known = np.isfinite(last)
    np.testing.assert_allclose(found[1][known], last[known], atol=room)
    np.testing.assert_allclose(found[1][~known], np.maximum(FAR, found[0][~known]), atol=room)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", ["rest", "up"])
@pytest.mark.parametrize("seed", SEEDS)
def test_no_column_is_outside_its_bounds(seed, name):
    """Of all forces and columns that obey all rows, the smallest and largest of each column."""
    problem, own, low, high = made_up(seed, name)
    lower, upper, unbounded = implied_box(problem, own, low, high, REACH)
    rows = rows_of(problem, own)
    A = np.array([[*force.ravel(), *C] for force, C, _, _ in rows])
    least, most = (np.array([one[i] for one in rows]) for i in (2, 3))
    sides, ends = np.vstack([A, -A]), np.concatenate([most, -least])
    kept = np.isfinite(ends)
    box = [*zip(low.ravel(), high.ravel(), strict=True), *own.bounds.T]
    for column, sign in product(range(3), (1.0, -1.0)):
        cost = np.zeros(A.shape[1])
        cost[low.size + column] = sign
        answer = linprog(cost, sides[kept], ends[kept], bounds=box)
        if answer.status == 0 and not unbounded[column]:
            value = answer.x[low.size + column]
            assert lower[column] - 1e-6 <= value <= upper[column] + 1e-6
