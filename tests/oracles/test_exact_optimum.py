"""The exact oracle: solved by hand, the paper's figures, invariances, the package at ease."""

import math
from dataclasses import replace
from fractions import Fraction
from functools import cache
from itertools import product

import numpy as np
import pytest
from scipy.optimize import nnls
from tests.core.random_scenes import general_scene, infeasible_scene, slope_scene
from tests.core.scenes import random_problem, scene, slider, structured_arguments
from tests.oracles.exact_optimum import ExactScene, Question
from tests.oracles.judging import Outcome, ask, compare

from graspless_pin import QuasistaticProblem

TORQUE = Question("torque")
STRICT, EXACT, NONZERO = (Question(sign_rule=rule) for rule in ("strict", "exact", "nonzero"))
UP = [0.0, 0.0, 1.0]


def pinch(weight: float = 0.0, **changes: object) -> QuasistaticProblem:
    """Two opposite fingers of one joint each, friction 1, square cones; t1 is up, t2 along x."""
    tangents = [[[0, 1], [0, 0], [1, 0]]] * 2
    jacobian = np.zeros((6, 2))
    jacobian[1, 0], jacobian[4, 1] = -0.5, 0.5
    return QuasistaticProblem(
        [[0, -1, 0], [0, 1, 0]], [[0, 1, 0], [0, -1, 0]], [0, 0, -weight, 0, 0, 0], jacobian,
        friction=1.0, tangents=tangents, max_normal_force=10.0, cone_edges=4,
    ).with_changes(**changes)  # fmt: skip


def test_margin_of_a_pinch_by_hand():
    """The squeeze f keeps f/sqrt(3) from the faces and 10 - f from the limit."""
    best = ExactScene(pinch(), STRICT).optimum()
    assert best is not None
    assert abs((10 / best.value - 1) ** 2 - 3) < Fraction(1, 10**20)


def test_torque_of_a_pinch_by_hand():
    """A margin of 1 takes a squeeze of sqrt(3), with levers of 1/2."""
    best = ExactScene(pinch(), replace(TORQUE, margin=1.0)).optimum()
    assert best is not None and abs((2 * best.value) ** 2 - 3) < Fraction(1, 10**20)
    limited = pinch(torque_limits=([-4.0, -4.0], [4.0, 2.0]))
    best = ExactScene(limited, replace(TORQUE, margin=1.0, by_limits=True)).optimum()
    # The first torque is -f/2, a share of 4; the second is -f/2, too, of its lower limit of 4.
    assert best is not None and abs((8 * best.value) ** 2 - 3) < Fraction(1, 10**20)
    uneven = pinch(torque_limits=([-4.0, -1.0], [4.0, 2.0]))
    best = ExactScene(uneven, replace(TORQUE, margin=1.0, by_limits=True)).optimum()
    assert best is not None and abs((2 * best.value) ** 2 - 3) < Fraction(1, 10**20)


def test_weight_hangs_on_a_sliding_down():
    """The object would slide down, along -t1, so both fingers may hold it by friction."""
    held = ExactScene(pinch(1.0), EXACT).optimum()
    assert held is not None and held.mode is not None
    assert {signs and signs[0] for signs in held.mode} == {-1}
    # A floor under it leaves no such sliding: then the floor has to carry all.
    floor = pinch(1.0).with_changes(
        positions=[[0, -1, 0], [0, 1, 0], [0, 0, -1]], normals=[[0, 1, 0], [0, -1, 0], UP],
        friction=[1.0, 1.0, 0.0], jacobian=np.vstack([pinch().jacobian, np.zeros((3, 2))]),
        tangents=[*pinch().tangents, [[1, 0], [0, 1], [0, 0]]],
        max_normal_force=10.0, sliding=None,
    )  # fmt: skip
    down = pytest.approx(math.sqrt(1 / 3), rel=2e-7)
    assert float(ExactScene(floor, EXACT).speed(((-1, 0), (-1, 0), None))) == down
    on_floor = ExactScene(floor.with_changes(friction=1.0), EXACT)
    assert float(on_floor.speed(((-1, 0), (-1, 0), None))) == down
    assert on_floor.speed(((-1, 0), (-1, 0), (1, 0))) == 0


def test_limits_of_zero_width_and_none():
    squeeze = 3.0
    fixed = pinch(torque_limits=([-0.5 * squeeze] * 2, [-0.5 * squeeze] * 2))
    best = ExactScene(fixed, STRICT).optimum()
    assert best is not None and abs(3 * best.value**2 - squeeze**2) < Fraction(1, 10**20)
    apart = fixed.with_changes(torque_limits=([-1.5, -1.6], [-1.5, -1.6]))
    assert ExactScene(apart, STRICT).relaxation() is None
    free = pinch(torque_limits=(-np.inf, np.inf))
    assert ExactScene(free, STRICT).optimum() == ExactScene(pinch(), STRICT).optimum()


@cache
def four_points(turn: float) -> QuasistaticProblem:
    """The same on four of the points, with square cones."""
    five = slider(turn)
    return QuasistaticProblem(
        five.positions[:4], five.normals[:4], five.external_wrench,
        friction=0.5, tangents=five.tangents[:4], cone_edges=4,
    )  # fmt: skip


def test_speed_of_the_slider_is_the_turn_of_its_tangents():
    """All five points slide along the edge of floor and wall, and along t2 by the sine only."""
    mode = ((1, -1),) * 5
    for turn in (1e-9, 1e-6, 1e-4):
        speed = ExactScene(slider(turn), STRICT).speed(mode)
        assert float(speed) == pytest.approx(math.sin(turn) / math.sqrt(5.0), rel=2e-7)
    assert ExactScene(slider(0.0), STRICT).speed(mode) == 0
    straight = pytest.approx(1.0 / math.sqrt(5.0), rel=2e-7)
    assert float(ExactScene(slider(0.0), EXACT).speed(((1, 0),) * 5)) == straight
    assert float(ExactScene(slider(0.0), NONZERO).speed(mode)) == straight
    assert ExactScene(slider(0.0), STRICT).speed((None,) * 5) == math.inf


def least_norm(exact: ExactScene, mode: tuple[tuple[int, int] | None, ...]) -> float:
    """The speed of a strict mode by another way: 1 over the least |u| with s u >= 1."""
    rows = np.array([[[float(e) for e in row] for row in block] for block in exact._velocities])
    chosen = [contact for contact, signs in enumerate(mode) if signs]
    flat = rows.reshape(-1, rows.shape[2])
    # Coordinates of the contact velocities, then of the motions that keep contacts touching.
    left, values, _ = np.linalg.svd(flat, full_matrices=False)
    seen = left[:, values > 1e-10 * values.max()].reshape(*rows.shape[:2], -1)
    _, sizes, right = np.linalg.svd(seen[chosen, 0])
    basis = right[(sizes > 1e-10).sum() :].T
    signed = [
        sign * (seen[contact, 1 + m] @ basis)
        for contact in chosen
        for m, sign in enumerate(mode[contact] or ())
    ]
    system = np.vstack([np.transpose(signed), np.ones(len(signed))])
    weights, _ = nnls(system, np.eye(len(system))[-1])
    apart = np.eye(len(system))[-1] - system @ weights
    return float(np.linalg.norm(apart[:-1]) / weights.sum()) if apart[-1] > 1e-14 else 0.0


@pytest.mark.sampled(2)
@pytest.mark.parametrize("seed", range(3))
def test_speed_is_that_of_the_least_motion(seed):
    exact = ExactScene(general_scene(seed, 3, joints=(1, 3)), STRICT)
    modes = list(exact.modes())[seed::31]
    speeds = [float(exact.speed(mode)) for mode in modes]
    others = [least_norm(exact, mode) if any(mode) else math.inf for mode in modes]
    assert speeds == pytest.approx(others, rel=1e-6, abs=1e-9)
    assert sum(0.0 < speed < 1.0 for speed in speeds) >= 2


def test_a_threshold_leaves_slow_motions_out():
    """Four of the points hold the slider only against a sliding of 1e-7 along t2."""
    exact = ExactScene(four_points(1e-7), STRICT)
    assert exact.optimum(Fraction(1, 10**6)) is None
    slow = exact.optimum(Fraction(1, 10**8))
    assert slow is not None and slow.mode is not None
    assert float(slow.value) == pytest.approx(0.0233918, rel=1e-5)
    speed = exact.speed(slow.mode)
    assert 1e-8 < float(speed) < 1e-7
    assert exact.optimum(speed) == slow and exact.optimum(speed * (1 + Fraction(1, 10**6))) is None


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(3))
def test_speed_knows_no_reference_point_and_no_scale(seed):
    problem = QuasistaticProblem(
        **structured_arguments(seed, ("slab", "pinch", "planar")[seed % 3], 4)
    )
    shift = 2.0**-4 * np.array([3.0, -5.0, 7.0])
    places = np.round(problem.positions * 2.0**20) / 2.0**20
    at_home = problem.with_changes(positions=places)
    moved = problem.with_changes(positions=places + shift)
    larger = problem.with_changes(positions=2.0**20 * places, jacobian=2.0**20 * problem.jacobian)
    scenes = [ExactScene(one, EXACT) for one in (at_home, moved, larger)]
    speeds = [[one.speed(mode) for mode in list(one.modes())[seed::388]] for one in scenes]
    for others in speeds[1:]:
        assert [float(one) for one in others] == pytest.approx(
            list(map(float, speeds[0])), rel=2e-7
        )
    assert any(speeds[0])


@pytest.mark.sampled(1)
@pytest.mark.parametrize("seed", range(6))
def test_search_is_the_listing_of_all_modes(seed):
    question = Question(
        ("margin", "torque")[seed % 2],
        sign_rule=("strict", "nonzero", "exact")[seed % 3],
        sliding_rule=("exempt", "constrained")[seed // 2 % 2],
    )
    count = 2 if question.sign_rule == "exact" else 3
    arguments = structured_arguments(seed, "slab", count, slides=seed // 2 % 2)
    exact = ExactScene(QuasistaticProblem(**arguments), question)
    values = [exact.in_mode(mode) for mode in exact.modes() if exact.admits(mode)]
    reached = [value for value in values if value is not None]
    pick = max if question.algorithm == "margin" else min
    best = exact.optimum()
    assert (best.value if best else None) == (pick(reached) if reached else None)


def test_forces_miss_what_is_taken_from_them():
    exact = ExactScene(pinch(2.0), STRICT)
    best = exact.optimum()
    assert best is not None and exact.load == 2
    forces = np.array(best.forces, dtype=float)
    assert exact.miss(forces) < 1e-15
    forces[0, 2] -= 0.2  # upward force that the weight needs: a tenth of the load
    assert float(exact.miss(forces)) == pytest.approx(0.1, rel=1e-6)
    squeezed = np.array(best.forces, dtype=float)
    squeezed[:, 1] += 20.0, -20.0
    assert float(exact.miss(squeezed)) > 1.0


PAPER = {
    ("sphere", "strict", "exempt"): (1.4509, 0.5187),
    ("up", "strict", "exempt"): (2.3001, 1.5554),
    ("up", "strict", "constrained"): (None, None),
    ("up", "nonzero", "constrained"): (2.3001, 1.5554),
    ("down", "strict", "exempt"): (3.9772, 0.8482),
}


@pytest.mark.sampled(1)
@pytest.mark.parametrize("case", PAPER, ids=" ".join)
def test_paper_figures(case):
    name, sign_rule, sliding_rule = case
    for algorithm, printed in zip(("margin", "torque"), PAPER[case], strict=True):
        question = Question(algorithm, 0.1, sign_rule=sign_rule, sliding_rule=sliding_rule)
        best = ExactScene(scene(name), question).optimum()
        assert (None if best is None else round(float(best.value), 4)) == printed


PAIRS = tuple(product(("strict", "exact", "nonzero"), ("exempt", "constrained")))


def ordinary(seed: int) -> tuple[QuasistaticProblem, Question]:
    """A scene of ordinary scales of 2 to 4 contacts, each with another rule and algorithm."""
    contacts, sliding = 2 + seed % 3, seed // 7 % 2
    makers = (
        lambda: general_scene(seed, contacts),
        lambda: general_scene(seed, contacts, joints=(1, 2)),
        lambda: slope_scene(seed, 3 + seed % 2),
        lambda: infeasible_scene(seed, contacts),
        lambda: random_problem(seed, contacts, slides=sliding),
        lambda: QuasistaticProblem(**structured_arguments(seed, "slab", 4, slides=sliding)),
        lambda: QuasistaticProblem(**structured_arguments(seed, "pinch", 4, slides=sliding)),
    )
    sign_rule, sliding_rule = PAIRS[seed // 3 % 6]
    question = Question(
        ("margin", "torque")[seed // 2 % 2], sign_rule=sign_rule, sliding_rule=sliding_rule
    )
    return makers[seed % 7](), question


@pytest.mark.sampled(8)
@pytest.mark.parametrize("seed", range(21))
def test_enumeration_agrees_at_ordinary_scales(seed):
    problem, question = ordinary(seed)
    verdict = compare(problem, question, ask(problem, question, search="enumerate"))
    assert verdict.outcome == Outcome.AGREE, verdict
