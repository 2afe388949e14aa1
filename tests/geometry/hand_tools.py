"""Small URDFs, random hands and finite differences for the tests of hands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import invert, pose_matrix

GRAVITY = np.array([0.4, -1.1, -9.8])


def random_pose(rng):
    return pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())


def random_q(hand: Hand, rng):
    """A position inside the limits for every independent joint."""
    lower, upper = hand.tree.ranges
    lower, upper = np.maximum(lower, -3.0), np.minimum(upper, 3.0)
    margin = 1e-3 * (upper - lower)
    values = rng.uniform(lower + margin, upper - margin)
    names = [hand.joint_names[index] for index in hand.tree.coupling.leaders]
    return dict(zip(names, values.tolist(), strict=True))


def difference_jacobian(hand: Hand, joints, links, points, step=1e-6):
    """Central differences of link-fixed points by the joints' positions, through pose_of."""
    local = [
        (invert(hand.pose_of(link)) @ [*point, 1.0])
        for link, point in zip(links, points, strict=True)
    ]

    def moved(joint, change):
        at = hand.with_configuration({joint: hand.q[joint] + change})
        return np.concatenate(
            [(at.pose_of(link) @ p)[:3] for link, p in zip(links, local, strict=True)]
        )

    return np.column_stack([(moved(j, step) - moved(j, -step)) / (2 * step) for j in joints])


def sample_contacts(hand: Hand, rng, count=9):
    """Points near the origins of random links."""
    links = list(rng.choice(hand.link_names, count))
    points = np.array([hand.pose_of(name)[:3, 3] for name in links])
    return links, points + rng.uniform(-0.03, 0.03, (count, 3))


def rnea(hand: Hand, links, points, forces, gravity):
    """Torques of all joints that hold still while each point pushes with its force."""
    model = hand.tree.pinocchio_model.copy()
    data = model.createData()
    q = hand.tree.configuration(hand.positions)
    pin.forwardKinematics(model, data, q)
    external = [pin.Force.Zero() for _ in range(model.njoints)]
    for name, point, force in zip(links, points, forces, strict=True):
        joint_id = model.frames[model.getFrameId(name, pin.BODY)].parentJoint
        on_link = pin.Force(np.r_[-force, np.cross(point, -force)])
        external[joint_id] += data.oMi[joint_id].actInv(on_link)
    model.gravity.linear = np.asarray(gravity)
    zero = np.zeros(model.nv)
    return pin.rnea(model, data, q, zero, zero, external)


def write_urdf(folder: Path, body: str, name="robot.urdf", header="") -> Path:
    file = folder / name
    file.write_text(f'{header}<robot name="test">{body}</robot>')
    return file


def joint(
    name, parent, child, kind="revolute", limit='lower="-1" upper="1" effort="2"', extra="",
    origin='xyz="0.1 0.02 0" rpy="0.2 0 0.1"', axis="0 0.6 0.8",
):  # fmt: skip
    limits = f'<limit {limit} velocity="1"/>' if limit else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin {origin}/><axis xyz="{axis}"/>{limits}{extra}</joint>'
    )


def link(name: str, collision: str = "", mass: float | str = 0.0) -> str:
    inertial = (
        f'<inertial><origin xyz="0.03 0.01 0.02"/><mass value="{mass}"/>'
        '<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="1e-3"/></inertial>'
        if mass
        else ""
    )
    shape = f"<collision><geometry>{collision}</geometry></collision>" if collision else ""
    return f'<link name="{name}">{inertial}{shape}</link>'
