"""Verdicts in words: one sentence about the proof, and whether rest lasts."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from math import ceil, floor, inf, isinf, log10
from types import MappingProxyType

import numpy as np

from graspless_pin.holding.controller import SmallMotions, first_few
from graspless_pin.holding.verdict import StabilityVerdict

NO_FINGERS: Mapping[str, str] = MappingProxyType({})
_NAMED_TORQUE = 0.2
"""Share of the largest unbalanced torque below which a joint is not named."""
_SAME_GROWTH = 2.0
"""Factor up to which growth rates on both models of a mesh count as the same."""


def lead_and_words(message: str) -> tuple[str, str]:
    """Return the first words of a verdict's message, such as "holds", and the rest of it."""
    lead, *rest = re.split("[:;] ", message, maxsplit=1)
    return lead, "".join(rest)


def strong_words(verdict: StabilityVerdict, fingers: Mapping[str, str] = NO_FINGERS) -> str:
    """Return the message of a strong verdict: the proof of the first instant, and if rest lasts.

    Args:
        verdict: The verdict.
        fingers: The finger of a joint by the joint's name, where it is known.
    """
    return _object_words(verdict) + _leaving_words(verdict.leaving, fingers)


def _leaving_words(joints: Sequence[str], fingers: Mapping[str, str]) -> str:
    """Return in words which fingers may leave; empty: none."""
    if not joints:
        return ""
    who, several = _joints_in_words(joints, fingers)
    alone, them = ("themselves", "them") if several else ("itself", "it")
    return f"; but {who} may move away by {alone}, as friction alone keeps {them}"


def _joints_in_words(joints: Sequence[str], fingers: Mapping[str, str]) -> tuple[str, bool]:
    """Return joints in words, by their fingers where known, and whether there are several."""
    owners = sorted({fingers[name] for name in joints if name in fingers})
    kind, who = ("finger", owners) if owners else ("joint", joints)
    return f"{kind}{'s' * (len(who) > 1)} {first_few([*map(repr, who)])}", len(who) > 1


def _object_words(verdict: StabilityVerdict) -> str:
    """Return the sentence of a strong verdict about the object."""
    count, free, small = verdict.programs, verdict.free_motions, verdict.small_motions
    proof = f"{count} LP{'s' if count != 1 else ''}"
    feedback = f"; needs position feedback: {free} free motion{'s' if free != 1 else ''}"
    if verdict.problem.is_sliding.any():
        message = f"keeps its motion: nothing else is an outcome (proof: {proof})"
        return message + (feedback if free else "")
    if small is None or small.unknown:
        why = "not examined" if small is None else small.unknown
        message = f"stays at the first instant; small motions not known: {why} (proof: {proof})"
        return message + (feedback if free else "")
    return _lasting_words(verdict, small, proof) + _assumed_words(small)


def _lasting_words(verdict: StabilityVerdict, small: SmallMotions, proof: str) -> str:
    """Return in words whether rest lasts after the first instant."""
    if not small.moving:
        under = f" with {verdict.controller}" if verdict.controller else ""
        lead = "stays" if verdict.leaving else "holds"
        neutral = f"; neutral: {', '.join(small.neutral)}" if small.neutral else ""
        return (
            f"{lead}{under}: the object provably stays at rest ({proof}); no small motion grows"
            f"{neutral}"
        )
    grows = f"{small.moving}, growing at {_two_digits(small.growth):g} /s{_surface_words(small)}"
    needed = f"joint feedback of {_stable_words(small)}"
    stops = "no joint feedback stops it" if isinf(small.stiffness) else f"{needed} stops it"
    if small.depends_on_forces:
        under = f"with {verdict.controller} " if verdict.controller else ""
        return (
            f"may fail: {under}torques leave contact forces open, and under some of them {grows}; "
            f"{stops} (first instant: {proof})"
        )
    if isinf(small.stiffness):
        return f"stays at the first instant; then {grows}: {stops} (proof: {proof})"
    without = f"with {verdict.controller}" if verdict.controller else "without it"
    return f"needs {needed}; {without} {grows} (first instant: {proof})"


def _assumed_words(small: SmallMotions) -> str:
    """Return in words at which contacts the rolling of the bodies is assumed; empty: at none."""
    if not small.assumed:
        return ""
    listed = first_few([*map(str, small.assumed)])
    whose = f"s {listed} have" if len(small.assumed) > 1 else f" {listed} has"
    return f"; assumed: contact{whose} a point that stays on both bodies, as no shapes touch there"


def _stable_words(small: SmallMotions) -> str:
    """Return the stabilising feedback in words, such as "at least 2 N m/rad"."""
    parts = []
    for low, high in small.stable or ((small.stiffness, inf),):
        least, most = f"{_two_digits(low, up=True):g}", f"{_two_digits(high):g}"
        if isinf(high):
            parts.append(f"at least {least}")
        else:
            parts.append(f"{least} to {most}" if low > 0.0 else f"at most {most}")
    return f"{' or '.join(parts)} {small.unit}"


def _surface_words(small: SmallMotions) -> str:
    """Return in words how growth depends on the model of a mesh's surface; empty: little."""
    rates = small.growth_by_surface
    if not rates or min(rates.values()) * _SAME_GROWTH >= max(rates.values()):
        return ""
    facets, fitted = (_two_digits(rates[name]) for name in ("facets", "fitted"))
    return f" (on a mesh's facets {facets:g} /s, on a smooth surface fitted to them {fitted:g} /s)"


def finger_words(verdict: StabilityVerdict, fingers: Mapping[str, str]) -> str:
    """Return the message of a verdict whose motion is one of joints alone.

    Args:
        verdict: The verdict; `moves` is ``finger``.
        fingers: The finger of a joint by the joint's name, where it is known.
    """
    problem, motion = verdict.problem, verdict.motion
    unbalanced = np.zeros(problem.joint_count)
    if motion is not None and problem.joint_inertia is not None:
        unbalanced = np.abs(problem.joint_inertia @ motion.joint_accelerations)
    moving = np.flatnonzero(unbalanced >= _NAMED_TORQUE * unbalanced.max(initial=0.0))
    most = int(np.argmax(unbalanced))
    who, several = _joints_in_words([problem.joint_names[joint] for joint in moving], fingers)
    moves = f"{who} {'move by themselves' if several else 'moves by itself'}"
    loads = "weight and contact forces" if problem.jacobian[:, moving].any() else "weight"
    rest = f"{_two_digits(float(unbalanced[most])):g} {problem.joint_units[most]}"
    return (
        f"fails: {moves}: torques do not balance {loads}, {rest} are unbalanced at joint "
        f"{problem.joint_names[most]!r}; the object stays in this outcome, which is not proven to "
        "be the only one"
    )


def _two_digits(value: float, *, up: bool = False) -> float:
    """Return a figure rounded to two digits."""
    if value <= 0.0 or isinf(value):
        return value
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{(ceil if up else round)(value / unit * (1.0 - 1e-9)) * unit:.2g}")
