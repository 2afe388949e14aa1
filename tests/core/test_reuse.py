"""What is kept between programs, problems and threads never changes an answer."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import permutations

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from random_scenes import general_scene, slope_scene
from scenes import assert_holds, cuboid_arguments, scene

from graspless_pin import (
    QuasistaticProblem,
    SlidingMode,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.algorithms.mode_oracle import ModeOracle
from graspless_pin.modes.enumeration import requirements_of
from graspless_pin.modes.feasibility import Requirement
from graspless_pin.modes.rules import Rules, SignRule
from graspless_pin.modes.witness_heuristics import NearestMotions
from graspless_pin.programs.forces import force_coordinates, force_rows
from graspless_pin.programs.objectives import Margin
from graspless_pin.solvers import piqp_engines

SEEDS = st.integers(0, 100_000)


def formulation(problem: QuasistaticProblem) -> Formulation:
    return formulate(problem, Margin())


def same_structure() -> list[QuasistaticProblem]:
    """Problems whose programs have entries in the same places, and one with fewer entries."""
    rest = scene("rest")
    jacobian = rest.jacobian.copy()
    jacobian[:, 1] = 0.0
    return [
        rest,
        rest.with_changes(friction=0.4),
        rest.with_changes(torque_limits=(-6.0, 7.0), max_normal_force=40.0),
        rest.with_changes(jacobian=jacobian, friction=0.5),
    ]


def figures(solution: TorqueSolution) -> tuple[bytes, str, float]:
    forces = solution.contact_forces.tobytes() if solution.found else b""
    return forces, solution.status.message, solution.certificate.bound


@pytest.mark.parametrize("algorithm", [maximize_margin, partial(minimize_torque, margin=0.1)])
def test_an_answer_does_not_depend_on_what_was_solved_before(monkeypatch, algorithm):
    problems = same_structure()
    alone = []
    for problem in problems:
        monkeypatch.setattr(piqp_engines, "_engines", piqp_engines._Engines())
        alone.append(figures(algorithm(problem)))
    assert len(set(alone)) == len(problems)
    monkeypatch.setattr(piqp_engines, "_engines", piqp_engines._Engines())
    for order in permutations(range(len(problems)), 3):
        for index in order:
            assert figures(algorithm(problems[index])) == alone[index]


def test_threads_do_not_disturb_each_other():
    problems = [general_scene(seed, 5) for seed in range(8)] + same_structure() * 2
    expected = [figures(minimize_torque(problem, 0.1)) for problem in problems]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda problem: figures(minimize_torque(problem, 0.1)), problems * 3))
    assert found == expected * 3


def test_a_joint_that_no_contact_knows_changes_nothing():
    arguments = cuboid_arguments()
    jacobian = np.array(arguments["jacobian"])
    idle = np.hstack([jacobian, np.zeros((len(jacobian), 1))])
    for algorithm in (maximize_margin, partial(minimize_torque, margin=0.1)):
        plain = algorithm(QuasistaticProblem(**arguments))
        more = algorithm(QuasistaticProblem(**{**arguments, "jacobian": idle}))
        assert_holds(more)
        assert more.margin == pytest.approx(plain.margin, rel=1e-6)
        assert more.torques == pytest.approx([*plain.torques, 0.0], abs=1e-6)


@settings(max_examples=60)
@given(SEEDS, st.integers(3, 9), st.booleans())
def test_signs_of_a_guessed_witness_are_feasible_under_every_rule(seed, contacts, slope):
    problem = (slope_scene if slope else general_scene)(seed, contacts)
    kinematics = formulation(problem).kinematics
    rng = np.random.default_rng(seed)
    for _ in range(5):
        chosen = tuple(np.flatnonzero(rng.random(contacts) < 0.6).tolist())
        wanted = rng.choice([-1.0, 0.0, 1.0], 2 * len(chosen), p=[0.4, 0.2, 0.4])
        found = kinematics.nearest.guessed_witness(chosen, wanted)
        if found is None:
            continue
        signs, _ = found
        assert ((signs == wanted) | (wanted == 0.0)).all()
        pairs = signs.astype(int).reshape(-1, 2).tolist()
        requirements = [Requirement(c, (a, b)) for c, (a, b) in zip(chosen, pairs, strict=True)]
        for rule in SignRule:
            assert kinematics.feasible(requirements, rule)


@settings(max_examples=60)
@given(SEEDS, st.integers(3, 6), st.booleans())
def test_a_motion_is_behind_signs_only_if_they_are_feasible(seed, contacts, slope):
    """Whatever motion is remembered: one of this problem, a little off, or any."""
    problem = (slope_scene if slope else general_scene)(seed, contacts)
    kinematics = formulation(problem).kinematics
    rng = np.random.default_rng(seed)
    chosen = tuple(np.flatnonzero(rng.random(contacts) < 0.7).tolist())
    signs = rng.choice(np.array([-1, 1], dtype=np.int8), 2 * len(chosen))
    pairs = signs.reshape(-1, 2).tolist()
    requirements = [Requirement(c, (a, b)) for c, (a, b) in zip(chosen, pairs, strict=True)]
    near = [rng.normal(size=kinematics.rows.shape[2]), np.zeros(kinematics.rows.shape[2])]
    found = kinematics.nearest.guessed_witness(chosen, signs.astype(float))
    if found is not None:
        near.append(found[1] + 1e-4 * rng.normal(size=len(found[1])))
    for start in near:
        motion = kinematics.nearest.witness_near(chosen, signs.reshape(-1, 2), start)
        if motion is None:
            continue
        for rule in SignRule:
            assert kinematics.feasible(requirements, rule)
        if chosen:
            velocities = kinematics.rows[list(chosen)] @ motion
            assert np.abs(velocities[:, 0]).max() <= 1e-7 * np.linalg.norm(motion)
            assert (velocities[:, 1:].ravel() * signs > 0.0).all()


def test_a_remembered_motion_serves_again_where_little_changed():
    problem = general_scene(4, 6, joints=(3, 4))
    kinematics = formulation(problem).kinematics
    fingers = tuple(np.flatnonzero(np.abs(problem.jacobian).sum(axis=1)[::3] > 0.0).tolist())
    rng = np.random.default_rng(0)
    for _ in range(20):
        signs = rng.choice(np.array([-1, 1], dtype=np.int8), 2 * len(fingers))
        found = kinematics.nearest.guessed_witness(fingers, signs.astype(float))
        assert found is not None
        near = found[1] * (1.0 + 1e-3 * rng.normal(size=len(found[1])))
        assert kinematics.nearest.witness_near(fingers, signs.reshape(-1, 2), near) is not None
        assert kinematics.nearest.witness_near(fingers, -signs.reshape(-1, 2), near) is None


def test_a_mode_still_admits_traces_of_friction_but_no_more():
    problem = general_scene(4, 6, joints=(3, 4))
    shared = formulation(problem)
    fingers = np.flatnonzero(np.abs(problem.jacobian).sum(axis=1)[::3] > 0.0).tolist()
    signs = np.ones((6, 2), dtype=np.int8)
    selection = np.isin(np.arange(6), fingers)
    mode = SlidingMode(selection, np.where(selection[:, None], signs, 0))
    found = shared.kinematics.nearest.guessed_witness(tuple(fingers), np.ones(2 * len(fingers)))
    assert found is not None
    columns = shared.cone_columns[0][np.isin(shared.cone_index, fingers)]
    x = np.zeros(len(shared.program.c))
    x[columns] = -0.1
    reader = ModeOracle(shared, Rules())
    assert reader.admitted_again(x, mode) is None  # no motion is known yet
    reader.motion = found[1]
    assert reader.admitted_again(x, mode) is x
    traces = x.copy()
    traces[columns[0, 0]] = 1e-9
    admitted = reader.admitted_again(traces, mode)
    assert admitted is not None
    assert admitted[columns[0, 0]] == 0.0
    against = x.copy()
    against[columns[0, 0]] = 1e-3
    assert reader.admitted_again(against, mode) is None


def test_a_guessed_witness_mostly_suffices_where_every_fingertip_can_move():
    """With three or more joints a finger any signs have a motion behind them."""
    problem = general_scene(4, 6, joints=(3, 4))
    kinematics = formulation(problem).kinematics
    fingers = tuple(np.flatnonzero(np.abs(problem.jacobian).sum(axis=1)[::3] > 0.0).tolist())
    rng = np.random.default_rng(0)
    for _ in range(20):
        wanted = rng.choice([-1.0, 1.0], 2 * len(fingers))
        assert kinematics.nearest.guessed_witness(fingers, wanted) is not None


@settings(max_examples=40)
@given(SEEDS, st.integers(3, 9), st.booleans())
def test_a_proposed_mode_has_a_motion_behind_it(seed, contacts, slope):
    problem = (slope_scene if slope else general_scene)(seed, contacts)
    shared = formulation(problem)
    x = np.random.default_rng(seed).normal(size=len(shared.program.c))
    mode = ModeOracle(shared, Rules()).heuristic_mode(x)
    if mode is not None:
        for rule in SignRule:
            assert shared.kinematics.feasible(requirements_of(mode), rule)


def test_solving_another_problem_leaves_an_earlier_program_as_it_was():
    problem = scene("rest")
    kept = formulate(problem, Margin(0.1))
    before = kept.program.P.copy()
    # More programs of one structure than solvers are kept for it: one is told the others' numbers.
    for epsilon in (0.1, 0.2, 0.3, 0.4):
        assert maximize_margin(problem, regularization=epsilon).found
    np.testing.assert_array_equal(kept.program.P, before)


def test_problems_with_different_cones_do_not_share_rows():
    problem = scene("rest")
    frictionless = np.where(np.arange(6) == 3, 0.0, problem.friction)
    others = [
        problem.with_changes(friction=0.5),
        problem.with_changes(friction=np.linspace(0.1, 0.6, 6)),
        problem.with_changes(friction=np.linspace(0.6, 0.1, 6)),
        problem.with_changes(friction=frictionless),
        problem.with_changes(friction=frictionless[::-1]),
        problem.with_changes(cone_edges=5),
        scene("up"),
    ]
    # More of them than are kept at once, and then again from the first.
    many = [problem.with_changes(friction=mu) for mu in np.linspace(0.2, 0.9, 20)]
    for one in [problem, *others, *many, problem, *others]:
        assert_rows_hold(one, np.random.default_rng(0))


@settings(max_examples=40)
@given(SEEDS, st.integers(3, 9), st.booleans())
def test_rows_of_forces_are_those_of_the_problem(seed, contacts, slope):
    problem = (slope_scene if slope else general_scene)(seed, contacts)
    assert_rows_hold(problem, np.random.default_rng(seed))


def assert_rows_hold(problem: QuasistaticProblem, rng: np.random.Generator) -> None:
    coordinates = force_coordinates(problem)
    rows = force_rows(problem, coordinates)
    x = rng.normal(size=rows.size)
    forces = coordinates.forces(x).ravel()
    scale = coordinates.force_scale
    np.testing.assert_allclose(
        coordinates.joint_scale * (rows.torque @ x), problem.J.T @ forces, atol=1e-9 * scale
    )
    np.testing.assert_allclose(
        scale * (rows.balance @ x) / rows.weight, problem.W @ forces, atol=1e-9 * scale
    )
    along_faces = (problem.H.T @ forces)[np.diag(problem.D_star) == 0.0]
    np.testing.assert_allclose(scale * (rows.cones.rows @ x), along_faces, atol=1e-9 * scale)
    normal = np.einsum("ij,ij->i", problem.normals, forces.reshape(-1, 3))
    np.testing.assert_allclose(scale * (rows.normal @ x), normal, atol=1e-9 * scale)


def test_a_motion_that_leaves_a_contact_is_behind_nothing():
    """Normals so nearly alike that damping keeps the motion from being taken back in full."""
    rows = np.zeros((2, 3, 3))
    rows[0, 0], rows[1, 0] = (1.0, 0.0, 0.0), (1.0, 1e-5, 0.0)
    rows[:, 1:, 2] = 1.0
    nearest = NearestMotions(rows, 1e-5)
    signs = np.ones((2, 2), dtype=np.int8)
    assert nearest.witness_near((0, 1), signs, np.array([0.0, 1.0, 0.01])) is None
    assert nearest.witness_near((0, 1), signs, np.array([0.0, 0.0, 0.01])) is not None
    assert nearest.witness_near((0,), signs[:1], np.array([0.0, 1.0, 0.01])) is not None
