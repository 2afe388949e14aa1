"""What a solution holds, how it reads, and that it cannot be changed."""

import pickle
import subprocess
import sys

import numpy as np
import pytest
from random_scenes import general_scene
from scenes import assert_holds, cuboid_arguments, rescaled, scene

from graspless_pin import (
    Evaluator,
    QuasistaticProblem,
    SlidingMode,
    Status,
    load_scene,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import NoSolutionError


def test_names_are_broken_where_a_table_would_be():
    names = ["left_finger_proximal_joint", "right_finger_proximal_joint"]
    text = str(maximize_margin(QuasistaticProblem(**cuboid_arguments(1.0), joint_names=names)))
    table = text.partition("joint ")[2].partition("torques in")[0]
    assert max(map(len, text.splitlines())) == 80
    assert "".join(line.split()[0] for line in table.splitlines()[2:]) == "".join(names)
    assert "+4.77" in table


def test_the_text_names_joints_contacts_and_margin():
    names = ["left_lever", "right_lever"]
    solution = maximize_margin(QuasistaticProblem(**cuboid_arguments(1.0), joint_names=names))
    text = str(solution)
    assert "margin e = 2.30006 N" in text
    rows = {line.split()[0]: line for line in text.splitlines() if line}
    assert "-4.77" in rows["left_lever"]
    assert "+4.77" in rows["right_lever"]
    assert "47.7 %" in rows["left_lever"]
    assert [rows[str(contact)].count("sliding") for contact in range(6)] == [0, 1, 1, 1, 1, 0]
    for contact in range(6):
        normal = solution.contact_forces[contact] @ solution.problem.normals[contact]
        assert f"{normal:.4f}" in rows[str(contact)]
    assert "certificate" in text
    assert solution.certificate.solver in text
    assert solution.status.message in text


def test_friction_use_and_state_in_the_text():
    """A block held by the friction of one hand-solved contact: 2 N of at most 0.5 * 5 N."""
    for push, words in ((2.0, ("80 %", "5.0000")), (2.5, ("limit",))):
        problem = QuasistaticProblem(
            [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [push, 0.0, -5.0, 0.0, 0.0, 0.0],
            friction=0.5, cone_edges=8, tangents=[[[1, 0], [0, 1], [0, 0]]],
        )  # fmt: skip
        lines = str(maximize_margin(problem)).splitlines()
        row = next(line for line in lines if line.split()[:1] == ["0"])
        assert all(word in row for word in words)


def test_the_text_of_an_infeasible_solution_says_why():
    solution = minimize_torque(scene("rest"), 20.0)
    assert str(solution).startswith(f"not found: infeasible\n\n{solution.explanation}\n\n")


def test_a_solution_that_was_sent_to_another_process_says_why(tmp_path):
    """There nothing but the solution itself has been loaded."""
    solution = minimize_torque(scene("rest"), 20.0)
    file = tmp_path / "solution.pickle"
    file.write_bytes(pickle.dumps(solution))
    code = f"import pickle; print(pickle.load(open({str(file)!r}, 'rb')))"
    shown = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)  # noqa: S603
    assert "the required margin would have to be at most" in solution.explanation
    assert shown.stdout == f"{solution}\n"


def test_a_problem_without_joints_has_no_joint_table():
    problem = QuasistaticProblem([[0, 0, 0]], [[0, 0, 1]], [0, 0, -5, 0, 0, 0], friction=0.5)
    solution = maximize_margin(problem)
    assert solution.torques.shape == (0,)
    assert "joint " not in str(solution)
    # A force of 5 N along n is 5 mu' / sqrt(1 + mu'^2) from the faces, mu' = mu cos(pi / 32).
    slope = 0.5 * np.cos(np.pi / 32)
    assert solution.margin == pytest.approx(5.0 * slope / np.sqrt(1.0 + slope**2), rel=1e-6)


def test_a_problems_arrays_are_its_own():
    arguments = cuboid_arguments(1.0)
    problem = QuasistaticProblem(**arguments)
    before = problem.tangents.copy()
    arguments["tangents"][:] = 7.0
    np.testing.assert_array_equal(problem.tangents, before)
    with pytest.raises(ValueError, match="read-only"):
        problem.kinetic_directions[...] = 1.0


def test_modes_compare_by_value():
    one = SlidingMode([True, False], [[1, -1], [0, 0]])
    assert one == SlidingMode(np.array([1, 0]), np.array([[1.0, -1.0], [0, 0]]))
    assert hash(one) == hash(SlidingMode([True, False], [[1, -1], [0, 0]]))
    assert one != SlidingMode([True, False], [[1, 1], [0, 0]])
    assert one != "+- .."
    assert str(one) == "+- .."
    assert str(SlidingMode([True], [[0, -1]])) == "0-"


def test_gravity_torques_shift_torques_and_limits():
    arguments = cuboid_arguments()
    plain = minimize_torque(QuasistaticProblem(**arguments), 0.1)
    gravity = np.array([0.3, -0.2])
    loaded = minimize_torque(QuasistaticProblem(**arguments, gravity_torques=gravity), 0.1)
    np.testing.assert_allclose(loaded.torques, loaded.contact_torques + gravity)
    # Symmetric pinching keeps both contact torques equal and opposite; the better place for the
    # load is to help them: (-0.9618 + 0.3, 0.9618 - 0.2).
    np.testing.assert_allclose(plain.torques, [-0.9618, 0.9618], rtol=2e-4)
    np.testing.assert_allclose(loaded.torques, [-0.6618, 0.7618], rtol=3e-4)
    assert_holds(loaded)


def test_gravity_torques_count_against_the_limits():
    """At 10 N m both levers press with 50 - e; 6 N m of gravity leave one of them 4 N m."""
    arguments = cuboid_arguments()
    limits = (-4.0, 4.0)
    free = maximize_margin(QuasistaticProblem(**arguments, torque_limits=limits))
    loaded = QuasistaticProblem(**arguments, torque_limits=limits, gravity_torques=[-2.0, 0.0])
    solution = maximize_margin(loaded)
    assert solution.margin < free.margin - 0.01
    shifted = QuasistaticProblem(**arguments, torque_limits=([-2.0, -4.0], [6.0, 4.0]))
    assert solution.margin == pytest.approx(maximize_margin(shifted).margin, rel=1e-6)
    assert_holds(solution)


def test_scale_by_limits_shares_the_load():
    """Two levers press one block from above: absolute halves the load, limits split it 1 to 3."""
    arguments = {
        "positions": [[-0.1, 0, 0.1], [0.1, 0, 0.1], [-0.1, 0, -0.1], [0.1, 0, -0.1]],
        "normals": [[0, 0, -1], [0, 0, -1], [0, 0, 1], [0, 0, 1]],
        "external_wrench": [0.0, 0.0, 12.0, 0.0, 0.0, 0.0],
        "jacobian": np.zeros((12, 2)),
        "friction": 0.0,
        "torque_limits": ([-1.0, -3.0], [1.0, 3.0]),
    }
    arguments["jacobian"][2, 0] = arguments["jacobian"][5, 1] = 0.1
    arguments["positions"][2:] = [[0.0, 0.0, -0.1], [0.0, 0.0, -0.1]]
    problem = QuasistaticProblem(**arguments)
    for scale in ("absolute", "limits"):
        solution = minimize_torque(problem, 0.0, scale=scale)
        # Moments about y allow only equal forces: both scales give 0.6 N m each.
        np.testing.assert_allclose(solution.torques, [-0.6, -0.6], atol=1e-6)
    # Now the supports under the levers may press back with a moment.
    arguments["positions"][2:] = [[-0.1, 0.0, -0.1], [0.1, 0.0, -0.1]]
    arguments["positions"][:2] = [[0.0, 0.1, 0.1], [0.0, 0.1, 0.1]]
    arguments["external_wrench"] = [0.0, 0.0, 12.0, 1.2, 0.0, 0.0]
    problem = QuasistaticProblem(**arguments)
    absolute = minimize_torque(problem, 0.0)
    by_limits = minimize_torque(problem, 0.0, scale="limits")
    np.testing.assert_allclose(absolute.torques, [-0.6, -0.6], atol=1e-6)
    np.testing.assert_allclose(by_limits.torques, [-0.3, -0.9], atol=1e-6)


def test_a_node_limit_ends_the_search():
    nothing = minimize_torque(scene("rest"), 0.1, node_limit=1)
    assert nothing.certificate.nodes == 1
    assert nothing.status in (Status.NOT_FOUND_IN_LIMIT, Status.LIMIT_REACHED)
    full = minimize_torque(scene("rest"), 0.1)
    assert full.certificate.nodes > 1
    assert nothing.certificate.bound <= full.max_torque + 1e-6
    assert minimize_torque(scene("rest"), 0.1, time_limit=0.0).status is Status.NOT_FOUND_IN_LIMIT


def test_the_representation_is_one_line():
    solution = maximize_margin(scene("up"))
    assert repr(solution) == (
        f"<TorqueSolution margin: OPTIMAL, margin={solution.margin:.6g}, "
        f"max_torque={solution.max_torque:.6g}, 6 contacts, 2 joints>"
    )
    problem = scene("up").with_changes(torque_limits=(0.0, 0.0))
    assert repr(maximize_margin(problem)) == (
        "<TorqueSolution margin: INFEASIBLE_FORCES, 6 contacts, 2 joints>"
    )


@pytest.mark.sampled(3)
@pytest.mark.parametrize("seed", range(8))
def test_the_largest_margin_is_reached_with_the_smallest_torque(seed):
    """Algorithm 2 at the margin of Algorithm 1: what `maximize_margin` advises."""
    problem = general_scene(seed, 5)
    best = maximize_margin(problem)
    least = minimize_torque(problem, margin=best.margin)
    assert least.found
    assert least.margin >= best.margin - 1e-5
    assert least.max_torque <= best.max_torque + 1e-5


@pytest.mark.parametrize("margin", [0.1, 40.0])
def test_a_solution_knows_what_was_optimised(margin):
    """Found or not: its document needs it."""
    best = minimize_torque(scene("rest"), 0.1)
    for mode in (None, best.mode):
        solution = minimize_torque(
            scene("rest"), margin, scale="limits", regularization=1e-3, mode=mode
        )
        assert solution.found == (margin < 1.0)
        assert solution.objective.by_limits and solution.regularization == 1e-3
        assert solution.given_mode == mode


@pytest.mark.parametrize("size", [1e-9, 1e-6, 1e-3, 1e9])
def test_figures_of_any_size_are_printed_with_their_digits(size):
    """As those of the same scene of everyday size, but for the power of ten."""
    problem = scene("rest")
    solution, other = (
        minimize_torque(rescaled(problem, factor), 0.1 * factor) for factor in (1.0, size)
    )
    plain, scaled = str(solution), str(other)
    assert f"margin e = {0.1 * size:.6g} N" in scaled
    assert f"max |torque| = {other.max_torque:.6g} N m" in scaled
    assert f"proven bound {other.certificate.bound:.6g} N m" in scaled
    normal = float(solution.problem.normals[0] @ solution.contact_forces[0])
    assert f"{normal:.4f}" in plain
    assert f"{float(problem.normals[0] @ other.contact_forces[0]):.5g}" in scaled
    for torque in other.torques:
        assert f"{torque:+.5g}" in scaled
    # What rounding left of zero is still zero; the proven gap is a figure of its own.
    tables = scaled.partition("certificate:")[0]
    assert "e-17" not in tables and "e-25" not in tables


def test_torques_are_told_by_joint():
    loaded = load_scene("examples/paper/cuboid_at_rest.yaml")
    solution, state = loaded.solve(), Evaluator(loaded).evaluate()
    for found in (solution, state):
        assert [*found.torques_by_joint] == ["finger_1/hinge", "finger_6/hinge"]
        np.testing.assert_array_equal([*found.torques_by_joint.values()], found.torques)
    missing = loaded.solve("torque", margin=1e3)
    with pytest.raises(NoSolutionError, match="no solution to read"):
        _ = missing.torques_by_joint
