"""Bad arguments are refused with the argument, the index and the value that is wrong."""

from functools import partial
from typing import Any

import numpy as np
import pytest
from scenes import scene

from graspless_pin import (
    ControlMode,
    FingerContacts,
    GrasplessPinError,
    QuasistaticProblem,
    SlidingMode,
    assemble_joint_space,
    compare_rules,
    contact_force_bounds,
    disturbance_margin,
    enumerate_modes,
    explain,
    margin_sensitivity,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    optimum_gradients,
    solve_each_mode,
    stability,
    tolerances,
)
from graspless_pin.errors import ArgumentError, NoSolutionError, SolverUnavailableError
from graspless_pin.problem.checks import check_unit_rows
from graspless_pin.solvers import available_solvers

GOOD = {
    "positions": [[0.0, 0.0, -0.1], [0.1, 0.0, 0.0]],
    "normals": [[0.0, 0.0, 1.0], [-1.0, 0.0, 0.0]],
    "external_wrench": [0.0, 0.0, -9.8, 0.0, 0.0, 0.0],
    "jacobian": np.zeros((6, 2)),
    "friction": 0.3,
}
FRAMES = np.array([[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]], [[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]]])
NAN, INF = float("nan"), float("inf")


def test_the_good_arguments_are_good():
    problem = QuasistaticProblem(**GOOD, tangents=FRAMES)
    assert problem.contact_count == 2
    assert problem.joint_count == 2


def changed(array, index, value):
    """A copy with one entry changed."""
    copy = np.array(array, dtype=float)
    copy[index] = value
    return copy


def untyped(value: Any) -> Any:
    """What is passed by somebody who does not check types."""
    return value


# Argument, its bad value, and what the message must say besides the argument's name.
BAD_PROBLEMS = {
    "positions of a wrong shape": ("positions", np.zeros((2, 2)), ["(2, 2)", "3"]),
    "positions as a vector": ("positions", [0.0, 0.0, 1.0], ["(3,)"]),
    "no contact": ("positions", np.zeros((0, 3)), ["at least one contact"]),
    "positions that are words": ("positions", [["a", "b", "c"]] * 2, ["array of real numbers"]),
    "positions with a flag": ("positions", [[0.0, 0.0, True]] * 2, ["array of real numbers"]),
    "flags as friction": ("friction", np.array([True, False]), ["array of real numbers"]),
    "ragged positions": ("positions", [[0.0, 0.0], [0.0, 0.0, 1.0]], ["array of real numbers"]),
    "too few normals": ("normals", [[0.0, 0.0, 1.0]], ["(1, 3)", "(2, 3)"]),
    "a long normal": (
        "normals", [[0.0, 0.0, 1.0], [-2.0, 0.0, 0.0]],
        ["row 1", "[-2.0, 0.0, 0.0]", "length 2", "unit"],
    ),
    "a zero normal": ("normals", [[0.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], ["row 0", "length 0"]),
    "a NaN normal": ("normals", changed(GOOD["normals"], (0, 0), NAN), ["NaN", "(0, 0)"]),
    "a wrench without moment": ("external_wrench", [0.0, 0.0, -9.8], ["(3,)", "expected (6"]),
    "a Jacobian with too few rows": ("jacobian", np.zeros((3, 2)), ["(3, 2)", "(6, any)"]),
    "a transposed Jacobian": ("jacobian", np.zeros((1, 6)), ["(1, 6)", "it is transposed"]),
    "a Jacobian as a vector": ("jacobian", np.zeros(6), ["(6,)"]),
    "negative friction": ("friction", [0.3, -0.1], ["-0.1", "index 1", ">= 0"]),
    "infinite friction": ("friction", INF, ["inf", "index 0", "finite"]),
    "friction of a wrong length": ("friction", [0.3, 0.3, 0.3], ["(3,)", "expected (2"]),
    "friction that is a word": ("friction", "rubber", ["array of real numbers"]),
    "tangents of a wrong shape": ("tangents", np.zeros((2, 3)), ["(2, 3)", "(2, 3, 2)"]),
    "a tangent that is not unit": (
        "tangents", changed(FRAMES, (1, 1, 0), 0.5), ["(1, 0)", "length 0.5", "unit"]
    ),
    "tangents not orthogonal to the normal": (
        "tangents", changed(changed(FRAMES, (0, 0, 0), 0.8), (0, 2, 0), 0.6),
        ["index 0", "[0.8, 0.0, 0.6]", "orthogonal", "[0.0, 0.0, 1.0]"],
    ),
    "second tangent not orthogonal to the normal": (
        "tangents", changed(changed(FRAMES, (0, 1, 1), 0.8), (0, 2, 1), 0.6),
        ["index 0", "[0.0, 0.8, 0.6]", "orthogonal", "[0.0, 0.0, 1.0]"],
    ),
    "tangents not orthogonal to each other": (
        "tangents", changed(changed(FRAMES, (0, 0, 1), 0.6), (0, 1, 1), 0.8),
        ["index 0", "[0.6, 0.8, 0.0]", "orthogonal", "0.6"],
    ),
    "sliding of a wrong shape": ("sliding", np.zeros(3), ["(3,)", "(2, 3)"]),
    "sliding into the surface": (
        "sliding", [[0.0, 0.0, 0.0], [0.1, 0.2, 0.0]],
        ["[0.1, 0.2, 0.0]", "index 1", "-0.1", "tangential"],
    ),
    "limits that are one number": ("torque_limits", 10.0, ["10.0", "(lower, upper)"]),
    "three limits": ("torque_limits", (1.0, 2.0, 3.0), ["(1.0, 2.0, 3.0)", "(lower, upper)"]),
    "a lower limit above the upper": (
        "torque_limits", ([-1.0, 3.0], [1.0, 2.0]), ["3.0", "2.0", "index 1", "above"]
    ),
    "limits of a wrong length": (
        "torque_limits", ([-1.0] * 3, 1.0), ["lower", "(3,)", "expected (2"]
    ),
    "a NaN limit": ("torque_limits", (-1.0, [1.0, NAN]), ["upper", "NaN", "(1,)"]),
    "a lower limit of infinity": ("torque_limits", (INF, INF), ["inf", "index 0"]),
    "no normal force": ("max_normal_force", [50.0, 0.0], ["0.0", "index 1", "> 0"]),
    "a negative normal force": ("max_normal_force", -5.0, ["-5.0", "index 0"]),
    "an infinite normal force": ("max_normal_force", INF, ["inf", "finite"]),
    "an unknown cone": ("cone", "square", ["'square'", "one of 'edges', 'round'"]),
    "two cone edges": ("cone_edges", 2, ["2", ">= 3"]),
    "half a cone edge": ("cone_edges", 6.5, ["6.5", "whole number"]),
    "a flag as cone edges": ("cone_edges", True, ["True", "whole number"]),
    "too few joint names": ("joint_names", ["thumb"], ["1 names", "2 columns"]),
    "equal joint names": ("joint_names", ["thumb", "thumb"], ["'thumb'", "distinct"]),
    "gravity torques of a wrong length": ("gravity_torques", [0.1], ["(1,)", "expected (2"]),
}  # fmt: skip


def assert_refused(caught, argument, parts):
    error = caught.value
    assert isinstance(error, GrasplessPinError)
    message = str(error)
    assert message.startswith(argument)
    missing = [part for part in parts if part not in message]
    assert not missing, message


@pytest.mark.parametrize("length", [1.0 - 9e-7, 1.0 + 9e-7])
def test_unit_vectors_may_be_off_by_a_millionth(length):
    check_unit_rows("normals", np.array([[1.0, 0.0, 0.0], [0.0, length, 0.0]]))
    with pytest.raises(ArgumentError, match=r"row 1 .* with length"):
        check_unit_rows("normals", np.array([[1.0, 0.0, 0.0], [0.0, 2.0 * length - 1.0, 0.0]]))


NORMALS = GOOD["normals"]
FORCE, POSITION, HYBRID = ControlMode.FORCE, ControlMode.POSITION, ControlMode.HYBRID
BAD_FINGERS = {
    "a contact that does not exist": (
        [FingerContacts(POSITION, [2])], "fingers[0].contacts", ["contact 2", "2 contacts"]
    ),
    "a negative contact": (
        [FingerContacts(POSITION, [-1])], "fingers[0].contacts", ["contact -1"]
    ),
    "a contact of two fingers": (
        [FingerContacts(POSITION, [0, 1]), FingerContacts(HYBRID, [1])],
        "fingers[1].contacts", ["contact 1", "finger 0"],
    ),
    "a hybrid finger with two contacts": (
        [FingerContacts(HYBRID, [0, 1])], "fingers[0].contacts", ["2 contacts", "exactly one"]
    ),
    "a hybrid finger without a contact": (
        [FingerContacts(HYBRID, [])], "fingers[0].contacts", ["0 contacts", "exactly one"]
    ),
    "a hybrid finger that pulls": (
        [FingerContacts(HYBRID, [0], max_force=-2.0)], "fingers[0].max_force", ["-2.0", ">= 0"]
    ),
    "a force finger without a Jacobian": (
        [FingerContacts(FORCE, [0])], "fingers[0].jacobian", ["missing"]
    ),
    "a Jacobian for another number of contacts": (
        [FingerContacts(FORCE, [0], np.zeros((6, 1)))],
        "fingers[0].jacobian", ["(6, 1)", "(3, any)"],
    ),
    "a NaN in a finger's Jacobian": (
        [FingerContacts(FORCE, [0], [[0.0], [NAN], [0.0]])],
        "fingers[0].jacobian", ["NaN", "(1, 0)"],
    ),
    "limits for another number of joints": (
        [FingerContacts(FORCE, [0], np.zeros((3, 2)), torque_limits=(-1.0, [1.0]))],
        "fingers[0].torque_limits upper", ["(1,)", "expected (2"],
    ),
    "names for another number of joints": (
        [FingerContacts(FORCE, [0], np.zeros((3, 2)), joint_names=["thumb"])],
        "fingers[0].joint_names", ["length 1", "is 2"],
    ),
}  # fmt: skip


BAD_MODES = {
    "signs of a wrong shape": ([True, False], [[1, 1]], ["(1, 2)", "(2,)"]),
    "a selection of a wrong shape": ([[True]], [[1, 1]], ["(1, 1)"]),
    "a sign of two": ([True], [[1, 2]], ["[[1, 2]]", "-1, 0 or 1"]),
    "half a sign": ([True], [[0.5, 1]], ["0.5", "-1, 0 or 1"]),
    "signs where nothing is selected": (
        [True, False], [[1, 1], [0, -1]], ["[0, -1]", "index 1", "not selected"]
    ),
}  # fmt: skip


ONE_UP = SlidingMode([True], [[1, 1]])
HALF_OPEN = SlidingMode([False, True, False], [[0, 0], [1, 0], [0, 0]])
BAD_OPTIONS = {
    "an unknown sign rule": (
        {"sign_rule": "loose"}, "sign_rule", ["'loose'", "'strict'", "'exact'", "'nonzero'"]
    ),
    "an unknown sliding rule": (
        {"sliding_rule": "free"}, "sliding_rule", ["'free'", "'exempt'", "'constrained'"]
    ),
    "an unknown friction": (
        {"static_friction": "none"}, "static_friction", ["'none'", "'coulomb'"]
    ),
    "an unknown search": ({"search": "guess"}, "search", ["'guess'", "'auto'", "'enumerate'"]),
    "a search that only the tests have": (
        {"search": "milp"}, "search", ["'milp'", "one of 'auto', 'enumerate'"]
    ),
    "a negative regularization": ({"regularization": -1e-3}, "regularization", ["-0.001", ">= 0"]),
    "an infinite regularization": ({"regularization": INF}, "regularization", ["inf", "finite"]),
    "a mode for another number of contacts": ({"mode": ONE_UP}, "mode", ["1 contacts", "3"]),
    "a mode with an open sign": (
        {"mode": HALF_OPEN}, "mode", ["[1, 0]", "contact 1", "'strict'", "no zero component"]
    ),
}  # fmt: skip


SOLVERS_WORDS = ["'abacus'", "piqp", "proxqp", "highs", "clarabel", *available_solvers()]
BAD_CALLS = [
    *((lambda p, margin=margin: minimize_torque(p, margin), "margin", [shown, ">= 0"])
      for margin, shown in ((-0.1, "-0.1"), (NAN, "nan"), (INF, "inf"))),
    (lambda p: minimize_torque(p, 0.1, scale="relative"), "scale",
     ["'relative'", "'absolute'", "'limits'"]),
    (lambda p: maximize_margin(p, solver="abacus"), "solver", SOLVERS_WORDS),
    (lambda p: minimize_torque(p, 0.1, solver="abacus"), "solver", SOLVERS_WORDS),
    (lambda p: untyped(maximize_margin)(p, sign_rul="exact"), "sign_rul", ["mean 'sign_rule'?"]),
    (lambda p: untyped(contact_force_bounds)(p, [0.0], timelimit=1.0), "timelimit",
     ["mean 'time_limit'?"]),
    (lambda p: stability(p, untyped(maximize_margin(p))), "torques",
     ["is a TorqueSolution", "pass solution.torques"]),
    (lambda p: stability(p, untyped({"hinge": 0.1})), "torques",
     ["unknown joint 'hinge'", "joint_1"]),
    (lambda p: contact_force_bounds(p, [0.1] * 7), "torques", ["(7,)", "(2,), one per joint"]),
    (lambda p: enumerate_modes(p, sign_rule="loose"), "sign_rule", ["'loose'"]),
    (lambda p: p.margin_of(np.zeros((2, 3))), "forces", ["(2, 3)", "(3, 3)"]),
    (lambda _: assemble_joint_space([[0.0, 0.0, 0.9]], []), "normals", ["row 0", "length 0.9"]),
    (lambda _: untyped(assemble_joint_space)([[1.0, 0.0, 0.0]], [3]), "fingers[0]",
     ["found 3", "needs a FingerContacts"]),
    *((lambda p, length=length: untyped(disturbance_margin)(p, characteristic_length=length),
       "characteristic_length", [shown]) for length, shown in (("x", "'x'"), (True, "True"),
                                                               (0.0, "0.0"), (INF, "inf"))),
    (lambda p: optimum_gradients(maximize_margin(p)).per_mass(0.0), "mass", ["is 0"]),
    (lambda p: tolerances(p, maximize_margin(p).torques, quantities=["push"]).of("mass"),
     "quantity", ["'mass'", "'push'"]),
]  # fmt: skip


ALGORITHMS = (maximize_margin, partial(minimize_torque, margin=0.1))
CALLS = {
    **{name: (partial(QuasistaticProblem, **{**GOOD, argument: value}), argument, parts)
       for name, (argument, value, parts) in BAD_PROBLEMS.items()},
    **{name: (partial(assemble_joint_space, NORMALS, fingers), argument, parts)
       for name, (fingers, argument, parts) in BAD_FINGERS.items()},
    **{name: (partial(SlidingMode, selection, signs), "signs", parts)
       for name, (selection, signs, parts) in BAD_MODES.items()},
    **{f"{name}, algorithm {number}": (partial(algorithm, scene("sphere"), **options), *said)
       for name, (options, *said) in BAD_OPTIONS.items()
       for number, algorithm in enumerate(ALGORITHMS, start=1)},
    **{f"call {number}": (partial(call, scene("sphere")), *said)
       for number, (call, *said) in enumerate(BAD_CALLS)},
}  # fmt: skip


@pytest.mark.parametrize(("call", "argument", "parts"), CALLS.values(), ids=CALLS)
def test_bad_arguments_are_named(call, argument, parts):
    with pytest.raises((ArgumentError, SolverUnavailableError)) as caught:
        call()
    assert_refused(caught, argument, parts)
    assert getattr(caught.value, "argument", argument).startswith(argument)


def test_an_infeasible_solution_says_why_it_has_nothing():
    forces = minimize_torque(scene("rest"), margin=20.0)
    modes = maximize_margin(scene("up"), sliding_rule="constrained")
    for solution in (forces, modes):
        assert not solution.found
        for name in ("torques", "contact_torques", "contact_forces", "max_torque_unit", "mode"):
            with pytest.raises(NoSolutionError) as caught:
                getattr(solution, name)
            assert solution.status.message in str(caught.value)
        # Figures are NaN, as tables want them.
        assert np.isnan([solution.margin, solution.max_torque]).all()


def test_solutions_and_verdicts_have_no_truth_value():
    found = maximize_margin(scene("rest"))
    for solution in (found, minimize_torque(scene("rest"), margin=20.0)):
        with pytest.raises(TypeError, match=r"solution\.found says whether"):
            bool(solution)
    verdict = stability(found.problem, found.torques)
    with pytest.raises(TypeError, match=r"compare verdict\.status"):
        bool(verdict)


OF_A_RECORD = {
    "maximize_margin": maximize_margin,
    "minimize_torque": partial(minimize_torque, margin=0.1),
    "disturbance_margin": disturbance_margin,
    "minimum_friction": minimum_friction,
    "margin_torque_curve": margin_torque_curve,
    "margin_sensitivity": margin_sensitivity,
    "contact_force_bounds": lambda problem: contact_force_bounds(problem, [0.0]),
    "compare_rules": compare_rules,
    "solve_each_mode": lambda problem: next(solve_each_mode(problem)),
    "enumerate_modes": enumerate_modes,
    "explain": explain,
    "optimum_gradients": optimum_gradients,
}


@pytest.mark.parametrize("name", OF_A_RECORD)
def test_something_else_than_a_problem_or_a_solution(name):
    of_solution = name in ("explain", "optimum_gradients")
    what, kind = ("solution", "Torque") if of_solution else ("problem", "Quasistatic")
    wanted = f"must be a {kind}{what.title()}"
    for value in (5, None, "sphere", *([scene("sphere")] if of_solution else [])):
        with pytest.raises(ArgumentError) as caught:
            OF_A_RECORD[name](value)
        assert_refused(caught, what, [type(value).__name__, wanted])
