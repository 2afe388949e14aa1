"""The window of squeeze: hand-solved ends, and what verdicts say on either side of each end."""

from dataclasses import replace

import numpy as np
import pytest
from tests.scene.scene_tools import EXAMPLES

from graspless_pin import (
    Controller,
    Holding,
    QuasistaticProblem,
    load_scene,
    squeeze_window,
)
from graspless_pin.errors import ArgumentError

ANGLE, FRICTION, WEIGHT, LEVER, LIMIT = 0.6, 0.5, 4.9, 0.1, 0.5
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"


def pressed_block(limit: float = LIMIT) -> QuasistaticProblem:
    """A block on a slope, pressed onto it by a frictionless finger of one joint."""
    corners = [[x, y, -0.02] for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    normals = [[0.0, 0.0, 1.0]] * 4 + [[0.0, 0.0, -1.0]]
    jacobian = np.zeros((15, 1))
    jacobian[14] = -LEVER  # the finger pushes down
    load = WEIGHT * np.array([np.sin(ANGLE), 0.0, -np.cos(ANGLE), 0.0, 0.0, 0.0])
    return QuasistaticProblem(
        [*corners, [0.0, 0.0, 0.02]],
        normals,
        load,
        jacobian,
        friction=[FRICTION] * 4 + [0.0],
        torque_limits=(-limit, limit),
        max_normal_force=100.0,
        object_inertia=np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3]),
        joint_inertia=[[1e-4]],
    )


def test_a_pressed_block_slips_below_and_meets_the_limit_above() -> None:
    problem = pressed_block()
    least = LEVER * WEIGHT * (np.sin(ANGLE) / FRICTION - np.cos(ANGLE))
    window = squeeze_window(problem, [2.0 * least], [1.0], samples=6, precision=1e-3)
    lower, upper = window.lower, window.upper
    assert lower is not None and upper is not None
    assert least <= lower.torques[0] <= 1.01 * least
    assert lower.amount == pytest.approx(lower.torques[0] - 2.0 * least, abs=1e-9)
    # Next to the end the proof may need more nodes than the search has.
    assert lower.reason in ("slips", "undecided")
    assert upper.torques[0] == pytest.approx(LIMIT, rel=1e-9)
    assert upper.reason == "limit" and window.others == ()
    # One lever carries the finger's force.
    forces = [end.normal_force for end in (lower, upper)]
    assert forces == pytest.approx([lower.torques[0] / LEVER, LIMIT / LEVER], rel=1e-6)
    pressed = (
        f"the hand presses with {forces[0]:.3g} to 5 N (sum of normal forces); "
        f"joint '{problem.joint_names[0]}' has {lower.torques[0]:+.3g} to +0.5 N m"
    )
    assert pressed in str(window).splitlines()
    assert "times the given direction" in str(window)
    holds = np.array([one is Holding.HOLDS for one in window.holding])
    torques = 2.0 * least + window.amounts
    np.testing.assert_array_equal(holds, torques > least)
    slips = [one is Holding.FAILS for one in window.holding]
    np.testing.assert_array_equal(slips, torques < least)
    # The margin of the slope's contacts grows with the finger's force.
    assert (np.diff(window.margins[holds]) > 0.0).all()
    assert np.isnan(window.margins[~holds]).all()
    assert np.isnan(window.normal_forces[~holds]).all()
    np.testing.assert_allclose(window.normal_forces[holds], torques[holds] / LEVER, rtol=1e-6)


def test_the_ends_of_a_narrow_window_are_told_to_a_share_of_its_own_width() -> None:
    """However far the limits let it be looked: here to 1000 N m, where 0.15 to 10 hold."""
    least, most = LEVER * WEIGHT * (np.sin(ANGLE) / FRICTION - np.cos(ANGLE)), LEVER * 100.0
    window = squeeze_window(pressed_block(1e3), [2.0 * least], [1.0], samples=6, precision=1e-3)
    assert window.lower is not None and window.upper is not None
    low, high = window.lower.torques[0], window.upper.torques[0]
    assert least <= low <= least + 1e-3 * (most - least)
    assert most - 1e-3 * (most - least) <= high <= most * (1.0 + 1e-9)
    assert window.upper.reason == "limit"


def test_the_internal_forces_are_the_direction_unless_there_is_another() -> None:
    """Twice the squeeze is twice the finger's part that the slope's normals balance."""
    problem = pressed_block()
    window = squeeze_window(problem, [0.2], samples=3, precision=0.01)
    assert window.direction[0] > 0.0
    assert window.amounts[0] == pytest.approx(-1.0)


@pytest.fixture(scope="module")
def pressed_ball():
    scene = load_scene(BALL)
    return scene, scene.solve("torque", margin=0.1).torques


def test_more_feedback_lets_the_hand_squeeze_more(pressed_ball) -> None:
    scene, torques = pressed_ball
    tops = []
    for stiffness in (0.5, 1.0):
        held = scene.with_changes(controller=Controller(stiffness))
        window = squeeze_window(held, torques, samples=4, precision=0.01)
        assert window.lower is not None and window.upper is not None
        assert window.lower.reason == "slips" and window.upper.reason == "grows"
        assert "the object rolls, growing at" in window.upper.message
        assert held.stability(window.upper.torques).holding == "holds"
        amounts = [window.lower.amount - 0.1, window.upper.amount + 0.1]
        beyond = squeeze_window(held, torques, samples=amounts, precision=1.0)
        assert [one == "holds" for one in beyond.holding] == [False, True, False]
        assert beyond.amounts == pytest.approx([amounts[0], 0.0, amounts[1]])
        tops.append(window.upper.amount)
        said = f"holds with joint feedback of {stiffness:g} N m/rad while torques change by "
        assert str(window).startswith(said)
        assert "-1 takes the squeeze away" in str(window)
        most = int(np.argmax(np.abs(window.direction)))
        told = [f"{end.torques[most]:+.3g}" for end in (window.lower, window.upper)]
        name = scene.problem().joint_names[most]
        words = f"joint {name!r}, which changes most, has {told[0]} to {told[1]} N m"
        assert words in str(window)
        assert 0.0 < window.lower.normal_force < window.upper.normal_force
    assert tops[1] > 1.5 * tops[0]


def test_joints_that_follow_keep_a_reserve_of_friction(pressed_ball) -> None:
    """The least change alone would leave no margin at some contact."""
    scene, torques = pressed_ball
    held = scene.with_changes(controller=Controller(2.0))
    window = squeeze_window(held, torques, samples=[-0.3, 0.2, 0.4], precision=1.0)
    assert (window.margins > 0.05).all()
    with pytest.raises(
        ArgumentError, match=r"samples: has 100; effort limits allow amounts from -1 to "
    ):
        squeeze_window(held, torques, samples=[100.0])


def pinched_cube() -> QuasistaticProblem:
    """A cube on a smooth floor between two pairs of smooth linear fingers, along x and along y."""
    half, ways = 0.05, np.array([[1, 0, 0], [-1, 0, 0], [0, 1, 0], [0, -1, 0]], dtype=float)
    floor = [[x, y, -half] for x in (-half, half) for y in (-half, half)]
    jacobian = np.zeros((8, 3, 4))
    jacobian[np.arange(4), :, np.arange(4)] = ways
    return QuasistaticProblem(
        [*(-half * ways), *floor],
        [*ways, *[[0.0, 0.0, 1.0]] * 4],
        [0.0, 0.0, -WEIGHT, 0.0, 0.0, 0.0],
        jacobian.reshape(24, 4),
        friction=0.0,
        torque_limits=(-20.0, 20.0),
        joint_units=["N"] * 4,
        max_normal_force=100.0,
    )


def test_joints_that_need_not_follow_keep_their_torques() -> None:
    """Where the first finger presses more, the one opposite does, and the other pair as before."""
    given, amounts = np.array([10.0, 10.0, 2.0, 2.0]), [-6.0, -1.5, 3.0, 8.0]
    window = squeeze_window(pinched_cube(), given, [1.0, 0.0, 0.0, 0.0], samples=amounts)
    expected = given + window.amounts[:, None] * [1.0, 1.0, 0.0, 0.0]
    np.testing.assert_allclose(window.torques, expected, atol=1e-6)


def test_without_feedback_the_ball_has_no_window(pressed_ball) -> None:
    scene, torques = pressed_ball
    window = squeeze_window(scene, torques, samples=2)
    assert window.lower is None and window.upper is None
    assert str(window).startswith("the given torques do not hold: needs joint feedback of at le")
    assert Holding.NEEDS_FEEDBACK in window.holding and np.nanmax(window.growth) > 1.0


def test_other_joints_follow_or_stay(pressed_ball) -> None:
    scene, torques = pressed_ball
    held = scene.with_changes(controller=Controller(2.0))
    names = scene.problem().joint_names
    turned = int(np.argmax(np.abs(torques)))
    direction = {names[turned]: float(np.sign(torques[turned])) * 0.05}
    follow = squeeze_window(held, torques, direction, samples=4, precision=0.01)
    fixed = squeeze_window(
        held, torques, direction, other_joints="fixed", samples=4, precision=0.01
    )
    assert follow.upper is not None and fixed.upper is not None and follow.lower is not None
    assert follow.upper.amount > 10.0 * fixed.upper.amount
    kept = np.arange(len(torques)) != turned
    np.testing.assert_array_equal(fixed.upper.torques[kept], torques[kept])
    assert np.abs(follow.lower.torques - torques)[kept].max() > 1e-4


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.2], [0.0]), "direction: is zero"),
        (([0.2], {"thumb": 1.0}), "direction: unknown joint 'thumb'; known: "),
        (([0.0],), "torques: have no known forces of rest"),
        (([0.2, 0.1],), "torques: has shape"),
    ],
)
def test_bad_arguments_are_refused(arguments, message) -> None:
    with pytest.raises(ArgumentError, match=message):
        squeeze_window(pressed_block(), *arguments)


@pytest.mark.parametrize("samples", [np.int64(1), [-0.1, 0.1]])
def test_samples_are_a_number_of_them_or_amounts(samples) -> None:
    window = squeeze_window(pressed_block(), [0.2], [1.0], samples=samples, precision=0.5)
    assert len(window.amounts) == 3
    with pytest.raises(ArgumentError, match=r"samples: is 2\.0; it must be a whole number"):
        squeeze_window(
            pressed_block(),
            [0.2],
            [1.0],
            samples=2.0,  # pyright: ignore[reportArgumentType]
        )


def test_an_end_within_the_precision_is_told_as_zero() -> None:
    """The joint is at its limit but for rounding: there is nothing above."""
    limit = 0.2 * (1.0 + 1e-5)
    window = squeeze_window(pressed_block(limit), [0.2], [1.0], samples=4)
    assert window.upper is not None and 0.0 < window.upper.amount < 1e-5
    assert " to 0 times the given direction" in str(window)


def test_a_hand_that_need_not_press_presses_with_zero() -> None:
    """A block on a floor stays without it; what rounding leaves is no force."""
    stands = pressed_block().with_changes(external_wrench=[0.0, 0.0, -WEIGHT, 0.0, 0.0, 0.0])
    window = squeeze_window(stands, [0.3], samples=4)
    assert window.lower is not None
    window = replace(window, lower=replace(window.lower, torques=np.array([2e-14])))
    assert "the hand presses with 0 to 5 N (sum of normal forces); " in str(window)
    assert " has 0 to +0.5 N m" in str(window)


def test_torques_that_are_rounding_of_zero_have_the_margin_of_zero() -> None:
    """0.3 - 3 * 0.1 is -5.55e-17: that the finger pulls by as much is no news."""
    stands = pressed_block().with_changes(external_wrench=[0.0, 0.0, -WEIGHT, 0.0, 0.0, 0.0])
    window = squeeze_window(stands, [0.3], [0.1], samples=[-3.0], precision=1.0)
    assert -1e-16 < window.torques[0, 0] < 0.0
    assert window.margins[0] == pytest.approx(0.0, abs=1e-6)
    assert window.normal_forces[0] == pytest.approx(0.0, abs=1e-6)
