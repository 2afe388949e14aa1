"""Solvers that fail, lie, mix up problems or give up: nothing that is stated is wrong."""

from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import cache, partial
from itertools import product
from typing import Any

import numpy as np
import pytest
from random_scenes import general_scene, slope_scene
from scenes import SOLVERS, assert_holds, scene
from scipy import optimize
from test_kinematics import WRONG_PROGRAMS, WRONG_SQUARES

from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    contact_force_bounds,
    disturbance_margin,
    explain,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
)
from graspless_pin.algorithms import dual_degeneracy, force_bounds, formulation
from graspless_pin.algorithms import margin_torque_curve as curve_module
from graspless_pin.algorithms.disturbances import DisturbanceMargin
from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.algorithms.options import SolveOptions, torque_objective
from graspless_pin.algorithms.warm_search import reaches_margin, solve_from
from graspless_pin.modes.rules import Rules
from graspless_pin.programs.answers import Answer, failed_answer
from graspless_pin.programs.objectives import Margin
from graspless_pin.programs.program import Program
from graspless_pin.solvers import Outcome, solve, solving
from graspless_pin.solvers.other_backends import by_qpsolvers

Found = tuple[np.ndarray, np.ndarray, np.ndarray]
Backend = Callable[[Program], Found | None]
RULES = Rules.parse()
RANGES = ("sphere", "small")
OPEN = (Status.UNVERIFIED, Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT)
PROBLEMS = {
    **{name: (lambda name=name: scene(name)) for name in ("sphere", "rest", "up")},
    "free": lambda: general_scene(3, 4),
    "slope": lambda: slope_scene(2, 4),
    "small": lambda: general_scene(5, 3),
}


def fresh(name: str) -> QuasistaticProblem:
    """A problem of which nothing has been computed yet."""
    return PROBLEMS[name]()


# Backends


def lies() -> dict[str, Callable[[Backend], Backend]]:
    """Ways to answer wrongly, as backends around a right one."""

    def changed(change: Callable[..., tuple[Any, Any, Any] | None]):
        def around(backend: Backend) -> Backend:
            def asked(program: Program) -> Found | None:
                raw = backend(program)
                return None if raw is None else change(program, *raw)

            return asked

        return around

    def of_another(backend: Backend) -> Backend:
        """The answer to the program of the same size that was asked before."""
        before: dict[tuple[int, int, int], Found] = {}

        def asked(program: Program) -> Found | None:
            raw = backend(program)
            size = len(program.c), len(program.b), len(program.u)
            stale = before.get(size)
            if raw is not None:
                before[size] = raw
            return raw if stale is None else stale

        return asked

    def of_the_opposite(backend: Backend) -> Backend:
        """A feasible point that is far from optimal: that of the opposite objective."""

        def asked(program: Program) -> Found | None:
            raw, other = backend(program), backend(replace(program, c=-program.c))
            return raw if raw is None or other is None else (other[0], raw[1], raw[2])

        return asked

    nan = np.nan
    return {
        "fails": changed(lambda *_: None),
        "a point that is off": changed(lambda _, x, y, z: (x + 1e-3, y, z)),
        "all zero": changed(lambda _, x, y, z: (0 * x, 0 * y, 0 * z)),
        "signs turned": changed(lambda _, x, y, z: (x, -y, -z)),
        "multipliers without end": changed(lambda _, x, y, z: (x + 1.0, 1e12 * y, 1e12 * z)),
        "rays of nothing": changed(lambda _, x, y, z: (1e9 + x, 1e9 + 0 * y, 1e9 + 0 * z)),
        "not a number": changed(lambda _, x, y, z: (nan * x, nan * y, nan * z)),
        "multipliers that are none": changed(lambda _, x, y, z: (x, nan * y, nan * z)),
        "infinite": changed(lambda _, x, y, z: (x + np.inf, y - np.inf, z + np.inf)),
        "of another program": of_another,
        "not optimal": of_the_opposite,
    }


LIES = lies()
MENDED = ("a point that is off", "multipliers without end", "of another program", "not optimal")


@pytest.fixture(params=list(LIES))
def lying(request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch) -> str:
    """All solvers lie, in one way."""
    for name in SOLVERS:
        honest = solving._BACKENDS.get(name) or by_qpsolvers(name)
        monkeypatch.setitem(solving._BACKENDS, name, LIES[request.param](honest))
    return request.param


HONEST: dict[tuple[str, str], Any] = {}


def honest(name: str, what: str) -> Any:
    """What is right, computed once, before anything lies."""
    if not HONEST:
        for one in PROBLEMS:
            problem = fresh(one)
            margin = maximize_margin(problem)
            torque = minimize_torque(problem, 0.01)
            HONEST.update({(one, "margin"): margin, (one, "torque"): torque})
            held = margin.torques if margin.found else np.zeros(problem.joint_count)
            if one in RANGES:
                HONEST[one, "bounds"] = contact_force_bounds(problem, held)
    return HONEST[name, what]


@pytest.fixture(autouse=True, scope="module")
def known() -> None:
    """Compute what is right before anything lies."""
    honest("rest", "margin")


def assert_right(found, expected, figure: str) -> None:
    """It is the right answer, or says that it is not proven."""
    if found.status is Status.UNVERIFIED:
        return
    if found.status in (Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT):
        if found.found:
            assert_holds(found)
    else:
        assert found.status is expected.status
        if expected.found:
            assert getattr(found, figure) == pytest.approx(getattr(expected, figure), abs=1e-5)
            assert_holds(found)
    if expected.found and np.isfinite(found.certificate.bound):
        best, sign = getattr(expected, figure), 1.0 if figure == "margin" else -1.0
        assert sign * found.certificate.bound >= sign * best - 1e-5


@pytest.mark.parametrize("how", LIES)
def test_where_one_solver_lies_another_answers(how, monkeypatch):
    """Unless the multipliers tell which constraints are active: then the answer is put right."""
    expected = honest("up", "margin")
    monkeypatch.setitem(solving._BACKENDS, "piqp", LIES[how](solving._BACKENDS["piqp"]))
    found = maximize_margin(fresh("up"), solver="piqp")
    assert found.found
    assert found.certificate.solver != "piqp" or how in MENDED
    assert found.margin == pytest.approx(expected.margin, rel=1e-6)
    assert_holds(found)


@pytest.mark.sampled(24)
@pytest.mark.parametrize("name", list(PROBLEMS))
def test_no_lie_of_all_solvers_becomes_an_answer(name, lying):
    # Listing all modes takes long where no program is answered.
    for search in ("auto", "enumerate") if name in RANGES else ("auto",):
        assert_right(maximize_margin(fresh(name), search=search), honest(name, "margin"), "margin")
        found = minimize_torque(fresh(name), 0.01, search=search)
        assert_right(found, honest(name, "torque"), "max_torque")


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", ["up", "small"])
def test_no_lie_becomes_an_answer_of_a_warm_search(name, lying):
    objective = Margin()
    for _ in range(2):
        found, left = solve_from(fresh(name), objective, SolveOptions(RULES))
        assert_right(found, honest(name, "margin"), "margin")
        again, _ = solve_from(fresh(name), objective, SolveOptions(RULES), left)
        assert_right(again, honest(name, "margin"), "margin")
    best = honest(name, "margin")
    for required in (0.5, 2.0):  # reached, and not
        goal = required * max(best.margin, 1e-3) if best.found else required
        reached, _ = reaches_margin(fresh(name), goal, SolveOptions(RULES))
        assert reached in (None, best.found and required < 1.0)


@pytest.mark.sampled(8)
@pytest.mark.parametrize("name", RANGES)
def test_no_lie_becomes_a_range_of_forces(name, lying):
    expected = honest(name, "bounds")
    assert_range(contact_force_bounds(fresh(name), expected.torques, time_limit=0.3), expected)


def assert_range(found, expected) -> None:
    """What is proven is right; what is not was reached, so it lies inside."""
    if not found.found:
        assert found.status in OPEN
        return
    inside = 1e-5 * found.problem.scales.force
    assert (found.lower[found.proven] <= expected.lower[found.proven] + inside).all()
    assert (found.upper[found.proven] >= expected.upper[found.proven] - inside).all()
    assert (found.lower >= expected.lower - inside).all()
    assert (found.upper <= expected.upper + inside).all()
    assert found.largest_margin <= expected.largest_margin + inside
    if found.status is Status.OPTIMAL:
        assert found.smallest_margin == pytest.approx(expected.smallest_margin, abs=inside)
        assert found.largest_margin == pytest.approx(expected.largest_margin, abs=inside)


# Single programs that nobody answers


def failing(chosen: Callable[[int], bool]) -> Callable[..., Answer]:
    """A `solve` that fails at some of its calls and is right at the others."""
    count = iter(range(10**9))

    def solved(program: Program, solver: str = "piqp", *, cutoff: float = np.inf) -> Answer:
        return (
            failed_answer(-np.inf) if chosen(next(count)) else solve(program, solver, cutoff=cutoff)
        )

    return solved


def patched(monkeypatch: pytest.MonkeyPatch, chosen: Callable[[int], bool]) -> None:
    solved = failing(chosen)
    for module in (formulation, force_bounds, curve_module):
        monkeypatch.setattr(module, "solve", solved)


def choices() -> Iterator[tuple[str, Callable[[int], bool]]]:
    yield "all", lambda _: True
    for first in (0, 1, 2, 5):
        yield f"number {first}", lambda index, first=first: index == first
    for seed in (0, 3):
        rng = np.random.default_rng(seed)
        drawn = rng.random(4096) < 0.1 + 0.1 * seed
        yield f"seed {seed}", lambda index, drawn=drawn: bool(drawn[index % len(drawn)])
    for start in (1, 8):
        yield f"from {start} on", lambda index, start=start: index >= start


CHOICES = dict(choices())
SEARCHES, FRICTIONS = ("auto", "enumerate"), ("virtual_sliding", "coulomb")


def margin_of(name: str, search: str, friction: str) -> TorqueSolution:
    return maximize_margin(fresh(name), search=search, static_friction=friction)


def ranges_of(friction: str) -> ContactForceBounds:
    torques = honest("small", "bounds").torques
    return contact_force_bounds(fresh("small"), torques, static_friction=friction)


def disturbances_of(name: str) -> DisturbanceMargin:
    return disturbance_margin(fresh(name), directions=np.vstack([np.eye(6)[:3], -np.eye(6)[:3]]))


def assert_disturbances(found, expected) -> None:
    if found.found:
        np.testing.assert_allclose(found.magnitudes, expected.magnitudes, rtol=1e-5, atol=1e-5)
    else:
        assert found.status in OPEN
        assert np.isnan(found.magnitudes).all()


def assert_curve(found, expected) -> None:
    if found.status is Status.OPTIMAL:
        at = np.linspace(0.0, expected.largest_margin, 23)[:-1]
        np.testing.assert_allclose(
            found.torque_at(at), expected.torque_at(at), rtol=1e-5, atol=1e-5
        )
        assert found.largest_margin == pytest.approx(expected.largest_margin, abs=1e-5)
    else:
        assert found.status in OPEN


ANALYSES: dict[str, tuple[Callable[[], Any], Callable[[Any, Any], None]]] = {
    **{
        " ".join(key): (partial(margin_of, *key), partial(assert_right, figure="margin"))
        for key in product(("sphere", "up", "small"), SEARCHES, FRICTIONS)
    },
    **{f"ranges {one}": (partial(ranges_of, one), assert_range) for one in FRICTIONS},
    **{
        f"disturbances {one}": (partial(disturbances_of, one), assert_disturbances)
        for one in ("sphere", "small")
    },
    **{
        f"curve {one}": (lambda one=one: margin_torque_curve(fresh(one)), assert_curve)
        for one in ("rest", "up")
    },
}


@cache
def expected_of(name: str) -> Any:
    return ANALYSES[name][0]()


@pytest.mark.sampled(42)
@pytest.mark.parametrize("which", CHOICES)
@pytest.mark.parametrize("name", ANALYSES)
def test_programs_without_an_answer_leave_right_figures(name, which, monkeypatch):
    expected, (ask, check) = expected_of(name), ANALYSES[name]
    patched(monkeypatch, CHOICES[which])
    check(ask(), expected)


@pytest.mark.parametrize("which", CHOICES)
def test_the_least_friction_with_programs_without_an_answer(which, monkeypatch):
    """A point on a slope of 30 degrees needs a friction of tan 30 degrees."""
    patched(monkeypatch, CHOICES[which])
    for friction in (0.2, 0.01):
        point = QuasistaticProblem(
            [[0, 0, 0]], [[0, 0, 1]], [-5.0, 0, -5.0 * np.sqrt(3), 0, 0, 0],
            friction=friction, tangents=[[[1, 0], [0, 1], [0, 0]]], cone_edges=4,
        )  # fmt: skip
        found = minimum_friction(point)
        right = np.tan(np.pi / 6.0) / friction
        if found.proven and right < 16.0:
            assert found.factor == pytest.approx(right, rel=1e-5)
        elif found.found:
            assert found.factor >= right * (1.0 - 1e-6)
        assert right < 16.0 or not found.found


@pytest.mark.sampled(4)
@pytest.mark.parametrize("which", CHOICES)
def test_what_an_explanation_suggests_helps(which, monkeypatch):
    problem = scene("rest").with_changes(torque_limits=([-0.2, -10.0], [0.2, 10.0]))
    solution = minimize_torque(problem, 0.1)
    assert not solution.found
    patched(monkeypatch, CHOICES[which])
    suggestions = explain(solution).suggestions
    monkeypatch.undo()
    for suggestion in suggestions:
        assert minimize_torque(suggestion.problem, 0.1, **suggestion.rules.options()).found


@pytest.mark.sampled(24)
@pytest.mark.parametrize("how", [*WRONG_SQUARES])
@pytest.mark.parametrize("name", list(PROBLEMS))
def test_no_wrong_routine_becomes_an_optimum(name, how, monkeypatch):
    monkeypatch.setattr(optimize, "nnls", WRONG_SQUARES[how])
    for search in SEARCHES:
        found = maximize_margin(fresh(name), search=search)
        assert_right(found, honest(name, "margin"), "margin")


@pytest.mark.parametrize("how", list(WRONG_PROGRAMS))
def test_no_wrong_program_tells_rows_positive_together(how, monkeypatch):
    """Of (1, 0), (0, 1) and (0, -1), only the first can be positive without a negative one."""
    monkeypatch.setattr(optimize, "linprog", WRONG_PROGRAMS[how])
    rows = np.array([[1.0, 0.0], [0.0, 1.0], [0.0, -1.0]])
    told = dual_degeneracy._jointly_positive(rows)
    assert not told[1:].any()
    assert told[0] or how != "right"


@pytest.mark.parametrize("outcome", list(Outcome))
def test_a_failed_program_in_a_mode_is_unverified(outcome, monkeypatch):
    problem = fresh("rest")
    mode = maximize_margin(problem).mode
    if outcome is Outcome.FAILED:
        patched(monkeypatch, lambda _: True)
    found = minimize_torque(fresh("rest"), 1e9 if outcome is Outcome.INFEASIBLE else 0.0, mode=mode)
    expected = {
        Outcome.SOLVED: Status.OPTIMAL_IN_MODE,
        Outcome.INFEASIBLE: Status.INFEASIBLE_IN_MODE,
        Outcome.FAILED: Status.UNVERIFIED,
    }
    assert found.status is expected[outcome]


def test_torques_of_a_warm_optimum_are_checked():
    """A start that belongs to another problem changes no answer."""
    for name, other in zip(PROBLEMS, [*PROBLEMS][1:] + [*PROBLEMS][:1], strict=True):
        for objective, what, figure in (
            (Margin(), "margin", "margin"),
            (torque_objective(0.01), "torque", "max_torque"),
        ):
            _, left = solve_from(fresh(other), objective, SolveOptions(RULES))
            found, _ = solve_from(fresh(name), objective, SolveOptions(RULES), left)
            assert found.status is honest(name, what).status
            assert_right(found, honest(name, what), figure)
