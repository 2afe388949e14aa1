"""A robot as its file describes it, for files of any kind: `urdf` and `mjcf` make this record.

It is passed to Pinocchio joint by joint (`tree`). Also the mesh files of links: reading them, and
advice on missing ones.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from graspless_pin.bounds import LARGEST_LENGTH
from graspless_pin.errors import MeshError, RobotError
from graspless_pin.geometry.bodies.meshes import scaled_mesh
from graspless_pin.geometry.bodies.shape import Shape
from graspless_pin.geometry.robots.description import JointCoupling
from graspless_pin.intake.text import fault_of_name
from graspless_pin.problem.checks import FloatArray
from graspless_pin.records import Record
from graspless_pin.suggestions import first_of, nearest_name

if TYPE_CHECKING:
    import trimesh

MOVABLE_KINDS = ("revolute", "prismatic", "continuous")
FREE_KINDS = ("floating", "planar")
"""Joints without a motor in a hand: fixed if they carry its base, else refused."""

LONGEST_CHAIN = 200
"""Largest number of joints between root and tip."""
MOST_LINKS = 1000
"""Largest number of links."""

_UNLIMITED = 1e30
"""Amount from which on a limit in a file, such as the largest float, means no limit."""


@dataclass(frozen=True)
class LinkMesh:
    """A mesh file of a link.

    Attributes:
        stated_name: The name of the mesh in the robot's file.
        file: The file; None: it is missing, which is an error only when it is read.
        searched_paths: The paths at which it was looked for.
        scale: Metres per unit of the file along x, y, z.
    """

    stated_name: str
    file: Path | None
    searched_paths: tuple[Path, ...]
    scale: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LinkShape(Record):
    """A collision shape or a visual shape.

    Attributes:
        shape: A primitive or a mesh file.
        T_link_shape: (4, 4) pose in the link's frame.
    """

    shape: Shape | LinkMesh
    T_link_shape: FloatArray


@dataclass(frozen=True, eq=False)
class RobotLink(Record):
    """A rigid link.

    Attributes:
        name: Its name.
        mass: kg.
        center_of_mass: (3,) in the link's frame, m.
        inertia: (3, 3) about the centre of mass, axes of the link's frame, kg m^2.
        collisions: Collision shapes.
        visuals: Visual shapes; empty if one of them is malformed.
        gravcomp: Share of its weight that an MJCF's ``gravcomp`` compensates.
    """

    name: str
    mass: float = 0.0
    center_of_mass: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    collisions: tuple[LinkShape, ...] = ()
    visuals: tuple[LinkShape, ...] = ()
    gravcomp: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True, eq=False)
class RobotJoint(Record):
    """A joint.

    Attributes:
        name: Its name.
        kind: One of `MOVABLE_KINDS` or `FREE_KINDS`, or ``fixed``.
        parent: The parent link.
        child: The child link.
        T_parent_joint: (4, 4) pose of the joint, equal to that of the child at position zero.
        axis: (3,) axis of rotation or translation, in the joint's frame, of any length.
        lower: Lowest position, rad or m; -inf: no limit.
        upper: Highest position; inf: no limit.
        effort: Largest torque or force in both directions, N m or N; inf: not stated.
        velocity: Largest rate in both directions, rad/s or m/s; inf: not stated.
        rotor_inertia: Inertia of its motor's rotor, gear ratio squared included, kg m^2 (kg).
        coupling: How it follows other joints, which need not exist; None: it is independent.
    """

    name: str
    kind: str
    parent: str
    child: str
    T_parent_joint: FloatArray
    axis: FloatArray = field(default_factory=lambda: np.array([1.0, 0.0, 0.0]))
    lower: float = -np.inf
    upper: float = np.inf
    effort: float = np.inf
    velocity: float = np.inf
    rotor_inertia: float = 0.0
    coupling: JointCoupling | None = None

    @property
    def is_movable(self) -> bool:
        """Whether it has one degree of freedom."""
        return self.kind in MOVABLE_KINDS


class DrawnTendon(NamedTuple):
    """A tendon over several joints that a motor pulls.

    Attributes:
        arms: Torque per newton of tension by joint, m.
        lower: Lowest tension, N.
        upper: Highest tension, N.
    """

    arms: Mapping[str, float]
    lower: float
    upper: float


@dataclass(frozen=True, eq=False)
class RobotModel(Record):
    """A tree of links and joints.

    Attributes:
        label: The file, for messages.
        root: The root link.
        links: In the order of the file.
        joints: In the order of the file.
        tendons: Tendons that motors pull, by name.
        disabled_pairs: Pairs of links whose overlaps are ignored.
        groups: Movable joints by group of an SRDF.
        group_states: Positions by joint, rad or m, by state of an SRDF, ``GROUP/STATE``.
        missing: Text on the joints and links that the robot does not have, by the group or state of
            the SRDF that names them.
    """

    label: str
    root: str
    links: tuple[RobotLink, ...]
    joints: tuple[RobotJoint, ...]
    tendons: Mapping[str, DrawnTendon] = field(default_factory=dict)
    disabled_pairs: frozenset[frozenset[str]] = frozenset()
    groups: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    group_states: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    missing: Mapping[str, str] = field(default_factory=dict)

    @property
    def movable_joints(self) -> tuple[str, ...]:
        """Names of the joints with one degree of freedom."""
        return tuple(joint.name for joint in self.joints if joint.is_movable)

    @property
    def couplings(self) -> tuple[JointCoupling, ...]:
        """The couplings of the joints that follow others."""
        return tuple(one.coupling for one in self.joints if one.is_movable and one.coupling)

    def subtree(self, top: str) -> RobotModel:
        """Return the subtree below a link as a robot.

        Raises:
            RobotError: If there is no such link.
        """
        link_names = links_below(
            self.label,
            [link.name for link in self.links],
            [(joint.parent, joint.child) for joint in self.joints],
            top,
        )
        joints = tuple(joint for joint in self.joints if joint.parent in link_names)
        kept = {joint.name for joint in joints}
        return replace(
            self,
            root=top,
            links=tuple(link for link in self.links if link.name in link_names),
            joints=joints,
            tendons={name: one for name, one in self.tendons.items() if kept >= set(one.arms)},
        )

    def with_fixed_base(self) -> RobotModel:
        """Return the robot with the free joint that carries all of it fixed at zero.

        Raises:
            RobotError: If there is such a joint anywhere else.
        """
        base_joints = [joint.name for joint in self.joints if joint.parent == self.root]
        for joint in self.joints:
            if joint.kind in FREE_KINDS and base_joints != [joint.name]:
                raise RobotError(
                    f"{self.label}: joint {joint.name!r} is {joint.kind} but does not carry the "
                    "whole robot; use revolute, continuous, prismatic or fixed joints"
                )
        return replace(
            self,
            joints=tuple(
                replace(joint, kind="fixed") if joint.kind in FREE_KINDS else joint
                for joint in self.joints
            ),
        )

    def prefixed(self, prefix: str) -> RobotModel:
        """Return the robot with a prefix before the name of every link, joint and tendon.

        Raises:
            RobotError: If a name becomes too long.
        """
        if not prefix:
            return self
        renamed = replace(
            self,
            root=prefix + self.root,
            links=tuple(replace(link, name=prefix + link.name) for link in self.links),
            joints=tuple(
                replace(
                    item,
                    name=prefix + item.name,
                    parent=prefix + item.parent,
                    child=prefix + item.child,
                    coupling=item.coupling and item.coupling.prefixed(prefix),
                )
                for item in self.joints
            ),
            tendons={
                prefix + name: item._replace(
                    arms={prefix + joint: arm for joint, arm in item.arms.items()}
                )
                for name, item in self.tendons.items()
            },
            disabled_pairs=frozenset(
                frozenset(prefix + link for link in pair) for pair in self.disabled_pairs
            ),
            groups={
                prefix + name: tuple(prefix + joint for joint in joints)
                for name, joints in self.groups.items()
            },
            group_states={
                prefix + name: {prefix + joint: value for joint, value in positions.items()}
                for name, positions in self.group_states.items()
            },
            missing={prefix + name: words for name, words in self.missing.items()},
        )
        renamed.check()
        return renamed

    def check(self) -> None:
        """Refuse names that are too long, and numbers that are too large or not finite.

        Raises:
            RobotError: If there is one.
        """
        check_name_lengths(self.label, "link", (link.name for link in self.links))
        check_name_lengths(self.label, "joint", (joint.name for joint in self.joints))
        check_name_lengths(self.label, "tendon", self.tendons)
        for link in self.links:
            poses = [one.T_link_shape for one in (*link.collisions, *link.visuals)]
            figures = [link.mass, link.center_of_mass, link.inertia, *poses]
            _check_magnitudes(f"{self.label}: link {link.name!r}", figures)
        for joint in self.joints:
            figures = [joint.T_parent_joint, joint.axis, joint.rotor_inertia]
            _check_magnitudes(f"{self.label}: joint {joint.name!r}", figures)


def _check_magnitudes(where: str, figures: Iterable[FloatArray | float]) -> None:
    values = np.concatenate([np.ravel(figure) for figure in figures])
    excessive = values[~(np.abs(values) <= LARGEST_LENGTH)]
    if len(excessive):
        raise RobotError(
            f"{where} has the value {excessive[0]:g}; it must be within ±{LARGEST_LENGTH:g}"
        )


def parsed_limit(value: float) -> float:
    """Return a limit of a file, infinite if it is so large that it means no limit."""
    return float(np.copysign(np.inf, value)) if abs(value) > _UNLIMITED else value


def check_name_lengths(label: str, kind: str, names: Iterable[str]) -> None:
    """Refuse names that are too long.

    Args:
        label: The file, for messages.
        kind: The kind of the named items.
        names: The names.

    Raises:
        RobotError: If one is too long.
    """
    for name in names:
        if fault := fault_of_name(name):
            raise RobotError(f"{label}: a <{kind}> {fault}, including its hand's prefix")


def root_of_tree(
    label: str, links: Sequence[str], joints: Sequence[str], ends: Sequence[tuple[str, str]]
) -> str:
    """Return the link that is no joint's child, and check that the links form a tree.

    Args:
        label: The file, for messages.
        links: Names of the links.
        joints: Names of the joints.
        ends: The links at each joint's ends, parent and child.

    Raises:
        RobotError: If there are too many links, a name is too long, missing or repeated, a joint's
            link does not exist, or the links form no tree, or one that is too deep.
    """
    if len(links) > MOST_LINKS:
        raise RobotError(f"{label}: has more than {MOST_LINKS} links, the most that are supported")
    for kind, names in (("link", links), ("joint", joints)):
        check_name_lengths(label, kind, names)
        for name, count in Counter(names).items():
            if not name:
                raise RobotError(f"{label}: a <{kind}> has no name")
            if count > 1:
                raise RobotError(f"{label}: two {kind}s are called {name!r}; rename one")
    if not links:
        raise RobotError(f"{label}: the robot has no <link>")
    known, children = set(links), [child for _, child in ends]
    for joint, joint_ends in zip(joints, ends, strict=True):
        for end, link in zip(("parent", "child"), joint_ends, strict=True):
            if link not in known:
                raise RobotError(
                    f"{label}: joint {joint!r} has the {end} link {link or None!r}, "
                    "which does not exist"
                )
    for link, count in Counter(children).items():
        if count > 1:
            raise RobotError(f"{label}: link {link!r} is the child of two joints")
    roots = sorted(known - set(children))
    if len(roots) != 1:
        roots_text = ", ".join(roots) if roots else "none (the links form a loop)"
        raise RobotError(f"{label}: a robot must have one root link, found {roots_text}")
    _check_chains(label, roots[0], ends)
    return roots[0]


def _check_chains(label: str, top: str, ends: Iterable[tuple[str, str]]) -> None:
    """Refuse too long a chain of joints, and links that are not connected to the root."""
    children: dict[str, list[str]] = {}
    for parent, child in ends:
        children.setdefault(parent, []).append(child)
    current, reached = [top], {top}
    for _ in range(LONGEST_CHAIN + 1):
        current = [child for link in current for child in children.get(link, ())]
        reached.update(current)
        if not current:
            unreached = sorted({child for _, child in ends} - reached)
            if unreached:
                raise RobotError(
                    f"{label}: these links are not connected to the root link {top!r}, but form a "
                    f"loop of joints: {first_of(unreached, _MOST_PLACES)}; correct their parents"
                )
            return
    raise RobotError(
        f"{label}: the chain to link {current[0]!r} has more than {LONGEST_CHAIN} joints, the "
        "most that are supported"
    )


def links_below(
    label: str, links: Iterable[str], ends: Sequence[tuple[str, str]], top: str
) -> set[str]:
    """Return a link and all links of its subtree.

    Args:
        label: The file, for messages.
        links: Names of the links.
        ends: The links at each joint's ends, parent and child.
        top: The link.

    Raises:
        RobotError: If there is no such link.
    """
    if top not in links:
        raise RobotError(f"{label}: there is no link {top!r} to start from")
    reached = {top}
    while below := {child for parent, child in ends if parent in reached} - reached:
        reached |= below
    return reached


_MOST_PLACES = 3
"""Number of paths in a message on a missing mesh."""
_LEAST_SIMILARITY = 0.75
"""Least similarity of a file name that is suggested."""
FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


NEEDED_SCALE = 'needs scale="0.001 0.001 0.001" in the URDF'
"""What a mesh in millimetres needs."""


def load_link_mesh(label: str, link: str, mesh: LinkMesh) -> trimesh.Trimesh:
    """Read a link's collision mesh in metres; do not modify the result.

    Args:
        label: The robot's file, for the message.
        link: The link.
        mesh: The mesh.

    Raises:
        MeshError: If it is missing or cannot be read.
    """
    if mesh.file is None:
        raise MeshError(
            f"{label}: link {link!r} needs the collision mesh {mesh.stated_name!r}, which is "
            f"missing (looked for {search_places_text(mesh)}); {missing_mesh_advice(mesh)}"
        )
    try:
        return scaled_mesh(mesh.file, mesh.scale, upright=False)
    except MeshError as error:
        raise MeshError(
            f"{label}: the collision mesh {mesh.file} of link {link!r}: {error}"
        ) from error


def search_places_text(mesh: LinkMesh) -> str:
    """Return a text with the likeliest paths at which a mesh was looked for."""
    return first_of([*map(str, mesh.searched_paths)], _MOST_PLACES) or "nowhere"


def missing_mesh_advice(mesh: LinkMesh) -> str:
    """Return advice on a missing mesh: the name that was probably meant, if any."""
    # For each path: the parts that do not exist, and the folder in which they are missing.
    missing: list[tuple[tuple[str, ...], Path]] = []
    for place in mesh.searched_paths:
        with suppress(OSError, ValueError):  # no file can have such a name
            folder = next(one for one in place.parents if one.is_dir())
            missing.append((place.relative_to(folder).parts, folder))
    for parts, folder in sorted(missing, key=lambda one: len(one[0])):
        with suppress(OSError):  # a folder without read permission
            is_folder = len(parts) > 1
            known = [item.name for item in folder.iterdir() if item.is_dir() == is_folder]
            if nearest := nearest_name(parts[0], known, _LEAST_SIMILARITY):
                return f"did you mean {nearest!r}?"
    scheme, _, address = mesh.stated_name.partition("://")
    package = Path(address).parts
    if scheme == "package" and not any(len(parts) < len(package) for parts, _ in missing):
        return "give package_dirs, the folder that holds the package"
    return "put the file there or correct the path"


def is_flat(vertices: FloatArray) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])
