"""What is said of rest that is proven, and of a hand that does not rest while the object does."""

from __future__ import annotations

import re
from collections.abc import Mapping
from math import ceil, floor, isinf, log10

import numpy as np

from graspless_pin.holding.verdict import StabilityVerdict

_NOTICED = 0.2
"""Of the torque that is left over most: joints with less are not named."""
_MOST_NAMED = 3


def parted(said: str) -> tuple[str, str]:
    """Return what a verdict leads with, such as "holds", and what it goes on with."""
    lead, *rest = re.split("[:;] ", said, maxsplit=1)
    return lead, "".join(rest)


def strong_words(verdict: StabilityVerdict) -> str:
    """Return what a strong verdict says: its proof is of the first instant, rest has to last."""
    count, free, small = verdict.programs, verdict.free_motions, verdict.small_motions
    proof = f"{count} LP{'s' if count != 1 else ''}"
    feedback = f"; needs position feedback: {free} free motion{'s' if free != 1 else ''}"
    if verdict.problem.is_sliding.any():
        said = f"keeps its motion: nothing else is an outcome (proof: {proof})"
        return said + (feedback if free else "")
    if small is None or small.unknown:
        why = "not looked at" if small is None else small.unknown
        said = f"stays at the first instant; small motions not known: {why} (proof: {proof})"
        return said + (feedback if free else "")
    if not small.moving:
        return f"holds: the object provably stays at rest ({proof}); no small motion grows"
    grows = f"{small.moving}, growing at {_rounded(small.growth):g} /s"
    if isinf(small.stiffness):
        said = f"stays at the first instant; then {grows}: no joint feedback stops it"
        return f"{said} (proof: {proof})"
    least = _rounded(small.stiffness, up=True)
    return (
        f"holds with joint feedback of at least {least:g} {small.unit}; without it {grows} "
        f"(first instant: {proof})"
    )


def finger_words(verdict: StabilityVerdict, fingers: Mapping[str, str]) -> str:
    """Return what a verdict says whose motion is one of joints alone.

    Args:
        verdict: The verdict; `moves` is ``finger``.
        fingers: The finger of a joint by the joint's name, where it is known.
    """
    problem, motion = verdict.problem, verdict.motion
    left = np.zeros(problem.joint_count)
    if motion is not None and problem.joint_inertia is not None:
        left = np.abs(problem.joint_inertia @ motion.joint_accelerations)
    moving = np.flatnonzero(left >= _NOTICED * left.max(initial=0.0))
    most = int(np.argmax(left))
    names = [problem.joint_names[joint] for joint in moving]
    of = sorted({fingers[name] for name in names if name in fingers})
    kind, who = ("finger", of) if of else ("joint", names)
    told = ", ".join(map(repr, who[:_MOST_NAMED])) + (", ..." if len(who) > _MOST_NAMED else "")
    moves = f"{kind} {told} moves by itself"
    if len(who) > 1:
        moves = f"{kind}s {told} move by themselves"
    borne = "weight and contact forces" if problem.jacobian[:, moving].any() else "weight"
    rest = f"{_rounded(float(left[most])):g} {problem.joint_units[most]}"
    return (
        f"fails: {moves}: torques do not balance {borne}, {rest} are left over at joint "
        f"{problem.joint_names[most]!r}; the object stays in this outcome, which is not proven to "
        "be the only one"
    )


def _rounded(value: float, *, up: bool = False) -> float:
    """Return two digits of a figure."""
    if value <= 0.0:
        return value
    unit = 10.0 ** (floor(log10(value)) - 1)
    return float(f"{(ceil if up else round)(value / unit * (1.0 - 1e-9)) * unit:.2g}")
