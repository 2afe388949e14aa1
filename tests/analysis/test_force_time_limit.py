"""Force bounds whose time is over: what is returned was reached, and nothing else is claimed."""

import itertools
import time
from collections.abc import Callable

import numpy as np
import pytest
from analysis_scenes import PAIRS
from force_oracle import ForceSet, component_rows
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    contact_force_bounds,
    enumerate_modes,
    minimize_torque,
)
from graspless_pin.algorithms import force_bounds
from graspless_pin.algorithms.branch_and_bound import search_modes
from graspless_pin.algorithms.force_bounds import ContactForceBounds, Extreme, ForceExtremes
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.search_state import SearchState

TIGHT = 1e-5


@pytest.fixture(scope="module")
def torques() -> np.ndarray:
    return minimize_torque(scene("sphere"), 0.5).torques


@pytest.fixture(scope="module")
def complete(torques) -> ContactForceBounds:
    return contact_force_bounds(scene("sphere"), torques)


def stopped_clock(looks: int) -> Callable[[], float]:
    """A clock that stands still, and jumps ahead once it was looked at so often."""
    readings = itertools.chain(itertools.repeat(0.0, looks), itertools.repeat(2.0))
    return lambda: next(readings)


def bounds_after(monkeypatch, torques, looks: int) -> ContactForceBounds:
    """The bounds where the time is over at a look at the clock."""
    with monkeypatch.context() as patch:
        patch.setattr(time, "monotonic", stopped_clock(looks))
        return contact_force_bounds(scene("sphere"), torques, time_limit=1.0)


@pytest.fixture(scope="module")
def looks(torques) -> int:
    """How often the complete search looks at the clock."""
    clock = itertools.count()
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(time, "monotonic", lambda: float(next(clock)))
        bounds = contact_force_bounds(scene("sphere"), torques, time_limit=1e9)
    assert bounds.status is Status.OPTIMAL
    return next(clock)


def assert_inside(partial: ContactForceBounds, complete: ContactForceBounds) -> None:
    """Proven ranges are the complete ones, the others lie in them."""
    sure = partial.proven
    np.testing.assert_allclose(partial.lower[sure], complete.lower[sure], atol=TIGHT)
    np.testing.assert_allclose(partial.upper[sure], complete.upper[sure], atol=TIGHT)
    assert (partial.lower >= complete.lower - TIGHT).all()
    assert (partial.upper <= complete.upper + TIGHT).all()
    assert (partial.lower <= partial.upper + TIGHT).all()
    assert partial.smallest_margin >= complete.smallest_margin - TIGHT
    assert partial.largest_margin <= complete.largest_margin + TIGHT
    assert partial.smallest_margin <= partial.largest_margin + TIGHT


def test_no_time_at_all():
    """Coulomb's law alone needs no search for a mode, so the torques are seen to be held."""
    torques = minimize_torque(scene("sphere"), 0.5, static_friction="coulomb").torques
    bounds, complete = (
        contact_force_bounds(scene("sphere"), torques, static_friction="coulomb", time_limit=limit)
        for limit in (0.0, None)
    )
    assert bounds.found and bounds.status is Status.LIMIT_REACHED
    assert not bounds.proven.any()
    assert_inside(bounds, complete)
    text = str(bounds)
    assert text.count(" *\n") + text.count(" * ") == bounds.proven.size
    assert "* found; it is not proven" in text
    assert "N or less to" in text and "between" not in text
    assert "* found" in bounds._repr_html_()


def test_no_time_to_hold_the_torques(torques):
    bounds = contact_force_bounds(scene("sphere"), torques, time_limit=0.0)
    assert bounds.status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)
    assert bounds.found == np.isfinite(bounds.upper).all() != np.isnan(bounds.upper).any()
    assert not bounds.proven.any()


def test_ever_more_time_proves_ever_more(monkeypatch, torques, complete, looks):
    earlier = np.zeros(complete.proven.shape, dtype=bool)
    for share in (0.2, 0.5, 0.95):
        bounds = bounds_after(monkeypatch, torques, int(share * looks))
        assert bounds.status is Status.LIMIT_REACHED
        assert_inside(bounds, complete)
        assert (bounds.proven | ~earlier).all()
        earlier = bounds.proven


def test_ranges_that_are_proven_before_the_margins_are(monkeypatch, torques, looks):
    """At the last look but one the ranges are all there, and the smallest margin is not."""
    bounds = bounds_after(monkeypatch, torques, looks - 2)
    assert bounds.status is Status.LIMIT_REACHED and bounds.proven.all()
    assert "*" not in str(bounds) and "N or less to" in str(bounds)


def test_what_was_reached_is_held_by_a_mode(monkeypatch, torques, looks):
    """Each end lies between the extremes of single modes, worked out apart, and so do margins."""
    problem = scene("sphere")
    bounds = bounds_after(monkeypatch, torques, looks // 3)
    assert bounds.found and not bounds.proven.all()
    rows = component_rows(problem)
    sets = [
        ForceSet(problem, mode, torques=torques, normal_limit=False)
        for mode in enumerate_modes(problem, maximal=True)
    ]
    ends = np.max([forces.maxima(np.vstack([rows, -rows])) for forces in sets], axis=0)
    most, least = ends.reshape(2, -1, 3) * [[[1.0]], [[-1.0]]]
    assert (bounds.upper <= most + TIGHT).all() and (bounds.lower >= least - TIGHT).all()
    np.testing.assert_allclose(bounds.upper[bounds.proven], most[bounds.proven], atol=TIGHT)
    np.testing.assert_allclose(bounds.lower[bounds.proven], least[bounds.proven], atol=TIGHT)


@pytest.mark.parametrize("failing", [5, 25])
def test_a_search_without_an_answer_leaves_the_rest(monkeypatch, torques, complete, failing):
    """One range is then only reached, or a margin; all others are proven as ever."""
    calls = itertools.count()

    def search(state):
        if next(calls) == failing:
            return state.undecided_status()
        return search_modes(state)

    monkeypatch.setattr(force_bounds, "search_modes", search)
    bounds = contact_force_bounds(scene("sphere"), torques)
    assert bounds.status is Status.LIMIT_REACHED
    assert bounds.proven.sum() >= bounds.proven.size - 1
    assert_inside(bounds, complete)


def test_a_search_that_denies_all_forces_proves_nothing_of_torques_that_are_held(
    monkeypatch, torques
):
    extremes = ForceExtremes(scene("sphere"), torques, SolveOptions.parse())
    assert extremes.status is Status.OPTIMAL

    monkeypatch.setattr(force_bounds, "search_modes", lambda _: Status.INFEASIBLE_MODES)
    normal = extremes.component(0, 0)
    found = extremes.largest(normal)
    assert not found.proven
    assert found.value == max(float(normal @ x) for x in extremes.reached)
    # Nothing above a value of interest is an answer.
    assert extremes.largest(normal, above=1e3) == Extreme(1e3, proven=True)


@pytest.mark.parametrize("cone", ["edges", "round"])
def test_a_margin_is_proven_where_every_distance_and_range_that_it_rests_on_is(monkeypatch, cone):
    problem = scene("sphere").with_changes(cone=cone)
    torques = minimize_torque(problem, 0.5).torques
    bounds = contact_force_bounds(problem, torques)
    extremes = ForceExtremes(problem, torques, SolveOptions.parse())
    real, calls = extremes.largest, itertools.count()
    every = np.ones((problem.contact_count, 3), dtype=bool)

    def margin(unproven: int, ranges: np.ndarray) -> Extreme:
        nonlocal calls
        calls = itertools.count()

        def largest(functional, *, above=-np.inf):
            found = real(functional, above=above)
            return Extreme(found.value, found.proven and next(calls) != unproven)

        monkeypatch.setattr(extremes, "largest", largest)
        return extremes.smallest_margin(bounds.lower, bounds.upper, ranges)

    whole = margin(-1, every)
    assert whole.proven and next(calls) > 2
    assert whole.value == pytest.approx(bounds.smallest_margin, abs=TIGHT)
    assert not margin(0, every).proven and not margin(1, every).proven
    one_open = every.copy()
    one_open[-2, 0] = False
    assert margin(-1, one_open) == pytest.approx(whole, abs=TIGHT)
    assert not margin(0, one_open).proven


def test_torques_whose_modes_no_solver_decides_on(monkeypatch, torques):
    monkeypatch.setattr(force_bounds, "search_modes", SearchState.undecided_status)
    bounds = contact_force_bounds(scene("sphere"), torques)
    assert bounds.status is Status.UNVERIFIED and not bounds.found
    assert np.isnan(bounds.lower).all() and not bounds.proven.any()


def test_enough_time_changes_nothing(torques, complete):
    bounds = contact_force_bounds(scene("sphere"), torques, time_limit=np.inf)
    assert bounds.status is Status.OPTIMAL and bounds.proven.all()
    for name in ("lower", "upper", "smallest_margin", "largest_margin"):
        np.testing.assert_array_equal(getattr(bounds, name), getattr(complete, name))
    assert not bounds.proven.flags.writeable


@pytest.mark.sampled(6)
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("looks", [0, 5, 20, 60])
def test_a_free_ray_is_not_denied_for_want_of_time(monkeypatch, pair, looks):
    """Stiff fingers squeeze without end: either that is found, or nothing is proven there."""
    problem = QuasistaticProblem(
        [[0, -0.1, 0], [0, 0.1, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -10, 0, 0, 0], friction=0.5
    )
    monkeypatch.setattr(time, "monotonic", stopped_clock(looks))
    bounds = contact_force_bounds(
        problem, [], sign_rule=pair[0], sliding_rule=pair[1], time_limit=1.0
    )
    if bounds.found:
        squeeze = bounds.upper[:, 0]
        assert (np.isinf(squeeze) | ~bounds.proven[:, 0]).all()
