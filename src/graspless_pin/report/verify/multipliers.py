"""The multipliers of a document as arrays; those that may prove nothing count as zero."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.values import array, entry, items, number, whole

_SIZED = ("normal_upper", "normal_lower", "torque_upper", "torque_lower", "share_upper",
          "share_lower")  # fmt: skip
"""Those that stand by contact or joint."""


@dataclass(frozen=True, eq=False)
class StatedMultipliers:
    """What a document states of the constraints, in the objective's unit over the constraint's own.

    Attributes:
        balance: (P,) of W f + w = 0; of any sign, all others are >= 0.
        faces: (M, r) of h^T f + e <= 0 where there is a cone; (M, 0) where these are round.
        round: (M, 3) in round cones themselves, of (mu f_n - sqrt(1 + mu^2) e, f_t) in one.
        normal_upper: (M,) of n^T f + e <= limit in Algorithm 1.
        normal_lower: (M,) of e <= n^T f in Algorithm 1 where there is no cone.
        torque_upper: (L,) of J^T f + g <= upper.
        torque_lower: (L,) of lower <= J^T f + g.
        share_upper: (L,) of J^T f + g <= t (or t times the upper limit) in Algorithm 2.
        share_lower: (L,) of -(J^T f + g) <= t (or t times minus the lower limit).
        own_upper: (q,) of the upper sides of an objective's own rows.
        own_lower: (q,) of their lower sides.
    """

    balance: np.ndarray
    faces: np.ndarray
    round: np.ndarray
    normal_upper: np.ndarray
    normal_lower: np.ndarray
    torque_upper: np.ndarray
    torque_lower: np.ndarray
    share_upper: np.ndarray
    share_lower: np.ndarray
    own_upper: np.ndarray
    own_lower: np.ndarray

    @property
    def torque(self) -> np.ndarray:
        """(L,) of each joint's torque."""
        return self.torque_upper - self.torque_lower + self.share_upper - self.share_lower


def stated_multipliers(given: object, problem: Problem, where: str) -> StatedMultipliers:
    """Return multipliers that stand in a document; those that may prove nothing count as 0.

    Raises:
        ValueError: If one is negative or something is missing.
    """
    stated, there = _stated(given, problem, where), _there(problem)
    # A first entry that is too small by a hair is taken for one that is enough.
    cones = stated["round"]
    cones[:, 0] = np.maximum(cones[:, 0], _lengths(cones[:, 1:]))
    return StatedMultipliers(
        balance=array(entry(given, "balance", where), problem.w.shape, f"balance of {where}"),
        **{key: np.where(there[key], one, 0.0) for key, one in stated.items()},
    )


def stray_multipliers(given: object, problem: Problem, where: str) -> list[str]:
    """Return the names under which multipliers stand of constraints that there are none of.

    Raises:
        ValueError: As in `stated_multipliers`.
    """
    stated, there = _stated(given, problem, where), _there(problem)
    strays = [
        key for key, one in stated.items() if one[~there[key] & np.ones_like(one, bool)].any()
    ]
    unknown = given.keys() - _names(problem) if isinstance(given, dict) else set()
    return strays + sorted(repr(key)[:40] for key in unknown)[:10]


def _stated(given: object, problem: Problem, where: str) -> dict[str, np.ndarray]:
    """Return all multipliers but those of the balance as they stand, by attribute."""
    M, L = problem.count, len(problem.units)
    faces, cones = np.zeros((M, problem.edges)), np.zeros((M, 3))
    listed: list[Any] = []
    if problem.is_round:
        cones = array(entry(given, "round_cones", where), (M, 3), f"round_cones of {where}")
    else:
        listed = items(entry(given, "faces", where), f"faces of {where}", 0, faces.size)
    for triple in listed:
        contact, face, value = items(triple, f"a face of {where}", 3, 3)
        contact = whole(contact, f"a contact of {where}", 0, M - 1)
        faces[contact, whole(face, f"a face of {where}", 0, problem.edges - 1)] += number(
            value, f"a face of {where}"
        )
    own, values = problem.own, {key: np.zeros(M if "normal" in key else L) for key in _SIZED}
    for key in _SIZED if own is None else own.multipliers.intersection(_SIZED):
        values[key] = array(entry(given, key, where), values[key].shape, f"{key} of {where}")
    values["own_upper"], values["own_lower"] = _own_multipliers(given, problem, where)
    for key, one in {**values, "faces": faces}.items():
        if (one < 0.0).any():
            raise ValueError(f"{key} of {where} has a negative multiplier")
    return {**values, "faces": faces, "round": cones}


def _there(problem: Problem) -> dict[str, np.ndarray]:
    """Whether the program has a constraint, by attribute: only those may prove anything."""
    (up, down), own, absent = problem.shared, problem.own, np.zeros(0, dtype=bool)
    cone = problem.cone[:, None]
    return {
        "normal_upper": np.full(problem.count, problem.has_normal_rows("normal_upper")),
        "normal_lower": ~problem.cone & problem.has_normal_rows("normal_lower"),
        "torque_upper": np.isfinite(problem.upper),
        "torque_lower": np.isfinite(problem.lower),
        "share_upper": up > 0.0,
        "share_lower": down > 0.0,
        "own_upper": absent if own is None else np.isfinite(own.rows.high),
        "own_lower": absent if own is None else np.isfinite(own.rows.low),
        "faces": cone,
        "round": cone,
    }


def _names(problem: Problem) -> set[str]:
    """Return all names under which a document states multipliers."""
    names, own = {"balance", "round_cones" if problem.is_round else "faces"}, problem.own
    if own is None:
        return names.union(_SIZED)
    for name, sign, _ in own.rows.blocks:
        names |= {f"{name}_upper", f"{name}_lower"} if sign == "either" else {name}
    return names | own.multipliers.intersection(_SIZED)


def _own_multipliers(given: object, problem: Problem, where: str) -> tuple[np.ndarray, np.ndarray]:
    """(q,) multipliers of the upper and of the lower sides of an objective's own rows."""
    upper, lower = [np.zeros(0)], [np.zeros(0)]
    for name, sign, shape in () if problem.own is None else problem.own.rows.blocks:
        up, down = (
            array(entry(given, key, where), shape, f"{key} of {where}").ravel()
            for key in ((f"{name}_upper", f"{name}_lower") if sign == "either" else (name, name))
        )
        if sign == "any":
            up, down = np.maximum(up, 0.0), np.maximum(-down, 0.0)
        upper.append(up)
        lower.append(down if sign != "upper" else np.zeros(len(up)))
    return np.concatenate(upper), np.concatenate(lower)


def _lengths(pairs: np.ndarray) -> np.ndarray:
    """(M,) lengths of (M, 2) pairs, none of them rounded down."""
    return np.hypot(pairs[:, 0], pairs[:, 1]) * (1.0 + tolerances.STATED)
