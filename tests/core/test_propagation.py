"""What is concluded from decisions keeps every maximal mode that agrees with them."""

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import scene

from graspless_pin import QuasistaticProblem, SlidingMode, enumerate_modes
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.propagation import Decisions, Propagation
from graspless_pin.modes.rules import Rules


def stiff_cuboid() -> QuasistaticProblem:
    """The paper's cuboid at rest between fingers that cannot move."""
    return scene("rest").with_changes(
        jacobian=np.zeros((18, 0)), torque_limits=(-1, 1), joint_names=[], gravity_torques=[]
    )


PROBLEMS = {
    "rest": lambda: scene("rest"),
    "stiff": stiff_cuboid,
    "slope-4": lambda: slope_scene(3, 4),
    "slope-5": lambda: slope_scene(1, 5),
    "slope-6": lambda: slope_scene(2, 6),
}


def agree(decisions: Decisions, mode: SlidingMode) -> bool:
    chosen = mode.selection
    signs = decisions.signs[chosen].astype(int) * mode.signs[chosen]
    return bool(
        not (decisions.selected & ~chosen).any()
        and not (decisions.released & chosen).any()
        and (signs >= 0).all()
    )


def some_decisions(rng: np.random.Generator, mode: SlidingMode) -> Decisions:
    """Decisions that agree with a mode, with any signs for contacts that it does not select."""
    chosen = mode.selection
    propagated = rng.choice([-1, 1], mode.signs.shape)
    signs = np.where(chosen[:, None], mode.signs, propagated)
    keep = rng.random(4)
    return Decisions(
        chosen & (rng.random(len(chosen)) < keep[0]),
        ~chosen & (rng.random(len(chosen)) < keep[1]),
        np.where(rng.random(signs.shape) < keep[2] * keep[3], signs, 0).astype(np.int8),
    )


CASES = [(name, sign) for name in PROBLEMS for sign in ("strict", "nonzero")]
CASES += [("stiff", "exact"), ("slope-4", "exact")]


@pytest.mark.sampled(2)
@pytest.mark.parametrize(("name", "sign"), CASES)
def test_no_maximal_mode_is_lost(name, sign):
    problem, rng = PROBLEMS[name](), np.random.default_rng(7)
    propagation = Propagation(problem, VirtualKinematics(problem), Rules.parse(sign))
    modes = list(enumerate_modes(problem, sign_rule=sign, maximal=True))
    narrowed = 0
    for index in rng.integers(len(modes), size=15):
        decisions = some_decisions(rng, modes[index])
        probe = bool(rng.integers(2))
        propagated = propagation.propagate(decisions, probe=probe)
        assert propagated is not None
        agreeing = [mode for mode in modes if agree(decisions, mode)]
        assert all(agree(propagated, mode) for mode in agreeing)
        narrowed += propagated.key != decisions.key
    assert narrowed > 0 or sign == "exact"


def turning_about_a_corner() -> QuasistaticProblem:
    """A plate on four feet, the last of which two stops hold in place."""
    feet = [(-0.1, -0.1, 0.0), (0.1, -0.1, 0.0), (-0.1, 0.1, 0.0), (0.1, 0.1, 0.0)]
    stops = [(0.15, 0.1, 0.0), (0.1, 0.15, 0.0)]
    normals = np.array([(0, 0, 1)] * 4 + [(-1, 0, 0), (0, -1, 0)], dtype=float)
    first = np.array([(0.8, 0.6, 0)] * 4 + [(0, 0.8, 0.6), (0.8, 0, 0.6)])
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    return QuasistaticProblem(
        [*feet, *stops], normals, [0, 0, -10, 0, 0, 0], friction=0.5, tangents=tangents
    )


@pytest.mark.parametrize("stops", [False, True])
def test_a_contact_that_touches_and_cannot_slide_is_not_selected(stops):
    problem = turning_about_a_corner()
    propagation = Propagation(problem, VirtualKinematics(problem), Rules.parse("strict"))
    chosen = np.array([True] * 3 + [False] + [stops] * 2)
    modes = [
        mode
        for mode in enumerate_modes(problem, maximal=True)
        if (mode.selection == [True, True, True, False, True, True]).all()
    ]
    assert len(modes) == 2  # either way about the corner
    decided = Decisions(chosen, np.zeros(6, dtype=bool), np.zeros((6, 2), dtype=np.int8))
    propagated = propagation.propagate(decided, probe=False)
    assert propagated is not None
    assert all(agree(propagated, mode) for mode in modes)
