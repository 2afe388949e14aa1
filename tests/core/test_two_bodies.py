"""Other passive coordinates than those of one free object: two boxes, and a block on a rail."""

import pickle
from typing import Any

import numpy as np
import pytest
from scenes import cuboid_arguments, random_arguments, sphere_arguments
from two_bodies import G, balances, on_a_rail, stacked

from graspless_pin import (
    QuasistaticProblem,
    Status,
    body_wrench_matrix,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError

PAIRS = [(0.5, 0.5), (0.5, 0.3), (0.3, 0.5)]
STEEP = pytest.mark.parametrize("beyond", [-0.02, 0.02])


@pytest.mark.parametrize("friction", PAIRS)
@STEEP
def test_a_stack_stays_up_to_the_smaller_friction_angle(friction, beyond):
    arguments = stacked(np.arctan(min(friction)) + beyond, friction)
    problem = QuasistaticProblem(**arguments)
    assert balances(arguments) == (beyond < 0.0)
    for solution in (maximize_margin(problem), minimize_torque(problem, 0.0)):
        assert solution.found == (beyond < 0.0)
        assert solution.found or solution.status is Status.INFEASIBLE_FORCES
    if beyond < 0.0:
        solution = maximize_margin(problem)
        assert solution.margin > 0.0
        left = problem.W @ solution.contact_forces.ravel() + problem.external_wrench
        np.testing.assert_allclose(left, 0.0, atol=1e-6)


@pytest.mark.parametrize("push", [0.1, 3.0])
@STEEP
def test_a_pushing_finger_holds_a_stack_on_a_steeper_slope(push, beyond):
    arguments = stacked(np.arctan(0.5) + beyond, push=push)
    problem, works = QuasistaticProblem(**arguments), balances(arguments)
    least = minimize_torque(problem, 0.0)
    assert maximize_margin(problem).found == works
    assert least.found == works
    assert works == (beyond < 0.0 or push > 1.0)
    if beyond > 0.0 and works:
        enough = least.max_torque
        assert balances(arguments | {"torque_limits": (0.0, 1.001 * enough)})
        assert not balances(arguments | {"torque_limits": (0.0, 0.999 * enough)})


def test_the_oracle_knows_the_slope_by_hand():
    for angle in (0.1, 0.4, 0.5, 0.6):
        assert balances(stacked(angle)) == (np.tan(angle) < 0.5)


@pytest.mark.parametrize(
    "arguments",
    [sphere_arguments(), cuboid_arguments(), cuboid_arguments(1.0), random_arguments(7, 3)],
    ids=["sphere", "cuboid", "sliding cuboid", "random"],
)
def test_a_problem_with_its_own_matrix_is_the_same(arguments):
    problem = QuasistaticProblem(**arguments)
    same = problem.with_changes(wrench_matrix=problem.W)
    assert same.wrench_matrix is not None
    for solve in (maximize_margin, lambda one: minimize_torque(one, 0.1)):
        first, second = solve(problem), solve(same)
        assert second.status is first.status
        assert second.value == pytest.approx(first.value, abs=1e-7, rel=1e-6, nan_ok=True)
        if first.found:
            assert second.max_torque == pytest.approx(first.max_torque, abs=1e-4)


def _both(first, second):
    """Two unrelated problems as one, of which nothing of the one touches the other."""
    one, two = QuasistaticProblem(**first), QuasistaticProblem(**second)

    def block(a, b):
        whole = np.zeros((a.shape[0] + b.shape[0], a.shape[1] + b.shape[1]))
        whole[: a.shape[0], : a.shape[1]] = a
        whole[a.shape[0] :, a.shape[1] :] = b
        return whole

    def joined(name):
        return np.concatenate([getattr(one, name), getattr(two, name)])

    return QuasistaticProblem(
        joined("positions"), joined("normals"), joined("external_wrench"), block(one.J, two.J),
        friction=joined("friction"), tangents=joined("tangents"), sliding=joined("sliding"),
        torque_limits=(joined("lower_torque"), joined("upper_torque")),
        max_normal_force=joined("max_normal_force"), cone_edges=one.cone_edges,
        wrench_matrix=block(one.W, two.W),
    )  # fmt: skip


def test_two_unrelated_objects_have_the_margin_of_the_weaker_one():
    strong: dict[str, Any] = cuboid_arguments()
    weak: dict[str, Any] = sphere_arguments() | {"cone_edges": 6}
    alone = [maximize_margin(QuasistaticProblem(**one)).margin for one in (strong, weak)]
    together = maximize_margin(_both(strong, weak))
    assert together.margin == pytest.approx(min(alone), abs=1e-6)
    assert maximize_margin(_both(weak, strong)).margin == pytest.approx(min(alone), abs=1e-6)
    # Without friction the cuboid slides down, whatever the sphere does.
    slippery: dict[str, Any] = strong | {"friction": 0.0}
    assert not maximize_margin(QuasistaticProblem(**slippery)).found
    assert not maximize_margin(_both(slippery, weak)).found


@pytest.mark.parametrize("push", [0.0, 3.0])
def test_the_order_of_bodies_does_not_matter(push):
    for angle in (0.0, 0.3, 0.44):
        first, second = (
            maximize_margin(QuasistaticProblem(**stacked(angle, push=push, order=order)))
            for order in ((0, 1), (1, 0))
        )
        assert second.status is first.status
        assert second.margin == pytest.approx(first.margin, abs=1e-6)


@pytest.mark.parametrize("squeeze", [5.0, 9.7, 9.9, 20.0])
def test_a_block_on_a_rail_is_held_by_two_fingers(squeeze):
    """Each finger bears half the weight by friction: at most mu times its normal force."""
    problem, mu = on_a_rail(squeeze), 0.5
    least = 0.5 * G / mu
    solution, weakest = maximize_margin(problem), minimize_torque(problem, 0.0)
    assert solution.found == weakest.found == (squeeze > least)
    if squeeze > least:
        assert weakest.max_torque == pytest.approx(least, abs=1e-6)
        np.testing.assert_allclose(solution.contact_forces[:, 2], 0.5 * G, atol=1e-6)
        # The force is along an edge of the pyramid, as far from both of its faces.
        narrow = np.cos(np.pi / 32)
        room = narrow * (mu * squeeze - 0.5 * G) / np.sqrt(1.0 + (mu * narrow) ** 2)
        assert solution.margin == pytest.approx(room, abs=1e-6)


def test_a_problem_of_other_coordinates_is_pickled_changed_and_shown():
    problem = QuasistaticProblem(**stacked(0.2, push=3.0))
    again = pickle.loads(pickle.dumps(problem))  # noqa: S301 - its own
    np.testing.assert_array_equal(again.W, problem.W)
    assert again.passive_units == problem.passive_units
    assert again.passive_count == 12
    assert "12 passive coordinates" in repr(problem)
    assert "passive" not in repr(QuasistaticProblem(**cuboid_arguments()))
    heavier = problem.with_changes(external_wrench=2.0 * problem.external_wrench)
    np.testing.assert_array_equal(heavier.W, problem.W)
    np.testing.assert_array_equal(heavier.object_inertia, problem.object_inertia)


def test_other_positions_want_another_matrix():
    problem = QuasistaticProblem(**stacked(0.2))
    with pytest.raises(ArgumentError, match=r"wrench_matrix.*give the matrix of the new positions"):
        problem.with_changes(positions=problem.positions + 0.01)
    moved = problem.with_changes(positions=problem.positions + 0.01, wrench_matrix=problem.W)
    np.testing.assert_array_equal(moved.W, problem.W)
    alone = problem.with_changes(
        positions=problem.positions, wrench_matrix=None, external_wrench=np.zeros(6)
    )
    assert alone.passive_count == 6
    assert alone.object_inertia is None
    # A rail's unit goes with its matrix.
    rail = on_a_rail(20.0)
    assert rail.with_changes(wrench_matrix=2.0 * rail.W).passive_units == ("N",)
    freed = rail.with_changes(wrench_matrix=None, external_wrench=np.zeros(6))
    assert len(freed.passive_units) == 6
    for wrong in (5.0, [[0.0, 0.0, 1.0], [1.0]], np.float64(1.0), "none"):
        with pytest.raises(ArgumentError, match=r"wrench_matrix"):
            rail.with_changes(wrench_matrix=wrong)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"wrench_matrix": np.zeros((12, 23))}, r"wrench_matrix.*\(12, 23\).*\(any, 24\)"),
        ({"wrench_matrix": np.zeros(24)}, r"wrench_matrix.*\(24,\)"),
        ({"wrench_matrix": np.zeros((0, 24))}, r"wrench_matrix.*no row"),
        ({"wrench_matrix": np.full((12, 24), np.nan)}, r"wrench_matrix.*NaN at index \(0, 0\)"),
        ({"external_wrench": np.zeros(6)}, r"external_wrench.*\(6,\).*\(12,\)"),
        ({"object_inertia": np.eye(6)}, r"object_inertia.*\(6, 6\).*\(12, 12\)"),
        ({"wrench_matrix": np.ones((7, 24))}, r"passive_units.*7 rows.*each of 6 rows"),
        ({"passive_units": ["N"]}, r"passive_units.*1 units.*12 rows"),
        ({"passive_units": ["kg"] * 12}, r"passive_units.*'kg' at index 0.*'N m'"),
        ({"passive_units": "N"}, r"passive_units.*sequence"),
        (
            {"wrench_matrix": None, "external_wrench": np.zeros(6), "passive_units": ["N"] * 6},
            r"passive_units.*without a wrench_matrix",
        ),
    ],
)
def test_wrong_coordinates_are_named(changes, said):
    with pytest.raises(ArgumentError, match=said):
        QuasistaticProblem(**stacked(0.2) | changes)


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"points": np.zeros((3, 2))}, r"points.*\(3, 2\)"),
        ({"bodies": [[0, -1]]}, r"bodies.*\(1, 2\).*\(2, 2\)"),
        ({"bodies": [[0, -1], [2, 0]]}, r"bodies.*2 at index \(1, 0\).*0 to 1"),
        ({"bodies": [[0, -1], [-1, 0]]}, r"bodies.*-1 at index \(1, 0\).*, 0 to 1$"),
        ({"bodies": [[0, -1], [1, 0.5]]}, r"bodies.*0.5 at index \(1, 1\).*whole.*or -1"),
        ({"bodies": [[0, -1], [1, 1]]}, r"bodies.*index 1.*itself"),
        ({"centers": np.zeros(3)}, r"centers.*\(3,\)"),
    ],
)
def test_wrong_bodies_are_named(changes, said):
    zeros = np.zeros((2, 3))
    arguments = {"points": zeros, "bodies": [[0, -1], [1, 0]], "centers": zeros}
    assert body_wrench_matrix(**arguments).shape == (12, 6)
    with pytest.raises(ArgumentError, match=said):
        body_wrench_matrix(**arguments | changes)


def test_the_reaction_is_the_opposite_force_about_the_other_centre():
    points, centers = np.array([[0.3, 0.1, 0.2]]), np.array([[0.0, 0.1, 0.0], [0.1, 0.0, 0.4]])
    force = np.array([1.0, -2.0, 3.0])
    wrench = body_wrench_matrix(points, [[1, 0]], centers) @ force
    np.testing.assert_allclose(wrench[:3], -force)
    np.testing.assert_allclose(wrench[3:6], np.cross(points[0] - centers[0], -force))
    np.testing.assert_allclose(wrench[6:9], force)
    np.testing.assert_allclose(wrench[9:], np.cross(points[0] - centers[1], force))
