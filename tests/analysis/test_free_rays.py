"""Forces that nothing holds: opposed fingers whose torques do not fix how hard they squeeze."""

from itertools import product
from typing import Any

import numpy as np
import pytest
from analysis_scenes import PAIRS, rules_of
from force_oracle import ForceSet, component_rows
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    contact_force_bounds,
    enumerate_modes,
    maximize_margin,
)
from graspless_pin.errors import ArgumentError

INF = np.inf


def pinched(columns: list[list[float]], *, tilt: float = 0.0, wrench=(0, 0, -10, 0, 0, 0)):
    """A finger on each side along y, friction 0.5 with the first edge along z.

    Args:
        columns: Force that each finger's joint feels: rows of its Jacobian; none: stiff fingers.
        tilt: Angle (rad) by which both normals lean towards x.
        wrench: External wrench.
    """
    s, c = np.sin(tilt), np.cos(tilt)
    jacobian = np.zeros((2, 3, len(columns)))
    for finger, column in enumerate(columns):
        jacobian[finger, :, finger] = column
    return QuasistaticProblem(
        [[0, -0.1, 0], [0, 0.1, 0]],
        [[s, c, 0], [s, -c, 0]],
        wrench,
        jacobian.reshape(6, -1),
        friction=0.5,
        tangents=[[[0, c], [0, -s], [1, 0]], [[0, c], [0, s], [1, 0]]],
        cone_edges=4,
    )


@pytest.mark.sampled(4)
@pytest.mark.parametrize("pair", PAIRS, ids="+".join)
@pytest.mark.parametrize("columns", [[], [[0, 0, 0.1], [0, 0, 0.1]]], ids=["stiff", "tangential"])
def test_nothing_holds_the_squeeze(columns, pair):
    """Each finger bears half the weight, 5 N, with at least 5 / 0.5 N of pressing and no most."""
    problem = pinched(columns)
    torques = [0.5] * len(columns)
    bounds = contact_force_bounds(problem, torques, sign_rule=pair[0], sliding_rule=pair[1])
    np.testing.assert_allclose(bounds.lower, [[10, 5, 0]] * 2, atol=1e-5)
    np.testing.assert_allclose(bounds.upper, [[INF, 5, 0]] * 2, atol=1e-5)
    np.testing.assert_array_equal(bounds.indeterminate, [[True, False, False]] * 2)
    assert bounds.smallest_margin == -INF
    best = max(
        ForceSet(problem, mode, torques=torques, normal_limit=False).best_case()[0]
        for mode in enumerate_modes(problem, sign_rule=pair[0], sliding_rule=pair[1])
    )
    assert bounds.largest_margin == pytest.approx(best, abs=1e-6)
    # At the best the cone's face and the normal-force limit are equally far: h^T f = f_n,max - f_n.
    slope = 0.5 * np.sqrt(0.5)
    press = (50.0 * np.hypot(1, slope) + 5.0 * np.sqrt(0.5)) / (slope + np.hypot(1, slope))
    assert best == pytest.approx(50.0 - press, abs=1e-6)
    assert "inf" in str(bounds) and "margin between -inf and" in str(bounds)


def test_torques_that_feel_the_squeeze_hold_it():
    """With J = 0.1 n a torque of 2 N m is 20 N of pressing, and all is determined."""
    problem = pinched([[0, 0.1, 0], [0, -0.1, 0]])
    bounds = contact_force_bounds(problem, [2.0, 2.0])
    np.testing.assert_allclose(bounds.lower, [[20, 5, 0]] * 2, atol=1e-5)
    np.testing.assert_allclose(bounds.upper, [[20, 5, 0]] * 2, atol=1e-5)
    assert not bounds.indeterminate.any()
    assert bounds.smallest_margin == pytest.approx(bounds.largest_margin, abs=1e-5)
    slope = 0.5 * np.sqrt(0.5)
    assert bounds.largest_margin == pytest.approx(
        (20 * slope - 5 * np.sqrt(0.5)) / np.hypot(1, slope)
    )


def test_one_finger_that_feels_it_holds_it():
    problem = pinched([[0, 0.1, 0]])
    bounds = contact_force_bounds(problem, [1.5])
    np.testing.assert_allclose(bounds.upper, [[15, 5, 0]] * 2, atol=1e-5)


@pytest.mark.parametrize("sliding_rule", ["exempt", "constrained"])
@pytest.mark.parametrize("sign_rule", ["strict", "exact", "nonzero", "coulomb"])
def test_a_ray_that_needs_friction(sign_rule, sliding_rule):
    """Fingers that lean towards x squeeze only with friction towards -x at both.

    They slide along x in opposite directions or not at all. So `strict` and `exact` forbid that
    friction; `nonzero` leaves it free while the object slides along z, and Coulomb always.
    """
    problem = pinched([], tilt=0.15, wrench=(-3, 0, 0, 0, 0, 0))
    options: dict[str, Any] = {"sign_rule": sign_rule, "sliding_rule": sliding_rule}
    modes = [None]
    if sign_rule == "coulomb":
        options = {"static_friction": "coulomb"}
    else:
        modes = list(enumerate_modes(problem, **options, maximal=True))
    bounds = contact_force_bounds(problem, [], **options)
    rows = component_rows(problem)
    most = np.max([ForceSet(problem, m, normal_limit=False).maxima(rows) for m in modes], axis=0)
    np.testing.assert_allclose(bounds.upper.ravel(), most, atol=1e-5)
    assert np.isinf(bounds.upper[:, 0]).all() == (sign_rule in ("nonzero", "coulomb"))
    assert (bounds.smallest_margin == -INF) == (sign_rule in ("nonzero", "coulomb"))
    # Pressed against both fingers by 3 N along x: at least the normals' share without friction.
    np.testing.assert_array_less(bounds.lower[:, 0], 1.5 / np.sin(0.15) + 1e-5)


@pytest.mark.parametrize("rule", ["coulomb", "strict"])
@pytest.mark.parametrize("axis", [[0.36, 0.48, 0.8], [3.0, 1.0, -2.0], [-1.0, 2.0, 5.0]])
def test_a_squeeze_makes_no_friction_where_there_is_none(axis, rule):
    """Right angles in rounded figures are off by 1e-17, and no normal force makes more of that."""
    normal = np.array(axis) / np.linalg.norm(axis)
    along = np.cross(normal, [0.0, 1.0, 0.0])
    slip = along / np.linalg.norm(along)
    options: dict[str, Any] = {"static_friction": rule} if rule == "coulomb" else {}
    stuck = QuasistaticProblem(
        np.zeros((2, 3)), [normal, -normal], [*-normal, 0, 0, 0], friction=0.0
    )
    bounds = contact_force_bounds(stuck, [], **options)
    np.testing.assert_array_equal(np.isinf(bounds.upper), [[True, False, False]] * 2)
    np.testing.assert_array_equal(bounds.upper[:, 1:], 0.0)
    np.testing.assert_array_equal(bounds.lower[:, 1:], 0.0)
    # Where both slide along t1 in opposite directions there is none along t2.
    sliding = stuck.with_changes(
        friction=0.5,
        sliding=[slip, -slip],
        external_wrench=[*(0.5 * slip - normal), 0, 0, 0],
    )
    bounds = contact_force_bounds(sliding, [], **options)
    np.testing.assert_array_equal(np.isinf(bounds.upper[:, 0]), [True, True])
    np.testing.assert_array_equal(bounds.upper[:, 2], 0.0)
    np.testing.assert_array_equal(bounds.lower[:, 2], 0.0)


def test_a_ray_that_no_force_goes_with():
    """Squeezing leaning fingers takes a slide along z, and the load one that excludes it.

    Only friction at the floor, below a finger, holds the moment about the line between the
    fingers. An object that stays on the floor there cannot slide along z at that finger.
    """
    pinch = pinched([], tilt=0.15)
    normals = np.vstack([pinch.normals, [0, 0, 1]])
    positions = np.vstack([pinch.positions, [0, 0.1, -0.1]])
    forces = np.array([10.0, 10.0, 5.0])[:, None] * normals + [[0, 0, 0], [0, 0, 0], [1, 0, 0]]
    problem = QuasistaticProblem(
        positions,
        normals,
        -np.concatenate([forces.sum(axis=0), np.cross(positions, forces).sum(axis=0)]),
        friction=0.5,
        tangents=np.concatenate([pinch.tangents, [[[1, 0], [0, 1], [0, 0]]]]),
        cone_edges=4,
    )
    bounds = contact_force_bounds(problem, [], sign_rule="nonzero")
    modes = list(enumerate_modes(problem, sign_rule="nonzero", maximal=True))
    rows = component_rows(problem)
    most = np.max([ForceSet(problem, m, normal_limit=False).maxima(rows) for m in modes], axis=0)
    np.testing.assert_allclose(bounds.upper.ravel(), most, atol=1e-5)
    assert np.isfinite(most).all()
    # Some mode has the ray, and some mode has forces.
    light = problem.with_changes(external_wrench=np.zeros(6))
    assert any(ForceSet(light, m, normal_limit=False).maximum(rows[0]) == INF for m in modes)


# The cuboid at rest once: under `nonzero` its search is long.
@pytest.mark.sampled(5)
@pytest.mark.parametrize(
    ("name", "pair"), [*product(["sphere", "up", "down"], PAIRS), ("rest", ("strict", "exempt"))]
)
def test_the_optimum_is_the_best_case(name, pair):
    """The torques of Algorithm 1 can end up with its margin, and with less or the same."""
    options = rules_of(pair)
    problem = scene(name)
    solution = maximize_margin(problem, **options)
    if not solution.found:
        assert pair == ("strict", "constrained") and name in ("up", "down")
        return
    bounds = contact_force_bounds(problem, solution.torques, **options)
    assert bounds.largest_margin == pytest.approx(solution.margin, abs=1e-4)
    assert bounds.smallest_margin <= bounds.largest_margin + 1e-5
    rows = component_rows(problem)
    components = (rows @ solution.contact_forces.ravel()).reshape(-1, 3)
    assert (components >= bounds.lower - 1e-4).all() and (components <= bounds.upper + 1e-4).all()


def test_torques_that_nothing_holds():
    problem = pinched([[0, 0.1, 0], [0, -0.1, 0]])
    bounds = contact_force_bounds(problem, [0.1, 0.1])
    assert not bounds.found and bounds.status is Status.INFEASIBLE_FORCES
    assert np.isnan(bounds.upper).all() and np.isnan(bounds.lower).all()
    assert np.isnan(bounds.smallest_margin) and np.isnan(bounds.largest_margin)
    assert str(bounds).startswith("not found: infeasible")
    assert not bounds.indeterminate.any()


def test_bad_arguments_are_named():
    problem = pinched([[0, 0.1, 0], [0, -0.1, 0]])
    with pytest.raises(ArgumentError, match=r"^torques: "):
        contact_force_bounds(problem, [1.0])
    with pytest.raises(ArgumentError, match=r"^sign_rule: is 'lax'"):
        contact_force_bounds(problem, [1.0, 1.0], sign_rule="lax")


def test_who_may_squeeze_with_any_force_is_said_in_words():
    problem = QuasistaticProblem(
        [(-0.05, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, -0.05)],
        [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)],
        [0.0, 0.0, -9.81, 0.0, 0.0, 0.0],
        friction=[0.0, 0.0, 0.5],
        cone="round",
    )
    every = contact_force_bounds(problem, [], static_friction="coulomb")
    assert every.covers == "over all forces of rest (round cones)"
    assert every.squeeze_words() == (
        "the supports may squeeze the object with unbounded force: contacts 0 and 1"
    )
    assert every.squeeze_words(["left", "right", "floor"]).startswith("left and right may squeeze")
    assert every.squeeze_words() in str(every)
    assert every.covers in str(every)
    pyramids = contact_force_bounds(
        problem.with_changes(cone="edges"), [], static_friction="coulomb"
    )
    assert pyramids.covers == "over all forces of rest (32 cone edges)"
    ruled = contact_force_bounds(problem, [])
    assert ruled.covers == "over all admissible contact forces"
    hung = problem.with_changes(external_wrench=[0.0, 0.0, 9.81, 0.0, 0.0, 0.0], friction=0.0)
    assert contact_force_bounds(hung, []).squeeze_words() == ""
