"""What is concluded from decisions keeps every maximal mode that agrees with them."""

from itertools import product

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import scene

from graspless_pin import QuasistaticProblem, SlidingMode, enumerate_modes
from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.propagation import Decisions, Propagation
from graspless_pin.modes.rules import Rules, SignRule


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


CASES = [(name, sign) for name in PROBLEMS if name != "slope-6" for sign in ("strict", "nonzero")]
CASES += [("stiff", "exact"), ("slope-5", "exact")]


@pytest.mark.parametrize(("name", "sign"), CASES)
def test_no_maximal_mode_is_lost(name, sign):
    problem, rng = PROBLEMS[name](), np.random.default_rng(7)
    propagation = Propagation(problem, VirtualKinematics(problem), Rules.parse(sign))
    modes = list(enumerate_modes(problem, sign_rule=sign, maximal=True))
    narrowed = 0
    for index in rng.integers(len(modes), size=25 if sign == "exact" else 60):
        decisions = some_decisions(rng, modes[index])
        probe = bool(rng.integers(2))
        propagated = propagation.propagate(decisions, probe=probe)
        assert propagated is not None
        agreeing = [mode for mode in modes if agree(decisions, mode)]
        assert all(agree(propagated, mode) for mode in agreeing)
        narrowed += propagated.key != decisions.key
    assert narrowed > 2 or sign == "exact"


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


@pytest.mark.parametrize("sign", ["strict", "nonzero", "exact"])
def test_the_last_of_four_feet_is_selected_where_all_signs_are_strict(sign):
    """It touches where three do; by the other rules it may do so without any friction."""
    whole = turning_about_a_corner()
    feet = QuasistaticProblem(
        whole.positions[:4], whole.normals[:4], whole.external_wrench,
        friction=0.5, tangents=whole.tangents[:4],
    )  # fmt: skip
    propagation = Propagation(feet, VirtualKinematics(feet), Rules.parse(sign))
    three = np.array([True, True, True, False])
    decided = Decisions(three, ~np.ones(4, dtype=bool), np.zeros((4, 2), dtype=np.int8))
    propagated = propagation.propagate(decided, probe=False)
    assert propagated is not None
    assert propagated.selected[3] == (sign == "strict")


PAIRS = [(a, b) for a in (-1, 1) for b in (-1, 1)]


@pytest.mark.parametrize("name", ["slope-5", "slope-6", "slope-7"])
def test_each_contact_gets_the_signs_that_it_alone_can_have(name):
    """One contact slides; what each other could do beside it is asked of the kinematics."""
    problem = PROBLEMS[name]()
    kinematics = VirtualKinematics(problem)
    propagation = Propagation(problem, kinematics, Rules.parse("strict"))
    concluded = set()
    for first, pair in product(np.flatnonzero(problem.has_cone).tolist(), PAIRS):
        start = Decisions.none(problem.contact_count).select(first)
        for component, sign in enumerate(pair):
            start = start and start.sign(first, component, sign)
        assert start is not None
        found = propagation.propagate(start, probe=True)
        asked = Requirement(first, pair)
        if not kinematics.feasible([asked], SignRule.STRICT):
            assert found is None
            continue
        assert found is not None
        for other in set(np.flatnonzero(problem.has_cone).tolist()) - {first}:
            ways = [
                way for way in PAIRS
                if kinematics.feasible([asked, Requirement(other, way)], SignRule.STRICT)
            ]  # fmt: skip
            if not ways:
                assert found.released[other]
            for component in range(2) if ways else ():
                left = {way[component] for way in ways}
                wanted = left.pop() if len(left) == 1 else 0
                assert found.signs[other, component] == wanted or found.selected[other]
                concluded.add((other, component, wanted))
    assert len({sign for _, _, sign in concluded}) == 3
