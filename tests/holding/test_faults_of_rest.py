"""Solvers beneath verdicts on rest that fail, lie or mix up problems: no verdict is wrong."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cache, partial
from typing import Any

import numpy as np
import pytest
from cases import (
    GRAVITY,
    block_between_walls,
    block_on_slope,
    dynamics_of,
    hybrid_on_wall,
    pressed_in_slot,
    pressed_on_wall,
)
from numpy.typing import NDArray
from scipy import optimize
from test_declared_motions import pushed_block, rod

from graspless_pin import (
    QuasistaticProblem,
    Stability,
    StabilityVerdict,
    maximize_margin,
    stability,
)
from graspless_pin.algorithms.disturbances import GuaranteedDisturbance
from graspless_pin.algorithms.robustness import LoadBracket, load_bracket
from graspless_pin.holding import (
    bounds,
    branching,
    declared_motion,
    equilibrium,
    relaxation,
    unstable_motion,
)
from graspless_pin.holding.bounds import States
from graspless_pin.holding.unstable_motion import is_outcome, polish
from graspless_pin.report import solution_document
from graspless_pin.report.verdict_data import disturbance_data, verdict_data
from graspless_pin.report.verify.disturbances import disturbance_checks
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest import verdict_checks
from graspless_pin.report.verify.rest_load import read_load
from graspless_pin.solvers import simplex
from graspless_pin.solvers.simplex import Simplex, SimplexAnswer, SimplexOutcome
from graspless_pin.tree_search import Limits

Array = NDArray[np.float64]
Lie = Callable[[SimplexAnswer], SimplexAnswer]
PUSH = np.array([1.0, 0.0, 0.0, 0.0, 0.0, 0.0])


def stool(angle: float = 0.0) -> QuasistaticProblem:
    """0.5 kg on three feet with friction 0.5, on a slope along x."""
    feet = [(0.1, 0.0, -0.05), (-0.1, 0.1, -0.05), (-0.1, -0.1, -0.05)]
    weight = 0.5 * GRAVITY * np.array([np.sin(angle), 0.0, -np.cos(angle)])
    return QuasistaticProblem(
        feet, [(0.0, 0.0, 1.0)] * 3, [*weight, 0.0, 0.0, 0.0], friction=0.5,
        object_inertia=np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3]),
        joint_inertia=np.zeros((0, 0)),
    )  # fmt: skip


def unweighed(problem: QuasistaticProblem) -> QuasistaticProblem:
    """The same with inertias that are not known."""
    return problem.with_changes(object_inertia=None, joint_inertia=None)


@dataclass(frozen=True)
class Case:
    """A problem with torques and the verdict on them, by hand or by the test of its own."""

    make: Callable[[], QuasistaticProblem]
    torques: tuple[float, ...]
    status: Stability


STRONG, WEAK, NONE = Stability.STRONG, Stability.WEAK, Stability.NONE
CASES = {
    "slope": Case(partial(stool, 0.2), (), STRONG),
    "steep": Case(partial(block_on_slope, 0.5, 0.6), (), NONE),
    "steep, unweighed": Case(lambda: unweighed(block_on_slope(0.5, 0.6)), (), NONE),
    "between walls": Case(partial(block_between_walls, 0.5), (), WEAK),
    "pressed": Case(pressed_on_wall, (19.0,), STRONG),
    "pressed too little": Case(pressed_on_wall, (9.7,), NONE),
    "slot": Case(pressed_in_slot, (25.0,), STRONG),
    "slot, too little": Case(pressed_in_slot, (9.7,), WEAK),
    "hybrid": Case(hybrid_on_wall, (25.0,), STRONG),
    "hybrid, too little": Case(hybrid_on_wall, (9.0,), NONE),
    "pushed": Case(pushed_block, (0.5 * GRAVITY,), STRONG),
    "pushed faster": Case(pushed_block, (0.6 * GRAVITY,), NONE),
    "carried": Case(partial(pushed_block, rubbing=0.3), (0.5 * GRAVITY,), WEAK),
    "rod": Case(partial(rod, 0.5), (), STRONG),
    "rod of Painleve": Case(partial(rod, 2.0), (), WEAK),
}


def said_of(name: str, **options: Any) -> StabilityVerdict:
    case = CASES[name]
    return stability(case.make(), case.torques, **{"node_limit": 80, **options})


@cache
def written(name: str) -> dict[str, Any]:
    """A document of a case's problem and torques, made before anything lies."""
    case = CASES[name]
    solution = maximize_margin(case.make(), static_friction="coulomb")
    made = json.loads(json.dumps(solution_document(solution), allow_nan=False))
    for joint, torque in zip(made["joints"], case.torques, strict=True):
        joint["torque"] = torque
    return made


@pytest.fixture(autouse=True, scope="module")
def known() -> None:
    """Make all documents before anything lies."""
    for name in CASES:
        written(name)
    undisturbed()


def plain(data: Any) -> Any:
    """As it comes back from a file, where what is infinite or none is null."""
    text = json.dumps(data, default=np.ndarray.tolist)
    return json.loads(text, parse_constant=lambda _: None)


def some_cases(*choices: str) -> list[str]:
    """A quarter of the cases: another one for each fourth choice of what goes wrong."""
    return list(CASES)[sum(map(len, choices)) % 4 :: 4]


def assert_true(name: str, **options: Any) -> Stability:
    """The verdict is the right one or none, and all that it states passes the checker."""
    verdict = said_of(name, **options)
    assert verdict.status in (CASES[name].status, Stability.UNDECIDED)
    made = written(name)
    problem = read_problem(made)
    bodies = read_load(made, problem)
    stated = problem.part(plain(verdict_data(verdict)), "stability", "stability")
    broken = [
        f"{line.name}: {line.detail}"
        for line in verdict_checks(stated, bodies)
        if line.passed is False
    ]
    assert not broken
    return verdict.status


# Linear programs


def of_another() -> Lie:
    """The answer to the program of the same size that was asked before."""
    before: dict[tuple[int, int], SimplexAnswer] = {}

    def asked(answer: SimplexAnswer) -> SimplexAnswer:
        size = len(answer.x), len(answer.rows)
        stale, before[size] = before.get(size, answer), answer
        return stale

    return asked


def lies() -> dict[str, Callable[[], Lie]]:
    """Ways to answer wrongly, each of which may remember."""

    def changed(x: Callable[[Array], Array], rows: Callable[[Array], Array]):
        return lambda: (
            lambda answer: SimplexAnswer(SimplexOutcome.OPTIMAL, x(answer.x), rows(answer.rows))
        )

    def outcome(kind: SimplexOutcome):
        return lambda: lambda answer: replace(answer, outcome=kind)

    def same(values: Array) -> Array:
        return values

    return {
        **{str(kind): outcome(kind) for kind in SimplexOutcome},
        "zeros": changed(np.zeros_like, np.zeros_like),
        "ones": changed(np.ones_like, np.ones_like),
        "a point of zeros": changed(np.zeros_like, same),
        "signs turned": changed(same, np.negative),
        "a point turned": changed(np.negative, same),
        "not a number": changed(lambda x: np.nan * x, lambda rows: np.nan * rows),
        "a point that is none": changed(lambda x: np.nan * x, same),
        "multipliers that are none": changed(same, lambda rows: np.nan * rows),
        "infinite": changed(lambda x: x + np.inf, lambda rows: rows - np.inf),
        "without end": changed(lambda x: x + 1e9, lambda rows: 1e12 * rows),
        "beyond all numbers": changed(lambda x: 1e300 * x, lambda rows: 1e300 * rows),
        "a point that is off": changed(lambda x: x + 1e-2, same),
        "a point a bit off": changed(lambda x: x + 1e-5, lambda rows: 1.001 * rows),
        "of another": of_another,
    }


LIES = lies()
SITES = {"rest": equilibrium, "relaxation": relaxation, "kept motion": declared_motion}


def lie_in(monkeypatch: pytest.MonkeyPatch, site: str, lie: Lie) -> None:
    class Lying(Simplex):
        def solve(self) -> SimplexAnswer:
            return lie(super().solve())

    monkeypatch.setattr(SITES[site], "Simplex", Lying)


def test_without_lies_all_is_decided_and_every_site_is_asked(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    asked = set[str]()
    for site in SITES:
        lie_in(monkeypatch, site, lambda answer, site=site: asked.add(site) or answer)
    for name, case in CASES.items():
        # Which outcome a tree meets first hangs on rounding.
        assert assert_true(name, node_limit=1000) is case.status
    assert asked == set(SITES)


@pytest.mark.sampled(9)
@pytest.mark.parametrize("how", list(LIES))
@pytest.mark.parametrize("sites", [*([site] for site in SITES), list(SITES)], ids="+".join)
def test_no_wrong_program_becomes_a_verdict(
    sites: list[str], how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    for site in sites:
        lie_in(monkeypatch, site, LIES[how]())
    with np.errstate(all="ignore"):
        for name in some_cases(how, *sites):
            assert_true(name)


@pytest.mark.parametrize("size", [1e155, 1e200, 1e300])
def test_forces_beyond_all_numbers_are_no_outcome(size: float) -> None:
    problem = pressed_in_slot()
    dynamics = dynamics_of(problem, [9.7])
    with np.errstate(all="ignore"):
        for seed in range(8):
            forces = np.zeros((problem.contact_count, 3))
            forces[:, 0] = size * np.random.default_rng(seed).random(problem.contact_count)
            assert not is_outcome(dynamics, forces)
            assert polish(dynamics, forces) is None


def raises(error: Exception) -> Callable[..., Any]:
    def asked(*_: Any, **__: Any) -> Any:
        raise error

    return asked


ENGINES: dict[str, Callable[[int, Array, Array], tuple[int, Array, Array]]] = {
    "too short": lambda _, x, rows: (0, x[:-1], rows),
    "no marginals": lambda _, x, rows: (0, x, rows[:0]),
    "runtime": raises(RuntimeError("it broke down")),
    "value": raises(ValueError("no such basis")),
    "arithmetic": raises(FloatingPointError("overflow")),
    "linear algebra": raises(np.linalg.LinAlgError("singular")),
}


@pytest.mark.parametrize("how", list(ENGINES))
def test_no_broken_engine_becomes_a_verdict(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = simplex._Highs.solve
    monkeypatch.setattr(simplex, "core", None)
    monkeypatch.setattr(simplex._Highs, "solve", lambda self: ENGINES[how](*honest(self)))
    for name in CASES:
        assert_true(name)


@pytest.mark.skipif(simplex.core is None, reason="nothing is compiled")
def test_where_the_dictionary_breaks_highs_answers(monkeypatch: pytest.MonkeyPatch) -> None:
    class Broken(simplex.core.DenseSimplex):
        def solve(self) -> Any:
            raise RuntimeError("it broke down")

    monkeypatch.setattr(simplex.core, "DenseSimplex", Broken)
    for name in ("slope", "steep", "pressed"):
        assert assert_true(name) is CASES[name].status


# Least squares

NNLS, LSTSQ = optimize.nnls, np.linalg.lstsq
Squares = Callable[[Array, Array], Array]


def wrong_squares(solved: Squares) -> dict[str, Squares]:
    """Solutions x of least squares |A x - b| that are wrong."""
    before: dict[int, Array] = {}

    def of_another(matrix: Array, target: Array) -> Array:
        found = solved(matrix, target)
        stale, before[len(found)] = before.get(len(found), found), found
        return stale

    def answering(change: Callable[[Array], Array]) -> Squares:
        return lambda matrix, target: change(solved(matrix, target))

    return {
        "zeros": answering(np.zeros_like),
        "ones": answering(np.ones_like),
        "turned": answering(np.negative),
        "not a number": answering(lambda x: np.nan * x),
        "infinite": answering(lambda x: x + np.inf),
        "without end": answering(lambda x: x + 1e9),
        "a bit off": answering(lambda x: x * (1.0 + 1e-5 * np.sin(np.arange(len(x))))),
        "too short": answering(lambda x: x[:-1]),
        "of another": of_another,
    }


def by_nnls(matrix: Array, target: Array) -> Array:
    return NNLS(matrix, target)[0]


def by_lstsq(matrix: Array, target: Array) -> Array:
    return np.asarray(LSTSQ(matrix, target, rcond=1e-12)[0], dtype=np.float64)


# All say that nothing is left.
WRONG_NNLS: dict[str, Callable[..., Any]] = {
    "gives up": raises(RuntimeError("Maximum number of iterations reached.")),
    **{
        how: lambda matrix, target, wrong=wrong: (wrong(matrix, target), 0.0)
        for how, wrong in wrong_squares(by_nnls).items()
    },
}
WRONG_LSTSQ: dict[str, Callable[..., Any]] = {
    "gives up": raises(np.linalg.LinAlgError("SVD did not converge in Linear Least Squares")),
    **{
        how: lambda matrix, target, wrong=wrong, **_: (wrong(matrix, target), [], 0, [])
        for how, wrong in wrong_squares(by_lstsq).items()
    },
}


def lie_in_squares(
    monkeypatch: pytest.MonkeyPatch, module: Any, name: str, owner: Any, lie: Callable[..., Any]
) -> None:
    """Let one caller's least squares lie, and no other's."""
    honest, solver = getattr(module, name), {optimize: "nnls", np.linalg: "lstsq"}[owner]

    def asked(*arguments: Any) -> Any:
        with monkeypatch.context() as patch:
            patch.setattr(owner, solver, lie)
            return honest(*arguments)

    monkeypatch.setattr(module, name, asked)


SQUARES = {
    f"{module.__name__.rpartition('.')[2]}, {how}": (module, name, owner, lie)
    for modules, name, owner, wrong in (
        ((equilibrium, branching), "nonnegative_squares", optimize, WRONG_NNLS),
        ((bounds, unstable_motion), "least_squares", np.linalg, WRONG_LSTSQ),
    )
    for module in modules
    for how, lie in wrong.items()
}


@pytest.mark.sampled(6)
@pytest.mark.parametrize("which", SQUARES)
def test_no_wrong_squares_become_a_verdict(which: str, monkeypatch: pytest.MonkeyPatch) -> None:
    lie_in_squares(monkeypatch, *SQUARES[which])
    with np.errstate(all="ignore"):
        for name in some_cases(which):
            assert_true(name)


@pytest.mark.parametrize("how", ["raises", "all", "turned"])
def test_no_wrong_null_space_becomes_a_verdict(how: str, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = branching.null_space
    wrong: dict[str, Callable[..., Any]] = {
        "raises": raises(np.linalg.LinAlgError("SVD did not converge")),
        # Nothing moves, or other motions do.
        "all": lambda fixed, **_: np.zeros((fixed.shape[1], 1)),
        "turned": lambda fixed, **options: honest(fixed[:, ::-1], **options),
    }
    monkeypatch.setattr(branching, "null_space", wrong[how])
    for name in some_cases(how):
        assert_true(name)


def test_a_contact_that_parts_is_not_closed_by_squares_that_leave_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """The smallest case: zeros with a residual of zero closed contacts that part."""
    case = CASES["pressed"]
    dynamics = dynamics_of(case.make(), case.torques)
    monkeypatch.setattr(optimize, "nnls", WRONG_NNLS["zeros"])
    assert branching.forced_state(dynamics, States.all_free(dynamics.contact_count)) is None


# Loads along a line


@cache
def undisturbed() -> StabilityVerdict:
    return stability(stool(), [])


def bracket(nodes: int) -> LoadBracket:
    return load_bracket(undisturbed(), PUSH, 10.0 * GRAVITY, 0.1, Limits(nodes))


@cache
def floor_document() -> dict[str, Any]:
    solution = maximize_margin(undisturbed().problem, static_friction="coulomb")
    return json.loads(json.dumps(solution_document(solution, verdict=undisturbed())))


def assert_true_bracket(nodes: int = 15) -> LoadBracket:
    """What is proven is on its side of what friction bears, and passes the checker."""
    made = floor_document()
    found, exact = bracket(nodes), 0.25 * GRAVITY
    # Slower than the resolution of 0.001 loads is no motion.
    assert found.guaranteed <= exact + 1e-3 * GRAVITY
    assert found.failing >= exact - 1e-9
    assert found.last_rest is not None
    if found.last_rest.no_rest is not None:
        assert found.possible == pytest.approx(exact, rel=1e-3)
    whole = GuaranteedDisturbance(undisturbed(), PUSH[None], (found,), 1.0, 10.0 * GRAVITY)
    stated = {**made, "disturbances": plain(disturbance_data(whole))}
    broken = [
        f"{line.name}: {line.detail}"
        for line in disturbance_checks(stated, read_problem(stated))
        if line.passed is False
    ]
    assert not broken
    return found


def test_without_lies_the_bracket_is_narrow() -> None:
    found = assert_true_bracket(nodes=100)
    assert found.failing - found.guaranteed <= 0.1 * found.failing
    assert found.possible == pytest.approx(0.25 * GRAVITY, rel=1e-3)


@pytest.mark.sampled(4)
@pytest.mark.parametrize("how", list(LIES))
@pytest.mark.parametrize("site", ["rest", "relaxation"])
def test_no_wrong_program_widens_what_is_guaranteed(
    site: str, how: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor_document()
    lie_in(monkeypatch, site, LIES[how]())
    with np.errstate(all="ignore"):
        assert_true_bracket()


@pytest.mark.sampled(3)
@pytest.mark.parametrize("which", SQUARES)
def test_no_wrong_squares_widen_what_is_guaranteed(
    which: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    floor_document()
    lie_in_squares(monkeypatch, *SQUARES[which])
    with np.errstate(all="ignore"):
        assert_true_bracket()
