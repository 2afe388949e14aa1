"""Small motions by surfaces' curvature, against moved scenes, meshes and hand-solved cases."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh
from scene_tools import EXAMPLES, loaded
from scipy.linalg import null_space
from scipy.spatial.transform import Rotation
from test_minimum_stiffness import G, ball, standing

from graspless_pin import MinimumStiffness, Scene, load_scene, minimum_stiffness
from graspless_pin.errors import SceneError
from graspless_pin.geometry.posing.finger_joints import hand_with_moved_actuators
from graspless_pin.scene import Acceleration, Load

STEP = 1e-5


def moved(scene: Scene, change: np.ndarray) -> Scene:
    """The scene with object and actuators moved by (6 + L,) m and rad."""
    T = np.array(scene.object.T_world_object)
    T[:3, :3] = Rotation.from_rotvec(change[3:6]).as_matrix() @ T[:3, :3]
    center = scene.object.center_of_mass_world + change[:3]
    T[:3, 3] = center - T[:3, :3] @ scene.object.center_of_mass
    hand = None if scene.hand is None else hand_with_moved_actuators(scene.hand, change[6:])
    return scene.with_changes(object=scene.object.with_pose(T), hand=hand)


def load_on_motions(scene: Scene, torques: np.ndarray, forces: np.ndarray) -> np.ndarray:
    """Q + G^T f with forces fixed in the world; without friction they turn with the normals."""
    problem = scene.problem()
    sizes = np.linalg.norm(forces, axis=1, keepdims=True)
    acting = np.where(problem.has_cone[:, None], forces, sizes * problem.normals)
    wrench = problem.external_wrench + problem.W @ acting.ravel()
    return np.r_[wrench, torques - problem.gravity_torques - problem.jacobian.T @ acting.ravel()]


def growth_of_moved_scenes(scene: Scene, torques: np.ndarray, found: MinimumStiffness) -> float:
    """The rate by differences of contacts found anew a little aside, under the same forces."""
    scene = scene.with_changes(motion=None)
    problem, hand = scene.problem(), scene.hand
    count = problem.joint_count
    kept = np.arange(6)
    if hand is not None:
        touching = [hand.tree.link_joints[link] for link in {*scene.contacts.bodies}
                    if link in hand.tree.link_joints]  # fmt: skip
        joints = hand.tree.supports[touching].any(axis=0)
        kept = np.r_[kept, 6 + np.flatnonzero(hand.actuation.from_joints[joints].any(axis=0))]
    rows = np.hstack([problem.W.T, -problem.jacobian]).reshape(-1, 3, 6 + count)
    rows = np.einsum("mji,mjk->mik", problem.frames, rows)
    still = np.ones((len(rows), 3), dtype=bool)
    still[:, 1:] = problem.has_cone[:, None]
    scale = np.r_[np.full(3, 0.05), np.ones(3 + count)][kept]
    basis = scale[:, None] * null_space(rows[still][:, kept] * scale, rcond=1e-6)
    N = np.zeros((6 + count, basis.shape[1]))
    N[kept] = basis
    K = np.zeros((N.shape[1],) * 2)
    for column, motion in enumerate(N.T):
        there, back = (
            load_on_motions(moved(scene, side * motion), torques, found.forces)
            for side in (STEP, -STEP)
        )
        K[:, column] = N.T @ (back - there) / (2.0 * STEP)
    M = np.zeros((6 + count, 6 + count))
    M[:6, :6] = problem.object_inertia
    if problem.joint_inertia is not None:
        M[6:, 6:] = problem.joint_inertia + found.armature * np.eye(count)
    damping = found.damping * N[6:].T @ N[6:]
    back = -np.linalg.solve(N.T @ M @ N, np.hstack([K, damping]))
    system = np.vstack([np.eye(len(K), 2 * len(K), len(K)), back])
    return float(np.linalg.eigvals(system).real.max())


def capsule(radius: float, length: float) -> dict[str, object]:
    return {"type": "capsule", "radius": radius, "length": length}


def lying(shape: dict[str, object]) -> dict[str, object]:
    return {"shape": shape, "pose": {"rpy": [np.pi / 2, 0, 0.0]}}


CURVED: dict[str, Callable[[Path], Scene]] = {
    "a box under two fingertips": lambda _: load_scene(EXAMPLES / "allegro_box_on_slope.yaml"),
    "a ball under two fingertips": lambda _: load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml"),
    "two hands": lambda _: load_scene(EXAMPLES / "two_hands_slide_crate.yaml"),
    "a ball on a capsule": lambda folder: standing(
        folder, ball(0.05), 0.13, lying(capsule(0.08, 0.3))
    ),
    "a ball on a cone's tip": lambda folder: standing(
        folder, ball(0.05), 0.15, {"shape": {"type": "cone", "radius": 0.2, "length": 0.2}}
    ),
    "a capsule across a cylinder": lambda folder: standing(
        folder, {}, 0.0, lying({"type": "cylinder", "radius": 0.015, "length": 0.3}),
        object={"shape": capsule(0.02, 0.2), "mass": 0.5,
                "pose": {"position": [0, 0, 0.035], "rpy": [0, np.pi / 2, 0]}},
    ),
}  # fmt: skip


def test_loads_off_the_centre_of_mass_count_in_small_motions() -> None:
    """What hangs on the ball, or turns with it, while all accelerates."""
    still = load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml")
    at = [0.0, 0.0, 0.04]
    for loads in (
        [Load("weight", mass=0.1, at=at)],
        [Load("cable", force=[0.2, 0.0, 0.5], at=at)],
        [Load("tool", force=[0.0, 0.3, -0.5], moment=[0.0, 1e-3, 0.0], at=at, axes="object")],
    ):
        scene = still.with_changes(loads=loads, acceleration=Acceleration(linear=[0.0, 0.0, 1.0]))
        torques = scene.solve("margin").torques
        found = minimum_stiffness(scene, torques)
        expected = growth_of_moved_scenes(scene, torques, found)
        assert found.growth == pytest.approx(expected, rel=1e-3)
        # The same forces on the same hand, but for the loads' levers.
        plain = growth_of_moved_scenes(still, still.solve("margin").torques, found)
        assert abs(plain / expected - 1.0) > 0.01


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", CURVED)
def test_growth_is_that_of_contacts_found_anew_aside(name: str, tmp_path: Path) -> None:
    scene = CURVED[name](tmp_path)
    torques = scene.solve("margin").torques
    found = minimum_stiffness(scene, torques)
    expected = growth_of_moved_scenes(scene, torques, found)
    assert found.growth == pytest.approx(expected, rel=1e-3)
    assert found.growth > 0.5


def between_balls(folder: Path, squeeze: float) -> Scene:
    """A ball of 5 cm, without friction or weight, between two fixed ones of 20 cm."""
    return loaded(
        folder,
        {
            "gravity": [0, 0, 0],
            "friction": 0.0,
            "max_normal_force": squeeze,
            "object": {"shape": ball(0.05), "mass": 0.5},
            "supports": [
                {"name": name, "shape": ball(0.2), "pose": {"position": [0, 0, z]}}
                for name, z in (("below", -0.25), ("above", 0.25))
            ],
        },
    )


@pytest.mark.parametrize("squeeze", [10.0, 40.0])
def test_forces_that_nothing_determines_count_as_the_worst(squeeze: float, tmp_path: Path) -> None:
    """Aside by x both normals lean by x / (R + r): 2 f x / (R + r) drives it out."""
    found = minimum_stiffness(between_balls(tmp_path, squeeze), [])
    assert found.growth == pytest.approx(np.sqrt(2.0 * squeeze / 0.25 / 0.5), rel=1e-5)
    np.testing.assert_allclose(np.abs(found.forces[:, 2]), squeeze, rtol=1e-6)
    assert found.motion is not None
    np.testing.assert_allclose(found.motion[2:], 0.0, atol=1e-6)


def test_what_some_forces_drive_and_others_leave_may_fail(tmp_path: Path) -> None:
    """Without a squeeze nothing drives the ball out."""
    said = between_balls(tmp_path, 40.0).stability([])
    assert said.status == "strong" and said.holding == "may_fail"
    small = said.small_motions
    assert small is not None and small.least_growth == 0.0 < small.growth
    assert str(said).startswith(
        "may fail: torques leave contact forces open, and under some of them the object shifts"
    )


def on_mesh(folder: Path, mesh: trimesh.Trimesh, height: float) -> Scene:
    mesh.export(folder / "below.stl")
    return standing(folder, ball(0.05), height, {"shape": {"type": "mesh", "path": "below.stl"}})


def turned_icosphere() -> trimesh.Trimesh:
    """A ball of 20 cm with a facet on top."""
    mesh = trimesh.creation.icosphere(subdivisions=4, radius=0.2)
    top = mesh.face_normals[np.argmax(mesh.face_normals[:, 2])]
    mesh.apply_transform(trimesh.geometry.align_vectors(top, [0, 0, 1]))
    return mesh


def test_a_surface_is_fitted_to_the_facets_of_a_fine_mesh(tmp_path: Path) -> None:
    """The facet itself is flat, and a ball on it just rolls; what it stands for is a sphere."""
    mesh = turned_icosphere()
    height = float(mesh.vertices[:, 2].max()) + 0.05
    found = minimum_stiffness(on_mesh(tmp_path, mesh, height), [])
    assert found.growth_by_surface["facets"] == 0.0
    expected = np.sqrt(5 * G / (7 * 0.25))
    assert found.growth_by_surface["fitted"] == pytest.approx(expected, rel=0.03)
    assert found.growth == found.growth_by_surface["fitted"]


def test_a_corner_of_a_coarse_mesh_is_a_corner(tmp_path: Path) -> None:
    """The ball turns about it: m (r^2 + 2/5 r^2) a'' = m g r a."""
    mesh = trimesh.creation.cone(radius=0.1, height=0.1, sections=4)
    height = float(mesh.vertices[:, 2].max()) + 0.05
    found = minimum_stiffness(on_mesh(tmp_path, mesh, height), [])
    assert set(found.growth_by_surface.values()) == {found.growth}
    assert found.growth == pytest.approx(np.sqrt(G / (1.4 * 0.05)), rel=1e-5)


def test_a_flat_face_with_vertices_in_it_is_flat(tmp_path: Path) -> None:
    """Rounding lifts them out of it by less than makes an edge."""
    mesh = trimesh.creation.box((0.4, 0.4, 0.2)).subdivide().subdivide()
    inside = (np.abs(mesh.vertices[:, :2]) < 0.19).all(axis=1) & (mesh.vertices[:, 2] > 0.09)
    mesh.vertices[inside, 2] += 1e-8 * (1.0 - (mesh.vertices[inside, :2] ** 2).sum(axis=1))
    found = minimum_stiffness(on_mesh(tmp_path, mesh, 0.15), [])
    assert set(found.growth_by_surface.values()) <= {0.0} and found.growth == 0.0


def test_a_box_and_its_mesh_are_one(tmp_path: Path) -> None:
    cylinder = lying({"type": "cylinder", "radius": 0.1, "length": 0.1})
    trimesh.creation.box((0.4, 0.2, 0.3)).export(tmp_path / "board.stl")
    shapes = {"type": "box", "size": [0.4, 0.2, 0.3]}, {"type": "mesh", "path": "board.stl"}
    box, mesh = (
        minimum_stiffness(standing(tmp_path, shape, 0.25, cylinder), []) for shape in shapes
    )
    assert box.growth == pytest.approx(mesh.growth, rel=1e-6) and box.growth > 1.0
    assert not box.growth_by_surface and set(mesh.growth_by_surface) == {"facets", "fitted"}


def test_a_contact_that_stands_for_a_line_is_refused(tmp_path: Path) -> None:
    """A coin on its edge: the two ends of the line are nearer than contacts are told apart."""
    coin = {"type": "cylinder", "radius": 0.01, "length": 8e-4}
    scene = standing(
        tmp_path, {}, 0.0, {"shape": {"type": "half_space"}},
        object={"shape": coin, "mass": 0.01,
                "pose": {"position": [0, 0, 0.01], "rpy": [np.pi / 2, 0, 0]}},
    )  # fmt: skip
    with pytest.raises(SceneError, match="one contact represents a line or a face on 'below'"):
        minimum_stiffness(scene, [])
