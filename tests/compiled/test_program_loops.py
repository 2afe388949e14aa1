"""The compiled loops from problems to proven optima do what the numpy beside their callers does."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graspless_pin import QuasistaticProblem, compiled, load_scene, maximize_margin
from graspless_pin.algorithms.formulation import Formulation, formulate
from graspless_pin.errors import GrasplessPinError
from graspless_pin.modes import witness_heuristics
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.modes.witness_heuristics import CLEARLY
from graspless_pin.problem.contact_map import contact_map
from graspless_pin.problem.scales import scales_of
from graspless_pin.programs import active_set
from graspless_pin.programs.active_set import active_set_of, solved_on
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare
from graspless_pin.programs.program import Program
from graspless_pin.solvers import Outcome, solve

pytestmark = pytest.mark.skipif(
    compiled.small_arrays is None, reason="the loops are not compiled: there is no C compiler"
)

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = (
    "paper/cuboid_at_rest", "paper/cuboid_sliding_up", "paper/sphere_on_slope",
    "allegro_box_on_slope", "trihand_push_box", "two_hands_slide_crate",
)  # fmt: skip
MARGIN = Margin()
PROGRAM = ("P", "c", "A", "b", "G", "l", "u", "lb", "ub", "box")


@cache
def example(name: str) -> QuasistaticProblem:
    return load_scene(EXAMPLES / f"{name}.yaml").problem()


def fresh(name: str, seed: int) -> QuasistaticProblem:
    """An example whose numbers are changed a little, of which nothing is assembled."""
    rng, problem = np.random.default_rng(seed), example(name)
    return problem.with_changes(
        jacobian=problem.jacobian * rng.uniform(0.9, 1.1, problem.jacobian.shape),
        external_wrench=problem.external_wrench * rng.uniform(0.9, 1.1, 6),
        friction=problem.friction * rng.choice([1.0, 1.0, 0.0], problem.contact_count),
        positions=problem.positions * rng.uniform(0.9, 1.1, problem.positions.shape),
    )


def assembled(name: str, seed: int, objective: Objective = MARGIN) -> Formulation:
    return formulate(fresh(name, seed), objective)


def same(ours, theirs, what: str = "") -> None:
    np.testing.assert_allclose(ours, theirs, rtol=1e-12, atol=1e-12, err_msg=what)


@pytest.mark.parametrize(
    "objective",
    [Margin(), Margin(0.1), Torque(), Torque(0.0), Torque(0.2, 0.1), TorqueShare(0.1)],
    ids=repr,
)
@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("name", NAMES)
def test_programs_are_alike(name, seed, objective, by_numpy) -> None:
    ours = assembled(name, seed, objective)
    theirs = by_numpy(lambda: assembled(name, seed, objective))
    for field in PROGRAM:
        same(getattr(ours.program, field), getattr(theirs.program, field), field)
    same(ours.program.rows, theirs.program.rows)
    assert ours.program.is_far == theirs.program.is_far
    for side, other in zip(ours.program.sides, theirs.program.sides, strict=True):
        same(side, other)
    for field in ("directions", "force_scale", "joint_scale", "length_scale"):
        same(getattr(ours.coordinates, field), getattr(theirs.coordinates, field), field)
    same(ours.kinematics.rows, theirs.kinematics.rows)
    same(ours.kinematics.scale, theirs.kinematics.scale)
    local = contact_map(ours.problem)
    assert not local.flags.writeable
    same(local, by_numpy(lambda: contact_map(fresh(name, seed))))


@pytest.mark.parametrize("name", NAMES)
def test_margins_are_alike(name, by_numpy) -> None:
    rng = np.random.default_rng(0)
    for seed in range(5):
        problem = fresh(name, seed)
        for size in (0.1, 10.0, 100.0):
            forces = size * rng.normal(size=(problem.contact_count, 3)) + size * problem.normals
            same(problem.margin_of(forces), by_numpy(lambda p=problem, f=forces: p.margin_of(f)))


def judged(program: Program, x, y, z, by_numpy) -> None:
    ours = program.judged(x, y, z)
    theirs = by_numpy(lambda: program.judged(x, y, z))
    np.testing.assert_allclose(ours, theirs, rtol=1e-10, atol=1e-9)


@pytest.mark.parametrize("name", NAMES)
def test_answers_prove_the_same(name, by_numpy) -> None:
    rng = np.random.default_rng(1)
    for seed in range(4):
        formulation = assembled(name, seed)
        program = formulation.program
        answer = solve(program, "piqp")
        if answer.outcome is Outcome.SOLVED:
            judged(program, answer.x, answer.y, answer.z, by_numpy)
        lb, ub = program.lb.copy(), program.ub.copy()
        lb[0], ub[2] = 0.0, 0.0
        for bounded in (program, program.bounded(lb, ub)):
            x = rng.normal(size=len(program.c))
            y, z = rng.normal(size=len(program.b)), rng.normal(size=len(program.l))
            judged(bounded, x, y, z * rng.choice([0.0, 1.0], len(z)), by_numpy)


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("name", NAMES)
def test_what_is_no_number_proves_nothing(name, bad) -> None:
    program = assembled(name, 0).program
    x, y, z = np.zeros(len(program.c)), np.zeros(len(program.b)), np.zeros(len(program.l))
    for place in (0, len(x) - 1):
        spoilt = x.copy()
        spoilt[place] = bad
        assert not program.judged(spoilt, y, z)[2] <= 1.0
    for multipliers in (y, z):
        spoilt = multipliers.copy()
        spoilt[-1] = bad
        given = (spoilt, z) if multipliers is y else (y, spoilt)
        bound, value, _ = program.judged(x, *given)
        assert not value - bound <= 1.0


@pytest.mark.parametrize("name", NAMES)
def test_optima_are_carried_over_alike(name, by_numpy) -> None:
    seen = 0
    for seed in range(6):
        here, there = assembled(name, seed).program, assembled(name, seed).program
        answer = solve(here, "piqp")
        if answer.outcome is not Outcome.SOLVED:
            continue
        near = active_set_of(here, answer)
        assert near is not None
        # Rows left out at random have no multipliers that make them optimal: damping tells them.
        rng = np.random.default_rng(seed)
        fewer = np.flatnonzero(rng.random(len(near.rows)) < 0.6)
        part = near._replace(
            rows=near.rows[fewer],
            upper=np.concatenate((near.upper[fewer], near.upper[len(near.rows) :])),
            weights=np.concatenate((near.weights[fewer], near.weights[len(near.rows) :])),
        )
        for start in (near, part):
            ours = active_set._refined(there, start)
            theirs = by_numpy(lambda p=there, s=start: active_set._refined(p, s))
            assert ours is not None and theirs is not None
            np.testing.assert_allclose(ours[0], theirs[0], rtol=0, atol=1e-8)
            if start is near:
                np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=1e-12)
            for _, weights, every in (ours, theirs):
                np.testing.assert_array_equal(every[start.rows], weights[: len(start.rows)])
                assert np.count_nonzero(every) <= len(start.rows)
        known = solved_on(there, near, np.inf)
        if known is not None:
            seen += 1
            assert known[0].value == pytest.approx(answer.value, abs=1e-7)
    assert seen >= 2


@settings(max_examples=80)
@given(name=st.sampled_from(NAMES), seed=st.integers(0, 5), kind=st.integers(0, 1000))
def test_forbidden_friction_is_cut_off_alike(name, seed, kind, by_numpy) -> None:
    formulation = assembled(name, seed)
    rng = np.random.default_rng(kind)
    count = formulation.problem.contact_count
    signs = rng.integers(-1, 2, (count, 2))
    mode = SlidingMode.unchecked(np.asarray(signs.any(axis=1)), signs.astype(np.int8))
    x = rng.normal(size=len(formulation.program.c)) * rng.choice([0.0, 1e-9, 1.0])
    ours, theirs = (
        formulation.admitted(mode, x),
        by_numpy(lambda: formulation.admitted(mode, x)),
    )
    np.testing.assert_array_equal(ours, theirs)
    assert (ours is x) == (theirs is x)


@settings(max_examples=80)
@given(name=st.sampled_from(NAMES), seed=st.integers(0, 5), kind=st.integers(0, 1000))
def test_motions_are_held_alike(name, seed, kind, by_numpy) -> None:
    problem = fresh(name, seed)
    rng = np.random.default_rng(kind)
    kinematics = formulate(problem, MARGIN).kinematics
    count = rng.integers(1, 1 + min(3, problem.contact_count))
    contacts = tuple(sorted(rng.permutation(problem.contact_count)[:count].tolist()))
    near = rng.normal(size=kinematics.rows.shape[2])
    held = kinematics.nearest._held(contacts, near)
    signs = np.sign(held.sliding).astype(np.int8)
    signs *= rng.choice([1, -1, 0], len(signs), p=[0.96, 0.03, 0.01])
    ours = kinematics.nearest.witness_near(contacts, signs.reshape(-1, 2), near)
    theirs = by_numpy(lambda: kinematics.nearest.witness_near(contacts, signs.reshape(-1, 2), near))
    assert (ours is None) == (theirs is None)
    if ours is not None:
        np.testing.assert_allclose(ours, theirs, rtol=0, atol=1e-8 * float(np.linalg.norm(near)))


@settings(max_examples=200)
@given(name=st.sampled_from(NAMES), seed=st.integers(0, 5), kind=st.integers(0, 1000))
def test_motions_are_guessed_alike(name, seed, kind, by_numpy) -> None:
    rng, problem = np.random.default_rng(kind), fresh(name, seed)
    count = rng.integers(1, 1 + problem.contact_count)
    contacts = tuple(sorted(rng.permutation(problem.contact_count)[:count].tolist()))
    wide = formulate(problem, MARGIN).kinematics
    # Signs that a motion has, but for some that are turned or left open.
    signs = np.sign(wide.nearest._motions(contacts)[: 2 * count] @ rng.normal(size=2 * count))
    signs *= rng.choice([1.0, -1.0, 0.0], len(signs), p=[0.85, 0.03, 0.12])
    near = (None, np.zeros(3), rng.normal(size=wide.rows.shape[2]))[kind % 3]
    ours, theirs = (
        wide.nearest.guessed_witness(contacts, signs, near),
        by_numpy(lambda: wide.nearest.guessed_witness(contacts, signs, near)),
    )
    # Damping in the place of ranks, and open signs at rest, leave a part of a guess to rounding.
    if signs.all():
        assert (ours is None) == (theirs is None)
    for found in (ours, theirs):
        if found is None:
            continue
        assert (found[0] * signs >= 0.0).all() and found[0].all()
        velocities, every = wide.rows[list(contacts)] @ found[1], wide.rows @ found[1]
        assert np.abs(velocities[:, 0]).max() <= 1.01e-8 * np.linalg.norm(every)
        slowest = (velocities[:, 1:].ravel() * found[0]).min()
        assert slowest >= 0.99 * CLEARLY * wide.threshold * np.linalg.norm(every)
    if ours is not None and theirs is not None and signs.all():
        size = float(np.linalg.norm(theirs[1]))
        np.testing.assert_allclose(ours[1], theirs[1], rtol=0, atol=1e-3 * size)


@pytest.mark.parametrize("kind", [153, 675, 2802])
def test_a_guess_that_fails_leads_to_a_better_one(kind, by_numpy, monkeypatch) -> None:
    """Signs of a motion that is not the first guess: what slides fast enough may go on so."""
    rng, problem = np.random.default_rng(kind), fresh("allegro_box_on_slope", 0)
    count = rng.integers(1, 1 + problem.contact_count)
    contacts = tuple(sorted(rng.permutation(problem.contact_count)[:count].tolist()))
    nearest = formulate(problem, MARGIN).kinematics.nearest
    signs = np.sign(nearest._motions(contacts)[: 2 * count] @ rng.normal(size=2 * count))
    ours = nearest.guessed_witness(contacts, signs, None)
    theirs = by_numpy(lambda: nearest.guessed_witness(contacts, signs, None))
    assert ours is not None and theirs is not None
    np.testing.assert_array_equal(ours[0], signs)
    monkeypatch.setattr(witness_heuristics, "GUESSES", 1)
    assert nearest.guessed_witness(contacts, signs, None) is None


@pytest.mark.parametrize("name", NAMES)
def test_whole_answers_are_alike(name, by_numpy) -> None:
    def answered(seed: int):
        try:
            solution = maximize_margin(fresh(name, seed))
        except GrasplessPinError as error:
            return str(error)
        return solution.status, solution.margin if solution.found else None

    for seed in range(4):
        ours, theirs = answered(seed), by_numpy(lambda s=seed: answered(s))
        assert ours[0] == theirs[0]
        assert ours[1] == (None if theirs[1] is None else pytest.approx(theirs[1], abs=1e-5))


ONES = np.ones((2, 3))
FRAMES = np.ones((2, 3, 2))
AXES = np.ones((2, 3, 3))
J = np.ones((6, 1))
LOW, HIGH = np.zeros(4), np.ones(4)
ROWS = np.ones((2, 4))
TWO, BOX = np.ones(2), np.ones((2, 2))
FIRST = np.array([0])
NONE = np.zeros(0, dtype=int)


def program_arguments(**changes):
    values = {
        "kind": 1, "required": 0.1, "turns": [True], "axes": [0, 3], "sides": np.ones((3, 2)),
        "face_count": 0, "reach": np.ones((2, 2)), "has_cone": np.ones(2, bool), "friction": TWO,
        "slopes": TWO, "directions": np.ones((2, 8)), "least_lever": 1e-12, "rounding": 1e-12,
        "farthest": 1e8, "least_limit": 1e-3, "most_strict": 1e6,
    }  # fmt: skip
    return tuple((values | changes).values())


def start_arguments(**changes):
    assert compiled.paper_programs is not None
    values = {
        "programs": compiled.paper_programs.PaperPrograms(*program_arguments()), "rows": [0, 8],
        "at_bounds": [1], "upper": np.ones(3, bool), "x": np.ones(3), "weights": np.ones(3),
        "count": 9, "signs": np.ones((2, 2)), "contacts": [1], "own_signs": TWO,
        "motion": np.ones(7), "judged_by": (0.0, 2, 1.0, 1.0),
    }  # fmt: skip
    return tuple((values | changes).values())


def witness_arguments(**changes):
    values = {
        "rows": np.ones((2, 3, 7)), "contacts": [1], "signs": TWO, "near": np.ones(7),
        "guesses": 2, "damping": 0.0, "corrections": 2, "rank_tolerance": 1.0, "least": 1.0,
    }  # fmt: skip
    return tuple((values | changes).values())


def refined_arguments(**changes):
    values = {
        "rows": ROWS, "low": LOW, "high": HIGH, "c": TWO, "lb": TWO, "ub": TWO, "active": FIRST,
        "at_bounds": NONE, "upper": np.array([True]), "x": TWO, "weights": np.ones(1),
        "damping": 1e-13, "corrections": 2,
    }  # fmt: skip
    return tuple((values | changes).values())


@pytest.mark.parametrize(
    ("loops", "name", "arguments"),
    [
        ("contact_frames", "contact_map", (ONES, ONES, FRAMES, np.ones((5, 1)))),
        ("contact_frames", "contact_map", (ONES, np.ones((3, 3)), FRAMES, J)),
        ("contact_frames", "contact_map", (ONES, ONES, AXES, J)),
        ("contact_frames", "force_directions", (ONES, FRAMES, TWO, ONES, np.ones(3, bool))),
        ("virtual_motions", "scaled_map", (np.ones((2, 3, 5)),)),
        ("virtual_motions", "witness", witness_arguments(contacts=[2])),
        ("virtual_motions", "witness", witness_arguments(contacts=[-1])),
        ("virtual_motions", "witness", witness_arguments(contacts=[0, 1])),
        ("virtual_motions", "witness", witness_arguments(signs=np.ones(3))),
        ("virtual_motions", "witness", witness_arguments(near=np.ones(6))),
        ("virtual_motions", "witness", witness_arguments(rows=np.ones((2, 2, 7)))),
        (
            "contact_frames", "margin",
            (ONES, ONES, FRAMES, TWO, np.ones(2, bool), np.ones(3), np.ones((2, 8))),
        ),
        ("contact_frames", "squared_lengths", (np.ones((2, 2)),)),
        ("paper_programs", "PaperPrograms", program_arguments(axes=[0, 6])),
        ("paper_programs", "PaperPrograms", program_arguments(axes=[-1, 3])),
        ("paper_programs", "PaperPrograms", program_arguments(axes=[0])),
        ("paper_programs", "PaperPrograms", program_arguments(face_count=1)),
        ("paper_programs", "PaperPrograms", program_arguments(face_count=-1)),
        ("paper_programs", "PaperPrograms", program_arguments(friction=np.ones(3))),
        ("paper_programs", "PaperPrograms", program_arguments(reach=np.ones((2, 3)))),
        ("linear_programs", "judged", (ROWS, LOW, HIGH, TWO, TWO, TWO, BOX, TWO, TWO, LOW[:1])),
        ("linear_programs", "judged", (ROWS, LOW, HIGH, TWO, TWO, TWO, BOX, LOW, TWO, TWO)),
        ("linear_programs", "refined", refined_arguments(active=np.array([4]))),
        ("linear_programs", "refined", refined_arguments(active=np.array([-1]))),
        ("linear_programs", "refined", refined_arguments(active=NONE, at_bounds=np.array([2]))),
        ("linear_programs", "refined", refined_arguments(upper=np.array([True, True]))),
        ("contact_frames", "without_forbidden", (TWO, [[[0, 2]]], [0], np.ones((1, 2), np.int8))),
        ("contact_frames", "without_forbidden", (TWO, [[[0, 1]]], [1], np.ones((1, 2), np.int8))),
        ("contact_frames", "without_forbidden", (TWO, [[[0, 1]]], [0], np.ones((1, 3), np.int8))),
        ("contact_frames", "without_forbidden", (TWO, [[[0]]], [0], np.ones((1, 2), np.int8))),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(loops: str, name: str, arguments: tuple) -> None:
    with pytest.raises(ValueError):
        getattr(getattr(compiled, loops), name)(*arguments)


def test_the_arguments_fit_otherwise() -> None:
    assert compiled.linear_programs is not None
    assert compiled.linear_programs.refined(*refined_arguments()) is not None
    endless = refined_arguments(high=np.full(4, np.inf))
    assert compiled.linear_programs.refined(*endless) is None
    vanishing = refined_arguments(rows=np.zeros((2, 4)))
    assert compiled.linear_programs.refined(*vanishing) is None


@pytest.mark.parametrize(
    "changes",
    [
        {"rows": [9]}, {"rows": [-1, 8]}, {"at_bounds": [3]}, {"upper": np.ones(2, bool)},
        {"x": np.ones(2)}, {"weights": np.ones(2)}, {"count": 7}, {"count": 12},
        {"signs": np.ones((3, 2))}, {"contacts": [2]}, {"own_signs": np.ones(3)},
        {"motion": np.ones(6)},
    ],
    ids=str,
)  # fmt: skip
def test_an_optimum_of_other_programs_is_refused(changes) -> None:
    assert compiled.optimum_starts is not None
    compiled.optimum_starts.Start(*start_arguments())
    with pytest.raises(ValueError):
        compiled.optimum_starts.Start(*start_arguments(**changes))


@pytest.mark.parametrize("seed", range(12))
@pytest.mark.parametrize("force", [0.0, 1.0, 50.0])
@pytest.mark.parametrize("turn", [0.0, 1.0, 50.0])
@pytest.mark.parametrize("count", [1, 3])
def test_scales_are_alike(seed, force, turn, count, by_numpy) -> None:
    """Of loads that are mostly a force, mostly a moment, neither, and at one point."""
    rng = np.random.default_rng(seed)
    positions, jacobian = rng.normal(size=(count, 3)), rng.normal(size=(3 * count, 3))
    jacobian[:, 1] *= rng.choice([0.0, 1e-14, 1.0])
    wrench = rng.normal(size=6) * np.repeat([force, turn], 3)
    limits = rng.uniform(1.0, 5.0, count)
    for levers in (jacobian, 0.0 * jacobian):
        ours, theirs = (
            one(lambda j=levers: scales_of(positions, wrench, j, limits))
            for one in (lambda call: call(), by_numpy)
        )
        for mine, other in zip(ours, theirs, strict=True):
            same(mine, other)
    if count == 1 and force and turn:
        moment = wrench[3:] - np.cross(positions[0], wrench[:3])
        size = np.linalg.norm(moment) / np.linalg.norm(wrench[:3])
        assert ours.length == pytest.approx(size)
