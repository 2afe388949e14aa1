"""How many virtual-sliding modes are feasible, what holds among them, and limits of a listing."""

import itertools
from functools import cache

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import random_problem, scene

from graspless_pin import SlidingMode, Status, enumerate_modes, minimize_torque, solve_each_mode
from graspless_pin.errors import ArgumentError, OverrunError
from graspless_pin.modes.kinematics import VirtualKinematics

COUNTS = [
    ("sphere", "strict", "exempt", 121),
    ("up", "strict", "exempt", 25),
    ("down", "strict", "exempt", 25),
    ("up", "strict", "constrained", 14),
    ("down", "strict", "constrained", 14),
    ("sphere", "exact", "exempt", 639),
    ("up", "exact", "exempt", 81),
    ("up", "exact", "constrained", 138),
]
MAXIMAL = {"rest": 262, "up": 16, "down": 16}


@cache
def modes_of(name, *, maximal):
    return list(enumerate_modes(scene(name), maximal=maximal))


@pytest.mark.sampled(5)
@pytest.mark.parametrize(("name", "sign", "sliding", "count"), COUNTS)
def test_counts(name, sign, sliding, count):
    modes = list(enumerate_modes(scene(name), sign_rule=sign, sliding_rule=sliding))
    assert len(modes) == count
    assert len(set(modes)) == count


@pytest.mark.sampled(0)
@pytest.mark.parametrize(("sign", "count"), [("exact", 4983), ("nonzero", 3011)])
def test_many_counts(sign, count):
    test_counts("rest", sign, "exempt", count)


@pytest.mark.parametrize(("name", "count"), MAXIMAL.items())
def test_maximal_counts(name, count):
    assert len(modes_of(name, maximal=True)) == count


@pytest.mark.parametrize("sign", ["strict", "exact", "nonzero"])
def test_maximal_modes_cover_all_modes(sign):
    problem = random_problem(2, 2 if sign == "exact" else 3)
    everything = list(enumerate_modes(problem, sign_rule=sign))
    largest = list(enumerate_modes(problem, sign_rule=sign, maximal=True))
    assert 0 < len(largest) < len(everything)
    for mode in everything:
        assert any(mode == other or extends(other, mode) for other in largest)
    # A mode is maximal where no listed one extends it at one contact.
    expected = {
        mode
        for mode in everything
        if not any(
            extends(other, mode) and (other.signs != mode.signs).any(axis=1).sum() == 1
            for other in everything
        )
    }
    assert set(largest) == expected


def extends(larger: SlidingMode, smaller: SlidingMode) -> bool:
    """Whether a mode selects more, or replaces a zero sign, and agrees with all other signs."""
    if larger == smaller or (smaller.selection & ~larger.selection).any():
        return False
    return bool((smaller.signs == np.where(smaller.signs == 0, 0, larger.signs)).all())


@pytest.mark.parametrize("sign", ["strict", "exact", "nonzero"])
def test_every_restriction_of_a_feasible_mode_is_feasible(sign):
    listed = set(enumerate_modes(scene("sphere"), sign_rule=sign))
    for mode in listed:
        for contact in np.flatnonzero(mode.selection):
            selection, signs = mode.selection.copy(), mode.signs.copy()
            selection[contact] = False
            signs[contact] = 0
            assert SlidingMode(selection, signs) in listed


def test_frictionless_contacts_are_never_selected():
    problem = random_problem(4, 3)
    smooth = type(problem)(
        problem.positions, problem.normals, problem.external_wrench, problem.jacobian,
        friction=[0.3, 0.0, 0.3], torque_limits=(-5.0, 5.0),
    )  # fmt: skip
    modes = list(enumerate_modes(smooth))
    assert len(modes) > 1
    assert not any(mode.selection[1] for mode in modes)


def test_listing_is_lazy(monkeypatch):
    solved = 0

    def counting(method):
        def counted(self, requirements, rule):
            nonlocal solved
            solved += 1
            return method(self, requirements, rule)

        return counted

    for name in ("solve", "feasible"):
        method = getattr(VirtualKinematics, name)
        monkeypatch.setattr(VirtualKinematics, name, counting(method))
    modes = enumerate_modes(scene("rest"))
    assert solved == 0
    first = list(itertools.islice(modes, 3))
    assert len(set(first)) == 3
    assert solved < 40
    assert len(list(modes)) == 987 - 3
    assert solved > 987


MANY = 24  # contacts: more modes than can be listed


def figures(solutions):
    return [(one.mode, one.margin) for one in solutions if one.found]


def test_as_many_modes_are_solved_as_nodes_are_allowed():
    every = list(solve_each_mode(scene("up")))
    assert all(one.status is not Status.NOT_FOUND_IN_LIMIT for one in every)
    for limit in (1, 3, 7):
        some = list(solve_each_mode(scene("up"), node_limit=limit))
        assert len(some) == limit + 1
        assert some[-1].status is Status.NOT_FOUND_IN_LIMIT
        assert figures(some) == figures(every[:limit])
    limited = list(solve_each_mode(scene("up"), node_limit=len(every), time_limit=1e9))
    assert figures(limited) == figures(every)
    assert len(limited) == len(every)


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_no_time_gives_no_mode_but_the_word_that_it_was_over(algorithm):
    (last,) = solve_each_mode(slope_scene(1, MANY), algorithm, time_limit=0.0)
    assert last.status is Status.NOT_FOUND_IN_LIMIT
    assert not last.found
    assert "limit" in last.status.message


@pytest.mark.parametrize(("maximal", "limit"), [(False, 100), (True, 3000)])
def test_a_listing_of_modes_ends_at_its_limit_by_an_error(maximal, limit):
    every, listed = modes_of("rest", maximal=maximal), []
    with pytest.raises(OverrunError, match=f"after {limit} partial modes"):
        listed.extend(
            each for each in enumerate_modes(scene("rest"), maximal=maximal, node_limit=limit)
        )
    assert 0 < len(listed) < len(every)
    assert listed == every[: len(listed)]
    with pytest.raises(OverrunError):
        next(enumerate_modes(slope_scene(1, MANY), maximal=maximal, time_limit=0.0))


def test_a_listing_within_its_limits_is_whole():
    limited = enumerate_modes(scene("up"), maximal=True, node_limit=10**9, time_limit=np.inf)
    assert list(limited) == modes_of("up", maximal=True)


@pytest.mark.parametrize(
    ("options", "name"),
    [({"node_limit": -1}, "node_limit"), ({"time_limit": -1.0}, "time_limit"),
     ({"time_limit": "soon"}, "time_limit")],
)  # fmt: skip
def test_limits_of_a_listing_are_checked_at_once(options, name):
    with pytest.raises(ArgumentError, match=name):
        enumerate_modes(scene("rest"), **options)


def test_the_search_by_listing_ends_when_the_time_is_over():
    problem = slope_scene(4, 8)
    found = minimize_torque(problem, 0.01, search="enumerate", time_limit=0.0)
    assert found.status is Status.NOT_FOUND_IN_LIMIT
