"""How many virtual-sliding modes are feasible, and what holds among them."""

import itertools

import numpy as np
import pytest
from scenes import random_problem, scene

from graspless_pin import SlidingMode, enumerate_modes
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.feasibility import Witness
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import SignRule

COUNTS = [
    ("sphere", "strict", "exempt", 121),
    ("rest", "strict", "exempt", 987),
    ("up", "strict", "exempt", 25),
    ("down", "strict", "exempt", 25),
    ("up", "strict", "constrained", 14),
    ("down", "strict", "constrained", 14),
    ("sphere", "exact", "exempt", 639),
    ("rest", "exact", "exempt", 4983),
    ("rest", "nonzero", "exempt", 3011),
    ("up", "exact", "exempt", 81),
    ("up", "exact", "constrained", 138),
]


@pytest.mark.parametrize(("name", "sign", "sliding", "count"), COUNTS)
def test_counts(name, sign, sliding, count):
    modes = list(enumerate_modes(scene(name), sign_rule=sign, sliding_rule=sliding))
    assert len(modes) == count
    assert len(set(modes)) == count


@pytest.mark.parametrize(
    ("name", "count", "maximal"), [("rest", 987, 262), ("up", 25, 16), ("down", 25, 16)]
)
def test_maximal_counts(name, count, maximal):
    problem = scene(name)
    everything = list(enumerate_modes(problem))
    largest = list(enumerate_modes(problem, maximal=True))
    assert (len(everything), len(largest)) == (count, maximal)
    # By brute force: a mode is maximal when no listed mode with more contacts agrees with it.
    selections = np.array([mode.selection for mode in everything])
    signs = np.array([mode.signs for mode in everything])
    expected = set()
    for mode in everything:
        agrees = ((signs == mode.signs) | (mode.signs == 0)).all(axis=(1, 2))
        if (agrees & (selections >= mode.selection).all(axis=1)).sum() == 1:  # itself
            expected.add(mode)
    assert set(largest) == expected


@pytest.mark.parametrize("sign", ["strict", "exact", "nonzero"])
def test_maximal_modes_cover_all_modes(sign):
    problem = random_problem(2, 3)
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
    problem = scene("rest") if sign == "strict" else scene("sphere")
    listed = set(enumerate_modes(problem, sign_rule=sign))
    for mode in listed:
        for contact in np.flatnonzero(mode.selection):
            selection, signs = mode.selection.copy(), mode.signs.copy()
            selection[contact] = False
            signs[contact] = 0
            assert SlidingMode(selection, signs) in listed


@pytest.mark.parametrize(("sliding", "selected"), [("exempt", False), ("constrained", True)])
def test_contacts_in_actual_sliding(sliding, selected):
    problem = scene("up")
    for mode in enumerate_modes(problem, sliding_rule=sliding):
        assert (mode.selection[problem.is_sliding] == selected).all()


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
    list(modes)
    assert solved > 987


@pytest.mark.parametrize("sign", ["strict", "exact", "nonzero"])
def test_every_listed_mode_has_a_virtual_motion(sign):
    problem = scene("sphere")
    kinematics = VirtualKinematics(problem)
    for mode in enumerate_modes(problem, sign_rule=sign):
        assert isinstance(kinematics.solve(requirements_of(mode), SignRule(sign)), Witness)
