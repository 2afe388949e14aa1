"""Force bounds, disturbances and least friction agree with brute force over enumerated modes."""

from functools import cache

import numpy as np
import pytest
from analysis_scenes import PAIRS, SCENES, options_of, rules_of, scene_of
from force_oracle import ForceSet, component_rows
from numpy.typing import ArrayLike, NDArray

from graspless_pin import (
    QuasistaticProblem,
    SlidingMode,
    Status,
    contact_force_bounds,
    disturbance_margin,
    enumerate_modes,
    maximize_margin,
    minimum_friction,
)
from graspless_pin.algorithms.force_bounds import ContactForceBounds

CASES = pytest.mark.parametrize(
    "index", range(len(SCENES)), ids=lambda i: "-".join(map(str, SCENES[i]))
)


def close(actual: ArrayLike, expected: ArrayLike) -> bool:
    """To 1e-6 relative, or absolute in units of what the forces are scaled by, some 10 N."""
    return bool(np.allclose(actual, expected, rtol=1e-6, atol=1e-5))


@cache
def problem_of(index: int) -> QuasistaticProblem:
    return scene_of(*SCENES[index])


@cache
def modes_of(index: int) -> list[SlidingMode]:
    return list(enumerate_modes(problem_of(index), **options_of(index), maximal=True))


@cache
def held_torques(index: int) -> NDArray[np.float64]:
    """Torques that can be held: those of an optimum, under the scene's rules if possible.

    They come from a vertex that linprog finds in the optimal mode: where the torques fix all
    forces, they have to be right to rounding for any force to exist.
    """
    problem = problem_of(index)
    solution = maximize_margin(problem, **options_of(index))
    _, forces = ForceSet(problem, solution.mode if solution.found else None).best_case()
    return problem.gravity_torques + (problem.jacobian.T @ forces if len(forces) else 0.0)


@cache
def bounds_of(index: int) -> ContactForceBounds:
    return contact_force_bounds(problem_of(index), held_torques(index), **options_of(index))


@cache
def factor_of(index: int) -> float:
    return minimum_friction(problem_of(index), **options_of(index)).factor


@pytest.mark.sampled(4)
@CASES
def test_force_bounds(index: int):
    problem, torques, bounds = problem_of(index), held_torques(index), bounds_of(index)
    sets = [
        forces
        for mode in modes_of(index)
        if (forces := ForceSet(problem, mode, torques=torques, normal_limit=False)).feasible()
    ]
    assert bounds.found == bool(sets)
    if not sets:
        assert bounds.status in (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES)
        assert np.isnan(bounds.lower).all() and np.isnan(bounds.smallest_margin)
        return
    assert bounds.status is Status.OPTIMAL
    rows = component_rows(problem)
    distances = sets[0].distances
    ends = np.max([forces.maxima(np.vstack([rows, -rows, -distances])) for forces in sets], axis=0)
    high, low, near = np.split(ends, [len(rows), 2 * len(rows)])
    upper, lower = high.reshape(-1, 3), -low.reshape(-1, 3)
    assert close(bounds.upper, upper)
    assert close(bounds.lower, lower)
    width = upper - lower
    threshold = 1e-6 * problem.max_normal_force.max()
    clear = np.abs(width - threshold) > 0.5 * threshold
    np.testing.assert_array_equal(bounds.indeterminate[clear], width[clear] > threshold)
    smallest = min((problem.max_normal_force - upper[:, 0]).min(), (-near).min())
    assert close(bounds.smallest_margin, smallest)
    largest = max(forces.best_case()[0] for forces in sets)
    assert close(bounds.largest_margin, largest)

    margins = contact_force_bounds(problem, torques, ranges=False, **options_of(index))
    assert margins.status is Status.OPTIMAL
    assert close([margins.smallest_margin, margins.largest_margin], [smallest, largest])
    assert np.isnan(margins.lower[~margins.proven]).all()
    assert close(margins.upper[margins.proven], upper[margins.proven])


@pytest.mark.sampled(5)
@CASES
@pytest.mark.parametrize("held", [True, False], ids=["held", "free"])
def test_disturbances(index: int, held: bool):
    """The largest multiple that is connected with zero through the modes' intervals."""
    problem = problem_of(index)
    rng = np.random.default_rng([index, held])
    directions, length = rng.normal(size=(2, 6)), float(rng.uniform(0.05, 0.2))
    torques = held_torques(index) if held else None
    found = disturbance_margin(
        problem, torques, directions, characteristic_length=length, **options_of(index)
    )
    units = directions / np.linalg.norm(directions, axis=1, keepdims=True)
    np.testing.assert_allclose(found.directions, units)
    sets = [ForceSet(problem, mode, torques=torques) for mode in modes_of(index)]
    undisturbed = any(forces.feasible() for forces in sets)
    assert found.found == undisturbed
    if not undisturbed:
        assert found.status in (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES)
        assert np.isnan(found.magnitudes).all()
        return
    for unit, magnitude in zip(units, found.magnitudes, strict=True):
        wrench = unit * np.repeat([1.0, length], 3)
        intervals = [ends for forces in sets if (ends := forces.multiples(wrench)) is not None]
        assert close(magnitude, reached(intervals))


def reached(intervals: list[tuple[float, float]]) -> float:
    """The end of the union's part that holds zero."""
    end = 0.0
    for first, last in sorted(intervals):
        if first <= end + 1e-6:
            end = max(end, last)
    return end


@pytest.mark.sampled(4)
@CASES
def test_least_friction(index: int):
    problem, factor = problem_of(index), factor_of(index)

    def feasible(by: float) -> bool:
        scaled = problem.with_changes(friction=by * problem.friction)
        modes = modes_of(index)
        if by == 0.0:  # no contact has a cone any more
            modes = enumerate_modes(scaled, **options_of(index), maximal=True)
        return any(ForceSet(scaled, mode).feasible() for mode in modes)

    if np.isnan(factor):
        assert not feasible(1.0) and not feasible(16.0)
    elif factor == 0.0:
        assert feasible(0.0)
    else:
        assert not feasible((1.0 - 2e-5) * factor)
        # Kinetic friction may balance at one factor only: the one that the scene was made with. It
        # is known as well as the balance is, to 1e-7 of the normal-force limit, some 1e-5 of a
        # friction force.
        assert feasible((1.0 + 2e-5) * factor) or (
            problem.is_sliding.any() and factor == pytest.approx(1.0, abs=1e-5) and feasible(1.0)
        )


@pytest.mark.sampled(0)
def test_the_scenes_cover_what_they_should():
    assert len(SCENES) == 26 and {contacts for *_, contacts in SCENES} == {2, 3, 4}
    bounds = [bounds_of(index) for index in range(len(SCENES))]
    assert sum(bound.found for bound in bounds) >= 17
    assert sum(not bound.found for bound in bounds) >= 2
    assert sum(bool(np.isinf(bound.upper).any()) for bound in bounds) >= 2
    assert sum(bound.found and bool(bound.indeterminate.any()) for bound in bounds) >= 7
    factors = np.array([factor_of(index) for index in range(len(SCENES))])
    assert np.isnan(factors).any() and (factors > 1.0).any()
    assert ((factors > 0.0) & (factors < 1.0)).sum() >= 10
    for pair in PAIRS:
        ruled = [index for index in range(len(SCENES)) if options_of(index) == rules_of(pair)]
        assert any(bounds[index].found for index in ruled)
        slides = {bool(problem_of(index).is_sliding.any()) for index in ruled}
        assert slides == {True, False}
