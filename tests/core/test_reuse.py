"""What is kept between programs, problems and threads never changes an answer."""

from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import permutations

import numpy as np
import pytest
from random_scenes import general_scene
from scenes import assert_holds, cuboid_arguments, scene

from graspless_pin import (
    QuasistaticProblem,
    TorqueSolution,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.modes.virtual_motions import NearestMotions
from graspless_pin.programs.objectives import Margin
from graspless_pin.solvers import piqp_engines


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
        rest.with_changes(external_wrench=1.25 * rest.external_wrench + 0.1),
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
        monkeypatch.setattr(piqp_engines, "_kept", {})
        alone.append(figures(algorithm(problem)))
    assert len(set(alone)) == len(problems)
    monkeypatch.setattr(piqp_engines, "_kept", {})
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


def test_solving_another_problem_leaves_an_earlier_program_as_it_was():
    problem = scene("rest")
    kept = formulate(problem, Margin(0.1))
    before = kept.program.P.copy()
    # More programs of one structure than solvers are kept for it: one is told the others' numbers.
    for epsilon in (0.1, 0.2, 0.3, 0.4):
        assert maximize_margin(problem, regularization=epsilon).found
    np.testing.assert_array_equal(kept.program.P, before)


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
