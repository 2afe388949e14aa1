"""Limits of what lists modes: it stops, says so, and what it gave is right."""

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import scene

from graspless_pin import Status, enumerate_modes, minimize_torque, solve_each_mode
from graspless_pin.errors import ArgumentError, OverrunError

MANY = 24  # contacts: more modes than can be listed


def figures(solutions):
    return [(one.mode, one.margin) for one in solutions if one.found]


@pytest.mark.parametrize("limit", [1, 3, 7])
def test_as_many_modes_are_solved_as_nodes_are_allowed(limit):
    every = list(solve_each_mode(scene("rest")))
    assert all(one.status is not Status.NOT_FOUND_IN_LIMIT for one in every)
    some = list(solve_each_mode(scene("rest"), node_limit=limit))
    assert len(some) == limit + 1
    assert some[-1].status is Status.NOT_FOUND_IN_LIMIT
    assert figures(some) == figures(every[:limit])


def test_a_limit_that_is_not_reached_leaves_nothing_out():
    every = list(solve_each_mode(scene("rest")))
    limited = list(solve_each_mode(scene("rest"), node_limit=len(every), time_limit=1e9))
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
    every = list(enumerate_modes(scene("rest"), maximal=maximal))
    listed = []
    with pytest.raises(OverrunError, match=f"after {limit} partial modes"):
        listed.extend(
            each for each in enumerate_modes(scene("rest"), maximal=maximal, node_limit=limit)
        )
    assert 0 < len(listed) < len(every)
    assert listed == every[: len(listed)]
    with pytest.raises(OverrunError):
        next(enumerate_modes(slope_scene(1, MANY), maximal=maximal, time_limit=0.0))


def test_a_listing_within_its_limits_is_whole():
    every = list(enumerate_modes(scene("rest"), maximal=True))
    limited = enumerate_modes(scene("rest"), maximal=True, node_limit=10**9, time_limit=np.inf)
    assert list(limited) == every


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
