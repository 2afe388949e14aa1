"""OMPL plans with an evaluator: its states and motions are those that the evaluator finds valid."""

import gc
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspless_pin import Evaluator, load_scene
from graspless_pin.errors import ArgumentError
from graspless_pin.planning.edges import ScrewMotion

pytest.importorskip("ompl", reason="OMPL is not installed: pip install 'graspless-pin[ompl]'")
from ompl import base, geometric, util

from graspless_pin.interfaces.ompl import (
    MarginShortfall,
    SmallestMargin,
    attach_evaluator,
    joint_space,
)

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
MARGIN = 0.68  # N
FARTHEST = 0.06  # m


class Push:
    """A box on a slope and the hand behind it: how far both have come, m, and its tilt, rad."""

    def __init__(self) -> None:
        scene = load_scene(EXAMPLES / "trihand_slide_and_pivot.yaml")
        self.evaluator = Evaluator(scene)
        self.home, self.T = self.evaluator.configuration(), scene.object.T_world_object
        self.places = [
            self.evaluator.joint_names.index(name)
            for name in ("carriage_x", "carriage_z", "carriage_pitch")
        ]

    def at(self, way: float, tilt: float) -> tuple[np.ndarray, np.ndarray]:
        q, T = self.home.copy(), np.array(self.T)
        T[:3, 3] += way * self.T[:3, 0]
        q[self.places] += [way * self.T[0, 0], way * self.T[2, 0], tilt]
        return q, T

    def to_state(self, state: Any) -> Any:
        return self.at(state[0], state[1]) if state[0] >= 0.0 else None

    def setup(self) -> Any:
        space, bounds = base.RealVectorStateSpace(2), base.RealVectorBounds(2)
        for place, (low, high) in enumerate([(-0.01, FARTHEST), (-0.04, 0.02)]):
            bounds.setLow(place, low)
            bounds.setHigh(place, high)
        space.setBounds(bounds)
        setup = geometric.SimpleSetup(space)
        setup.getSpaceInformation().setStateValidityCheckingResolution(0.2)
        return setup


def state_of(setup: Any, *values: float) -> Any:
    state = setup.getStateSpace().allocState()
    for place, value in enumerate(values):
        state[place] = value
    return state


def margin_between(push: Push, evaluator: Evaluator, one, other, fraction: float) -> float:
    """The margin on the way between two states, worked out without edges."""
    (q0, T0), (q1, T1) = push.at(*one), push.at(*other)
    motion = ScrewMotion.between(T0, T1, evaluator.scene.object.center_of_mass)
    return evaluator.evaluate(q0 + fraction * (q1 - q0), *motion.pose_and_twist(fraction)).margin


@pytest.fixture
def push():
    util.noOutputHandler()
    return Push()


def test_a_plan_keeps_the_margin_all_along(push):
    setup = push.setup()
    attach_evaluator(setup, push.evaluator, push.to_state, margin=MARGIN)
    gc.collect()  # OMPL alone keeps what asks the evaluator
    ends = (0.0, 0.0), (FARTHEST, 0.01)
    setup.setStartAndGoalStates(*(state_of(setup, *end) for end in ends))
    setup.setPlanner(geometric.RRTConnect(setup.getSpaceInformation()))
    calls = 0

    def enough() -> bool:
        nonlocal calls
        calls += 1
        return calls > 500

    assert setup.solve(base.PlannerTerminationCondition(enough))
    assert setup.haveExactSolutionPath()
    fresh = Evaluator(push.evaluator.scene)
    corners = [(state[0], state[1]) for state in setup.getSolutionPath().getStates()]
    for one, other in pairwise(corners):
        for fraction in np.linspace(0.0, 1.0, 7):
            assert margin_between(push, fresh, one, other, fraction) >= MARGIN - 1e-6


def test_there_is_no_way_back(push):
    setup = push.setup()
    space = attach_evaluator(setup, push.evaluator, push.to_state, margin=0.6)
    information = setup.getSpaceInformation()
    low, high = state_of(setup, 0.0, 0.0), state_of(setup, 0.03, 0.0)
    assert information.isValid(low) and information.isValid(high)  # at rest
    assert information.checkMotion(low, high) and not information.checkMotion(high, low)
    assert space.last_valid(low, high) == 1.0 and space.last_valid(high, low) == 0.0
    for objective in (SmallestMargin(space), MarginShortfall(space, 1.0)):
        assert not objective.isSymmetric()
        there, back = objective.motionCost(low, high), objective.motionCost(high, low)
        assert objective.isCostBetterThan(there, back)
        assert back.value() == objective.infiniteCost().value()


def test_how_far_a_motion_is_valid(push):
    setup = push.setup()
    space = attach_evaluator(setup, push.evaluator, push.to_state, margin=MARGIN)
    one, other = (0.0, 0.0), (0.02, -0.03)
    start, end = state_of(setup, *one), state_of(setup, *other)
    last = space.last_valid(start, end)
    assert 0.0 < last < 1.0 and not space.is_valid_motion(start, end)
    fresh = Evaluator(push.evaluator.scene)
    margins = [margin_between(push, fresh, one, other, share) for share in (last, last + 0.34)]
    assert margins[0] >= MARGIN - 1e-6
    assert margins[1] < MARGIN


def test_objectives_are_integrals_and_minima(push):
    setup = push.setup()
    space = attach_evaluator(setup, push.evaluator, push.to_state, margin=0.1)
    one, other = (0.0, 0.0), (0.04, 0.015)
    start, end = state_of(setup, *one), state_of(setup, *other)
    fresh, fractions = Evaluator(push.evaluator.scene), np.linspace(0.0, 1.0, 41)
    margins = np.array([margin_between(push, fresh, one, other, s) for s in fractions])
    smallest = SmallestMargin(space)
    assert smallest.motionCost(start, end).value() == pytest.approx(margins.min(), rel=2e-3)
    wanted = float(np.median(margins)) + 0.1
    lack = np.trapezoid(np.maximum(wanted - margins, 0.0), fractions)
    length = np.linalg.norm(np.subtract(one, other))
    shortfall = MarginShortfall(space, wanted)
    assert shortfall.motionCost(start, end).value() == pytest.approx(lack * length, rel=0.02)
    path = geometric.PathGeometric(setup.getSpaceInformation())
    for state in (start, end):
        path.append(state)
    assert path.cost(smallest).value() == smallest.motionCost(start, end).value()
    assert path.cost(shortfall).value() == shortfall.motionCost(start, end).value()
    q, T = push.at(*one)
    at_rest = fresh.evaluate(q, T, np.zeros(6)).margin
    assert smallest.stateCost(start).value() == pytest.approx(at_rest, abs=1e-6)
    assert shortfall.stateCost(start).value() == pytest.approx(max(wanted - at_rest, 0.0), abs=1e-6)
    costs = [base.Cost(value) for value in (0.5, 0.7)]
    assert smallest.combineCosts(*costs).value() == 0.5
    assert smallest.isCostBetterThan(costs[1], costs[0])
    assert shortfall.combineCosts(*costs).value() == pytest.approx(1.2)
    for objective in (smallest, shortfall):
        bound = objective.motionCostHeuristic(start, end)
        assert not objective.isCostBetterThan(objective.motionCost(start, end), bound)


def test_a_planner_that_optimises(push):
    setup = push.setup()
    space = attach_evaluator(setup, push.evaluator, push.to_state, margin=0.1)
    objective = SmallestMargin(space)
    setup.setOptimizationObjective(objective)
    ends = [state_of(setup, *end) for end in ((0.0, 0.0), (0.03, 0.0))]
    setup.setStartAndGoalStates(*ends)
    setup.setPlanner(geometric.RRTstar(setup.getSpaceInformation()))
    calls = 0

    def enough() -> bool:
        nonlocal calls
        calls += 1
        return calls > 25

    setup.solve(base.PlannerTerminationCondition(enough))
    path = setup.getSolutionPath()
    states = path.getStates()
    found = min(space.margins(one, other)[1].min() for one, other in pairwise(states))
    assert path.cost(objective).value() == pytest.approx(found)


def test_a_motion_of_two_kinds_is_cut_where_one_ends(push):
    """The box slides, and then the palm alone turns."""

    def to_state(state: Any) -> Any:
        return push.at(min(state[0], 0.03), -max(state[0] - 0.03, 0.0))

    def breakpoints(start: Any, end: Any) -> list[float]:
        return [(0.03 - start[0]) / (end[0] - start[0])]

    setup = push.setup()
    setup.getSpaceInformation().setStateValidityCheckingResolution(0.99)
    space = attach_evaluator(setup, push.evaluator, to_state, margin=0.1, breakpoints=breakpoints)
    fractions, margins = space.margins(state_of(setup, 0.0, 0.0), state_of(setup, 0.05, 0.0))
    assert np.count_nonzero(fractions == 0.6) == 2
    slides = fractions <= 0.6
    slides[np.flatnonzero(fractions == 0.6)[1]] = False
    fresh = Evaluator(push.evaluator.scene)
    for fraction, margin in zip(fractions[slides], margins[slides], strict=True):
        expected = margin_between(push, fresh, (0.0, 0.0), (0.03, 0.0), fraction / 0.6)
        assert margin == pytest.approx(expected, abs=1e-6)
    for fraction, margin in zip(fractions[~slides], margins[~slides], strict=True):
        q, T = push.at(0.03, -0.05 * (fraction - 0.6))
        at_rest = fresh.evaluate(q, T, np.zeros(6)).margin
        assert margin == pytest.approx(at_rest, abs=1e-6)


def test_states_that_are_none(push):
    setup = push.setup()
    space = attach_evaluator(setup, push.evaluator, push.to_state, margin=0.1)
    off, on = state_of(setup, -0.005, 0.0), state_of(setup, 0.01, 0.0)
    assert space.state(off) is None and not space.is_valid(off)
    assert not space.is_valid_motion(off, on) and space.last_valid(off, on) == 0.0
    assert SmallestMargin(space).stateCost(off).value() == -np.inf
    assert space.margins(off, on)[1][-1] == -np.inf


def test_joints_alone():
    util.noOutputHandler()
    evaluator = Evaluator(load_scene(EXAMPLES / "trihand_push_box.yaml"))
    space = joint_space(evaluator)
    bounds = space.getBounds()
    np.testing.assert_array_equal([list(bounds.low), list(bounds.high)], evaluator.joint_limits)
    setup = geometric.SimpleSetup(space)
    evaluated = attach_evaluator(setup, evaluator, margin=0.1)
    q = evaluator.configuration()
    opened = q + 0.1 * np.array([name.endswith("distal") for name in evaluator.joint_names])
    start, end = state_of(setup, *q), state_of(setup, *opened)
    assert evaluated.is_valid(start) and not evaluated.is_valid_motion(start, end)
    fault = evaluator.first_invalid(q, opened, margin=0.1)
    assert fault is not None and evaluated.last_valid(start, end) == fault.last_valid
    assert SmallestMargin(evaluated).isSymmetric()  # the object stays
    some = joint_space(evaluator, ["finger_2_distal", "finger_1_spread"])
    low = [evaluator.joint_limits[0][evaluator.joint_names.index(name)]
           for name in ("finger_2_distal", "finger_1_spread")]  # fmt: skip
    assert list(some.getBounds().low) == low
    with pytest.raises(ArgumentError, match="finger_4"):
        joint_space(evaluator, ["finger_4_distal"])
    with pytest.raises(ArgumentError, match="margin"):
        attach_evaluator(setup, evaluator, margin=-1.0)
    with pytest.raises(ArgumentError, match="margin"):
        MarginShortfall(evaluated, -1.0)


def test_an_object_that_moves_with_a_link():
    util.noOutputHandler()
    evaluator = Evaluator(load_scene(EXAMPLES / "panda_carry_bar.yaml"), attached_to="panda_hand")
    setup = geometric.SimpleSetup(joint_space(evaluator))
    space = attach_evaluator(setup, evaluator, margin=3.0)
    home, across = evaluator.configuration(), evaluator.configuration({"panda_joint1": 1.5})
    start, end = state_of(setup, *home), state_of(setup, *across)
    assert space.is_valid(start) and space.is_valid(end)
    fault = evaluator.first_invalid(home, across, margin=3.0)
    assert fault is not None and space.last_valid(start, end) == fault.last_valid
    margin = evaluator.evaluate(home).margin
    assert SmallestMargin(space).stateCost(start).value() == pytest.approx(margin, abs=1e-6)


def test_states_of_some_joints_need_a_function():
    evaluator = Evaluator(load_scene("examples/panda_carry_bar.yaml"), attached_to="panda_hand")
    setup = geometric.SimpleSetup(joint_space(evaluator, evaluator.joint_names[:2]))
    with pytest.raises(ArgumentError, match="2 values, but the evaluator has 7 joints"):
        attach_evaluator(setup, evaluator)
