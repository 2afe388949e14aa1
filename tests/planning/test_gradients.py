"""Gradients of both optima by all data, against central differences of full re-solves."""

from collections import Counter
from dataclasses import fields
from itertools import product
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.analysis.analysis_scenes import PAIRS, scene_of
from tests.core.random_scenes import general_scene
from tests.core.scenes import scene

from graspless_pin import (
    QuasistaticProblem,
    margin_sensitivity,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.gradients import Gradients, optimum_gradients
from graspless_pin.errors import ArgumentError, NoSolutionError

NAMES = (
    *("sphere", "rest", "up", "down"),
    *(f"general {seed}" for seed in range(4)),
    *(f"slope {seed}" for seed in range(2)),
    *(f"random {seed}" for seed in range(4)),
    *(f"structured {seed}" for seed in range(3)),
    "tight 1",
)
ALGORITHMS = ("margin", "torque", "limits")
STEP = 1e-5


def problem_of(name: str) -> QuasistaticProblem:
    family, _, number = name.partition(" ")
    seed = int(number or 0)
    if family == "general":
        return general_scene(seed, 2 + seed % 3, joints=(1, 3), cone_edges=5)
    if family == "tight":
        problem = general_scene(20 + seed, 3, joints=(1, 2), cone_edges=5)
        solution = maximize_margin(problem, static_friction="coulomb")
        press = np.einsum("ij,ij->i", problem.normals, solution.contact_forces)
        return problem.with_changes(max_normal_force=press + 0.7 * solution.margin)
    contacts = {"slope": 3 + seed % 2, "random": 2 + seed % 3, "structured": 3}
    return scene_of(family, seed, contacts[family]) if number else scene(name)


def solve(problem, algorithm, **options):
    if algorithm == "margin":
        return maximize_margin(problem, **options)
    required = options.pop("margin", 0.02)
    scale = "limits" if algorithm == "limits" else "absolute"
    return minimize_torque(problem, required, scale=scale, **options)


def optimum(solution, algorithm) -> float:
    if algorithm == "margin":
        return solution.margin
    if algorithm == "torque":
        return solution.max_torque
    problem, torques = solution.problem, solution.torques
    up = torques[problem.upper_torque > 0] / problem.upper_torque[problem.upper_torque > 0]
    down = torques[problem.lower_torque < 0] / problem.lower_torque[problem.lower_torque < 0]
    return max(up.max(initial=0.0), down.max(initial=0.0))


def turned(problem, contact, axis):
    """The problem with one contact's frame turned about an axis (rad)."""
    R = Rotation.from_rotvec(axis).as_matrix()
    changes = {name: getattr(problem, name).copy() for name in ("normals", "tangents", "sliding")}
    for values in changes.values():
        values[contact] = R @ values[contact]
    return problem.with_changes(**changes)


def changed(problem, name, step):
    return problem.with_changes(**{name: getattr(problem, name) + step})


def directions(problem, rng):
    """(what, entries of its gradient with weights, problem moved by h) in random directions."""
    p, m, l = problem, problem.contact_count, problem.joint_count  # noqa: E741

    def plain(name, shape, active=None):
        d = rng.normal(size=shape) * (1.0 if active is None else active)
        return name, d, lambda h: changed(p, name, h * d)

    yield plain("positions", (m, 3))
    yield plain("external_wrench", (6,))
    yield plain("friction", (m,), (p.friction > 0.0).astype(float))
    yield plain("max_normal_force", (m,))
    contact = int(rng.integers(m))
    n = p.normals[contact]
    axis = np.cross(n, rng.normal(size=3))
    d = np.zeros((m, 3))
    d[contact] = np.cross(axis, n)
    yield "normals", d, lambda h: turned(p, contact, h * axis)
    spin = np.zeros(m)
    spin[contact] = 1.0
    yield "spins", spin, lambda h: turned(p, contact, h * n)
    if l:
        yield plain("jacobian", (3 * m, l))
        yield plain("gravity_torques", (l,))
        low, high = p.lower_torque, p.upper_torque
        loose = (low < high).astype(float)
        for name, side in (("upper_torque", 1), ("lower_torque", 0)):
            d = rng.normal(size=l) * loose * np.isfinite((low, high)[side])
            yield (
                name,
                d,
                lambda h, d=d, side=side: p.with_changes(
                    torque_limits=(low + (1 - side) * h * d, high + side * h * d)
                ),
            )


def compared(index: int, algorithm: str, solver: str = "auto") -> Counter[str]:
    """Compare one scene in its best mode; count the comparisons that were made."""
    rng = np.random.default_rng([index, 7])
    problem = problem_of(NAMES[index])
    options: dict[str, Any] = dict(
        zip(("sign_rule", "sliding_rule"), PAIRS[index % 6], strict=True)
    )
    solution = solve(problem, algorithm, solver=solver, **options)
    if not solution.found:
        return Counter({"infeasible": 1})
    gradients = optimum_gradients(solution)
    best, options["mode"] = optimum(solution, algorithm), solution.mode
    counts: Counter[str] = Counter()
    for what, direction, moved in directions(problem, rng):
        beside = [solve(moved(sign * STEP), algorithm, **options) for sign in (1.0, -1.0)]
        if not all(other.found for other in beside):
            counts["at the edge"] += 1
            continue
        ends = [optimum(other, algorithm) for other in beside]
        right, left = (ends[0] - best) / STEP, (best - ends[1]) / STEP
        derivative = float(np.sum(getattr(gradients.values, what) * direction))
        tolerance, where = 2e-3 * max(1.0, abs(right), abs(left)), (NAMES[index], algorithm, what)
        smooth = abs(right - left) <= tolerance
        if gradients.unique[what][direction != 0.0].all():
            assert derivative == pytest.approx((right + left) / 2.0, abs=tolerance), (
                NAMES[index],
                what,
            )
            counts[what] += 1
            counts[f"{what}, not zero"] += abs(derivative) > 10.0 * tolerance
        else:
            low, high = sorted((left, right))
            amid = low - tolerance <= derivative <= high + tolerance
            assert amid or solver == "highs", where
            counts["flagged"] += 1
            counts["flagged kinks"] += not smooth
    return counts


def test_gradients_are_finite_differences():
    """Unmarked entries are derivatives; marked ones lie between the one-sided derivatives."""
    counts: Counter[str] = Counter()
    for index, algorithm in product(range(len(NAMES)), ALGORITHMS):
        counts += compared(index, algorithm)
    assert counts["infeasible"] <= 6
    assert counts["flagged kinks"] >= 30
    names = [item.name for item in fields(Gradients) if item.name != "required_margin"]
    for name in names:
        assert counts[name] >= 20, (name, counts)
        assert counts[f"{name}, not zero"] >= 3, (name, counts)


def test_a_vertex_is_not_taken_for_the_only_optimum():
    """HiGHS answers with a vertex of all optimal forces and multipliers, at which both may end."""
    counts: Counter[str] = Counter()
    for index, algorithm in product(range(len(NAMES)), ALGORITHMS):
        counts += compared(index, algorithm, "highs")
    assert counts["flagged kinks"] >= 30
    feet = [[x, y, -0.05] for x in (-0.1, 0.1) for y in (-0.1, 0.1)]
    plate = QuasistaticProblem(feet, [[0, 0, 1]] * 4, [0, 0, -8, 0, 0, 0], friction=0.5,
                               max_normal_force=50.0, cone_edges=4)  # fmt: skip
    # As a plate on four equal feet: a push aside, wherever it goes, costs margin at once.
    found = optimum_gradients(maximize_margin(plate, static_friction="coulomb", solver="highs"))
    assert found.unique["external_wrench"].tolist() == [False, False, True, False, False, False]
    assert not found.unique["friction"].any()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["sphere", "up", "general 1", "general 5", "slope 1", "tight 1"])
def test_friction_wrench_and_limits_agree_with_the_sensitivity(name):
    problem = problem_of(name)
    known = margin_sensitivity(problem)
    values = optimum_gradients(known.solution).values
    for item in ("friction", "external_wrench", "upper_torque", "lower_torque", "max_normal_force"):
        np.testing.assert_allclose(
            getattr(values, item), getattr(known, item), atol=2e-5, rtol=1e-5
        )
    gradients = optimum_gradients(known.solution)
    assert gradients.load == pytest.approx(known.load)
    assert gradients.per_mass(2.0) == pytest.approx(known.per_mass(2.0))


@pytest.mark.sampled(3)
@pytest.mark.parametrize("name", ["sphere", "up", "general 1", "general 6"])
@pytest.mark.parametrize("algorithm", ["torque", "limits"])
def test_required_margin(name, algorithm):
    problem = problem_of(name)
    at = solve(problem, algorithm, margin=0.02)
    low, high = (
        optimum(solve(problem, algorithm, margin=0.02 + h, mode=at.mode), algorithm)
        for h in (-1e-4, 1e-4)
    )
    slope = float(optimum_gradients(at).values.required_margin[0])
    assert slope > 0.0
    assert slope == pytest.approx((high - low) / 2e-4, rel=1e-3)


def pinch(jacobian, **options):
    """Two contacts that face each other, without a load."""
    points, normals = [[0, -0.1, 0], [0, 0.1, 0]], [[0, 1, 0], [0, -1, 0]]
    options |= {"friction": 0.5, "torque_limits": (-1.0, 1.0)}
    return QuasistaticProblem(points, normals, np.zeros(6), jacobian, **options)


def test_by_hand():
    """A finger 0.1 m long presses 10 N of force at most: e = 50 - f_n, and f_n = tau / 0.1."""
    problem = pinch(np.array([[0, -0.1, 0, 0, 0, 0]]).T, cone_edges=4)
    gradients = optimum_gradients(maximize_margin(problem))
    s = 0.5 * np.sqrt(0.5)
    per_newton = s / np.hypot(1.0, s)
    assert gradients.solution.margin == pytest.approx(10.0 * per_newton)
    assert gradients.values.lower_torque[0] == pytest.approx(-10.0 * per_newton, rel=1e-6)
    assert gradients.values.upper_torque[0] == pytest.approx(0.0, abs=1e-6)
    # f_n = 1 N m / |J|: a longer lever presses less.
    assert gradients.values.jacobian[1, 0] == pytest.approx(100.0 * per_newton, rel=1e-6)
    assert gradients.values.gravity_torques[0] == pytest.approx(10.0 * per_newton, rel=1e-6)


def test_fingers_that_limit_together_are_flagged():
    """Two equal fingers against each other: more strength of one alone changes nothing."""
    jacobian = np.zeros((6, 2))
    jacobian[1, 0], jacobian[4, 1] = -0.1, 0.1
    gradients = optimum_gradients(maximize_margin(pinch(jacobian), static_friction="coulomb"))
    assert gradients.degenerate
    np.testing.assert_array_equal(gradients.unique["lower_torque"], [False, False])
    np.testing.assert_array_equal(gradients.unique["upper_torque"], [True, True])
    # Together they do count, whichever way the multipliers are split.
    assert -gradients.values.lower_torque.sum() == pytest.approx(gradients.solution.margin)
    # An optimum with one set of forces and multipliers is not degenerate.
    gradients = optimum_gradients(maximize_margin(problem_of("general 1")))
    assert gradients.degenerate is False


def test_limits_that_are_equal_have_no_derivative():
    """Nor has the weight that a joint carries which moves no contact: any other is infeasible."""
    jacobian = np.zeros((9, 3))
    jacobian[1, 0], jacobian[4, 1] = -0.1, 0.1
    pinched = QuasistaticProblem(
        [[0, -0.05, 0], [0, 0.05, 0], [0, 0, -0.05]], [[0, 1, 0], [0, -1, 0], [0, 0, 1]],
        [0, 0, -4.9, 0, 0, 0], jacobian, friction=0.5, torque_limits=([-2, -2, 0], [2, 2, 0]),
    )  # fmt: skip
    for solver in ("auto", "highs"):
        found = maximize_margin(pinched, static_friction="coulomb", solver=solver)
        unique = optimum_gradients(found).unique
        for name in ("gravity_torques", "upper_torque", "lower_torque"):
            assert not unique[name][2], name


def test_what_has_no_gradient():
    lifted = scene("sphere").with_changes(external_wrench=[0, 0, 99, 0, 0, 0])
    with pytest.raises(NoSolutionError, match="no optimum to differentiate"):
        optimum_gradients(maximize_margin(lifted))
    with pytest.raises(ArgumentError, match="regularisation"):
        optimum_gradients(maximize_margin(scene("sphere"), regularization=1e-4))


def test_gradients_print_as_a_small_table():
    found = optimum_gradients(maximize_margin(problem_of("rest")))
    lines = str(found).splitlines()
    assert lines[0] == "derivatives of the largest margin, N"
    values = {line.split()[0]: line.split()[1:] for line in lines[4:]}
    assert set(values) == {one.name for one in fields(Gradients)}
    friction = found.values.friction
    largest = friction[np.abs(friction).argmax()]
    assert float(values["friction"][0]) == pytest.approx(largest, abs=1e-3)
    assert values["required_margin"] == ["0", "N", "yes"]
    assert len(str(found.values).splitlines()) == len(lines) - 2
