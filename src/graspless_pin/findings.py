"""What is wrong without being an error: one record for it, from wherever it is found.

What is found is emitted: inside `capture` it is kept, else it becomes a Python warning.
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
    """How much a finding weighs, the gravest first. See the example of `Finding`."""

    SERIOUS = "serious"
    """The answer is not one to the question that was meant, or the scene cannot be set up so."""
    WARNING = "warning"
    """The answer may hang on it."""
    NOTE = "note"
    """Worth to know."""


class FindingCode(StrEnum):
    """What can be found; `docs/troubleshooting.md` has the cures. See the example of `Finding`."""

    severity: Severity

    def __new__(cls, value: str, severity: Severity) -> Self:
        """Make a member of its value and its severity."""
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
    THRESHOLD = "hangs-on-threshold", Severity.WARNING
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
        """The code in words."""
        return self.replace("-", " ")


@dataclass(frozen=True)
class Finding:
    """Something that is wrong, or looks so, with what to do about it.

    Examples:
        >>> from graspless_pin import load_scene
        >>> scene = load_scene("examples/box_between_walls.yaml").with_changes(friction=80)
        >>> found = scene.findings[0]
        >>> print(found.severity, found.code, found.message, sep="; ")
        warning; steep-friction; the coefficient of friction 80 (default) is above 3

    Attributes:
        code: What it is.
        subject: Name of the body, joint, link or file that it is about.
        message: What was found.
        advice: What to do.
        key: Where the scene file says it, such as ``("supports", 0, "pose")``; empty: nowhere.
        place: The file's name, line and key, where it is known.
    """

    code: FindingCode
    subject: str
    message: str
    advice: str
    key: tuple[str | int, ...] = ()
    place: str = ""

    @property
    def severity(self) -> Severity:
        """How much it weighs."""
        return self.code.severity

    def __str__(self) -> str:
        """Return where it is, what was found and what to do."""
        place = f"{self.place}: " if self.place else ""
        return f"{place}{self.message}; {self.advice}"


_UNITS = frozenset({
    FindingCode.ANGLE_IN_DEGREES, FindingCode.ANGLE_IN_RADIANS, FindingCode.UNLIKELY_SIZE,
    FindingCode.UNLIKELY_DENSITY, FindingCode.UNLIKELY_INERTIA, FindingCode.UNLIKELY_GRAVITY,
    FindingCode.MESH_SCALE,
})  # fmt: skip
"""What is found where a figure is in another unit than was meant."""


def causes_first(findings: Iterable[Finding]) -> tuple[Finding, ...]:
    """Return findings in the order in which to look at them, each once.

    Wrong units come first: they explain what else is found. All others come by severity, then in
    the order of their codes.
    """
    codes, severities = list(FindingCode), list(Severity)
    once = dict.fromkeys(findings)

    def place(one: Finding) -> tuple[bool, int, int]:
        return one.code not in _UNITS, severities.index(one.severity), codes.index(one.code)

    return tuple(sorted(once, key=place))


def is_serious(findings: Iterable[Finding]) -> bool:
    """Return whether any of them is serious."""
    return any(one.severity is Severity.SERIOUS for one in findings)


def plain_findings(findings: Iterable[Finding]) -> list[dict[str, Any]]:
    """Return findings as plain data, for documents."""
    return [{**asdict(one), "severity": one.severity, "key": list(one.key)} for one in findings]


_LISTENER: ContextVar[list[Finding] | None] = ContextVar("listener", default=None)


def emit(*findings: Finding) -> None:
    """Pass on what was found: to the innermost `capture`, else as Python warnings.

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
    """Collect what is emitted inside, in this thread; nothing of it becomes a warning."""
    found: list[Finding] = []
    token = _LISTENER.set(found)
    try:
        yield found
    finally:
        _LISTENER.reset(token)
