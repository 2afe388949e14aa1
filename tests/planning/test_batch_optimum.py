"""Optima that warm starts in loops lead to: what they prove, and that nothing else passes."""

import pickle
from dataclasses import replace

import numpy as np
import pytest
from planning_scenes import EXAMPLES, example, nearby

from graspless_pin import (
    Margin,
    QuasistaticProblem,
    SolveOptions,
    Torque,
    compiled,
    load_scene,
)
from graspless_pin.algorithms import batch_optimum
from graspless_pin.algorithms.batch_optimum import WarmStart, warm_optimum
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.warm_search import solve_from
from graspless_pin.geometry.hand.configuration import independent_positions
from graspless_pin.planning import Evaluator
from graspless_pin.planning.configurations import Configurations
from graspless_pin.planning.evaluation import WarmAnswer
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.scene import batch_states
from graspless_pin.scene.batch_states import BatchContactFinder, solids_of

SCENE = "allegro_box_on_slope"
pytestmark = pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")


@pytest.fixture(scope="module")
def learned():
    """A problem of the Allegro hand's box, and what its solution leaves behind."""
    problem = example(SCENE).problem()
    return problem, solve_from(problem, Margin(), SolveOptions())[1]


@pytest.mark.sampled(3)
@pytest.mark.parametrize("objective", [Margin(), Torque(required_margin=0.1)])
@pytest.mark.parametrize("name", [SCENE, "trihand_push_box", "paper/cuboid_sliding_up"])
def test_a_warm_optimum_is_the_optimum(name, objective):
    solver = StateSolver(Configurations(example(name)), objective, SolveOptions())
    evaluator = Evaluator(example(name))
    rng = np.random.default_rng(8)
    seen = 0
    for _ in range(12):
        q = nearby(evaluator, rng, 2e-4)
        answer = solver.solve(q, None, None)
        if not isinstance(answer._found, WarmAnswer):
            continue
        seen += 1
        full = evaluator.scene_at(q).problem()
        optimum, solution = answer._found.optimum, answer.solution
        cold = solve_problem(full, objective)
        assert solution.value == pytest.approx(cold.value, abs=2e-7)
        assert abs(optimum.gap) <= 1e-8 * abs(optimum.signed_unit)
        document = solution_document(solution)
        assert verify_document(document).proven
    assert seen >= 3


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_an_evaluation_is_a_batch_of_one(algorithm, monkeypatch):
    """Its solution, made when it is read, is that of its figures, and is proven."""
    evaluator = Evaluator(example(SCENE), algorithm=algorithm)
    rng = np.random.default_rng(8)
    states = [nearby(evaluator, rng, 2e-4) for _ in range(4)]
    for q in states:
        evaluator.evaluate(q)
    searched, solved = [], StateSolver.posed_scene
    monkeypatch.setattr(
        StateSolver, "posed_scene", lambda *of, **how: searched.append(of) or solved(*of, **how)
    )
    for q in states:
        named = dict(zip(evaluator.joint_names, q.tolist(), strict=True))
        by_name, answer = evaluator.evaluate(named), evaluator.evaluate(q)
        assert by_name.margin == pytest.approx(answer.margin, abs=1e-9)
        assert len(answer.torques) == len(answer.joint_names) == len(answer.joint_units)
        solution = answer.solution
        assert answer.margin == pytest.approx(solution.margin, rel=1e-12)
        np.testing.assert_allclose(answer.torques, solution.torques, rtol=0, atol=1e-12)
        assert solution.problem.joint_names == answer.joint_names
        assert answer.contacts.bodies == evaluator.scene_at(q).contacts.bodies
        assert verify_document(solution_document(solution)).proven
        again = pickle.loads(pickle.dumps(answer))  # noqa: S301 - our own
        assert again.margin == answer.margin and again.solution.found
    assert len(searched) <= len(states)  # of twice as many


@pytest.mark.parametrize("turn", [0.05, 1.0])
def test_a_warm_optimum_is_scaled_as_its_problem(turn):
    """Under a load that is a moment more than a force, about the contacts' centre."""
    problem = example("paper/cuboid_at_rest").problem()
    twisted = problem.with_changes(external_wrench=[0.0, 0.0, -turn, 0.0, turn, 0.0])
    solution, start = solve_from(twisted, Margin(), SolveOptions())
    assert solution.found
    found = warm_optimum(twisted, Margin(), SolveOptions(), (start,))
    assert found is not None
    assert twisted.scales.force > 1.5 * turn
    assert abs(found[0].signed_unit) == pytest.approx(twisted.scales.force, rel=1e-12)


@pytest.mark.parametrize("way", [1.0, -1.0])
@pytest.mark.parametrize("objective", [Margin(), Torque(required_margin=0.01)])
def test_a_load_that_no_forces_balance_has_no_warm_optimum(objective, way):
    """Two points on one line bear no moment about it, whatever was active before."""
    pinch = QuasistaticProblem(
        [[0.05, 0.0, 0.0], [-0.05, 0.0, 0.0]], [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], [[1.0], [0.0], [0.0], [-1.0], [0.0], [0.0]],
        friction=0.5, torque_limits=(-9.0, 9.0),
    )  # fmt: skip
    options = SolveOptions.parse(sign_rule="nonzero")
    solution, start = solve_from(pinch, objective, options)
    assert solution.found
    found = warm_optimum(pinch, objective, options, (start,))
    twisted = pinch.with_changes(external_wrench=[0.0, 0.0, -1.0, 0.02 * way, 0.0, 0.0])
    assert found is not None
    assert warm_optimum(twisted, objective, options, (start,)) is None


def test_the_first_start_that_serves_is_taken_for_the_best_case_alone(learned):
    problem, start = learned
    found = warm_optimum(problem, Margin(), SolveOptions(), (WarmStart(), start))
    assert found is not None
    assert found[1] == 1
    for options in (SolveOptions.parse(stability="strong"), SolveOptions.parse(
        sign_rule="direction")):  # fmt: skip
        assert warm_optimum(problem, Margin(), options, (start,)) is None
    assert warm_optimum(problem, Margin(regularization=1e-3), SolveOptions(), (start,)) is None
    assert warm_optimum(problem, Margin(), SolveOptions(), ()) is None


@pytest.mark.parametrize(
    "spoil",
    [
        lambda start: replace(start, motion=-start.motion),
        lambda start: replace(
            start, relaxation=start.relaxation._replace(upper=~start.relaxation.upper)
        ),
        lambda start: replace(
            start, relaxation=start.relaxation._replace(rows=start.relaxation.rows[:10],
                                                        upper=start.relaxation.upper[:10],
                                                        weights=start.relaxation.weights[:10])
        ),
        lambda start: replace(start, structure=replace(start.structure, face_count=1)),
    ],
    ids=["motion", "sides", "rows", "structure"],
)  # fmt: skip
def test_a_start_that_does_not_fit_says_nothing(learned, spoil):
    problem, start = learned
    assert warm_optimum(problem, Margin(), SolveOptions(), (start,)) is not None
    assert warm_optimum(problem, Margin(), SolveOptions(), (spoil(start),)) is None


@pytest.mark.sampled(5)
@pytest.mark.parametrize("path", sorted(EXAMPLES.glob("*.yaml")), ids=lambda path: path.stem)
def test_loops_find_what_pinocchio_and_the_search_for_contacts_do(path):
    if "scene:" in path.read_text(encoding="utf-8"):
        pytest.skip("a study, not a scene")
    evaluator = Evaluator(load_scene(path))
    if evaluator.scene.hand is None:
        pytest.skip("no hand")
    tree, rng = evaluator.scene.hand.tree, np.random.default_rng(9)
    loops = BatchContactFinder(evaluator.scene)
    q = np.array([nearby(evaluator, rng, 2e-4) for _ in range(4)] + [evaluator.joint_limits[0]])
    q[4, 0] -= 1.0
    states = loops.contacts_at(q)
    if states is None:
        assert path.stem != SCENE
        return
    assert states.counts[4] == -1
    for k in range(4):
        positions = independent_positions(tree, q[k])
        gravity = evaluator.scene.gravity * evaluator.scene.count_own_weight
        weights = tree.gravity_torques(positions, gravity)
        np.testing.assert_allclose(
            states.columns[k], tree.kinematics(positions).J.reshape(6, -1), rtol=0, atol=1e-13
        )
        np.testing.assert_allclose(states.weights[k], weights, rtol=0, atol=1e-13)
        if states.counts[k] >= 0:
            contacts = evaluator.scene_at(q[k]).contacts.arrays
            rows = states.rows[k, : states.counts[k]]
            assert contacts.hand_count == len(rows)
            own = np.hstack([contacts.positions, contacts.normals])[: len(rows)]
            np.testing.assert_allclose(rows, own, rtol=0, atol=1e-13)
    assert (states.counts[:4] == 3).all() or path.stem != SCENE


def test_loops_leave_a_link_with_several_shapes_near_the_object_to_the_search(monkeypatch):
    """Its contacts may be one patch, which a loop for balls does not know."""

    def of_one_link(shapes):
        hands = len(shapes.names) > 1
        return solids_of(replace(shapes, names=("tips",) * len(shapes.names)) if hands else shapes)

    evaluator = Evaluator(example(SCENE))
    q = evaluator.configuration()[None]
    apart = BatchContactFinder(evaluator.scene).contacts_at(q)
    assert apart is not None and apart.counts.tolist() == [3]
    monkeypatch.setattr(batch_states, "solids_of", of_one_link)
    together = BatchContactFinder(evaluator.scene).contacts_at(q)
    assert together is not None and together.counts.tolist() == [-1]


def test_an_optimum_is_asked_of_the_loops_that_found_it(monkeypatch):
    """Another thread may put loops of its own into the cache, or push these out, in between."""
    monkeypatch.setattr(batch_optimum, "loops_of", batch_optimum.loops_of.__wrapped__)
    evaluator = Evaluator(example(SCENE), algorithm="margin")
    first, again = evaluator.evaluate(), evaluator.evaluate()
    assert again.margin == pytest.approx(first.margin, abs=1e-8)
    reached = [evaluator.is_feasible(margin=share * first.margin) for share in (0.9, 0.9, 1.1)]
    assert reached == [True, True, False]
