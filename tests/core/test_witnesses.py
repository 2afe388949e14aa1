"""Motions that damped least squares find slide as they are asked to, whatever the rank."""

from __future__ import annotations

from functools import cache
from pathlib import Path

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from graspless_pin import QuasistaticProblem, load_scene
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.modes.kinematics import VirtualKinematics
from graspless_pin.modes.witness_heuristics import CLEARLY
from graspless_pin.programs.objectives import Margin

EXAMPLES = Path(__file__).parents[2] / "examples"
NAMES = (
    "paper/cuboid_at_rest", "paper/cuboid_sliding_up", "paper/sphere_on_slope",
    "allegro_box_on_slope", "trihand_push_box", "two_hands_slide_crate",
)  # fmt: skip
MARGIN = Margin()


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


def assert_slides(
    kinematics: VirtualKinematics, contacts: tuple[int, ...], signs: np.ndarray, motion: np.ndarray
) -> None:
    """The contacts touch, and each slides clearly with its signs."""
    velocities, every = kinematics.rows[list(contacts)] @ motion, kinematics.rows @ motion
    assert np.abs(velocities[:, 0]).max() <= 1.01e-8 * np.linalg.norm(every)
    slowest = (velocities[:, 1:].ravel() * signs).min()
    assert slowest >= 0.99 * CLEARLY * kinematics.threshold * np.linalg.norm(every)


@settings(max_examples=40)
@given(name=st.sampled_from(NAMES), seed=st.integers(0, 5), kind=st.integers(0, 1000))
def test_motions_near_another_one_slide_with_the_signs(name, seed, kind) -> None:
    problem, rng = fresh(name, seed), np.random.default_rng(kind)
    kinematics = formulate(problem, MARGIN).kinematics
    count = rng.integers(1, 1 + min(3, problem.contact_count))
    contacts = tuple(sorted(rng.permutation(problem.contact_count)[:count].tolist()))
    near = rng.normal(size=kinematics.rows.shape[2])
    signs = rng.choice([1, -1, 0], 2 * count, p=[0.48, 0.48, 0.04]).astype(np.int8)
    found = kinematics.nearest.witness_near(contacts, signs.reshape(-1, 2), near)
    if found is not None:
        assert signs.all()
        assert_slides(kinematics, contacts, signs, found)


@settings(max_examples=80)
@given(name=st.sampled_from(NAMES), seed=st.integers(0, 5), kind=st.integers(0, 1000))
def test_guessed_motions_slide_with_the_signs(name, seed, kind) -> None:
    rng, problem = np.random.default_rng(kind), fresh(name, seed)
    count = rng.integers(1, 1 + problem.contact_count)
    contacts = tuple(sorted(rng.permutation(problem.contact_count)[:count].tolist()))
    kinematics = formulate(problem, MARGIN).kinematics
    # Signs that a motion has, but for some that are turned or left open.
    signs = np.sign(kinematics.nearest._motions(contacts)[: 2 * count] @ rng.normal(size=2 * count))
    signs *= rng.choice([1.0, -1.0, 0.0], len(signs), p=[0.85, 0.03, 0.12])
    near = (None, np.zeros(3), rng.normal(size=kinematics.rows.shape[2]))[kind % 3]
    found = kinematics.nearest.guessed_witness(contacts, signs, near)
    if found is not None:
        assert (found[0] * signs >= 0.0).all() and found[0].all()
        assert_slides(kinematics, contacts, *found)
