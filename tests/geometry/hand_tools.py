"""Small URDFs, random hands and finite differences for the tests of hands."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.hand import Hand
from graspless_pin.geometry.poses import invert, pose_matrix

GRAVITY = np.array([0.4, -1.1, -9.8])


def random_pose(rng):
    return pose_matrix(rng.uniform(-1, 1, 3), Rotation.random(rng=rng).as_matrix())


def random_q(hand: Hand, rng):
    """A position inside the limits for every independent joint."""
    q = {}
    for index in hand.tree.coupling.leaders:
        lower = max(hand.tree.lower[index], -3.0)
        upper = min(hand.tree.upper[index], 3.0)
        q[hand.joint_names[index]] = rng.uniform(lower + 1e-4, upper - 1e-4)
    return q


def difference_jacobian(hand: Hand, joints, links, points, step=1e-6):
    """Central differences of link-fixed points by the joints' positions, through link_pose."""
    local = [
        (invert(hand.link_pose(link)) @ [*point, 1.0])
        for link, point in zip(links, points, strict=True)
    ]

    def moved(joint, change):
        at = hand.with_configuration({joint: hand.q[joint] + change})
        return np.concatenate(
            [(at.link_pose(link) @ p)[:3] for link, p in zip(links, local, strict=True)]
        )

    return np.column_stack([(moved(j, step) - moved(j, -step)) / (2 * step) for j in joints])


def write_urdf(folder: Path, body: str, name="robot.urdf", header="") -> Path:
    file = folder / name
    file.write_text(f'{header}<robot name="test">{body}</robot>')
    return file


def joint(name, parent, child, kind="revolute", limit='lower="-1" upper="1" effort="2"', extra=""):
    limits = f'<limit {limit} velocity="1"/>' if limit else ""
    return (
        f'<joint name="{name}" type="{kind}"><parent link="{parent}"/><child link="{child}"/>'
        f'<origin xyz="0.1 0.02 0" rpy="0.2 0 0.1"/><axis xyz="0 0.6 0.8"/>{limits}{extra}</joint>'
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
