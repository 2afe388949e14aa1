"""What is true of a path, worked out without what planned it: each state anew, and by the checker.

Contacts, margin and forces of each state are found as for a scene of its own; the checker, which is
numpy alone, goes through the document of the answer; MuJoCo measures the distances.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin import Evaluator, Scene
from graspless_pin.errors import SceneError
from graspless_pin.planning.edges import ScrewMotion
from graspless_pin.problem.checks import FloatArray
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.simulation.model import OBJECT, simulation_model
from graspless_pin.simulation.protocol import load_mujoco

State = tuple[FloatArray, FloatArray]
"""(n,) positions of all joints that follow no others, rad or m, and (4, 4) the object's pose, m."""
AXES = np.array([0.0, 1.0, 0.0]), np.array([1.0, 0.0, 0.0])
"""Along which tangents of an object that moves with a link lie at its start."""
_ROUNDING = 1e-9
_NEAR = 0.05
"""m: distances are measured up to here."""


@dataclass(frozen=True)
class VerifiedPath:
    """What was found along a path.

    Attributes:
        states: Whose joints and distances were looked at.
        margins: (K,) of those that were solved, N; -inf: no torques hold the object, or nothing
            touches it.
        objections: What the checker says against answers, by the state's number.
        outside: States in which a joint is outside its limits.
        clearance: The least distance of bodies that shall not touch, m, no more than 0.05.
        closest: The two bodies.
    """

    states: int
    margins: FloatArray
    objections: tuple[str, ...]
    outside: int
    clearance: float
    closest: str

    @property
    def lost(self) -> int:
        """In how many states nothing holds the object."""
        return int(np.isneginf(self.margins).sum())

    @property
    def distance(self) -> str:
        """The least distance in words, mm."""
        return f"{1e3 * self.clearance:.1f} ({self.closest})" if self.closest else "above 50"

    def below(self, margin: float) -> int:
        """In how many states the margin is smaller, by more than a millionth of a newton."""
        return int((self.margins < margin - 1e-6).sum())


def between(one: State, other: State, center: FloatArray, step: tuple[float, float]) -> list[State]:
    """Return states between two, without the first, no farther apart than m and rad.

    Joints go linearly, the object along its screw motion.
    """
    (q0, T0), (q1, T1) = one, other
    screw = ScrewMotion.between(T0, T1, center)
    shares = np.append(np.array(screw.lengths) / step, np.abs(q1 - q0).max() / step[1])
    fractions = np.linspace(0.0, 1.0, 1 + max(1, int(np.ceil(shares.max()))))[1:]
    return [(q0 + s * (q1 - q0), screw.pose_and_twist(s)[0]) for s in fractions.tolist()]


def scene_in(scene: Scene, state: State, *, carried: bool) -> Scene:
    """Return a scene in a state.

    Args:
        scene: The scene, with a hand.
        state: Of it.
        carried: Whether friction pyramids turn with the object, as those of `attached_to` do.
    """
    q, T = state
    hand, evaluator, moved = scene.hand, Evaluator(scene), scene.object
    if hand is None:
        raise ValueError("the scene has no hand")
    named = dict(zip(evaluator.joint_names, np.clip(q, *evaluator.joint_limits), strict=True))
    turn = T[:3, :3] @ moved.T_world_object[:3, :3].T
    axes = [turn @ axis for axis in scene.tangent_axes or AXES] if carried else scene.tangent_axes
    return scene.with_changes(
        hand=hand.with_configuration(named), object=moved.with_pose(T), tangent_axes=axes
    )


def verified_path(
    scene: Scene, states: Sequence[State], *, carried: bool, every: int = 1
) -> VerifiedPath:
    """Look at states of a scene.

    Args:
        scene: See `scene_in`.
        states: Of it.
        carried: See `scene_in`.
        every: One state in so many is solved; joints and distances are looked at in all.
    """
    distances = Distances(scene, states[:: max(1, len(states) - 1)])
    lower, upper = Evaluator(scene).joint_limits
    margins, objections, outside = [], list[str](), 0
    nearest = _NEAR, ""
    for number, (q, T) in enumerate(states):
        outside += bool((q < lower - _ROUNDING).any() or (q > upper + _ROUNDING).any())
        nearest = min(nearest, distances.least(q, T))
        if number % every:
            continue
        there = scene_in(scene, (q, T), carried=carried)
        try:
            solution = there.solve("margin")
        except SceneError as error:  # the object is in something, or nothing touches it
            margins.append(-np.inf)
            objections.append(f"state {number}: {error}")
            continue
        margins.append(solution.margin if solution.found else -np.inf)
        checks = verify_document(solution_document(solution, there)).checks
        objections += [f"state {number}: {one}" for one in checks if one.passed is not True]
    return VerifiedPath(len(states), np.array(margins), tuple(objections), outside, *nearest)


class Distances:
    """Distances by MuJoCo of links, supports and object, but for what touches in the scene.

    Neighbours at a joint are left out, and what overlaps in the scene or moves as one.
    """

    def __init__(self, scene: Scene, states: Sequence[State]) -> None:
        """Build the model, in which all joints move.

        Args:
            scene: The scene.
            states: Between which bodies move that do not move as one.
        """
        forced = scene.with_changes({"hand.control": "force"})
        built = simulation_model(forced, np.zeros(forced.problem().joint_count))
        self._mujoco: Any = load_mujoco()
        self._model: Any = self._mujoco.MjModel.from_xml_string(built.xml)
        self._data: Any = self._mujoco.MjData(self._model)
        self._joints = {name: self._model.joint(name).qposadr[0] for name in built.joints}
        self._start = {} if forced.hand is None else dict(forced.hand.q)
        self._pose({}, scene.object.T_world_object)
        geoms = range(self._model.ngeom)
        self._names = [built.links.get(self._model.geom(k).name, OBJECT) for k in geoms]
        self._joint_names = Evaluator(scene).joint_names
        touching = {frozenset((name, OBJECT)) for name in scene.contacts.bodies}
        pairs = [
            (a, b)
            for a, b in itertools.combinations(geoms, 2)
            if self._can_meet(a, b)
            and frozenset((self._names[a], self._names[b])) not in touching
            and self._apart(a, b, _NEAR) > 0.0
        ]
        seen = np.array([self._relative(pairs, *state) for state in states])
        moving = np.ptp(seen, axis=0).max(axis=1) > _ROUNDING
        self._pairs = [pair for pair, moves in zip(pairs, moving, strict=True) if moves]

    def least(self, q: FloatArray, T_world_object: FloatArray) -> tuple[float, str]:
        """Return the least distance in a state, m, up to 0.05, and between which bodies."""
        self._pose(self._named(q), T_world_object)
        nearest = _NEAR, ""
        for a, b in self._pairs:
            apart = self._apart(a, b, nearest[0])
            if apart < nearest[0]:
                nearest = apart, f"{self._names[a]}, {self._names[b]}"
        return nearest

    def _named(self, q: FloatArray) -> dict[str, float]:
        return dict(zip(self._joint_names, q.tolist(), strict=True))

    def _relative(
        self, pairs: Sequence[tuple[int, int]], q: FloatArray, T_world_object: FloatArray
    ) -> FloatArray:
        """Return (P, 12) the pose of one shape in the frame of the other, for each pair."""
        self._pose(self._named(q), T_world_object)
        a, b = np.transpose(pairs)
        at, turned = self._data.geom_xpos, self._data.geom_xmat.reshape(-1, 3, 3)
        back = turned[a].transpose(0, 2, 1)
        offsets = np.einsum("nij,nj->ni", back, at[b] - at[a])
        return np.hstack([offsets, (back @ turned[b]).reshape(-1, 9)])

    def _can_meet(self, a: int, b: int) -> bool:
        bodies = [int(self._model.geom_bodyid[one]) for one in (a, b)]
        parents = [int(self._model.body_parentid[one]) for one in bodies]
        still = [int(self._model.body_weldid[one]) == 0 for one in bodies]
        neighbours = any(
            one and one == parent for one, parent in zip(bodies, parents[::-1], strict=True)
        )
        return bodies[0] != bodies[1] and not all(still) and not neighbours

    def _apart(self, a: int, b: int, most: float) -> float:
        return float(self._mujoco.mj_geomDistance(self._model, self._data, a, b, most, None))

    def _pose(self, q: dict[str, float], T_world_object: FloatArray) -> None:
        """Pose the model, whose joints are counted from the scene's configuration."""
        data, model = self._data, self._model
        for name, place in self._joints.items():
            data.qpos[place] = q[name] - self._start[name] if name in q else 0.0
        place = int(model.jnt_qposadr[model.body(OBJECT).jntadr[0]])
        quaternion = np.zeros(4)
        self._mujoco.mju_mat2Quat(quaternion, T_world_object[:3, :3].ravel())
        data.qpos[place : place + 7] = [*T_world_object[:3, 3], *quaternion]
        self._mujoco.mj_kinematics(model, data)
