"""Findings: records of what looks wrong without being an error.

Findings are emitted: inside `capture` they are collected, else they become Python warnings.
"""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import asdict, dataclass
from enum import StrEnum
from typing import Any, Self

from graspless_pin.errors import GrasplessPinWarning


class Severity(StrEnum):
    """The severity of a finding, the gravest first. See the example of `Finding`."""

    SERIOUS = "serious"
    """The scene is not the intended one, or cannot exist as it is described."""
    WARNING = "warning"
    """The answer may depend on it."""
    NOTE = "note"
    """Useful to know."""


class FindingCode(StrEnum):
    """Kinds of findings; `docs/troubleshooting.md` has remedies. See the example of `Finding`."""

    severity: Severity

    def __new__(cls, value: str, severity: Severity) -> Self:
        """Create a member from its value and its severity."""
        member = str.__new__(cls, value)
        member._value_ = value
        member.severity = severity
        return member

    UNREADABLE = "unreadable", Severity.SERIOUS
    MISSING_MESH = "missing-collision-mesh", Severity.SERIOUS
    UNUSABLE_MESH = "unusable-mesh", Severity.SERIOUS
    NO_SHAPES = "hand-without-shapes", Severity.SERIOUS
    HAND_TOUCHES_NOTHING = "hand-touches-nothing", Severity.SERIOUS
    HAND_THROUGH_SUPPORT = "hand-through-support", Severity.SERIOUS
    HAND_THROUGH_ITSELF = "hand-through-itself", Severity.SERIOUS
    NORMAL_POINTS_OUT = "normal-points-out", Severity.SERIOUS
    NO_MOTORS = "no-motors", Severity.SERIOUS
    NO_TORQUE_COUNTS = "no-torque-counts", Severity.WARNING
    CONTACT_OFF_SURFACE = "contact-off-surface", Severity.WARNING
    SUPPORT_MISSED = "support-missed", Severity.WARNING
    FINGER_MISSED = "finger-missed", Severity.WARNING
    DEEP_OVERLAP = "deep-overlap", Severity.WARNING
    UNEVEN_GAPS = "uneven-gaps", Severity.WARNING
    ANGLE_IN_DEGREES = "angle-in-degrees", Severity.WARNING
    ANGLE_IN_RADIANS = "angle-in-radians", Severity.WARNING
    UNLIKELY_SIZE = "unlikely-size", Severity.WARNING
    UNLIKELY_DENSITY = "unlikely-density", Severity.WARNING
    UNLIKELY_INERTIA = "unlikely-inertia", Severity.WARNING
    CENTER_OUTSIDE = "center-of-mass-outside", Severity.WARNING
    UNLIKELY_LOAD = "unlikely-load", Severity.WARNING
    UNLIKELY_GRAVITY = "unlikely-gravity", Severity.WARNING
    STEEP_FRICTION = "steep-friction", Severity.WARNING
    DANGLING_MIMIC = "dangling-mimic", Severity.WARNING
    CONTRADICTING_LIMITS = "contradicting-limits", Severity.WARNING
    PLACEHOLDER_EFFORT = "placeholder-effort", Severity.WARNING
    UNKNOWN_EFFORT = "unknown-effort", Severity.WARNING
    SHARED_TENDON = "tendon-without-limits", Severity.WARNING
    LEFT_OUT_SPRINGS = "springs-left-out", Severity.WARNING
    LEFT_OUT_OF_MJCF = "left-out-of-mjcf", Severity.WARNING
    PLACEHOLDER_FORCE = "placeholder-force", Severity.WARNING
    MESH_SCALE = "mesh-scale", Severity.WARNING
    OPEN_MESH = "open-mesh", Severity.WARNING
    SIMPLIFIED_HULL = "simplified-hull", Severity.NOTE
    EMPTY_SHAPE = "empty-shape", Severity.WARNING
    HOLLOW_MESH = "hollow-mesh", Severity.NOTE
    NO_COLLISION = "no-collision-geometry", Severity.WARNING
    MISSPELT_MATERIAL = "misspelt-material", Severity.WARNING
    UNUSED_MATERIALS = "unused-materials", Severity.WARNING
    LOAD_TOO_LARGE = "load-too-large", Severity.WARNING
    NO_RESERVE = "no-reserve", Severity.WARNING
    NOT_OPTIMAL = "not-proven-optimal", Severity.WARNING
    THRESHOLD = "depends-on-threshold", Severity.WARNING
    IDLE_MOUNT = "mount-touches-nothing", Severity.NOTE
    NO_SUPPORT_TOUCHES = "no-support-touches", Severity.NOTE
    QUATERNION_ORDER = "quaternion-order", Severity.NOTE
    AMBIGUOUS_NORMAL = "ambiguous-normal", Severity.NOTE
    NEUTRAL_OUTSIDE = "neutral-outside-limits", Severity.NOTE
    WEIGHTLESS_LINK = "weightless-link", Severity.NOTE
    LOCKED_JOINT = "joint-without-travel", Severity.NOTE
    MISSING_VISUAL = "missing-visual-mesh", Severity.NOTE
    MESH_AXES = "mesh-axes", Severity.NOTE
    RELATIVE_MESH = "relative-mesh-path", Severity.NOTE
    READER_REMARK = "reader-remark", Severity.NOTE
    NO_CACHE = "no-cache", Severity.NOTE
    UNUSED_OPTION = "unused-option", Severity.NOTE
    NO_VIDEO = "no-video", Severity.WARNING

    @property
    def words(self) -> str:
        """The code as words, without hyphens."""
        return self.replace("-", " ")


@dataclass(frozen=True)
class Finding:
    """A fault, or what looks like one, with advice.

    Examples:
        >>> from graspless_pin import load_scene
        >>> scene = load_scene("examples/box_between_walls.yaml").with_changes(friction=80)
        >>> found = scene.findings[0]
        >>> print(found.severity, found.code, found.message, sep="; ")
        warning; steep-friction; the coefficient of friction 80 (default) is above 3

    Attributes:
        code: Its kind.
        subject: Name of the body, joint, link or file that it is about.
        message: What was found.
        advice: What to do.
        key: Its key in the scene file, such as ``("supports", 0, "pose")``; empty: none.
        place: The file's name, line and key, if known.
    """

    code: FindingCode
    subject: str
    message: str
    advice: str
    key: tuple[str | int, ...] = ()
    place: str = ""

    @property
    def severity(self) -> Severity:
        """Severity of its code."""
        return self.code.severity

    def __str__(self) -> str:
        """Return its place, message and advice."""
        place = f"{self.place}: " if self.place else ""
        return f"{place}{self.message}; {self.advice}"


_UNITS = frozenset({
    FindingCode.ANGLE_IN_DEGREES, FindingCode.ANGLE_IN_RADIANS, FindingCode.UNLIKELY_SIZE,
    FindingCode.UNLIKELY_DENSITY, FindingCode.UNLIKELY_INERTIA, FindingCode.UNLIKELY_GRAVITY,
    FindingCode.MESH_SCALE,
})  # fmt: skip
"""Findings that are usually caused by a figure in a wrong unit."""


def causes_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return distinct findings in the order in which to handle them.

    Wrong units come first: they often cause the others. All others are in the order of severity,
    then of their codes.
    """
    codes, severities = list(FindingCode), list(Severity)
    distinct = dict.fromkeys(findings)

    def rank(item: Finding) -> tuple[bool, int, int]:
        return item.code not in _UNITS, severities.index(item.severity), codes.index(item.code)

    return tuple(sorted(distinct, key=rank))


def is_serious(findings: Iterable[Finding]) -> bool:
    """Return whether any finding is serious."""
    return any(finding.severity is Severity.SERIOUS for finding in findings)


def plain_findings(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as plain data, for documents."""
    return [{**asdict(one), "severity": one.severity, "key": list(one.key)} for one in findings]


_LISTENER: ContextVar[list[Finding] | None] = ContextVar("listener", default=None)


def emit(*findings: Finding) -> None:
    """Emit findings to the innermost `capture`, else as Python warnings.

    Warns:
        GrasplessPinWarning: Outside any `capture`; the warning has the finding.
    """
    listener = _LISTENER.get()
    for finding in findings:
        if listener is not None:
            listener.append(finding)
        else:
            warnings.warn(GrasplessPinWarning(finding), stacklevel=3)


@contextmanager
def capture() -> Iterator[list[Finding]]:
    """Collect the findings emitted in the block, in this thread; none becomes a warning."""
    found: list[Finding] = []
    token = _LISTENER.set(found)
    try:
        yield found
    finally:
        _LISTENER.reset(token)
