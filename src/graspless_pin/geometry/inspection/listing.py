"""List robots with their fingers, joints and limits, and where these come from."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

from graspless_pin.errors import MeshError, RobotError
from graspless_pin.findings import capture
from graspless_pin.geometry.hand.actuation import is_placeholder, spread_names, urdf_efforts
from graspless_pin.geometry.hand.assembly import JoinedMounts, Mount, join_mounts
from graspless_pin.geometry.hand.tree import KinematicTree
from graspless_pin.geometry.robots.description import FingerSpec, RobotDescription
from graspless_pin.geometry.robots.files import find_robot, robot_names


@dataclass(frozen=True)
class EffortRecord:
    """The effort limit of a joint or tendon.

    Attributes:
        lower: Lower limit, N m (N for prismatic joints and tendons).
        upper: Upper limit, in the same unit.
        known: Whether it is stated with a source, rather than taken from the URDF.
        source: Where it comes from, or what is known of it.
    """

    lower: float
    upper: float
    known: bool
    source: str


@dataclass(frozen=True)
class JointRecord:
    """A movable joint.

    Attributes:
        name: Its name.
        kind: ``revolute``, ``continuous`` or ``prismatic``.
        lower: Lowest position, rad or m; -inf without a limit. Where others follow the joint, their
            limits count, too.
        upper: Highest position, likewise; inf without a limit.
        follows: Multiplier by independent joint that it follows; empty if it is independent.
        offset: Its position when those stand at zero, rad or m.
        effort: Its effort limit; None if it follows others, hangs on tendons or is locked.
        is_held: Whether it is position-controlled unless asked otherwise.
        is_locked: Whether its limits leave it no room: it holds whatever it feels.
    """

    name: str
    kind: str
    lower: float
    upper: float
    follows: Mapping[str, float]
    offset: float
    effort: EffortRecord | None
    is_held: bool
    is_locked: bool = False


@dataclass(frozen=True)
class RobotRecord:
    """A robot of the list. See the example of `list_robots`.

    Attributes:
        name: Its name.
        origin: Where its model comes from.
        urdf_path: Its URDF.
        palms: The links that carry fingers.
        fingers: Fingers by name.
        joints: Movable joints in model order.
        tendons: Effort limit by tendon.
        stiffness: Gain of position feedback that its file states, see `RobotDescription`.
        damping: The same of the damping.
        problem: Why it cannot be loaded, if it cannot; then the rest is empty.
    """

    name: str
    origin: str
    urdf_path: Path | None
    palms: tuple[str, ...] = ()
    fingers: Mapping[str, FingerSpec] = field(default_factory=dict)
    joints: tuple[JointRecord, ...] = ()
    tendons: Mapping[str, EffortRecord] = field(default_factory=dict)
    stiffness: float | Mapping[str, float] | None = None
    damping: float | Mapping[str, float] | None = None
    problem: str | None = None


def list_robots(names: Sequence[str] | None = None) -> tuple[RobotRecord, ...]:
    """List robots; meshes are not read.

    Args:
        names: Robot files or example-robot-data models; None lists all robot files that come with
            this package.

    Returns:
        A record of each. One that cannot be loaded says why.

    Examples:
        >>> from graspless_pin.geometry import list_robots
        >>> (robot,) = list_robots(["trihand"])
        >>> sorted(robot.fingers)
        ['finger_1', 'finger_2', 'finger_3']
    """
    return tuple(_record(name) for name in (robot_names() if names is None else names))


def describe_efforts(robot: RobotDescription, joined: JoinedMounts) -> dict[str, EffortRecord]:
    """Return the effort limit of every joint with a motor and every tendon of one robot."""
    tree, tendons = joined.tree, joined.tendons
    stated = spread_names(tree, joined.fingers, robot.effort_sources, tendons)
    pulled = {joint for arms in tendons.values() for joint in arms}
    lower, upper = urdf_efforts(tree)
    efforts: dict[str, EffortRecord] = {}
    for index in tree.coupling.leaders:
        name = tree.joint_names[index]
        if name in pulled or name in tree.locked:
            continue
        note = joined.effort_unknown.get(name)
        if note is None and is_placeholder(float(upper[index]), on_arm=name in joined.outer_joints):
            note = "the URDF's, which looks like a placeholder"
        efforts[name] = EffortRecord(
            float(lower[index]), float(upper[index]), known=False, source=note or "the URDF's"
        )
    for name in tendons:
        note = joined.effort_unknown.get(name, "nobody states it")
        if name in joined.tensions:
            note = joined.effort_unknown.get(name, "the MJCF's")
        ends = joined.tensions.get(name, (0.0, float("inf")))
        efforts[name] = EffortRecord(*ends, known=False, source=note)
    for name, (low, high) in joined.effort_limits.items():
        source = " ".join(robot.effort_sources[stated[name]].split())
        efforts[name] = EffortRecord(low, high, known=True, source=source)
    return efforts


def _record(name: str) -> RobotRecord:
    """Return the record of one robot."""
    try:
        robot = find_robot(name)
    except RobotError as error:
        return RobotRecord(name, "unknown", None, problem=str(error))
    origin = (
        f"the model {robot.model} of example-robot-data"
        if robot.model
        else f"the URDF {robot.urdf_path.name}"
    )
    if robot.root_link is not None:
        origin += f", from the link {robot.root_link} on"
    try:
        with capture():  # the audit says it
            joined = join_mounts([Mount(robot)], with_shapes=False)
            if not joined.palms:  # shapes tell whether it ends in a jaw
                joined = join_mounts([Mount(robot)])
            robot.check_gains([*joined.tree.joint_names, *joined.tendons, *joined.fingers])
    except (RobotError, MeshError) as error:
        return RobotRecord(robot.name, origin, robot.urdf_path, problem=str(error))
    efforts = describe_efforts(robot, joined)
    return RobotRecord(
        name=robot.name,
        origin=origin,
        urdf_path=robot.urdf_path,
        palms=joined.palms,
        fingers=joined.fingers,
        joints=tuple(_joint(joined, index, efforts) for index in range(len(joined.tree.lower))),
        tendons={tendon: efforts[tendon] for tendon in joined.tendons},
        stiffness=robot.stiffness,
        damping=robot.damping,
    )


def _joint(joined: JoinedMounts, index: int, efforts: Mapping[str, EffortRecord]) -> JointRecord:
    """Return the record of one joint."""
    tree: KinematicTree = joined.tree
    name, coupling = tree.joint_names[index], tree.coupling
    leads = index in coupling.leaders
    lower, upper = tree.lower[index], tree.upper[index]
    if leads:
        lower, upper = (ends[coupling.leaders.index(index)] for ends in tree.ranges)
    follows = {
        tree.leader_names[column]: float(coupling.S[index, column])
        for column in coupling.drivers([index])
    }
    return JointRecord(
        name=name,
        kind=tree.joint_kinds[index],
        lower=float(lower),
        upper=float(upper),
        follows={} if leads else follows,
        offset=float(coupling.offset[index]),
        effort=efforts.get(name),
        is_held=name in joined.held_joints,
        is_locked=name in tree.locked,
    )
