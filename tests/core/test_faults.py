"""Solvers that fail, lie, mix up problems or give up: nothing that is stated is wrong."""

from collections.abc import Callable, Iterator
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from random_scenes import general_scene, slope_scene
from scenes import SOLVERS, assert_holds, random_problem, scene
from scipy import optimize
from test_kinematics import assert_conflict, assert_witness

from graspless_pin import (
    QuasistaticProblem,
    Status,
    contact_force_bounds,
    disturbance_margin,
    explain,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    minimum_friction,
)
from graspless_pin.algorithms import dual_degeneracy, force_extremes, formulation
from graspless_pin.algorithms import margin_torque_curve as curve_module
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.torque import torque_objective
from graspless_pin.algorithms.warm_start import reaches_margin, solve_from
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.feasibility import Requirement, Witness
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import Rules, SignRule
from graspless_pin.programs.answers import Answer, failed
from graspless_pin.programs.objectives import Margin
from graspless_pin.programs.program import Program
from graspless_pin.solvers import Outcome, solve, solving
from graspless_pin.solvers.other_backends import by_qpsolvers

Found = tuple[np.ndarray, np.ndarray, np.ndarray]
Backend = Callable[[Program], Found | None]
RULES = Rules.parse()
RANGES = ("sphere", "small")
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
    }


LIES = lies()


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


@pytest.mark.parametrize("name", list(PROBLEMS))
def test_no_lie_of_all_solvers_becomes_an_answer(name, lying):
    # Listing all modes takes long where no program is answered.
    for search in ("auto", "enumerate") if name in RANGES else ("auto",):
        assert_right(maximize_margin(fresh(name), search=search), honest(name, "margin"), "margin")
        found = minimize_torque(fresh(name), 0.01, search=search)
        assert_right(found, honest(name, "torque"), "max_torque")


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


@pytest.mark.parametrize("name", RANGES)
def test_no_lie_becomes_a_range_of_forces(name, lying):
    expected = honest(name, "bounds")
    found = contact_force_bounds(fresh(name), expected.torques, time_limit=0.3)
    if not found.found:
        limits = Status.UNVERIFIED, Status.NOT_FOUND_IN_LIMIT
        assert found.status in (*limits, expected.status)
        return
    assert_range(found, expected)


def assert_range(found, expected) -> None:
    """What is proven is right; what is not was reached, so it lies inside."""
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
        return failed(-np.inf) if chosen(next(count)) else solve(program, solver, cutoff=cutoff)

    return solved


def patched(monkeypatch: pytest.MonkeyPatch, chosen: Callable[[int], bool]) -> None:
    solved = failing(chosen)
    for module in (formulation, force_extremes, curve_module):
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
SEARCHES = ("auto", "enumerate")
some_fail = pytest.mark.parametrize("which", list(CHOICES))


@some_fail
@pytest.mark.parametrize("name", ["sphere", "up", "small"])
def test_a_program_without_an_answer_leaves_right_bounds(name, which):
    for search, friction in product(SEARCHES, ("virtual_sliding", "coulomb")):
        if (name, friction) not in HONEST:
            HONEST[name, friction] = maximize_margin(fresh(name), static_friction=friction)
        with pytest.MonkeyPatch.context() as patch:
            patched(patch, CHOICES[which])
            found = maximize_margin(fresh(name), search=search, static_friction=friction)
        assert_right(found, HONEST[name, friction], "margin")


@some_fail
@pytest.mark.parametrize("options", [{}, {"static_friction": "coulomb"}], ids=["strict", "coulomb"])
def test_ranges_of_forces_with_programs_without_an_answer(which, options, monkeypatch):
    expected = honest("small", "bounds")
    if options:
        problem = fresh("small")
        expected = HONEST.setdefault(
            ("small", "coulomb bounds"), contact_force_bounds(problem, expected.torques, **options)
        )
    patched(monkeypatch, CHOICES[which])
    found = contact_force_bounds(fresh("small"), expected.torques, **options)
    if found.found:
        assert_range(found, expected)
    else:
        assert found.status in (Status.UNVERIFIED, Status.NOT_FOUND_IN_LIMIT)


def directions() -> np.ndarray:
    return np.vstack([np.eye(6)[:3], -np.eye(6)[:3]])


@some_fail
@pytest.mark.parametrize("name", ["sphere", "small"])
def test_disturbances_with_programs_without_an_answer(name, which, monkeypatch):
    key = name, "disturbances"
    if key not in HONEST:
        HONEST[key] = disturbance_margin(fresh(name), directions=directions())
    patched(monkeypatch, CHOICES[which])
    found = disturbance_margin(fresh(name), directions=directions())
    if found.found:
        np.testing.assert_allclose(found.magnitudes, HONEST[key].magnitudes, rtol=1e-5, atol=1e-5)
    else:
        assert found.status in (
            Status.UNVERIFIED, Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT
        )  # fmt: skip
        assert np.isnan(found.magnitudes).all()


@some_fail
@pytest.mark.parametrize("name", ["rest", "up"])
def test_curves_with_programs_without_an_answer(name, which, monkeypatch):
    key = name, "curve"
    if key not in HONEST:
        HONEST[key] = margin_torque_curve(fresh(name))
    expected = HONEST[key]
    patched(monkeypatch, CHOICES[which])
    found = margin_torque_curve(fresh(name))
    if found.status is Status.OPTIMAL:
        at = np.linspace(0.0, expected.largest_margin, 23)
        np.testing.assert_allclose(
            found.torque_at(at[:-1]), expected.torque_at(at[:-1]), rtol=1e-5, atol=1e-5
        )
        assert found.largest_margin == pytest.approx(expected.largest_margin, abs=1e-5)
    else:
        assert found.status in (
            Status.UNVERIFIED, Status.LIMIT_REACHED, Status.NOT_FOUND_IN_LIMIT
        )  # fmt: skip


def on_a_slope(friction: float) -> QuasistaticProblem:
    """A point on a slope of 30 degrees, which needs a friction of tan 30 degrees."""
    tangents = [[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]]
    return QuasistaticProblem(
        [[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]], [-5.0, 0, -5.0 * np.sqrt(3), 0, 0, 0],
        friction=friction, tangents=tangents, cone_edges=4,
    )  # fmt: skip


@some_fail
def test_the_least_friction_with_programs_without_an_answer(which, monkeypatch):
    patched(monkeypatch, CHOICES[which])
    for friction in (0.2, 0.01):
        found = minimum_friction(on_a_slope(friction))
        right = np.tan(np.pi / 6.0) / friction
        if found.proven and right < 16.0:
            assert found.factor == pytest.approx(right, rel=1e-5)
        elif found.found:
            assert found.factor >= right * (1.0 - 1e-6)
        assert right < 16.0 or not found.found


@some_fail
def test_what_an_explanation_suggests_helps(which, monkeypatch):
    problem = scene("rest").with_changes(torque_limits=([-0.2, -10.0], [0.2, 10.0]))
    solution = minimize_torque(problem, 0.1)
    assert not solution.found
    patched(monkeypatch, CHOICES[which])
    suggestions = explain(solution).suggestions
    monkeypatch.undo()
    for suggestion in suggestions:
        assert minimize_torque(suggestion.problem, 0.1, **suggestion.rules.options()).found


# Routines of scipy behind the virtual motions


def questions() -> list[tuple[QuasistaticProblem, SignRule, list[Requirement]]]:
    """Requirements on a few contacts, some of which no motion meets."""
    found = []
    for seed in range(12):
        rng = np.random.default_rng(seed)
        problem = random_problem(seed, 4) if seed % 3 else scene(("rest", "up")[seed % 2])
        for rule in SignRule:
            contacts = rng.choice(
                problem.contact_count, size=int(rng.integers(1, 5)), replace=False
            )
            pairs = [(int(a), int(b)) for a, b in rng.choice((-1, 1), (len(contacts), 2))]
            asked = [
                Requirement(int(contact), pair)
                for contact, pair in zip(sorted(contacts), pairs, strict=True)
            ]
            if rule is SignRule.EXACT:
                asked[0] = Requirement(asked[0].contact, (0, asked[0].signs[1]))
            found.append((problem, rule, asked))
    return found


def wrong_squares() -> dict[str, Callable[..., Any]]:
    """Nonnegative least squares that lie."""
    before: dict[int, np.ndarray] = {}

    def of_another(matrix: np.ndarray, target: np.ndarray):
        weights, size = NNLS(matrix, target)
        stale = before.get(len(weights), weights)
        before[len(weights)] = weights
        return stale, size

    def gives_up(*_: Any):
        raise RuntimeError("Maximum number of iterations reached")

    def answering(make: Callable[[np.ndarray], np.ndarray]):
        return lambda matrix, target: (make(NNLS(matrix, target)[0]), 0.0)

    def first(weights: np.ndarray) -> np.ndarray:
        return np.append(1.0, np.zeros(len(weights) - 1)) if len(weights) else weights

    return {
        "gives up": gives_up,
        "zeros": answering(np.zeros_like),
        "ones": answering(np.ones_like),
        "the first": answering(first),
        "negative": answering(lambda weights: -weights),
        "of both signs": answering(lambda weights: weights - weights.mean()),
        "not a number": answering(lambda weights: np.nan * weights),
        "one that is none": answering(lambda weights: np.where(weights > 0, weights, np.nan)),
        "infinite": answering(lambda weights: weights + np.inf),
        "a bit off": answering(
            lambda weights: weights * (1.0 + 1e-3 * np.sin(np.arange(len(weights))))
        ),
        "of another": of_another,
    }


NNLS = optimize.nnls
LINPROG = optimize.linprog
WRONG_SQUARES = wrong_squares()


def wrong_programs() -> dict[str, Callable[..., Any]]:
    """Linear programs that lie."""

    def answering(status: int, x: Callable, marginals: Callable):
        def solved(*arguments: Any, **options: Any):
            answer = LINPROG(*arguments, **options)
            return SimpleNamespace(
                status=status, message="as asked", x=x(answer.x),
                ineqlin=SimpleNamespace(marginals=marginals(answer.ineqlin.marginals)),
            )  # fmt: skip

        return solved

    same = np.copy
    return {
        "right": answering(0, same, same),
        "time is over": answering(1, same, same),
        "infeasible": answering(2, same, same),
        "unbounded": answering(3, same, same),
        "zeros": answering(0, np.zeros_like, np.zeros_like),
        "ones": answering(0, np.ones_like, np.ones_like),
        "minus ones": answering(0, np.ones_like, lambda z: -np.ones_like(z)),
        "turned": answering(0, lambda x: np.append(-x[:-1], 1.0), lambda z: -z),
        "never a motion": answering(0, np.zeros_like, same),
        "not a number": answering(0, lambda x: np.nan * x, lambda z: np.nan * z),
    }


WRONG_PROGRAMS = wrong_programs()


def assert_no_wrong_verdicts() -> int:
    """All verdicts are right and prove themselves, or none is given; return how many there are."""
    count = 0
    for problem, rule, asked in questions():
        try:
            verdict = VirtualKinematics(problem).solve(asked, rule)
        except UndecidedMotionError:
            continue
        count += 1
        if isinstance(verdict, Witness):
            assert_witness(problem, rule, asked, verdict)
        else:
            assert_conflict(problem, rule, asked, verdict)
            assert_combination(problem, rule, asked, verdict)
    return count


def assert_combination(problem, rule, asked, conflict) -> None:
    """No motion sees more of the combination than the threshold."""
    v = conflict.combination
    signs = {(contact, component): sign for contact, component, sign in conflict.signs}
    given = {requirement.contact: requirement.signs for requirement in asked}
    for (contact, component), sign in signs.items():
        assert sign * v[contact, 1 + component] > 0.0
    for contact, pair in given.items():
        for component in range(2):
            if (contact, component) not in signs:
                free = rule is SignRule.EXACT and pair[component] == 0
                assert free or v[contact, 1 + component] == 0.0
    unnamed = [contact for contact in range(len(v)) if contact not in given]
    assert not v[unnamed].any()
    frames = np.concatenate([problem.normals[:, :, None], problem.tangents], axis=2)
    world = np.einsum("lij,lj->li", frames, v).ravel()
    motions = np.hstack([problem.W.T, -problem.J])
    size = np.linalg.norm(motions, axis=0)
    motions = motions[:, size > 0.0] / size[size > 0.0]
    left, values, _ = np.linalg.svd(motions, full_matrices=False)
    seen = left[:, values > 1e-8 * values.max()]
    assert np.linalg.norm(seen.T @ world) < 1e-6
    if rule is SignRule.NONZERO:
        along = np.array([np.multiply(given[c], v[c, 1:]).min() for c in given])
        assert along.sum() == pytest.approx(1.0)
    else:
        assert sum(sign * v[c, 1 + k] for (c, k), sign in signs.items()) == pytest.approx(1.0)


def test_right_routines_decide_all_questions():
    assert assert_no_wrong_verdicts() == len(questions())


@pytest.mark.parametrize("how", list(WRONG_SQUARES))
def test_no_wrong_least_squares_become_a_verdict(how, monkeypatch):
    monkeypatch.setattr(optimize, "nnls", WRONG_SQUARES[how])
    # The linear program decides instead, but not where its motion is one at the border of its box.
    assert assert_no_wrong_verdicts() >= 0.65 * len(questions())


@pytest.mark.parametrize("how", list(WRONG_PROGRAMS))
@pytest.mark.parametrize("squares", ["gives up", "zeros"])
def test_no_wrong_linear_program_becomes_a_verdict(how, squares, monkeypatch):
    monkeypatch.setattr(optimize, "nnls", WRONG_SQUARES[squares])
    monkeypatch.setattr(optimize, "linprog", WRONG_PROGRAMS[how])
    decided = assert_no_wrong_verdicts()
    assert decided > 0 or how != "right"


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
    told = dual_degeneracy._positive_together(rows)
    assert not told[1:].any()
    assert told[0] or how != "right"


@pytest.mark.parametrize("outcome", list(Outcome))
def test_a_failed_program_in_a_mode_is_unverified(outcome, monkeypatch):
    problem = fresh("rest")
    mode = maximize_margin(problem).mode
    if outcome is Outcome.FAILED:
        patched(monkeypatch, lambda _: True)
    found = minimize_torque(fresh("rest"), 1e9 if outcome is Outcome.INFEASIBLE else 0.0, mode=mode)
    assert (
        found.status
        is {
            Outcome.SOLVED: Status.OPTIMAL_IN_MODE,
            Outcome.INFEASIBLE: Status.INFEASIBLE_IN_MODE,
            Outcome.FAILED: Status.UNVERIFIED,
        }[outcome]
    )


def test_torques_of_a_carried_optimum_are_checked():
    """A start that belongs to another problem changes no answer."""
    for name, other in product(PROBLEMS, repeat=2):
        for objective, what, figure in (
            (Margin(), "margin", "margin"),
            (torque_objective(0.01), "torque", "max_torque"),
        ):
            _, left = solve_from(fresh(other), objective, SolveOptions(RULES))
            found, _ = solve_from(fresh(name), objective, SolveOptions(RULES), left)
            assert found.status is honest(name, what).status
            assert_right(found, honest(name, what), figure)
