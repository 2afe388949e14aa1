"""Changes of description change nothing but what they must."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import (
    assert_holds,
    cuboid_arguments,
    random_arguments,
    sphere_arguments,
    structured_arguments,
)
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque

few = settings(max_examples=25)
EPSILON = 1e-2
"""A regularised optimum is unique in its forces, so forces and torques can be compared too."""


@st.composite
def problems(draw):
    """Arguments of a random problem, of any kind."""
    seed = draw(st.integers(0, 5000))
    kind = draw(st.sampled_from(["free", "slab", "pinch", "planar", "paper"]))
    if kind == "paper":
        return sphere_arguments() if seed % 2 else cuboid_arguments(seed % 3 - 1.0)
    slides = draw(st.integers(0, 1))
    if kind == "free":
        arguments = random_arguments(seed, 3, slides=slides)
    else:
        arguments = structured_arguments(seed, kind, 4, slides=slides)
    return arguments


vectors = st.tuples(*[st.floats(-1.0, 1.0)] * 3).map(np.array)
rotations = st.integers(0, 10_000).map(
    lambda seed: Rotation.random(rng=np.random.default_rng(seed)).as_matrix()
)


def solve_both(arguments, force_scale=1.0):
    """Algorithms 1 and 2 at a given margin, plain and regularised, checked against the letters."""
    problem = QuasistaticProblem(**arguments)
    solutions = [
        maximize_margin(problem),
        minimize_torque(problem, 0.2 * force_scale),
        maximize_margin(problem, regularization=EPSILON),
    ]
    for solution in solutions:
        if solution.found:
            assert_holds(solution, 1e-5 * max(1.0, force_scale))
    return solutions


def assert_same(one, two, *, factor=1.0, forces=None, torques=None):
    """Compare solutions; `factor` is that of all forces, `forces` and `torques` map `one`'s."""
    for before, after in zip(one, two, strict=True):
        assert before.status is after.status
    if one[0].found:
        assert two[0].margin == pytest.approx(factor * one[0].margin, rel=1e-5, abs=1e-6 * factor)
    if one[1].found:
        expected = pytest.approx(factor * one[1].max_torque, rel=1e-5, abs=1e-6 * factor)
        assert two[1].max_torque == expected
    if one[2].found and forces is not None:
        tolerance = 5e-3 * factor
        expected = forces(one[2].contact_forces)
        np.testing.assert_allclose(two[2].contact_forces, expected, atol=tolerance)
        expected = one[2].torques if torques is None else torques(one[2].torques)
        np.testing.assert_allclose(two[2].torques, expected, atol=tolerance)


def full(arguments):
    """The same arguments with every optional one written out, from the problem itself."""
    problem = QuasistaticProblem(**arguments)
    return {
        "positions": problem.positions,
        "normals": problem.normals,
        "external_wrench": problem.external_wrench,
        "jacobian": problem.jacobian,
        "friction": problem.friction,
        "tangents": problem.tangents,
        "sliding": problem.sliding,
        "torque_limits": (problem.lower_torque, problem.upper_torque),
        "max_normal_force": problem.max_normal_force,
        "cone_edges": problem.cone_edges,
        "gravity_torques": problem.gravity_torques,
    }


@few
@given(problems(), rotations, vectors)
def test_a_rigid_change_of_frame(arguments, rotation, shift):
    """All is turned, and moments are taken about the old origin seen from a new one."""
    old = full(arguments)
    force, moment = (rotation @ part for part in old["external_wrench"].reshape(2, 3))
    count = len(old["positions"])
    turned = old["jacobian"].reshape(count, 3, -1)
    new = {
        **old,
        "positions": old["positions"] @ rotation.T + shift,
        "normals": old["normals"] @ rotation.T,
        "external_wrench": np.concatenate([force, moment + np.cross(shift, force)]),
        "jacobian": np.einsum("ij,ljk->lik", rotation, turned).reshape(3 * count, -1),
        "tangents": np.einsum("ij,ljk->lik", rotation, old["tangents"]),
        "sliding": old["sliding"] @ rotation.T,
    }
    assert_same(solve_both(old), solve_both(new), forces=lambda f: f @ rotation.T)


@few
@given(problems(), vectors)
def test_another_reference_point(arguments, reference):
    old = full(arguments)
    force, moment = old["external_wrench"].reshape(2, 3)
    new = {
        **old,
        "positions": old["positions"] - reference,
        "external_wrench": np.concatenate([force, moment - np.cross(reference, force)]),
    }
    assert_same(solve_both(old), solve_both(new), forces=lambda f: f)


@few
@given(problems(), st.randoms(use_true_random=False))
def test_relabelled_contacts(arguments, random):
    old = full(arguments)
    count = len(old["positions"])
    order = list(range(count))
    random.shuffle(order)
    per_contact = ("positions", "normals", "friction", "tangents", "sliding", "max_normal_force")
    new = {**old, **{name: old[name][order] for name in per_contact}}
    new["jacobian"] = old["jacobian"].reshape(count, 3, -1)[order].reshape(3 * count, -1)
    assert_same(solve_both(old), solve_both(new), forces=lambda f: f[order])


@few
@given(problems(), st.randoms(use_true_random=False))
def test_permuted_joints(arguments, random):
    old = full(arguments)
    order = list(range(old["jacobian"].shape[1]))
    random.shuffle(order)
    new = {
        **old,
        "jacobian": old["jacobian"][:, order],
        "torque_limits": tuple(limit[order] for limit in old["torque_limits"]),
        "gravity_torques": old["gravity_torques"][order],
    }
    assert_same(
        solve_both(old), solve_both(new), forces=lambda f: f, torques=lambda tau: tau[order]
    )


@few
@given(problems(), st.sampled_from([1e-3, 0.1, 7.0, 1e3]))
def test_all_forces_scaled(arguments, scale):
    old = full(arguments)
    new = {
        **old,
        "external_wrench": scale * old["external_wrench"],
        "max_normal_force": scale * old["max_normal_force"],
        "torque_limits": tuple(scale * limit for limit in old["torque_limits"]),
        "gravity_torques": scale * old["gravity_torques"],
    }
    assert_same(
        solve_both(old),
        solve_both(new, scale),
        factor=scale,
        forces=lambda f: scale * f,
        torques=lambda tau: scale * tau,
    )


@few
@given(problems(), st.sampled_from([1e-3, 0.1, 10.0, 1e3]))
def test_all_lengths_scaled(arguments, scale):
    """In another unit of length, moments and torques are scaled and forces are not."""
    old = full(arguments)
    if (np.abs(old["jacobian"]).max(axis=0) > 0.9).any():
        return  # a hybrid finger's column is a direction, not a lever
    new = {
        **old,
        "positions": scale * old["positions"],
        "external_wrench": old["external_wrench"] * np.repeat([1.0, scale], 3),
        "jacobian": scale * old["jacobian"],
        "torque_limits": tuple(scale * limit for limit in old["torque_limits"]),
        "gravity_torques": scale * old["gravity_torques"],
    }
    one, two = (
        [maximize_margin(QuasistaticProblem(**a)), minimize_torque(QuasistaticProblem(**a), 0.2)]
        for a in (old, new)
    )
    assert [s.status for s in one] == [s.status for s in two]
    if one[0].found:
        assert two[0].margin == pytest.approx(one[0].margin, rel=1e-5, abs=1e-6)
    if one[1].found:
        expected = pytest.approx(scale * one[1].max_torque, rel=1e-5, abs=1e-6 * scale)
        assert two[1].max_torque == expected


@few
@given(problems())
def test_the_speed_of_sliding_does_not_matter(arguments):
    old = full(arguments)
    new = {**old, "sliding": 50.0 * old["sliding"]}
    assert_same(solve_both(old), solve_both(new), forces=lambda f: f)
