"""The joint feedback that a robot runs in addition to constant torques.

Records of small motions about rest under it: their growth, and proofs that none grows.
"""

from __future__ import annotations

import reprlib
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from math import nan

import numpy as np

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, real_number
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.records import Record
from graspless_pin.suggestions import names_in_words

DAMPING, ARMATURE = 0.02, 1e-4
"""Defaults of each joint, N m s/rad and kg m^2."""
LEVER = 0.1
"""m: gains per radian are divided by its square for joints that slide."""


class Feedback(StrEnum):
    """Kinds of controllers without gains. See the example of `Controller`."""

    ANY = "any"
    """Not decided: verdicts tell the least stiffness that is needed."""
    TORQUE = "torque"
    """None: the torques are constant."""
    POSITION = "position"
    """Joints keep their positions, whatever torques that takes."""


CONSTANT_TORQUES = "constant torques"
"""Name of a controller without feedback, in sentences."""
JOINTS_HELD = "joints held in their positions"
"""Name of a controller that keeps positions, in sentences."""
TORQUES_OF_HELD_JOINTS = (
    "Joints hold their positions with whatever torques this requires. The torques below balance "
    "the load, but others may occur; no verdict relies on them."
)
"""Note on torques that are worked out for joints that keep their positions."""
_MOST_NAMED = 3
_MOST_GAINS = 3
_WORDS = "or one of 'torque', 'position' and 'any'"


@dataclass(frozen=True)
class Controller:
    """Feed-forward torques with position feedback: tau = tau* + K (q_0 - q) - D q'.

    Gains are given for all joints alike, or by the names of joints and fingers, with those of all
    others under ``default``. Gains of fingers and of all joints are per radian, and divided by the
    square of `LEVER` for joints that slide; those of a joint are in its own unit.

    Attributes:
        stiffness: K, N m/rad (N/m for a joint that slides), or a `Feedback`; kept as a number where
            the torques are constant.
        damping: D, of the joints' own friction and the motors', too, N m s/rad (N s/m).

    Raises:
        ArgumentError: If a gain is negative or no number.

    Examples:
        >>> from graspless_pin import Controller, load_scene
        >>> scene = load_scene("examples/allegro_sphere_on_slope.yaml")
        >>> torques = scene.solve().torques
        >>> str(scene.with_changes(controller=Controller(2.0)).stability(torques).holding)
        'holds'
        >>> str(scene.with_changes(controller=Controller(0.1)).stability(torques).holding)
        'needs_feedback'
    """

    stiffness: float | Mapping[str, float] | Feedback | str = Feedback.ANY
    damping: float | Mapping[str, float] = DAMPING

    def __post_init__(self) -> None:
        """Check the gains."""
        for name in ("stiffness", "damping"):
            given = getattr(self, name)
            if isinstance(given, str) and name == "stiffness":
                if given not in Feedback.__members__.values():
                    raise ArgumentError(
                        name, f"found {reprlib.repr(given)}; needs a number (N m/rad) {_WORDS}"
                    )
                kind = Feedback(given)
                object.__setattr__(self, name, 0.0 if kind is Feedback.TORQUE else kind)
            elif isinstance(given, Mapping):
                checked = {str(key): real_number(f"{name}[{key}]", value, 0.0)
                           for key, value in given.items()}  # fmt: skip
                object.__setattr__(self, name, checked)
            else:
                object.__setattr__(self, name, real_number(name, given, 0.0))

    @classmethod
    def parse(cls, name: str, given: object) -> Controller:
        """Return a given controller, or one with a given stiffness of all joints.

        Raises:
            ArgumentError: If it is neither.
        """
        if isinstance(given, Controller):
            return given
        if isinstance(given, int | float) and not isinstance(given, bool):
            return cls(given)
        if isinstance(given, str) and given in Feedback.__members__.values():
            return cls(given)
        raise ArgumentError(
            name,
            f"found {reprlib.repr(given)}; needs a Controller, e.g. Controller(stiffness=2.0), a "
            f"stiffness of all joints (N m/rad) {_WORDS}",
        )

    @property
    def is_given(self) -> bool:
        """Whether gains or a mode are given: otherwise verdicts tell the stiffness needed."""
        return self.stiffness is not Feedback.ANY

    @property
    def holds_joints(self) -> bool:
        """Whether joints keep their positions, whatever torques that takes."""
        return self.stiffness is Feedback.POSITION

    def check(self, joints: Sequence[str], fingers: Sequence[str]) -> None:
        """Refuse gains of unknown joints and fingers.

        Raises:
            ArgumentError: Naming the key.
        """
        for name in ("stiffness", "damping"):
            given = getattr(self, name)
            known = [*joints, *fingers, DEFAULT_GAIN]
            for key in given if isinstance(given, Mapping) else ():
                if key not in known:
                    raise ArgumentError(
                        f"{name}.{key}", f"is not a joint or finger; {names_in_words(key, known)}"
                    )

    def gains(
        self, joints: Sequence[str], shares: FloatArray, fingers: Mapping[str, str]
    ) -> tuple[FloatArray, FloatArray]:
        """Return K and D of some joints, each (c,), in their units; K is zero if it has no gains.

        Args:
            joints: Their names.
            shares: (c,) see `gain_shares`.
            fingers: The finger of each joint that belongs to one.
        """

        def of(given: float | Mapping[str, float] | str, otherwise: float) -> FloatArray:
            if isinstance(given, str):
                return np.zeros(len(shares))
            if not isinstance(given, Mapping):
                return float(given) * shares
            rest = given.get(DEFAULT_GAIN, otherwise)
            return np.array(
                [
                    given.get(name, share * given.get(fingers.get(name, ""), rest))
                    for name, share in zip(joints, shares.tolist(), strict=True)
                ]
            )

        return of(self.stiffness, 0.0), of(self.damping, DAMPING)


def gain_shares(slides: Sequence[bool]) -> FloatArray:
    """Return (c,) factors on gains per radian: 1 for joints that turn, 100 for those that slide."""
    return np.where(np.array(slides, dtype=bool), 1.0 / LEVER**2, 1.0)


def gain_words(
    gains: Sequence[float], unit: str, joints: Sequence[str], fingers: Mapping[str, str]
) -> str:
    """Return the gains of some joints in words; empty: none is positive.

    Fingers are named where all of their joints have the same gain, else joints.

    Args:
        gains: Their gains in one unit.
        unit: The unit.
        joints: Their names.
        fingers: The finger of each joint that belongs to one.
    """
    by_gain: dict[str, list[str]] = {}
    for name, gain in sorted(zip(joints, gains, strict=True), key=lambda one: one[1]):
        by_gain.setdefault(f"{gain:g}", []).append(name)
    by_gain |= {"0": by_gain.pop("0")} if "0" in by_gain else {}
    if [*by_gain] in ([], ["0"]):
        return ""
    if len(by_gain) == 1:
        return f"joint feedback of {next(iter(by_gain))} {unit}"
    parts = [
        f"{f'{gain} {unit}' if gain != '0' else 'none'} at {_joint_words(names, joints, fingers)}"
        for gain, names in by_gain.items()
    ]
    if len(parts) > _MOST_GAINS:
        parts = [f"{parts[0]} to {parts[-1 - ('0' in by_gain)]}", *parts[-1:][: "0" in by_gain]]
    return f"joint feedback of {', '.join(parts)}"


def _joint_words(names: Sequence[str], joints: Sequence[str], fingers: Mapping[str, str]) -> str:
    """Return some joints in words; a finger is named where all of its joints are among them."""
    partial = {fingers.get(name, "") for name in joints if name not in names} | {""}
    whole = {fingers[name]: None for name in names if fingers.get(name, "") not in partial}
    parts = [*whole, *(name for name in names if fingers.get(name) not in whole)]
    return first_few([*map(repr, parts)])


def first_few(names: Sequence[str]) -> str:
    """Return the names in one line, at most the first three."""
    return ", ".join(names[:_MOST_NAMED]) + (", ..." if len(names) > _MOST_NAMED else "")


@dataclass(frozen=True, eq=False)
class GrowthProof(Record):
    """Small motions z about a rest, and a proof that none grows faster than a rate.

    M_z z'' + D_z z' + (K_geo + N_q^T K N_q) z = 0 with M_z = N^T (M + rotors) N, D_z = N_q^T D N_q;
    see `holding.small_motions`.

    Attributes:
        velocities: (P + L, d) N: motions without slip at contacts that bear any load.
        forces: (M, 3) of a rest in which all contacts that can do so bear load, N, world axes.
        geometric_stiffness: (d, d) K_geo, under the worst admissible contact forces as found.
        joints: c columns of the joints that carry touching links: N_q is their rows of N.
        gains: (c,) K, N m/rad (N/m).
        damping: (c,) D, N m s/rad (N s/m).
        rotors: (c,) inertia of rotors that was added, kg m^2 (kg).
        rate: 1/s.
        lyapunov: (2d, 2d) P > 0 with A^T P + P A <= 2 rate P, in coordinates in which M_z is one
            and time counts in one over the fastest frequency; see `scaled_system`.
    """

    velocities: FloatArray
    forces: FloatArray
    geometric_stiffness: FloatArray
    joints: tuple[int, ...]
    gains: FloatArray
    damping: FloatArray
    rotors: FloatArray
    rate: float
    lyapunov: FloatArray


@dataclass(frozen=True, eq=False)
class SmallMotions(Record):
    """Growth of small motions about a rest under the controller, to second order.

    Slips and separations are not part of it: the verdict itself is about them.

    Attributes:
        stiffness: The least feedback at each joint with which none grows, and with no larger one
            that is `stable`, N m/rad (N/m where all joints slide); 0: none grows without; inf: no
            feedback is enough; NaN: it is not known.
        growth: Rate of the one that grows fastest under the controller, 1/s; 0: none grows faster
            than `small_motions.GROWTH_LIMIT`; NaN as above.
        unit: Of the stiffness.
        moving: That motion in words, such as "the fingers buckle"; empty: none grows.
        unknown: Why nothing is known; empty: it is known.
        growth_by_surface: See `MinimumStiffness`; empty where no mesh touches.
        motion: (P + L,) the velocity of the one that grows fastest; None: none grows.
        neutral: Marginally stable motions, in words.
        least_growth: Least growth found over all contact forces that the torques leave open; NaN as
            above.
        stable: All feedback with which none grows, (low, high) each, ascending, in that unit; the
            last high is inf where none grows with any larger one.
        proofs: Proofs that none grows, by model of the surfaces; empty: one does, or it is not
            known.
        assumed: See `MinimumStiffness`.
    """

    stiffness: float
    growth: float
    unit: str = ""
    moving: str = ""
    unknown: str = ""
    growth_by_surface: Mapping[str, float] = field(default_factory=dict)
    motion: FloatArray | None = None
    neutral: tuple[str, ...] = ()
    least_growth: float = nan
    stable: tuple[tuple[float, float], ...] = ()
    proofs: Mapping[str, GrowthProof] = field(default_factory=dict)
    assumed: tuple[int, ...] = ()

    @property
    def depends_on_forces(self) -> bool:
        """Whether some admissible contact forces let a motion grow, and others none."""
        return self.growth > 0.0 and self.least_growth == 0.0

    @classmethod
    def not_known(cls, why: str) -> SmallMotions:
        """Return a record without figures, with the reason why they are not known."""
        return cls(nan, nan, unknown=why)
