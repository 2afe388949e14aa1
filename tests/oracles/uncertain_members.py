"""Draw members of uncertain sets, and ask a linear program of its own whether each balances.

``make uncertain``: 10 000 members in each of 30 cases. A member is a scene that is changed itself:
its object's mass and centre of mass, gravity's direction, loads and friction; contacts and matrices
are made anew. The program shares no code with the package: forces are combinations of cone edges.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from graspless_pin import QuasistaticProblem, Scene, Uncertainty, load_scene
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene import Load

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
SCENES = (
    "paper/cuboid_at_rest", "paper/cuboid_sliding_up", "paper/sphere_on_slope",
    "allegro_mug_against_wall", "allegro_box_on_slope", "allegro_sphere_on_slope",
)  # fmt: skip
SETS: dict[str, dict[str, Any]] = {
    "mass and centre of mass": {"mass": 0.2, "center_of_mass": 0.01},
    "mass, centre and push": {"mass": 0.1, "center_of_mass": 0.004, "force": 0.1},
    "tilt and friction": {"tilt": 0.03, "friction": 0.1},
    "friction and mass": {"friction": 0.15, "mass": 0.1},
    "push and moment": {"force": (0.2, 0.1, 0.1), "moment": 0.003},
}
BALANCED = 1e-6
"""Of the load: what forces may leave unbalanced."""


def imbalance(
    problem: QuasistaticProblem, torques: FloatArray, added: FloatArray | None = None
) -> float:
    """Return how much of the load stays unbalanced at best, over the load.

    Args:
        problem: Contacts and load.
        torques: (L,) of the motors.
        added: (L, d) torques that may be added in any amount.
    """
    edges, contact = [], []
    for number in range(problem.contact_count):
        n, mu, (t1, t2) = (
            problem.normals[number],
            problem.friction[number],
            problem.tangents[number].T,
        )
        v = problem.sliding[number]
        if np.linalg.norm(v) > 0.0:
            found = [n - mu * v / np.linalg.norm(v)]
        elif mu == 0.0:
            found = [n]
        else:
            angles = 2.0 * np.pi * np.arange(problem.cone_edges) / problem.cone_edges
            found = [n + mu * (np.cos(a) * t1 + np.sin(a) * t2) for a in angles]
        edges += found
        contact += [number] * len(found)
    G = np.array(edges)
    places = np.array(contact)
    wrenches = np.hstack([G, np.cross(problem.positions[places], G)]).T
    joints = np.array(
        [problem.jacobian[3 * c : 3 * c + 3].T @ edge for c, edge in zip(contact, G, strict=True)]
    ).T.reshape(problem.joint_count, len(G))
    loaded = problem.jacobian.any(axis=0)
    force = float(np.linalg.norm(problem.external_wrench[:3]))
    length = float(np.ptp(problem.positions, axis=0).max())
    rows = np.vstack([wrenches, joints[loaded]])
    right = np.concatenate([-problem.external_wrench, (torques - problem.gravity_torques)[loaded]])
    sizes = np.concatenate([np.full(3, force), np.full(3 + int(loaded.sum()), force * length)])
    free = np.zeros((len(rows), 0))
    if added is not None:
        free = np.vstack([np.zeros((6, added.shape[1])), -added[loaded]])
    A = np.hstack([rows, free]) / sizes[:, None]
    b = right / sizes
    ones = np.ones((len(b), 1))
    most = np.zeros((problem.contact_count, A.shape[1] + 1))
    most[places, np.arange(len(places))] = 1.0
    answer = linprog(
        np.eye(A.shape[1] + 1)[-1],
        A_ub=np.vstack([np.hstack([A, -ones]), np.hstack([-A, -ones]), most]),
        b_ub=np.concatenate([b, -b, problem.max_normal_force]),
        bounds=[(0, None)] * len(G) + [(None, None)] * free.shape[1] + [(0, None)],
        method="highs",
    )
    assert answer.status == 0
    return float(answer.fun)


def yielding(problem: QuasistaticProblem) -> FloatArray:
    """Return (L, d) joint rates of motions in which no contact parts or slips against friction."""
    rows = []
    for number in range(problem.contact_count):
        x, y, z = problem.positions[number]
        cross = np.array([[0, -z, y], [z, 0, -x], [-y, x, 0]])
        J = problem.jacobian[3 * number : 3 * number + 3]
        relative = np.hstack([np.eye(3), -cross, -J])
        slides = problem.sliding[number].any() or problem.friction[number] == 0.0
        rows += [problem.normals[number][None] @ relative] if slides else [relative]
    _, sizes, motions = np.linalg.svd(np.vstack(rows))
    rank = int((sizes > 1e-9 * sizes[0]).sum())
    return motions[rank:, 6:].T


def drawn_scene(
    scene: Scene, given: dict[str, Any], rng: np.random.Generator, edge: float
) -> Scene:
    """Return a scene that is somewhere in a set, or with ``edge`` 1 often on its border."""

    def share(size: Any = None) -> Any:
        values = rng.uniform(-1.0, 1.0, size)
        return np.where(rng.random(size) < edge, np.sign(values), values)

    made = scene.object
    center = made.center_of_mass + np.broadcast_to(given.get("center_of_mass", 0.0), 3) * share(3)
    mass = made.mass * (1.0 + given.get("mass", 0.0) * float(share()))
    tilt = given.get("tilt", 0.0) * abs(float(share()))
    across = np.cross(scene.gravity, rng.normal(size=3))
    turn = Rotation.from_rotvec(tilt * across / np.linalg.norm(across))
    push = np.broadcast_to(given.get("force", 0.0), 3) * share(3)
    moment = np.broadcast_to(given.get("moment", 0.0), 3) * share(3)
    loads = (
        [*scene.loads, Load("drawn", push, moment)] if push.any() or moment.any() else scene.loads
    )
    return scene.with_changes(
        object=replace(made, mass=mass, center_of_mass=center, inertia=np.eye(3) * 1e-3),
        gravity=turn.apply(scene.gravity),
        loads=loads,
    )


def drawn_problem(
    scene: Scene, given: dict[str, Any], rng: np.random.Generator, edge: float = 0.3
) -> QuasistaticProblem:
    """Return the problem of a scene somewhere in a set; each contact has its own friction."""
    problem = drawn_scene(scene, given, rng, edge).problem()
    off = given.get("friction", 0.0) * rng.uniform(-1.0, 1.0, problem.contact_count)
    return problem.with_changes(friction=problem.friction * (1.0 + off))


def unbalanced(
    scene: Scene,
    given: dict[str, Any],
    found: RobustSolution,
    count: int,
    seed: int,
    added: FloatArray | None = None,
) -> Iterator[float]:
    """Yield the imbalance of members under robust torques."""
    rng = np.random.default_rng(seed)
    for _ in range(count):
        yield imbalance(drawn_problem(scene, given, rng), found.torques, added)


def main() -> int:
    """Print a row for each case; exit with 1 where a member of a proven set does not balance."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=10_000)
    options = parser.parse_args()
    wrong = 0
    for name in SCENES:
        scene = load_scene(EXAMPLES / f"{name}.yaml")
        for told, given in SETS.items():
            found = scene.solve(
                "torque", margin=0.02, uncertainty=Uncertainty(**given), static_friction="coulomb"
            )
            added, how = None, "constant"
            if not found.found:
                print(f"{name}, {told}: no constant torques ({len(found.conflict)} conflict)")
                found = scene.solve(
                    "torque", margin=0.02, uncertainty=Uncertainty(**given),
                    static_friction="coulomb", feedback=1.0,
                )  # fmt: skip
                added, how = yielding(scene.problem()), "feedback"
                if not found.found:
                    print(f"{name}, {told}: none with feedback")
                    continue
            off = np.array(list(unbalanced(scene, given, found, options.count, 1, added)))
            bad = int((off > BALANCED).sum())
            print(
                f"{name}, {told}: {bad} of {len(off)} unbalanced, {how}, {found.coverage}",
                flush=True,
            )
            wrong += bad if found.coverage is Coverage.WHOLE_SET else 0
    return int(wrong > 0)


if __name__ == "__main__":
    sys.exit(main())
