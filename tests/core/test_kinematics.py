"""Feasibility of virtual sliding: witnesses and conflicts against linprog, which may lie, too."""

from collections.abc import Callable
from functools import cache, lru_cache, partial
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from edge_form import virtual_motion_exists
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_problem, scene, structured_arguments
from scipy import optimize

from graspless_pin import (
    QuasistaticProblem,
    Status,
    disturbance_margin,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_search import reaches_margin, solve_from
from graspless_pin.errors import GrasplessPinError, UndecidedMotionError
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import Conflict, Requirement, SignRule, Witness
from graspless_pin.modes.virtual_motions import NearestMotions
from graspless_pin.programs.objectives import Margin

ANY_SIGNS = {
    SignRule.STRICT: st.sampled_from(list(product((-1, 1), repeat=2))),
    SignRule.EXACT: st.sampled_from([p for p in product((-1, 0, 1), repeat=2) if any(p)]),
    SignRule.NONZERO: st.sampled_from(list(product((-1, 1), repeat=2))),
}
KINDS = ("slab", "pinch", "planar")


@st.composite
def questions(draw, rules):
    """A problem, a rule and requirements on some of its contacts."""
    seed, contacts = draw(st.integers(0, 2000)), draw(st.integers(2, 6))
    kind = draw(st.sampled_from(("free", *KINDS)))
    if kind == "free":
        problem = random_problem(seed, contacts)
    else:
        problem = QuasistaticProblem(**structured_arguments(seed, kind, max(contacts, 3)))
    rule = draw(st.sampled_from(rules))
    chosen = draw(st.sets(st.integers(0, problem.contact_count - 1), min_size=1))
    return problem, rule, [Requirement(c, draw(ANY_SIGNS[rule])) for c in sorted(chosen)]


# The same questions are put again and again where solvers lie about them.
exists = lru_cache(maxsize=4096)(virtual_motion_exists)


def oracle(problem, rule, requirements):
    mode: list[tuple[int, int] | None] = [None] * problem.contact_count
    for requirement in requirements:
        mode[requirement.contact] = requirement.signs
    return exists(problem, tuple(mode), str(rule))


@settings(max_examples=40)
@given(questions(list(ANY_SIGNS)), st.none() | st.integers(0, 2000))
def test_verdicts_agree_with_linprog_and_prove_themselves(question, seed):
    """Whatever is said to matter most."""
    problem, rule, requirements = question
    importance = None
    if seed is not None:
        importance = np.random.default_rng(seed).uniform(0.03, 1.0, (len(requirements), 2))
    verdict = VirtualKinematics(problem).solve(requirements, rule, importance)
    assert isinstance(verdict, Witness) == oracle(problem, rule, requirements)
    if isinstance(verdict, Witness):
        assert_witness(problem, rule, requirements, verdict)
    else:
        assert_conflict(problem, rule, requirements, verdict)


def assert_witness(problem, rule, requirements, witness):
    """The velocities come from a motion and meet every requirement."""
    frames = np.concatenate([problem.normals[:, :, None], problem.tangents], axis=2)
    world = np.einsum("lij,lj->li", frames, witness.velocities).ravel()
    motions = np.hstack([problem.W.T, -problem.J])
    motion = np.linalg.lstsq(motions, world, rcond=None)[0]
    size = np.abs(witness.velocities).max()
    np.testing.assert_allclose(motions @ motion, world, atol=1e-7 * size)
    for requirement in requirements:
        normal, *tangential = witness.velocities[requirement.contact] / size
        assert abs(normal) <= 1e-7
        signed = np.array(requirement.signs) * tangential
        if rule is SignRule.NONZERO:
            assert (signed >= -1e-9).all()
            assert signed.sum() > 1e-6
        else:
            for sign, value, raw in zip(requirement.signs, signed, tangential, strict=True):
                assert value > 1e-6 if sign else abs(raw) <= 1e-7


def assert_conflict(problem, rule, requirements, conflict):
    """What the conflict names is infeasible on its own, and was asked for."""
    asked = {requirement.contact: requirement.signs for requirement in requirements}
    named: dict[int, list[int]] = {contact: [0, 0] for contact in conflict.contacts}
    for contact, component, sign in conflict.signs:
        assert asked[contact][component] == sign != 0
        named.setdefault(contact, [0, 0])[component] = sign
    assert set(named) <= set(asked)
    assert not set(conflict.contacts) & {contact for contact, _, _ in conflict.signs}
    # Only the named signs are asked for, everything else at these contacts is left open: every
    # completion of them is infeasible.
    values = (-1, 0, 1) if rule is SignRule.EXACT else (-1, 1)
    options = []
    for contact, signs in named.items():
        pairs = [p for p in product(values, values) if any(p)]
        options.append(
            [
                Requirement(contact, pair)
                for pair in pairs
                if all(s in (0, p) for s, p in zip(signs, pair, strict=True))
            ]
        )
    # A zero that is part of the question stays part of the conflict.
    for index, contact in enumerate(named):
        zeros = [c for c in range(2) if asked[contact][c] == 0]
        options[index] = [r for r in options[index] if all(r.signs[c] == 0 for c in zeros)]
    count = np.prod([len(o) for o in options])
    if count <= 64:
        for requirements_ in product(*options):
            assert not oracle(problem, rule, requirements_)


def test_one_rigid_body_cannot_slide_apart():
    """Two supports on one table cannot both slide outwards along the line between them."""
    problem = QuasistaticProblem(
        [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]] * 2, np.zeros(6),
        friction=0.5, tangents=[[[1, 0], [0, 1], [0, 0]]] * 2,
    )  # fmt: skip
    kinematics = VirtualKinematics(problem)
    apart = [Requirement(0, (-1, 1)), Requirement(1, (1, 1))]
    verdict = kinematics.solve(apart, SignRule.STRICT)
    assert isinstance(verdict, Conflict)
    assert set(verdict.signs) == {(0, 0, -1), (1, 0, 1)}
    assert verdict.contacts == ()
    together = [Requirement(0, (1, 1)), Requirement(1, (1, -1))]
    assert isinstance(kinematics.solve(together, SignRule.STRICT), Witness)


@pytest.fixture
def undecided(monkeypatch):
    """No solver decides on any virtual motion, and none is guessed."""

    def gives_up(*_, **__):
        raise RuntimeError("Maximum number of iterations reached")

    def fails(*_, **__):
        return SimpleNamespace(status=4, message="numerical difficulties")

    monkeypatch.setattr("scipy.optimize.nnls", gives_up)
    monkeypatch.setattr("scipy.optimize.linprog", fails)
    monkeypatch.setattr(NearestMotions, "guessed_witness", lambda *_: None)


@pytest.mark.usefixtures("undecided")
@pytest.mark.parametrize("search", ["auto", "enumerate"])
@pytest.mark.parametrize("algorithm", [maximize_margin, partial(minimize_torque, margin=0.1)])
def test_an_undecided_motion_is_a_status(algorithm, search):
    solution = algorithm(scene("rest"), search=search)
    assert solution.status is Status.UNVERIFIED
    assert not solution.found


@pytest.mark.usefixtures("undecided")
def test_an_undecided_motion_leaves_margins_undecided_and_is_an_error_of_a_listing():
    problem = scene("rest")
    assert solve_from(problem, Margin(), SolveOptions())[0].status is Status.UNVERIFIED
    assert reaches_margin(problem, 0.01, SolveOptions())[0] is None
    assert disturbance_margin(problem).status is Status.UNVERIFIED
    with pytest.raises(UndecidedMotionError, match="numerical difficulties"):
        list(enumerate_modes(scene("rest")))
    assert issubclass(UndecidedMotionError, GrasplessPinError)


# Routines of scipy behind the virtual motions


@cache
def fixed_questions() -> list[tuple[QuasistaticProblem, SignRule, list[Requirement]]]:
    """Requirements on a few contacts, some of which no motion meets."""
    found = []
    for seed in range(8):
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
    for problem, rule, asked in fixed_questions():
        try:
            verdict = VirtualKinematics(problem.with_changes()).solve(asked, rule)
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


def test_right_routines_decide_all_fixed_questions():
    assert assert_no_wrong_verdicts() == len(fixed_questions())


@pytest.mark.sampled(8)
@pytest.mark.parametrize("how", list(WRONG_SQUARES))
def test_no_wrong_least_squares_become_a_verdict(how, monkeypatch):
    monkeypatch.setattr(optimize, "nnls", WRONG_SQUARES[how])
    # The linear program decides instead, but not where its motion is one at the border of its box.
    assert assert_no_wrong_verdicts() >= 0.65 * len(fixed_questions())


@pytest.mark.sampled(6)
@pytest.mark.parametrize("how", list(WRONG_PROGRAMS))
@pytest.mark.parametrize("squares", ["gives up", "zeros"])
def test_no_wrong_linear_program_becomes_a_verdict(how, squares, monkeypatch):
    monkeypatch.setattr(optimize, "nnls", WRONG_SQUARES[squares])
    monkeypatch.setattr(optimize, "linprog", WRONG_PROGRAMS[how])
    decided = assert_no_wrong_verdicts()
    assert decided > 0 or how != "right"
