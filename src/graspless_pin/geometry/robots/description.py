"""The description of a robot beyond its URDF: fingers, couplings, meshes, effort limits."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from graspless_pin.errors import RobotError
from graspless_pin.geometry.bodies.decomposition import (
    DEFAULT_CONCAVITY,
    DEFAULT_TIME_LIMIT,
    WAYS,
    Cut,
)
from graspless_pin.problem.checks import one_of, unknown_name
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.records import Brief, Record
from graspless_pin.suggestions import names_in_words


@dataclass(frozen=True)
class FingerSpec:
    """A finger. See the example of `list_robots`.

    Attributes:
        joints: Its movable joints.
        links: The links whose contacts are the finger's; empty means every link that its joints
            move.
        tip: The link at its end, if one is named.
    """

    joints: tuple[str, ...]
    links: tuple[str, ...] = ()
    tip: str | None = None


@dataclass(frozen=True)
class JointCoupling:
    """A coupled joint: ``q[joint] = sum(m * q[leader]) + offset`` (radians or metres).

    Attributes:
        joint: The joint that follows.
        follows: Multiplier m by leader; a leader may itself follow other joints.
        offset: Position of the joint when all leaders are at zero.
    """

    joint: str
    follows: Mapping[str, float]
    offset: float = 0.0

    def prefixed(self, prefix: str) -> JointCoupling:
        """Return the coupling with ``prefix`` before every joint's name."""
        leaders = {prefix + leader: factor for leader, factor in self.follows.items()}
        return JointCoupling(prefix + self.joint, leaders, self.offset)


@dataclass(frozen=True)
class LinkMeshes:
    """How the collision meshes of a robot's links are made convex.

    A decomposition takes seconds for a mesh, minutes for a hand of fine meshes; it is cached on
    disk.

    See the example of `list_robots`.

    Attributes:
        convex: ``hull`` fills all hollows; ``decompose`` cuts a mesh into convex pieces. One value
            for all links, or values by link, the others being hulls.
        concavity: For ``decompose``: largest depth of a hollow that may still be filled, as a share
            of half a mesh's largest extent, 0.01 to 1.
        decompose_time_limit: Time limit of the decomposition of each mesh, s, at most 1e6.
        max_pieces: Largest number of convex pieces of each mesh; None: no limit but the concavity.
    """

    convex: str | Mapping[str, str] = "hull"
    concavity: float = DEFAULT_CONCAVITY
    decompose_time_limit: float = DEFAULT_TIME_LIMIT
    max_pieces: int | None = None

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ArgumentError: A value is invalid or out of range.
        """
        if not isinstance(self.convex, Mapping):
            one_of(WAYS, "convex", self.convex)
        for link, word in self.convex.items() if isinstance(self.convex, Mapping) else ():
            one_of(WAYS, f"convex[{link!r}]", word)
        self._cut_settings()

    def _cut_settings(self) -> Cut:
        return Cut(self.concavity, self.decompose_time_limit, self.max_pieces)

    def cuts(self, links: Collection[str], prefix: str = "") -> dict[str, Cut]:
        """Return the settings of the decomposition by link, of the links that are decomposed.

        Args:
            links: All links that have a mesh, with the prefix.
            prefix: Prefix of every link's name.

        Raises:
            ArgumentError: If a named link is not among them.
        """
        if not isinstance(self.convex, Mapping):
            return dict.fromkeys(links if self.convex == "decompose" else (), self._cut_settings())
        for link in self.convex:
            if prefix + link not in links:
                known = [name.removeprefix(prefix) for name in links]
                raise unknown_name("convex", "link with a collision mesh", link, known)
        named = [prefix + link for link, word in self.convex.items() if word == "decompose"]
        return dict.fromkeys(named, self._cut_settings())


@dataclass(frozen=True, repr=False)
class RobotDescription(Record, Brief):
    """A robot before it is mounted: a URDF and what the URDF does not state.

    Attributes:
        name: Name in messages and tables.
        urdf_path: The URDF, xacro file or MJCF.
        package_dirs: Folders in which the URDF's ``package://`` addresses are looked up.
        root_link: The link that is mounted, with its subtree; None is the URDF's root.
        xacro_args: Values of the ``<xacro:arg>`` of a xacro file.
        srdf: Its SRDF; None: the one beside the URDF, if there is one.
        palms: The links that carry fingers; empty: found from the tree.
        fingers: Fingers by name; empty: the branches below the palms.
        couplings: Coupled joints, instead of the URDF's mimic joints of these names.
        tendons: Moment arm by joint, m, by tendon.
        effort_limits: Limit by finger, joint or tendon (N m, or N for a prismatic joint or a
            tendon): a symmetric one, or (lower, upper).
        effort_sources: Source of each of these limits.
        effort_unknown: Note on the limit by finger, joint or tendon whose real limit is unknown.
        meshes: How the collision meshes of its links are made convex.
        visuals_collide: Whether links without collision shapes collide with their visual ones.
        stiffness: Gain of position feedback, N m/rad, of all joints or by joint, finger or
            ``default``; None: not stated.
        damping: Damping gain likewise, N m s/rad.
        file: The robot file, if there is one.
        model: Name of the model of example-robot-data, if it is one.
        read: The `RobotModel` of a robot that no file describes; None: it is read from the files.
    """

    name: str
    urdf_path: Path
    package_dirs: tuple[Path, ...] = ()
    root_link: str | None = None
    xacro_args: Mapping[str, str] = field(default_factory=dict)
    srdf: Path | None = None
    palms: tuple[str, ...] = ()
    fingers: Mapping[str, FingerSpec] = field(default_factory=dict)
    couplings: tuple[JointCoupling, ...] = ()
    tendons: Mapping[str, Mapping[str, float]] = field(default_factory=dict)
    effort_limits: Mapping[str, float | tuple[float, float]] = field(default_factory=dict)
    effort_sources: Mapping[str, str] = field(default_factory=dict)
    effort_unknown: Mapping[str, str] = field(default_factory=dict)
    meshes: LinkMeshes = field(default_factory=LinkMeshes)
    visuals_collide: bool = False
    stiffness: float | Mapping[str, float] | None = None
    damping: float | Mapping[str, float] | None = None
    file: Path | None = None
    model: str | None = None
    read: Any = None

    @property
    def label(self) -> str:
        """Name of the robot in messages, with its file, if there is one."""
        name = f"robot {self.name!r}"
        return name if self.file is None else f"{self.file}: {name}"

    def check_gains(self, known: Sequence[str]) -> None:
        """Refuse gains of names that are neither joints nor fingers.

        Args:
            known: Names of joints and fingers, without a prefix.

        Raises:
            RobotError: If there is one; names file and key.
        """
        for kind in ("stiffness", "damping"):
            stated = getattr(self, kind)
            for name in stated if isinstance(stated, Mapping) else ():
                if name not in (*known, DEFAULT_GAIN):
                    raise RobotError(
                        f"{self.file}: controller.{kind}.{name}: is not a joint or finger; "
                        f"{names_in_words(name, known)}"
                    )
