"""Try hands of packages that install by name: their files are read, their code is not.

`make hands` downloads the packages without their dependencies into out/hands and holds each hand
against what shares no code with the readers: MuJoCo's kinematics and weight (MJCF) or yourdfpy's
kinematics (URDF), finite differences of the Jacobian, rnea, and brute force over the triangles of
the links' hulls for contacts with a ball and with plates on their largest faces.
"""

from __future__ import annotations

import sys
import warnings
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import trimesh
import yourdfpy
from tests.geometry.contact_tools import find_contacts
from tests.geometry.hand_tools import (
    GRAVITY,
    difference_jacobian,
    random_q,
    rnea,
    sample_contacts,
)

from graspless_pin import Hand
from graspless_pin.errors import GrasplessPinError, GrasplessPinWarning
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.poses import invert
from graspless_pin.simulation.protocol import load_mujoco

GRIPPERS = "robosuite/models/assets/grippers"
GYMNASIUM = "gymnasium_robotics/envs/assets"
HANDS = {
    "Shadow": f"{GYMNASIUM}/hand/reach.xml",
    "Adroit": f"{GYMNASIUM}/adroit_hand/adroit_relocate.xml",
    "Fetch": f"{GYMNASIUM}/fetch/reach.xml",
    "Fourier left": f"{GRIPPERS}/fourier_left_hand.xml",
    "Fourier right": f"{GRIPPERS}/fourier_right_hand.xml",
    "Inspire left": f"{GRIPPERS}/inspire_left_hand.xml",
    "Inspire right": f"{GRIPPERS}/inspire_right_hand.xml",
    "Panda": f"{GRIPPERS}/panda_gripper.xml",
    "Rethink": f"{GRIPPERS}/rethink_gripper.xml",
    "Robotiq 140": f"{GRIPPERS}/robotiq_gripper_140.xml",
    "Robotiq S": f"{GRIPPERS}/robotiq_gripper_s.xml",
    "Spot": f"{GRIPPERS}/bd_gripper.xml",
    "F5D6 left": "dexmate_urdf/robots/hands/f5d6_hand/f5d6_left.urdf",
    "F5D6 right": "dexmate_urdf/robots/hands/f5d6_hand/f5d6_right.urdf",
    "Dexmate gripper": "dexmate_urdf/robots/hands/dexs_gripper/dexs_gripper.urdf",
    "iCub mk3": "share/iCub/robots/left_hand_mk3/model.urdf",
}
_OFF, _TILT = 5e-6, 1e-4
"""How far off a surface a contact's point may be, m, and the normal of a ball's."""
RADIUS, GAP = 0.03, 2e-4
"""Of the ball that touches each link, m, and how far it is away."""
PLATE, _FACES = (1.0, 1.0, 0.01), 3
"""The plates that lie on so many faces of each link, m."""


class Checked(NamedTuple):
    """What one hand showed.

    Attributes:
        links: Of the hand.
        joints: Movable ones.
        poses: Largest difference of a link's pose, m and 1.
        jacobian: The same of the Jacobian, against finite differences.
        torques: Of the joints' torques, N m: rnea, and MuJoCo's weight for MJCF.
        contacts: Touches with balls and plates; with balls the largest difference of gaps, m,
            normals, and points, m; with plates how far points are off either surface, m.
    """

    links: int
    joints: int
    poses: float
    jacobian: float
    torques: float
    contacts: tuple[int, float, float, float, float]


def check_hand(path: Path, package_dirs: list[Path]) -> Checked:
    """Load one hand and hold it against the oracles."""
    rng = np.random.default_rng(5)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)
        hand = Hand.from_urdf(path, package_dirs=package_dirs, control="force")
    hand = hand.with_configuration(random_q(hand, rng))
    if path.suffix == ".xml":
        poses, weight = _against_mujoco(hand, path)
    else:
        poses, weight = _against_yourdfpy(hand, path), 0.0
    links, points = sample_contacts(hand, rng)
    J = hand.contact_jacobian(links, points)
    numeric = difference_jacobian(hand, hand.actuated_joint_names, links, points)
    forces = rng.uniform(-20.0, 20.0, (len(links), 3))
    tau = hand.tree.coupling.S.T @ rnea(hand, links, points, forces, GRAVITY)
    leaders = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    columns = [leaders.index(joint) for joint in hand.actuated_joint_names]
    torques = J.T @ forces.ravel() + hand.gravity_torques(GRAVITY)
    return Checked(
        len(hand.link_names), len(hand.joint_names), poses, float(np.abs(J - numeric).max()),
        max(weight, float(np.abs(torques - tau[columns]).max())), _touched(hand, rng),
    )  # fmt: skip


def agrees(seen: Checked) -> bool:
    """Return whether all oracles agree with a hand."""
    _, *contacts = seen.contacts
    gaps, normals, points, off = contacts
    worst = max(seen.poses, 1e-2 * seen.jacobian, seen.torques)
    return worst <= 1e-10 and max(gaps, points, off) <= _OFF and normals <= _TILT


def _against_mujoco(hand: Hand, path: Path) -> tuple[float, float]:
    mujoco = load_mujoco()
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    q = dict(zip(hand.joint_names, hand.positions, strict=True))
    for joint, value in q.items():
        data.joint(joint).qpos = value
    mujoco.mj_forward(model, data)

    def pose(body: str) -> np.ndarray:
        T = np.eye(4)
        T[:3, :3], T[:3, 3] = data.body(body).xmat.reshape(3, 3), data.body(body).xpos
        return T

    known = {model.body(index).name for index in range(model.nbody)}
    (root,) = (link for link, above in hand.tree.parent_links.items() if above is None)
    T_root_world = invert(pose(root))
    poses = [
        np.abs(hand.pose_of(link) - T_root_world @ pose(link)).max()
        for link in hand.link_names
        if link in known
    ]
    gravity = T_root_world[:3, :3] @ model.opt.gravity
    dofs = [int(model.joint(joint).dofadr[0]) for joint in hand.joint_names]
    weight = hand.tree.gravity_torques(hand.positions, gravity) - data.qfrc_bias[dofs]
    return float(max(poses)), float(np.abs(weight).max())


def _against_yourdfpy(hand: Hand, path: Path) -> float:
    other = yourdfpy.URDF.load(
        str(path), load_meshes=False, load_collision_meshes=False, build_collision_scene_graph=False
    )
    other.update_cfg({name: hand.q[name] for name in other.actuated_joint_names})
    return float(
        max(
            np.abs(hand.pose_of(link) - other.get_transform(link, other.base_link)).max()
            for link in hand.link_names
        )
    )


def _touched(hand: Hand, rng: np.random.Generator) -> tuple[int, float, float, float, float]:
    """Touch the hull of each link with a ball and plates, seen by triangles."""
    count, gaps, points, normals, off = 0, 0.0, 0.0, 0.0, 0.0
    for body in hand.collision_bodies():
        shape, T = body.geometry, np.array(body.T_world_geometry)
        if not hasattr(shape, "num_points"):
            continue
        corners = np.array([shape.point(index) for index in range(shape.num_points)])
        hull = trimesh.convex.convex_hull(corners @ T[:3, :3].T + T[:3, 3])
        away = rng.normal(size=3)
        start = hull.center_mass + hull.scale * away / np.linalg.norm(away)
        on_hull = _nearest(hull, start)
        outward = (start - on_hull) / np.linalg.norm(start - on_hull)
        T_ball = np.eye(4)
        T_ball[:3, 3] = on_hull + (RADIUS + GAP) * outward
        ball = CollisionBody("ball", coal.Sphere(RADIUS), T_ball)
        (found,) = find_contacts(ball, [body], [], tolerance=1e-3)
        count += 1
        gaps = max(gaps, abs(found.distance - GAP))
        midway = on_hull + 0.5 * GAP * outward
        points = max(points, float(np.linalg.norm(found.position - midway)))
        normals = max(normals, float(np.abs(found.normal - outward).max()))
        for face in np.argsort(hull.area_faces)[-_FACES:]:
            count += 1
            off = max(off, _off_surfaces(body, hull, hull.face_normals[face], rng))
    return count, gaps, normals, points, off


def _off_surfaces(
    body: CollisionBody, hull: trimesh.Trimesh, along: np.ndarray, rng: np.random.Generator
) -> float:
    """Lay a plate on a hull, tilted by a milliradian; tell how far points are off surfaces, m."""
    outward = along + 1e-3 * rng.normal(size=3)
    outward /= np.linalg.norm(outward)
    T = np.eye(4)
    T[:3, :3] = np.asarray(trimesh.geometry.align_vectors([0, 0, 1], outward))[:3, :3]
    above = float(((hull.vertices - hull.center_mass) @ outward).max())
    T[:3, 3] = hull.center_mass + (above + GAP + 0.5 * PLATE[2]) * outward
    plate = CollisionBody("plate", coal.Box(*PLATE), T)
    found = find_contacts(plate, [body], [], tolerance=2e-3)
    worst = 0.0 if found else np.inf
    for point in found:
        half = 0.5 * point.distance * point.normal
        on_hull, on_plate = point.position - half, point.position + half
        height = (on_plate - T[:3, 3]) @ T[:3, 2] + 0.5 * PLATE[2]
        miss = float(np.linalg.norm(_nearest(hull, on_hull) - on_hull))
        worst = max(worst, miss, abs(float(height)))
    return worst


def _nearest(hull: trimesh.Trimesh, point: np.ndarray) -> np.ndarray:
    """Return the nearest point of a hull: of all its triangles."""
    large = 1e4  # trimesh takes triangles of a square millimetre in metres for lines
    triangles = large * hull.triangles
    nearest = trimesh.triangles.closest_point(
        triangles, np.tile(large * point, (len(triangles), 1))
    )
    return nearest[np.argmin(np.linalg.norm(nearest - large * point, axis=1))] / large


def _short(values: Sequence[float]) -> str:
    return ", ".join(f"{value:.0e}" for value in values)


def main() -> None:
    """Check all hands of a folder of packages; exit code 1 where one disagrees or is missing."""
    folder, wrong = Path(sys.argv[1]), 0
    print(
        "hand: links, joints; differences of poses, Jacobian, torques; touches, differences of "
        "gaps, normals, points with balls, how far points on plates are off"
    )
    for name, inside in HANDS.items():
        path = folder / inside
        try:
            seen = check_hand(path, [folder, folder / "share"])
        except (GrasplessPinError, ValueError) as error:  # no position is within all limits
            wrong += 1
            print(f"{name}: {error}")
            continue
        touches, *contacts = seen.contacts
        wrong += not agrees(seen)
        figures = _short([seen.poses, seen.jacobian, seen.torques])
        print(f"{name}: {seen.links}, {seen.joints}; {figures}; {touches}, {_short(contacts)}")
    print(f"{len(HANDS)} hands, {wrong} of them wrong")
    sys.exit(wrong > 0)


if __name__ == "__main__":
    main()
