"""The tiny random scenes that the analyses are compared on with brute force."""

from __future__ import annotations

from itertools import product
from typing import TypedDict

import numpy as np
from scipy.spatial.transform import Rotation
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import SIGN_RULES, SLIDING_RULES, random_problem, structured_arguments

from graspless_pin import QuasistaticProblem, load_scene

PAIRS = tuple(product(SIGN_RULES, SLIDING_RULES))

# (family, seed, contacts): 26 of 2 to 4 contacts.
SCENES = (
    *(("general", seed, 2 + seed % 2) for seed in range(4)),
    *(("slope", seed, 3 + (seed % 5 == 1)) for seed in range(8)),
    *(("random", seed, 2 + seed % 2) for seed in range(6)),
    *(("structured", seed, 3) for seed in range(4)),
    *(("squeezed", seed, 2 + seed % 2) for seed in range(4)),
)


class PairOptions(TypedDict):
    """A rule pair as options."""

    sign_rule: str
    sliding_rule: str


def rules_of(pair: tuple[str, str]) -> PairOptions:
    """A rule pair as options."""
    return {"sign_rule": pair[0], "sliding_rule": pair[1]}


def options_of(index: int) -> PairOptions:
    """The rule pair of the scene with this index: each in turn, one later after each round.

    The families alternate sliding and resting scenes; so each pair meets both.
    """
    return rules_of(PAIRS[(index + index // len(PAIRS)) % len(PAIRS)])


def scene_of(family: str, seed: int, contacts: int) -> QuasistaticProblem:
    """The scene of an entry of `SCENES`."""
    if family == "general":
        return general_scene(seed, contacts, joints=(1, 2), cone_edges=5)
    if family == "slope":
        return slope_scene(seed, contacts, cone_edges=4)
    if family == "random":
        return random_problem(seed, contacts, slides=seed % 2)
    if family == "structured":
        kind = ("slab", "pinch", "planar")[seed % 3]
        return QuasistaticProblem(**structured_arguments(seed, kind, contacts, slides=seed % 2))
    return squeezed_scene(seed, contacts)


def squeezed_scene(seed: int, contacts: int) -> QuasistaticProblem:
    """Two opposed fingers whose joints feel nothing of how hard they squeeze, and supports.

    For even seeds both fingers are position-controlled (no column); for odd ones each has one
    joint that moves along the first tangent. The fingers of every third scene are tilted, so that
    squeezing them takes friction.

    Args:
        seed: Of the random numbers.
        contacts: M >= 2; all but two are supports below.
    """
    rng = np.random.default_rng([3, seed, contacts])
    tilt = 0.15 if seed % 3 == 2 else 0.0
    normals = np.tile([0.0, 0.0, 1.0], (contacts, 1))
    normals[0] = [np.sin(tilt), np.cos(tilt), 0.0]
    normals[1] = [np.sin(tilt), -np.cos(tilt), 0.0]
    positions = np.column_stack([rng.uniform(-0.08, 0.08, (contacts, 2)), -0.1 * np.ones(contacts)])
    positions[:2] = [[0.0, -0.1, 0.0], [0.0, 0.1, 0.0]]
    first = np.cross(normals, [1.0, 0.0, 0.0])
    first /= np.linalg.norm(first, axis=1, keepdims=True)
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    friction = rng.uniform(0.4, 0.8, contacts)
    share = rng.uniform(-0.4, 0.4, (contacts, 2)) * friction[:, None]
    forces = rng.uniform(2.0, 8.0, (contacts, 1)) * (
        normals + np.einsum("lij,lj->li", tangents, share)
    )
    moment = np.cross(positions, forces).sum(axis=0)
    columns = 2 * (seed % 2)
    jacobian = np.zeros((contacts, 3, columns))
    for joint in range(columns):
        jacobian[joint, :, joint] = 0.1 * tangents[joint, :, 0]
    R = Rotation.random(rng=rng).as_matrix()
    return QuasistaticProblem(
        positions @ R.T,
        normals @ R.T,
        -np.concatenate([R @ forces.sum(axis=0), R @ moment]),
        (R @ jacobian).reshape(3 * contacts, columns),
        friction=friction,
        tangents=R @ tangents,
        max_normal_force=20.0,
        cone_edges=4,
    )


def contacts_alone(name: str) -> QuasistaticProblem:
    """The problem of an example with coarse cones, whose hand weighs nothing."""
    problem = load_scene(f"examples/{name}.yaml").problem()
    return problem.with_changes(cone_edges=8, gravity_torques=np.zeros(problem.joint_count))
