"""Inspection of robots: lists of fingers, joints and limits, and audits of faults in their files.

An audit gives advice with each finding.
"""

from __future__ import annotations

import difflib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from graspless_pin.errors import ArgumentError, MeshError, RobotError
from graspless_pin.findings import Finding, FindingCode, capture, causes_first
from graspless_pin.geometry.bodies.meshes import scale_findings
from graspless_pin.geometry.hand.actuation import is_placeholder
from graspless_pin.geometry.hand.assembly import (
    EffortRecord,
    JoinedMounts,
    Mount,
    describe_efforts,
    join_mounts,
)
from graspless_pin.geometry.hand.configuration import joint_positions
from graspless_pin.geometry.hand.coupling import LIMIT_TOLERANCE, dangling_couplings
from graspless_pin.geometry.hand.reading import URDF, read_robot
from graspless_pin.geometry.hand.robot_model import (
    NEEDED_SCALE,
    LinkMesh,
    RobotModel,
    is_flat,
    load_link_mesh,
    missing_mesh_advice,
    search_places_text,
)
from graspless_pin.geometry.robots.description import FingerSpec, RobotDescription
from graspless_pin.geometry.robots.files import find_robot, robot_names
from graspless_pin.intake.files import read_bytes
from graspless_pin.suggestions import first_of


@dataclass(frozen=True)
class JointRecord:
    """A movable joint.

    Attributes:
        name: Its name.
        kind: ``revolute``, ``continuous`` or ``prismatic``.
        lower: Lowest position, rad or m; -inf without a limit. If other joints follow it, their
            limits are included.
        upper: Highest position, likewise; inf without a limit.
        follows: Multiplier by independent joint that it follows; empty if it is independent.
        offset: Position when those are at zero, rad or m.
        effort: Effort limit; None if the joint follows others, is driven by tendons or is locked.
        is_held: Whether it is position-controlled by default.
        is_locked: Whether limits or a coupling of factor 0 leave it no travel: it holds any torque.
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
        origin: Where its model is from.
        urdf_path: Its URDF.
        palms: The links that carry fingers.
        fingers: Fingers by name.
        joints: Movable joints in model order.
        tendons: Effort limit by tendon.
        stiffness: Gain of position feedback that its file states, see `RobotDescription`.
        damping: The same of the damping.
        problem: Why it cannot be loaded; None if it can; otherwise the other fields are empty.
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
    """List robots; meshes are read only of robots whose file names no fingers.

    Args:
        names: Robot files or example-robot-data models; None lists all robot files that come with
            this package.

    Returns:
        A record of each robot; one that cannot be loaded has a ``problem``.

    Examples:
        >>> from graspless_pin.geometry import list_robots
        >>> (robot,) = list_robots(["trihand"])
        >>> sorted(robot.fingers)
        ['finger_1', 'finger_2', 'finger_3']
    """
    return tuple(_robot_record(name) for name in (robot_names() if names is None else names))


def _robot_record(name: str) -> RobotRecord:
    """Return the record of one robot."""
    try:
        robot = find_robot(name)
    except RobotError as error:
        return RobotRecord(name, "unknown", None, problem=str(error))
    origin = f"the file {robot.urdf_path.name}"
    if robot.model:
        origin = f"the model {robot.model} of example-robot-data"
    if robot.root_link is not None:
        origin += f", from the link {robot.root_link} on"
    try:
        with capture():  # the audit emits these findings
            # Shapes decide which branches are fingers, and whether there is a jaw.
            joined = join_mounts([Mount(robot)], with_shapes=not robot.fingers)
            if robot.fingers and not joined.palms:
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
        joints=tuple(
            _joint_record(joined, index, efforts) for index in range(len(joined.tree.lower))
        ),
        tendons={tendon: efforts[tendon] for tendon in joined.tendons},
        stiffness=robot.stiffness,
        damping=robot.damping,
    )


def _joint_record(
    joined: JoinedMounts, index: int, efforts: Mapping[str, EffortRecord]
) -> JointRecord:
    """Return the record of one joint."""
    tree, coupling = joined.tree, joined.tree.coupling
    name = tree.joint_names[index]
    is_leader = index in coupling.leaders
    lower, upper = tree.lower[index], tree.upper[index]
    if is_leader:
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
        follows={} if is_leader else follows,
        offset=float(coupling.offset[index]),
        effort=efforts.get(name),
        is_held=name in joined.held_joints,
        is_locked=name in tree.locked or not (is_leader or follows),
    )


_HOLLOW_RATIO = 2.0
"""Volume of the hull over that of a closed mesh below which a cut rarely changes contacts."""


def _audit_meshes(robot: RobotDescription, model: RobotModel) -> Iterator[Finding]:
    """Find meshes that are missing, of unlikely size, unusable or far from convex."""
    # Imported here: it imports trimesh, which a list of robots does not need.
    from graspless_pin.geometry.bodies.mesh_files import MESH, dae_frame

    relative_paths: list[str] = []
    up_axes: dict[str, str] = {}
    for link in model.links:
        for use, shapes in (("collision", link.collisions), ("visual", link.visuals)):
            for mesh in (
                link_shape.shape for link_shape in shapes if isinstance(link_shape.shape, LinkMesh)
            ):
                yield from _audit_mesh(robot, model.label, link.name, use, mesh)
                if "://" not in mesh.stated_name and not Path(mesh.stated_name).is_absolute():
                    relative_paths.append(mesh.stated_name)
                if use == "collision" and mesh.file and mesh.file.suffix.lower() == ".dae":
                    with suppress(MeshError):  # found already
                        frame = dae_frame(mesh.file, read_bytes(mesh.file, MESH))
                        up_axes[mesh.file.name] = frame[1]
    if relative_paths:
        yield Finding(
            FindingCode.RELATIVE_MESH,
            "robot",
            f"paths of meshes are relative to the URDF's folder: {len(relative_paths)}, such as "
            f"{relative_paths[0]!r}",
            "nothing to do here; Pinocchio alone and most ROS tools need package:// or file://",
        )
    rotated = [f"{name} ({up})" for name, up in up_axes.items() if up not in ("", "Z_UP")]
    if rotated:
        yield Finding(
            FindingCode.MESH_AXES,
            "robot",
            f"collision meshes state that an axis other than z is up: {first_of(rotated, 3)}",
            "nothing to do if the robot looks right: like most readers of URDF, this one does not "
            "turn meshes",
        )


def _audit_mesh(
    robot: RobotDescription, label: str, link: str, use: str, mesh: LinkMesh
) -> Iterator[Finding]:
    """Audit one mesh of a link."""
    where = f"link {link}, {use}"
    if mesh.file is None:
        effect = "the robot cannot be loaded" if use == "collision" else "only drawing needs it"
        yield Finding(
            FindingCode.MISSING_MESH if use == "collision" else FindingCode.MISSING_VISUAL,
            where,
            f"{mesh.stated_name!r} is missing (looked for {search_places_text(mesh)}); {effect}",
            missing_mesh_advice(mesh),
        )
        return
    if use == "visual":
        return
    try:
        loaded = load_link_mesh(label, link, mesh)
        vertices = np.array(loaded.vertices)
    except MeshError as error:
        yield Finding(FindingCode.UNUSABLE_MESH, where, str(error), "export the mesh again as STL")
        return
    scale = " ".join(f"{factor:g}" for factor in mesh.scale)
    mesh_words = f"{mesh.file.name} with scale {scale}"
    yield from scale_findings(where, mesh_words, vertices, NEEDED_SCALE)
    if is_flat(vertices):
        yield Finding(
            FindingCode.UNUSABLE_MESH,
            where,
            f"{mesh.file.name} lies in one plane and has no volume",
            "give it a thickness or use a box",
        )
        return
    convex = robot.meshes.convex
    is_cut = (convex.get(link) if isinstance(convex, Mapping) else convex) == "decompose"
    is_closed = loaded.is_watertight and loaded.is_winding_consistent and loaded.volume != 0.0
    if is_cut or not is_closed:
        return
    ratio = float(loaded.convex_hull.volume / abs(loaded.volume))
    if ratio > _HOLLOW_RATIO:
        name = mesh.file.name
        yield Finding(
            FindingCode.HOLLOW_MESH,
            where,
            f"the convex hull of {name}, which replaces it, has {ratio:.1f} times its volume",
            f"if its concave parts matter, give 'convex: {{{link}: decompose}}' in the scene's "
            "hand or in a robot file",
        )


_MESH_FAILURES = (FindingCode.MISSING_MESH, FindingCode.UNUSABLE_MESH)


@dataclass(frozen=True)
class AuditReport:
    """The audit of a robot. See the example of `audit_urdf`.

    Attributes:
        name: The robot.
        urdf_path: Its URDF.
        loads: Whether it can be mounted without changes.
        links: Its links.
        joints: Its movable joints.
        palms: The links that carry fingers.
        fingers: The joints of every finger.
        findings: The findings, the gravest first.
        mass: Total mass of the links, kg.
    """

    name: str
    urdf_path: Path
    loads: bool
    links: tuple[str, ...] = ()
    joints: tuple[str, ...] = ()
    palms: tuple[str, ...] = ()
    fingers: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    findings: tuple[Finding, ...] = ()
    mass: float = 0.0


def audit_urdf(
    source: str | Path,
    package_dirs: Sequence[str | Path] = (),
    root_link: str | None = None,
) -> AuditReport:
    """Audit a URDF or robot; mistakes in it become findings, not errors.

    Args:
        source: A path to a URDF or robot file, or a robot's name. Faults of the URDF that a robot
            file corrects (limits, couplings) are not reported.
        package_dirs: For the ``package://`` addresses of a URDF given by path.
        root_link: Audit only this link and its subtree.

    Returns:
        The report.

    Raises:
        RobotError: If there is no such robot, robot file or URDF.
        ArgumentError: If ``package_dirs`` is given for anything but a URDF.

    Examples:
        >>> from graspless_pin.geometry import audit_urdf
        >>> audit_urdf("robots/trihand.urdf").loads
        True
    """
    robot = find_robot(source, package_dirs)
    if root_link is not None:
        robot = replace(robot, root_link=root_link)
    read_bytes(robot.urdf_path, URDF)  # a file that cannot be read is an error, not a finding
    findings: list[Finding] = []
    errors: list[Exception] = []
    with capture() as emitted:
        with capture(), _collect_errors(errors):  # findings on shapes are emitted again below
            model = read_robot(robot)
            findings += [*_audit_meshes(robot, model), *_audit_shapes(model)]
        joined: JoinedMounts | None = None
        with _collect_errors(errors):
            joined = join_mounts([Mount(robot)], with_shapes=False)
            findings += _audit_mimics(robot, read_robot(robot, with_shapes=False))
            findings += _audit_joints(robot, joined)
        if not errors:
            with _collect_errors(errors):
                joined = join_mounts([Mount(robot)])
    if errors:
        workaround = _workaround_advice(robot, joined)
        if not any(item.code in _MESH_FAILURES for item in findings):
            findings.append(
                Finding(
                    FindingCode.UNREADABLE,
                    str(robot.urdf_path),
                    str(errors[0]),
                    "fix this first: the robot cannot be loaded until then",
                )
            )
        findings = [
            replace(item, advice=item.advice + workaround)
            if item.code in (*_MESH_FAILURES, FindingCode.UNREADABLE)
            else item
            for item in findings
        ]
    codes = {item.code for item in findings}
    findings += [item for item in emitted if item.code not in codes]
    report = AuditReport(robot.name, robot.urdf_path, not errors, findings=causes_first(findings))
    if joined is None:
        return report
    return replace(
        report,
        links=tuple(joined.tree.link_frames),
        joints=joined.tree.joint_names,
        palms=joined.palms,
        fingers={name: spec.joints for name, spec in joined.fingers.items()},
        mass=float(joined.tree.masses[0].sum()),
    )


@contextmanager
def _collect_errors(errors: list[Exception]) -> Iterator[None]:
    """Append an error that says what is wrong with a robot to ``errors``, and continue."""
    try:
        yield
    except (RobotError, MeshError, ArgumentError) as error:
        errors.append(error)


def _workaround_advice(robot: RobotDescription, joined: JoinedMounts | None) -> str:
    """Return advice to load only the hand of a robot that cannot be loaded, if possible."""
    for palm in () if joined is None or robot.root_link is not None else joined.palms:
        with suppress(RobotError, MeshError, ArgumentError):
            join_mounts([Mount(replace(robot, root_link=palm, fingers={}, palms=()))])
            return f"; or take only the hand, which can be loaded: root_link: {palm}"
    return ""


def _audit_shapes(model: RobotModel) -> Iterator[Finding]:
    """Find links that are drawn but have no collision shape, or have a shape but no mass."""
    solid = [link for link in model.links if link.collisions]
    without_collision = [link.name for link in model.links if link.visuals and not link.collisions]
    if not solid:
        yield Finding(
            FindingCode.NO_SHAPES,
            "robot",
            "no link has collision geometry, so the robot touches nothing",
            "add <collision> shapes, at least to the fingertips, let the visual shapes collide "
            "(visuals_collide: true in the scene's hand or a robot file), or give the contacts in "
            "the scene",
        )
    elif without_collision:
        yield Finding(
            FindingCode.NO_COLLISION,
            f"links {', '.join(without_collision)}",
            "are drawn but have no collision geometry: nothing touches them",
            "add <collision> shapes to those that may touch the object, or give visuals_collide: "
            "true in the scene's hand or a robot file",
        )
    weightless = [link.name for link in solid if link.mass == 0.0]
    if weightless and any(link.mass > 0.0 for link in model.links):
        yield Finding(
            FindingCode.WEIGHTLESS_LINK,
            f"links {', '.join(weightless)}",
            "have shapes but no mass: their weight is left out, and if a joint moves no other "
            "mass, there are no verdicts",
            "add <inertial> with their mass, unless other links include it",
        )


def _audit_mimics(robot: RobotDescription, model: RobotModel) -> Iterator[Finding]:
    """Find mimic joints whose leader does not exist."""
    joints = model.movable_joints
    couplings = {item.joint: item for item in (*model.couplings, *robot.couplings)}
    for joint, leader in dangling_couplings(joints, couplings.values()):
        similar = [name for name in joints if leader and name.endswith(leader)]
        similar = similar or difflib.get_close_matches(leader, joints, n=1)
        hint = f" (perhaps {', '.join(similar)})" if similar else ""
        yield Finding(
            FindingCode.DANGLING_MIMIC,
            f"joint {joint}",
            f"mimics {leader!r}, which does not exist or is fixed; it is left independent",
            f"correct the name{hint} in the URDF, or couple it under 'couplings' in a robot file",
        )


def _audit_joints(robot: RobotDescription, joined: JoinedMounts) -> Iterator[Finding]:
    """Find doubtful effort limits and joints that cannot be at zero."""
    tree = joined.tree
    for name, effort in describe_efforts(robot, joined).items():
        note = " (position-controlled by default)" if name in joined.held_joints else ""
        where = f"{'tendon' if name in joined.tendons else 'joint'} {name}"
        if name in joined.effort_unknown and not effort.known:
            yield Finding(
                FindingCode.UNKNOWN_EFFORT,
                where,
                f"the effort limit {effort.upper:g} is declared unknown: {effort.source}",
                "measure it or ask the maker, and give it in effort_limits",
            )
        elif not effort.known and is_placeholder(effort.upper, on_arm=name in joined.outer_joints):
            yield Finding(
                FindingCode.PLACEHOLDER_EFFORT,
                where,
                (
                    f"the effort limit {effort.upper:g} looks like a placeholder{note}"
                    if np.isfinite(effort.upper)
                    else f"no effort limit is given{note}"
                ),
                "give the motor's real limit in effort_limits (N m, or N if prismatic)",
            )
    rest, movable = joint_positions(tree, {}), set(tree.leader_names) - tree.locked
    lowest, highest = tree.tolerated_limits
    for name in sorted(tree.locked):
        where = tree.lower[tree.joint_index[name]]
        yield Finding(
            FindingCode.LOCKED_JOINT,
            f"joint {name}",
            f"both its limits are {where:g}: it never moves and needs no motor",
            "nothing to do if this is intended; a <limit> without lower and upper means 0 and 0",
        )
    for index, name in enumerate(tree.joint_names):
        limits = f"[{tree.lower[index]:g}, {tree.upper[index]:g}]"
        if not lowest[index] <= rest[index] <= highest[index]:
            yield Finding(
                FindingCode.NEUTRAL_OUTSIDE,
                f"joint {name}",
                f"follows its leader to {rest[index]:g}, outside its limits {limits}",
                "give a position of the leader in q, or correct limits, multiplier or offset",
            )
        elif abs(rest[index]) > LIMIT_TOLERANCE and name in movable:
            is_own_limit = not lowest[index] <= 0.0 <= highest[index]
            limits_words = f"its limits {limits}" if is_own_limit else "the limits of its followers"
            yield Finding(
                FindingCode.NEUTRAL_OUTSIDE,
                f"joint {name}",
                f"zero is outside {limits_words}; if not in q, it is at {rest[index]:g}",
                "give its position in q if this is not intended",
            )
