"""The paper's matrices against hand-written small cases and identities; orders of wrenches."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import random_problem, scene

from graspless_pin import QuasistaticProblem
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.cones import projected_tangents
from graspless_pin.problem.matrices import force_first, moment_first

SEEDS = st.integers(0, 10_000)
RT10 = np.sqrt(10.0)


def table_with_slider() -> QuasistaticProblem:
    """Contact 0 rests on a table, contact 1 slides along +x, contact 2 is smooth; mu = 1/3."""
    return QuasistaticProblem(
        [[1.0, 2.0, 3.0], [-1.0, 0.0, 0.0], [0.0, 0.0, 4.0]],
        [[0.0, 0.0, 1.0], [0.0, 0.0, 1.0], [0.0, 0.0, -1.0]],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0],
        np.arange(9.0)[:, None],
        friction=[1.0 / 3.0, 1.0 / 3.0, 0.0],
        sliding=[[0.0, 0.0, 0.0], [0.2, 0.0, 0.0], [0.0, 0.0, 0.0]],
        cone_edges=4,
        tangents=[[[1, 0], [0, 1], [0, 0]], [[1, 0], [0, 1], [0, 0]], [[0, 1], [1, 0], [0, 0]]],
    )


def test_shapes():
    problem = table_with_slider()
    sizes = {"W": (6, 9), "C": (9, 6), "T": (9, 6), "N": (9, 3), "H": (9, 6), "J": (9, 1)}
    sizes |= {"D": (9, 9), "D_star": (6, 6)}
    for letter, shape in sizes.items():
        matrix = getattr(problem, letter)
        assert matrix.shape == shape, letter
        assert not matrix.flags.writeable, letter


def test_c_by_hand():
    C = table_with_slider().C
    cone = np.array([[1, 0, -1, 0], [0, 1, 0, -1], [3, 3, 3, 3]]) / RT10
    np.testing.assert_allclose(C[:3, :4], cone, atol=1e-15)
    # The object slides along +x over the table: friction on it points along -x.
    np.testing.assert_allclose(C[3:6, 4], np.array([-1.0, 0.0, 3.0]) / RT10, atol=1e-15)
    np.testing.assert_allclose(C[6:, 5], [0.0, 0.0, -1.0], atol=1e-15)
    blocks = np.zeros_like(C, dtype=bool)
    blocks[:3, :4] = blocks[3:6, 4] = blocks[6:, 5] = True
    assert not C[~blocks].any()


def test_h_by_hand():
    H = table_with_slider().H
    # The face through the edges (1, 0, 3) and (0, 1, 3) is 3x + 3y - z = 0.
    first = np.array([3.0, 3.0, -1.0]) / np.sqrt(19.0)
    np.testing.assert_allclose(H[:3, 0], first, atol=1e-15)
    np.testing.assert_allclose(H[:3, 2], first * [-1, -1, 1], atol=1e-15)
    assert not H[3:].any()


def test_t_n_d_and_j_by_hand():
    problem = table_with_slider()
    T = np.zeros((9, 6))
    T[0, 0] = T[1, 1] = T[3, 2] = T[4, 3] = T[7, 4] = T[6, 5] = 1.0
    np.testing.assert_array_equal(problem.T, T)
    N = np.zeros((9, 3))
    N[2, 0] = N[5, 1] = 1.0
    N[8, 2] = -1.0
    np.testing.assert_array_equal(problem.N, N)
    np.testing.assert_array_equal(problem.D, np.diag([0, 0, 0, 1, 1, 1, 0, 0, 0]))
    np.testing.assert_array_equal(problem.D_star, np.diag([0, 0, 0, 0, 1, 1]))
    np.testing.assert_array_equal(problem.J, np.arange(9.0)[:, None])
    assert problem.is_sliding.tolist() == [False, True, False]
    assert problem.has_cone.tolist() == [True, False, False]


@settings(max_examples=30)
@given(SEEDS)
def test_w_f_is_the_summed_wrench(seed):
    problem = random_problem(seed, 4)
    forces = np.random.default_rng(seed).normal(size=(4, 3))
    wrench = np.zeros(6)
    for point, force in zip(problem.positions, forces, strict=True):
        wrench[:3] += force
        wrench[3:] += [
            point[1] * force[2] - point[2] * force[1],
            point[2] * force[0] - point[0] * force[2],
            point[0] * force[1] - point[1] * force[0],
        ]
    np.testing.assert_allclose(problem.W @ forces.ravel(), wrench, atol=1e-12)


@settings(max_examples=30)
@given(SEEDS, st.integers(3, 12), st.floats(0.05, 2.0))
def test_edges_lie_on_the_coulomb_cone_and_faces_touch_their_edges(seed, edges, friction):
    base = random_problem(seed, 2)
    problem = QuasistaticProblem(
        base.positions, base.normals, base.external_wrench,
        friction=friction, tangents=base.tangents, cone_edges=edges,
    )  # fmt: skip
    for contact in range(2):
        rows, columns = (
            slice(3 * contact, 3 * contact + 3),
            slice(edges * contact, edges * contact + edges),
        )
        C, H = problem.C[rows, columns], problem.H[rows, columns]
        normal, tangents = problem.normals[contact], problem.tangents[contact]
        np.testing.assert_allclose(np.linalg.norm(C, axis=0), 1.0)
        np.testing.assert_allclose(np.linalg.norm(H, axis=0), 1.0)
        tangential = np.linalg.norm(tangents.T @ C, axis=0)
        np.testing.assert_allclose(tangential, friction * (normal @ C))
        # The first edge is along t1, the others follow towards t2 at equal angles.
        np.testing.assert_allclose(tangents.T @ C[:, 0] / tangential[0], [1.0, 0.0], atol=1e-12)
        angles = np.unwrap(np.arctan2(*(tangents.T @ C)[::-1]))
        np.testing.assert_allclose(np.diff(angles), 2.0 * np.pi / edges)
        # Face m holds the edges m and m + 1 and leaves every other edge, and n, on its inner side.
        product = H.T @ C
        for face in range(edges):
            touching = {face, (face + 1) % edges}
            np.testing.assert_allclose(product[face, list(touching)], 0.0, atol=1e-12)
            others = [edge for edge in range(edges) if edge not in touching]
            assert (product[face, others] < -1e-6).all()
        assert (H.T @ normal < 0.0).all()


@settings(max_examples=30)
@given(SEEDS)
def test_a_sliding_column_opposes_the_sliding_velocity(seed):
    problem = random_problem(seed, 3, slides=2)
    first = problem.cone_edges
    for column, contact in ((first, 1), (first + 1, 2)):
        force = problem.C[3 * contact : 3 * contact + 3, column]
        velocity = problem.sliding[contact]
        normal = problem.normals[contact]
        tangential = force - (normal @ force) * normal
        assert force @ velocity < 0.0
        assert tangential @ velocity == pytest.approx(
            -np.linalg.norm(tangential) * np.linalg.norm(velocity)
        )
        assert np.linalg.norm(tangential) == pytest.approx(
            problem.friction[contact] * (normal @ force)
        )


@settings(max_examples=30)
@given(SEEDS)
def test_default_tangents_follow_their_rule(seed):
    base = random_problem(seed, 4)
    problem = QuasistaticProblem(base.positions, base.normals, base.external_wrench, friction=0.3)
    for normal, frame in zip(problem.normals, problem.tangents, strict=True):
        axis = [1.0, 0.0, 0.0] if abs(normal[1]) > 0.99 else [0.0, 1.0, 0.0]
        first = np.cross(normal, axis) / np.linalg.norm(np.cross(normal, axis))
        np.testing.assert_allclose(frame[:, 0], first, atol=1e-12)
        np.testing.assert_allclose(frame[:, 1], np.cross(normal, first), atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_default_tangents_of_a_normal_along_y(sign):
    problem = QuasistaticProblem([[0, 0, 0]], [[0, sign, 0]], np.zeros(6), friction=0.3)
    np.testing.assert_allclose(problem.tangents[0], [[0, -1], [0, 0], [-sign, 0]])


def test_first_tangents_lie_along_the_first_axis_that_is_not_the_normal():
    axes = [np.array([0.0, 0.0, 2.0]), np.array([3.0, 3.0, 1.0])]
    up, aside = projected_tangents(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), axes)
    np.testing.assert_allclose(up[:, 0], np.array([1.0, 1.0, 0.0]) / np.sqrt(2.0), atol=1e-15)
    np.testing.assert_allclose(aside, [[0.0, 0.0], [0.0, -1.0], [1.0, 0.0]], atol=1e-15)


def test_the_spheres_default_tangents_are_the_printed_ones():
    printed = [
        [[-0.5, -0.612], [0.0, -0.707], [-0.866, 0.354]],
        [[-0.707, 0.0], [0.0, -1.0], [0.707, 0.0]],
        [[-0.5, 0.612], [0.0, -0.707], [-0.866, -0.354]],
    ]
    np.testing.assert_allclose(scene("sphere").tangents, printed, atol=1e-3)


def test_margin_of_by_hand():
    problem = QuasistaticProblem(
        [[0, 0, 0]], [[0, 0, 1]], np.zeros(6), friction=1.0, cone_edges=4, max_normal_force=10.0
    )
    # The faces are |x| + |y| <= z: a force along n is z / sqrt(3) away from each.
    assert problem.margin_of([[0, 0, 3.0]]) == pytest.approx(np.sqrt(3.0))
    assert problem.margin_of([[0, 0, 9.0]]) == pytest.approx(1.0)
    assert problem.margin_of([[1.0, 1.0, 3.0]]) == pytest.approx(1.0 / np.sqrt(3.0))
    assert problem.margin_of([[2.0, 2.0, 3.0]]) == pytest.approx(-1.0 / np.sqrt(3.0))


@settings(max_examples=60)
@given(SEEDS, st.integers(3, 9), st.integers(0, 1), st.integers(3, 33))
def test_margin_of_is_the_least_distance_to_any_face_or_limit(seed, contacts, slides, edges):
    problem = random_problem(seed, contacts, slides=slides)
    rng = np.random.default_rng(seed)
    friction = np.where(rng.random(contacts) < 0.2, 0.0, problem.friction)
    problem = problem.with_changes(friction=friction, cone_edges=edges)
    forces = rng.normal(scale=20.0, size=(contacts, 3))
    normal = np.einsum("ij,ij->i", problem.normals, forces)
    distances = [*normal, *(problem.max_normal_force - normal)]
    faces = problem.H.T @ forces.ravel()
    distances += (-faces[np.diag(problem.D_star) == 0.0]).tolist()
    assert problem.margin_of(forces) == pytest.approx(min(distances), abs=1e-9)


def test_each_order_of_wrenches_becomes_the_other():
    rows = np.arange(18.0).reshape(3, 6)
    for force_rows in (rows, rows[0]):
        moment_rows = moment_first(force_rows)
        np.testing.assert_array_equal(moment_rows, force_rows[..., [3, 4, 5, 0, 1, 2]])
        np.testing.assert_array_equal(force_first(moment_rows), force_rows)
        moment_rows[...] = 7.0
    np.testing.assert_array_equal(rows.ravel(), np.arange(18.0))  # is left alone


@pytest.mark.parametrize(
    ("wrench", "found"),
    [
        ([1.0, 2.0, 3.0], r"has shape \(3,\); expected \(6,\)"),
        (np.zeros((6, 5)), r"has shape \(6, 5\); expected \(any, 6\)"),
        (5.0, r"has shape \(\); expected"),
        ([[1.0] * 6, [1.0]], r".* it must be an array of real numbers"),
        ([0, 0, 0, 0, 0, float("nan")], r"is NaN at index \(5,\)"),
    ],
)
def test_what_is_no_wrench_is_refused(wrench, found):
    for convert in (moment_first, force_first):
        with pytest.raises(ArgumentError, match=f"wrench: {found}"):
            convert(wrench)
