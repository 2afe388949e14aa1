"""The tip of a finger: which point of it touches, how that moves, and what is in the object."""

from __future__ import annotations

from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject
from graspless_pin.geometry.contact.convex_sets import Revolved
from graspless_pin.geometry.contact.distances import LinkDistances, bounded_set
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.tree import LinkGeometry
from graspless_pin.geometry.posing.finger_joints import driving_columns
from graspless_pin.problem.checks import FloatArray


class Tip:
    """The tip of one finger and where it should be.

    Attributes:
        finger: The finger's name.
        link: The link at its tip.
        point: (3,) where it should touch the object, world, m.
        normal: (3,) unit normal there into the object, world axes.
    """

    def __init__(
        self,
        hand: Hand,
        target: ManipulatedObject,
        finger: str,
        point: FloatArray,
        normal: FloatArray,
    ) -> None:
        """Prepare one finger.

        Raises:
            ArgumentError: If the finger has no collision shape or no joint.
        """
        spec = hand.fingers[finger]
        shaped = {item.link for item in hand.tree.geometries}
        ends = (*spec.links, *(() if spec.tip is None else (spec.tip,)))
        ends = [link for link in ends if link in shaped]
        if not ends:
            raise ArgumentError(
                f"goals[{finger!r}]", "this finger has no collision shape to touch with"
            )
        if not driving_columns(hand, finger):
            raise ArgumentError(f"goals[{finger!r}]", "this finger has no joint to move")
        self.finger = finger
        self.link = ends[-1]
        self.point = point
        self.normal = normal
        self._tree = hand.tree
        self._shapes = [item for item in hand.tree.geometries if item.link == self.link]
        self._distances = LinkDistances(hand, {*spec.links, self.link}, target.collision_bodies())

    def touch(self, positions: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the tip's point farthest along the normal and its Jacobian.

        Args:
            positions: (n,) of all joints.

        Returns:
            (3,) the point, world, and (3, a) its velocity per rate of the independent joints.
        """
        tree = self._tree
        kinematics, joint = tree.kinematics(positions), self._shapes[0].joint
        T_world_joint = kinematics.T_world_joint[joint]
        touch, fixed = max(
            (_farthest(item, T_world_joint, self.normal) for item in self._shapes),
            key=lambda found: float(found[0] @ self.normal),
        )
        by_joint = tree.point_jacobians(kinematics.J, [joint], fixed[None])[0]
        return touch, by_joint @ tree.coupling.S

    def overlaps(self, positions: FloatArray) -> dict[str, float]:
        """Return how deep each link of the finger is in the object, without those outside."""
        deepest: dict[str, float] = {}
        distances = self._distances.at(positions)
        for link, distance in zip(self._distances.links, distances.tolist(), strict=True):
            if distance < 0.0:
                deepest[link] = max(deepest.get(link, 0.0), -distance)
        return deepest


def _farthest(
    item: LinkGeometry, T_world_joint: FloatArray, normal: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return a shape's point farthest along a normal, and the body-fixed point it moves with.

    A sphere's farthest point slides over it as it turns and so moves like its centre.
    """
    solid = bounded_set(item)
    T = T_world_joint @ item.T_joint_geometry
    touch = T[:3, :3] @ solid.feature(T[:3, :3].T @ normal).mean(axis=0) + T[:3, 3]
    swept = solid.swept_radius if isinstance(solid, Revolved) else 0.0
    return touch, touch - swept * normal
