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
    "slope-5": lambda: slope_scene(2, 5),
    "slope-6": lambda: slope_scene(1, 6),
    "slope-7": lambda: slope_scene(4, 7),
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
CASES += [("stiff", "exact"), ("slope-5", "exact")]


@pytest.mark.parametrize(("name", "sign"), CASES)
def test_no_maximal_mode_is_lost(name, sign):
    problem, rng = PROBLEMS[name](), np.random.default_rng(7)
    propagation = Propagation(problem, VirtualKinematics(problem), Rules.parse(sign))
    modes = list(enumerate_modes(problem, sign_rule=sign, maximal=True))
    narrowed = 0
    for index in rng.integers(len(modes), size=150):
        decisions = some_decisions(rng, modes[index])
        probe = bool(rng.integers(2))
        propagated = propagation.propagate(decisions, probe=probe)
        assert propagated is not None
        agreeing = [mode for mode in modes if agree(decisions, mode)]
        assert all(agree(propagated, mode) for mode in agreeing)
        narrowed += propagated.key != decisions.key
    assert narrowed > 10 or sign == "exact"
