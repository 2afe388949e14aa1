"""A robot as its file describes it, whatever the file's kind: `urdf` and `mjcf` make this record.

Pinocchio gets it joint by joint (`tree`). And mesh files of links: read, or missing with what to do
about it.
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
"""Joints that a hand has no motor for: fixed where they carry a base, refused elsewhere."""

LONGEST_CHAIN = 200
"""More joints between root and tip than any robot has."""
MOST_LINKS = 1000
"""More links than any robot has."""

_UNLIMITED = 1e30
"""Limits beyond it, such as the largest number that a computer has, mean that there is none."""


@dataclass(frozen=True)
class LinkMesh:
    """A mesh file of a link.

    Attributes:
        written: How the robot's file names it.
        file: The file; None: it is missing, which nobody needs to mind but who reads it.
        looked: Where it was looked for.
        scale: Metres per unit of the file along x, y, z.
    """

    written: str
    file: Path | None
    looked: tuple[Path, ...]
    scale: tuple[float, float, float]


@dataclass(frozen=True, eq=False)
class LinkShape(Record):
    """A collision shape or a visual one.

    Attributes:
        shape: A primitive, or a mesh file.
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
        collisions: What touches.
        visuals: How it looks; empty where one of its visual shapes is malformed.
        borne: Share of its weight that an MJCF's ``gravcomp`` takes off its joints.
    """

    name: str
    mass: float = 0.0
    center_of_mass: FloatArray = field(default_factory=lambda: np.zeros(3))
    inertia: FloatArray = field(default_factory=lambda: np.zeros((3, 3)))
    collisions: tuple[LinkShape, ...] = ()
    visuals: tuple[LinkShape, ...] = ()
    borne: float = field(default=0.0, kw_only=True)


@dataclass(frozen=True, eq=False)
class RobotJoint(Record):
    """A joint.

    Attributes:
        name: Its name.
        kind: One of `MOVABLE_KINDS` or `FREE_KINDS`, or ``fixed``.
        parent: The link that it hangs on.
        child: The link that it carries.
        T_parent_joint: (4, 4) pose of the joint, which is that of the child at zero.
        axis: (3,) that it turns about or slides along, in its own frame, of any length.
        lower: Lowest position, rad or m; -inf: there is none.
        upper: Highest position; inf: there is none.
        effort: Largest torque or force both ways, N m or N; inf: the file states none.
        velocity: Largest rate both ways, rad/s or m/s; inf: the file states none.
        rotor_inertia: Of its motor, gear ratio squared included, kg m^2 (kg).
        coupling: How it follows other joints, which need not exist; None: it moves by itself.
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
    """A tendon that a motor pulls over several joints.

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
        root: The link that carries all others.
        links: In the order of the file.
        joints: In the order of the file.
        tendons: Tendons that motors pull, by name.
        disabled_pairs: Pairs of links that may be in each other.
        groups: Movable joints by group of an SRDF.
        group_states: Positions by joint, rad or m, by state of an SRDF, ``GROUP/STATE``.
        lacking: Joints and links that the robot does not have, in words, by the group or state of
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
    lacking: Mapping[str, str] = field(default_factory=dict)

    @property
    def movable_joints(self) -> tuple[str, ...]:
        """Names of the joints with one degree of freedom."""
        return tuple(joint.name for joint in self.joints if joint.is_movable)

    @property
    def couplings(self) -> tuple[JointCoupling, ...]:
        """Of the joints that follow others."""
        return tuple(one.coupling for one in self.joints if one.is_movable and one.coupling)

    def below(self, top: str) -> RobotModel:
        """Return the robot that begins with one of its links, with what hangs on it.

        Raises:
            RobotError: If there is no such link.
        """
        kept = links_below(
            self.label,
            [link.name for link in self.links],
            [(joint.parent, joint.child) for joint in self.joints],
            top,
        )
        joints = tuple(joint for joint in self.joints if joint.parent in kept)
        inside = {joint.name for joint in joints}
        return replace(
            self,
            root=top,
            links=tuple(link for link in self.links if link.name in kept),
            joints=joints,
            tendons={name: one for name, one in self.tendons.items() if inside >= set(one.arms)},
        )

    def with_fixed_base(self) -> RobotModel:
        """Return it with the floating or planar joint that carries the whole robot fixed at zero.

        Raises:
            RobotError: If there is such a joint anywhere else.
        """
        first = [joint.name for joint in self.joints if joint.parent == self.root]
        for joint in self.joints:
            if joint.kind in FREE_KINDS and first != [joint.name]:
                raise RobotError(
                    f"{self.label}: joint {joint.name!r} is {joint.kind} and does not carry the "
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
        """Return it with a prefix before the name of every link, joint and tendon.

        Raises:
            RobotError: If a name becomes too long.
        """
        if not prefix:
            return self
        named = replace(
            self,
            root=prefix + self.root,
            links=tuple(replace(link, name=prefix + link.name) for link in self.links),
            joints=tuple(
                replace(
                    one,
                    name=prefix + one.name,
                    parent=prefix + one.parent,
                    child=prefix + one.child,
                    coupling=one.coupling and one.coupling.prefixed(prefix),
                )
                for one in self.joints
            ),
            tendons={
                prefix + name: one._replace(
                    arms={prefix + joint: arm for joint, arm in one.arms.items()}
                )
                for name, one in self.tendons.items()
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
            lacking={prefix + name: words for name, words in self.lacking.items()},
        )
        named.check()
        return named

    def check(self) -> None:
        """Refuse names that are too long, and figures that are none.

        Raises:
            RobotError: There are.
        """
        check_name_lengths(self.label, "link", (link.name for link in self.links))
        check_name_lengths(self.label, "joint", (joint.name for joint in self.joints))
        check_name_lengths(self.label, "tendon", self.tendons)
        for link in self.links:
            poses = [one.T_link_shape for one in (*link.collisions, *link.visuals)]
            figures = [link.mass, link.center_of_mass, link.inertia, *poses]
            _check_figures(f"{self.label}: link {link.name!r}", figures)
        for joint in self.joints:
            figures = [joint.T_parent_joint, joint.axis, joint.rotor_inertia]
            _check_figures(f"{self.label}: joint {joint.name!r}", figures)


def _check_figures(where: str, figures: Iterable[FloatArray | float]) -> None:
    values = np.concatenate([np.ravel(one) for one in figures])
    wrong = values[~(np.abs(values) <= LARGEST_LENGTH)]
    if len(wrong):
        raise RobotError(
            f"{where} has the figure {wrong[0]:g}; it must be within ±{LARGEST_LENGTH:g}"
        )


def limit_of(value: float) -> float:
    """Return a limit of a file, infinite where it is too far to be one."""
    return float(np.copysign(np.inf, value)) if abs(value) > _UNLIMITED else value


def check_name_lengths(label: str, kind: str, names: Iterable[str]) -> None:
    """Refuse names that are too long.

    Args:
        label: The file, for messages.
        kind: What they are names of.
        names: The names.

    Raises:
        RobotError: One is.
    """
    for name in names:
        if fault := fault_of_name(name):
            raise RobotError(f"{label}: a <{kind}> {fault}, its hand's prefix included")


def root_of_tree(
    label: str, links: Sequence[str], joints: Sequence[str], ends: Sequence[tuple[str, str]]
) -> str:
    """Return the link that is nobody's child.

    Args:
        label: The file, for messages.
        links: Names of the links.
        joints: Names of the joints.
        ends: The links at each joint's ends, parent and child.

    Raises:
        RobotError: If there are more links than any robot has, a name is too long, missing or twice
            there, a joint hangs on no link, or the links form no tree, or one that is too deep.
    """
    if len(links) > MOST_LINKS:
        raise RobotError(
            f"{label}: has more than {MOST_LINKS} links, the most that a robot may have"
        )
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
    for joint, both in zip(joints, ends, strict=True):
        for end, link in zip(("parent", "child"), both, strict=True):
            if link not in known:
                raise RobotError(
                    f"{label}: joint {joint!r} names the {end} link {link or None!r}, "
                    "which does not exist"
                )
    for link, count in Counter(children).items():
        if count > 1:
            raise RobotError(f"{label}: link {link!r} is the child of two joints")
    roots = sorted(known - set(children))
    if len(roots) != 1:
        found = ", ".join(roots) if roots else "none (the links form a loop)"
        raise RobotError(f"{label}: a robot has one root link, found {found}")
    _check_chains(label, roots[0], ends)
    return roots[0]


def _check_chains(label: str, top: str, ends: Iterable[tuple[str, str]]) -> None:
    """Refuse a chain of more joints than any robot has, and links that do not hang on the root."""
    below: dict[str, list[str]] = {}
    for parent, child in ends:
        below.setdefault(parent, []).append(child)
    level, reached = [top], {top}
    for _ in range(LONGEST_CHAIN + 1):
        level = [child for link in level for child in below.get(link, ())]
        reached.update(level)
        if not level:
            apart = sorted({child for _, child in ends} - reached)
            if apart:
                raise RobotError(
                    f"{label}: the root link is {top!r}, and what does not hang on it hangs on a "
                    f"loop of joints: {first_of(apart, _MOST_PLACES)}; correct their parents"
                )
            return
    raise RobotError(
        f"{label}: more than {LONGEST_CHAIN} joints follow each other down to link {level[0]!r}; "
        "no robot has so many"
    )


def links_below(
    label: str, links: Iterable[str], ends: Sequence[tuple[str, str]], top: str
) -> set[str]:
    """Return a link and all that hangs on it.

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
    kept = {top}
    while below := {child for parent, child in ends if parent in kept} - kept:
        kept |= below
    return kept


_MOST_PLACES = 3
"""That a message names, of those where a mesh was looked for."""
_ALIKE = 0.75
"""How much names of files are, of which one was probably meant."""
FLATNESS = 1e-7
"""Thickness over length below which a mesh (single-precision vertices) has no volume."""


NEEDED_SCALE = 'needs scale="0.001 0.001 0.001" in the URDF'
"""What a mesh in millimetres needs."""


def load_link_mesh(label: str, link: str, mesh: LinkMesh) -> trimesh.Trimesh:
    """Read a link's collision mesh in metres; do not change what is returned.

    Args:
        label: The robot's file, for the message.
        link: The link.
        mesh: The mesh.

    Raises:
        MeshError: If it is missing or cannot be read.
    """
    if mesh.file is None:
        raise MeshError(
            f"{label}: link {link!r} needs the collision mesh {mesh.written!r}, which is missing "
            f"(looked for {looked_for(mesh)}); {what_to_do(mesh)}"
        )
    try:
        return scaled_mesh(mesh.file, mesh.scale, upright=False)
    except MeshError as error:
        raise MeshError(
            f"{label}: the collision mesh {mesh.file} of link {link!r}: {error}"
        ) from error


def looked_for(mesh: LinkMesh) -> str:
    """Return where a mesh was looked for, in words: the likeliest places."""
    return first_of([*map(str, mesh.looked)], _MOST_PLACES) or "nowhere"


def what_to_do(mesh: LinkMesh) -> str:
    """Return what to do about a mesh that is missing: the name that was probably meant, if any."""
    # Of each place what is not there: folders and the file; and the folder that holds them not.
    missing: list[tuple[tuple[str, ...], Path]] = []
    for place in mesh.looked:
        with suppress(OSError, ValueError):  # no file can have such a name
            folder = next(one for one in place.parents if one.is_dir())
            missing.append((place.relative_to(folder).parts, folder))
    for parts, folder in sorted(missing, key=lambda one: len(one[0])):
        with suppress(OSError):  # a folder that nobody may look into
            is_folder = len(parts) > 1
            known = [item.name for item in folder.iterdir() if item.is_dir() == is_folder]
            if nearest := nearest_name(parts[0], known, _ALIKE):
                return f"did you mean {nearest!r}?"
    scheme, _, address = mesh.written.partition("://")
    package = Path(address).parts
    if scheme == "package" and not any(len(parts) < len(package) for parts, _ in missing):
        return "give package_dirs, the folder that holds the package"
    return "put the file there or correct the path"


def is_flat(vertices: FloatArray) -> bool:
    """Return whether (V, 3) vertices lie in one plane; coal would crash on their hull."""
    extents = np.linalg.svd(vertices - vertices.mean(axis=0), compute_uv=False)
    return len(extents) < 3 or bool(extents[2] <= FLATNESS * extents[0])
