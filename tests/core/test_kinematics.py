"""Feasibility of virtual sliding: witnesses and conflicts against linprog."""

from functools import partial
from itertools import product
from types import SimpleNamespace

import numpy as np
import pytest
from edge_form import virtual_motion_exists
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_problem, scene, structured_arguments

from graspless_pin import (
    QuasistaticProblem,
    Status,
    disturbance_margin,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.warm_start import reaches_margin, solve_from
from graspless_pin.errors import GrasplessPinError, UndecidedMotionError
from graspless_pin.modes.feasibility import Conflict, Requirement, Witness
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.rules import SignRule
from graspless_pin.modes.witness_heuristics import NearestMotions
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


def oracle(problem, rule, requirements):
    mode: list[tuple[int, int] | None] = [None] * problem.contact_count
    for requirement in requirements:
        mode[requirement.contact] = requirement.signs
    return virtual_motion_exists(problem, tuple(mode), str(rule))


@settings(max_examples=150)
@given(questions(list(ANY_SIGNS)))
def test_verdicts_agree_with_linprog_and_prove_themselves(question):
    assert_right_verdict(*question)


@settings(max_examples=80)
@given(questions(list(ANY_SIGNS)), st.integers(0, 2000))
def test_what_matters_most_changes_no_verdict(question, seed):
    problem, rule, requirements = question
    importance = np.random.default_rng(seed).uniform(0.03, 1.0, (len(requirements), 2))
    assert_right_verdict(problem, rule, requirements, importance)


def assert_right_verdict(problem, rule, requirements, importance=None):
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


@pytest.mark.parametrize("rule", list(ANY_SIGNS))
def test_nothing_asked_is_feasible(rule):
    verdict = VirtualKinematics(scene("rest")).solve([], rule)
    assert isinstance(verdict, Witness)


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


def test_a_joint_lets_a_contact_slide():
    """A finger whose joint moves along t1 lets contact 1 slide apart from contact 0."""
    arguments = {
        "positions": [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        "normals": [[0.0, 0.0, 1.0]] * 2,
        "external_wrench": np.zeros(6),
        "friction": 0.5,
        "tangents": [[[1, 0], [0, 1], [0, 0]]] * 2,
    }
    along_t1 = np.zeros((6, 1))
    along_t1[3] = 0.1
    apart = [Requirement(0, (-1, 1)), Requirement(1, (1, 1))]
    problem = QuasistaticProblem(**arguments, jacobian=along_t1)
    assert isinstance(VirtualKinematics(problem).solve(apart, SignRule.STRICT), Witness)


@pytest.mark.parametrize("scale", [1e-3, 1.0, 1e3])
def test_verdicts_do_not_depend_on_units(scale):
    base = structured_arguments(7, "pinch", 4)
    scaled = {
        **base,
        "positions": scale * base["positions"],
        "jacobian": scale * base["jacobian"],
    }
    one, two = (VirtualKinematics(QuasistaticProblem(**a)) for a in (base, scaled))
    pairs = [(a, b) for a in (-1, 1) for b in (-1, 1)]
    for signs in product(pairs, repeat=4):
        asked = [Requirement(contact, pair) for contact, pair in enumerate(signs)]
        verdicts = [k.solve(asked, SignRule.STRICT) for k in (one, two)]
        assert isinstance(verdicts[0], Witness) == isinstance(verdicts[1], Witness)


@pytest.mark.parametrize("name", ["sphere", "rest", "up", "down"])
def test_least_squares_that_give_up_change_no_answer(name, monkeypatch):
    expected = maximize_margin(scene(name), sliding_rule="constrained")

    def gives_up(*_):
        raise RuntimeError("Maximum number of iterations reached")

    monkeypatch.setattr("scipy.optimize.nnls", gives_up)
    solution = maximize_margin(scene(name), sliding_rule="constrained")
    assert solution.status is expected.status
    if expected.found:
        assert solution.margin == pytest.approx(expected.margin, rel=1e-9)


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
def test_an_undecided_motion_leaves_a_margin_undecided():
    problem = scene("rest")
    objective = Margin()
    assert solve_from(problem, objective, SolveOptions())[0].status is Status.UNVERIFIED
    assert reaches_margin(problem, 0.01, SolveOptions())[0] is None


@pytest.mark.usefixtures("undecided")
def test_an_undecided_motion_leaves_no_disturbance_margin():
    assert disturbance_margin(scene("rest")).status is Status.UNVERIFIED


@pytest.mark.usefixtures("undecided")
def test_an_undecided_motion_is_an_error_where_modes_are_listed():
    with pytest.raises(UndecidedMotionError, match="numerical difficulties"):
        list(enumerate_modes(scene("rest")))
    assert issubclass(UndecidedMotionError, GrasplessPinError)
