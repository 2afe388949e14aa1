"""Which states of a published plan of contact points balance: `make published-plan CLONE=FOLDER`.

FOLDER is a clone of github.com/XianyiCheng/HiDex; nothing of it is in this repository. Of a task in
its folder ``data``, ``setup.yaml`` states a box, blocks around it, friction and weight, and each
row of ``output.csv`` is a state: six numbers for each finger, a point in the object's frame and the
normal into the object, and the object's pose. Lengths are read as metres. The contacts with the
blocks are not in the file: they are found. Each finger is the example's ``point_finger``.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from graspless_pin import Evaluator, Scene, load_scene
from graspless_pin.planning import EvaluatedStates
from graspless_pin.planning.edges import segment_twist
from graspless_pin.solution.tables import Table

FINGER = Path(__file__).resolve().parents[2] / "examples" / "robots" / "point_finger.urdf"
RADIUS = 0.001
NEAR = 0.01
"""What is nearer touches: the plan's poses are rounded to a few of its units in a thousand."""
AWAY = 50.0
"""Where a finger is that touches nothing."""


@dataclass(frozen=True, eq=False)
class Plan:
    """K states.

    Attributes:
        scene: The scene of the first one.
        q: (K, 3 F) positions of the fingers' joints.
        poses: (K, 4, 4) of the object.
    """

    scene: Scene
    q: NDArray[np.float64]
    poses: NDArray[np.float64]


def read_plan(task: Path) -> Plan:
    """Read the plan in a task's folder."""
    setup = yaml.safe_load((task / "setup.yaml").read_text(encoding="utf-8"))
    rows = np.loadtxt(task / "output.csv", delimiter=",", ndmin=2)
    poses = np.tile(np.eye(4), (len(rows), 1, 1))
    poses[:, :3, :3] = Rotation.from_quat(rows[:, -4:]).as_matrix()
    poses[:, :3, 3] = rows[:, -7:-4]
    contacts = rows[:, :-7].reshape(len(rows), -1, 6)
    middles = contacts[:, :, :3] - RADIUS * contacts[:, :, 3:]
    tips = np.einsum("kij,kfj->kfi", poses[:, :3, :3], middles) + poses[:, None, :3, 3]
    tips = np.where(np.isnan(tips), AWAY, tips)
    with TemporaryDirectory() as folder:
        file = Path(folder, "scene.yaml")
        file.write_text(yaml.safe_dump(_scene(setup, poses[0], tips[0])), encoding="utf-8")
        return Plan(load_scene(file), tips.reshape(len(rows), -1), poses)


def _scene(setup: dict[str, Any], pose: NDArray[np.float64], tips: Any) -> dict[str, Any]:
    """Return the scene file of a state."""
    weight = np.array(setup["object_weight"][:3], dtype=float)
    gravity = 9.81 * weight / np.linalg.norm(weight)
    mounts = [{"prefix": f"f{k}_", "urdf": str(FINGER)} for k in range(len(tips))]
    q = {
        f"f{k}_{axis}": float(tip[i]) for k, tip in enumerate(tips) for i, axis in enumerate("xyz")
    }
    return {
        "friction": {
            "hand": setup["robot_object_friction_coefficient"],
            "supports": setup["environment_object_friction_coefficient"],
        },
        "gravity": gravity.tolist(),
        "contact_tolerance": NEAR,
        "max_penetration": 5 * NEAR,
        "hand": {"mounts": mounts, "q": q, "control": "force", "count_own_weight": False},
        "object": {
            "shape": {"type": "box", "size": setup["box_object"]["shape"]},
            "mass": float(np.linalg.norm(weight)) / 9.81,
            "pose": {"position": pose[:3, 3].tolist(), "matrix": pose[:3, :3].tolist()},
        },
        "supports": [
            {
                "name": name,
                "shape": {"type": "box", "size": block["dimension"]},
                "pose": {"position": block["location"]},
            }
            for name, block in setup["environment"].items()
        ],
    }


def twists_of(plan: Plan, evaluator: Evaluator) -> NDArray[np.float64]:
    """(K, 6) towards the next state, without what would leave or enter the supports.

    Neighbouring states are far apart on curves: of the screw motion between them stays what keeps
    the contacts with the supports.
    """
    twists = np.zeros((len(plan.poses), 6))
    for k, T in enumerate(plan.poses):
        ends = (k, k + 1) if k + 1 < len(plan.poses) else (k - 1, k)
        center = plan.scene.object.center_of_mass
        whole = segment_twist(plan.poses[ends[0]], plan.poses[ends[1]], 1.0, center)
        found = evaluator.evaluate(plan.q[k], T).contacts.arrays
        normals = found.normals[found.hand_count :]
        arms = found.positions[found.hand_count :] - T[:3, 3]
        rates = np.hstack([normals, np.cross(arms, normals)])
        twists[k] = whole - np.linalg.pinv(rates) @ (rates @ whole)
    return twists


def judged(task: Path) -> tuple[EvaluatedStates, EvaluatedStates]:
    """Return what is found of a plan's states at rest, and moving along the plan."""
    plan = read_plan(task)
    evaluator = Evaluator(plan.scene)
    rest = evaluator.evaluate_many(plan.q, plan.poses, workers=1)
    twists = twists_of(plan, evaluator)
    return rest, evaluator.evaluate_many(plan.q, plan.poses, twists, workers=1)


def main() -> int:
    """Print a row for each state."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("clone", type=Path)
    parser.add_argument("task", nargs="?", default="corner_pivot")
    given = parser.parse_args()
    rest, moving = judged(given.clone / "data" / given.task)
    rows = [
        (k, count, one.name.lower(), margin, other.name.lower(), moved)
        for k, (count, one, margin, other, moved) in enumerate(
            zip(
                rest.contact_counts, rest.statuses, rest.margins, moving.statuses, moving.margins,
                strict=True,
            )
        )
    ]  # fmt: skip
    headers = ["state", "contacts", "at rest", "margin", "moving", "its margin"]
    print(Table(rows, headers, "margins in N", ".4f"))
    balanced = int(rest.found.sum())
    print(f"{balanced} of {len(rows)} states balance at rest, {moving.found.sum()} moving")
    return int(balanced < len(rows))


if __name__ == "__main__":
    sys.exit(main())
