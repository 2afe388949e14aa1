"""Read the figures of a document: the problem, the rules, and what is stated of the answer.

Multipliers that may prove nothing count as zero.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.own_objective import read_own_objective
from graspless_pin.report.verify.problem import Forces, Problem, faces_between
from graspless_pin.report.verify.values import (
    MOST,
    array,
    entry,
    items,
    number,
    short_text,
    truth,
    whole,
    word,
)

CHECKED_FORMAT = 2
KNOWN_CONES = ("edges", "round")
"""Models of friction cones that are known by name; of others a document states the corners."""


def read_problem(document: dict[str, Any]) -> Problem:
    """Return the problem of a document.

    Raises:
        ValueError: Naming the key that is missing or wrong.
    """
    where = "the document"
    contacts = items(entry(document, "contacts", where), "contacts", 1, MOST)
    joints = items(entry(document, "joints", where), "joints", 0, MOST)
    edges = whole(entry(document, "cone_edges", where), "cone_edges", 3, MOST)
    cone, corners, kinetic = short_text(document.get("cone", "edges"), "cone"), None, None
    law = True
    if cone == "round":
        edges = 0
    elif cone not in KNOWN_CONES:
        law = truth(entry(document, "coulombs_law", where), "coulombs_law")
        corners, kinetic = _read_cones(contacts, cone)
        edges = corners.shape[1]
    rules = entry(document, "rules", where)
    given_map, turns = _read_coordinates(document, len(contacts))
    algorithm, own = entry(document, "algorithm", where), None
    if algorithm is None:
        if edges == 0:
            raise ValueError("an objective of one's own stands in no document with round cones")
        found = entry(document, "found", where) is True
        given = entry(document, "objective", where)
        sizes = len(contacts), len(turns)
        algorithm, own = "own", read_own_objective(given, sizes, found=found)
    else:
        algorithm = word(algorithm, "algorithm", ("margin", "torque"))

    def column(key: str, shape: tuple[int, ...]) -> np.ndarray:
        rows = [array(entry(c, key, f"contact {i}"), shape, f"{key} of contact {i}")
                for i, c in enumerate(contacts)]  # fmt: skip
        return np.array(rows).reshape(len(contacts), *shape)

    def limits(key: str, absent: float) -> np.ndarray:
        found = [entry(j, key, f"joint {i}") for i, j in enumerate(joints)]
        return np.array([absent if x is None else number(x, f"joint's {key}") for x in found])

    sign_rules, sliding_rules = ("strict", "exact", "nonzero"), ("exempt", "constrained")
    friction_rules = ("virtual_sliding", "coulomb")
    options = {"sign_rule": sign_rules, "sliding_rule": sliding_rules,
               "static_friction": friction_rules}  # fmt: skip
    words = {key: word(entry(rules, key, "rules"), key, known) for key, known in options.items()}
    scale = word(entry(document, "scale", where), "scale", ("absolute", "limits"))
    frames = np.concatenate([column("normal", (3,))[:, None], column("tangents", (2, 3))], axis=1)
    problem = Problem(
        p=column("position", (3,)) - read_origin(document),
        frames=frames,
        mu=column("friction", ()),
        limit=column("max_normal_force", ()),
        v=column("sliding", (3,)),
        J=column("jacobian", (3, len(joints))),
        w=array(entry(document, "external_wrench", where), (len(turns),), "external_wrench"),
        edges=edges,
        lower=limits("lower", -np.inf),
        upper=limits("upper", np.inf),
        gravity=limits("torque_gravity", np.nan),
        units=tuple(
            word(entry(j, "unit", f"joint {i}"), "unit", ("N m", "N")) for i, j in enumerate(joints)
        ),
        turns=turns,
        given=given_map,
        algorithm=algorithm,
        e0=number(entry(document, "required_margin", where), "required_margin"),
        by_limits=algorithm == "torque" and scale == "limits",
        epsilon=number(entry(document, "regularization", where), "regularization"),
        sign_rule=words["sign_rule"],
        constrained=words["sliding_rule"] == "constrained",
        coulomb=words["static_friction"] == "coulomb",
        own=own,
        corners=corners,
        kinetic=kinetic,
        coulombs_law=law,
    )
    if corners is not None and kinetic is not None:
        _check_cones(problem, [*zip(corners, kinetic, strict=True)])
    for name, wrong in {
        "friction must not be negative": problem.mu < 0.0,
        "max_normal_force must be positive": problem.limit <= 0.0,
        "torque_gravity must be a number": ~np.isfinite(problem.gravity),
        "lower must not be above upper": problem.lower > problem.upper,
        "required_margin must not be negative": np.array(problem.e0 < 0.0),
        "required_margin is 0 in Algorithm 1": np.array(problem.is_margin and problem.e0 != 0.0),
        "regularization must not be negative": np.array(problem.epsilon < 0.0),
    }.items():
        if wrong.any():
            raise ValueError(name)
    for index, joint in enumerate(joints):
        short_text(entry(joint, "name", f"joint {index}"), "a joint's name")
    return problem


def _read_coordinates(document: dict[str, Any], count: int) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the (M, 3, P) stated map of passive coordinates, and which have loads in N m.

    Without a map they are the force and the moment on one object.
    """
    where, units = "the document", document.get("passive_units")
    rows = document.get("wrench_matrix")
    if rows is None:
        if units is not None:
            raise ValueError("the document states passive_units, but no wrench_matrix")
        return None, np.repeat([False, True], 3)
    size = len(items(rows, "wrench_matrix", 1, MOST))
    stated = items(entry(document, "passive_units", where), "passive_units", size, size)
    turns = [word(unit, "one of passive_units", ("N m", "N")) == "N m" for unit in stated]
    matrix = array(rows, (size, 3 * count), "wrench_matrix")
    return matrix.T.reshape(count, 3, size), np.array(turns)


def _read_cones(contacts: list[Any], cone: str) -> tuple[np.ndarray, np.ndarray]:
    """(M, r, 2) corners and (M, 2) kinetic friction that a document states of its cones."""
    stated, kinetic = [], np.zeros((len(contacts), 2))
    for index, contact in enumerate(contacts):
        where = f"contact {index}"
        if isinstance(contact, dict) and "kinetic_friction" in contact:
            kinetic[index] = array(
                contact["kinetic_friction"], (2,), f"kinetic_friction of {where}"
            )
            continue
        own = entry(contact, "cone_corners", f"{where} with the cone {cone!r}, not known by name,")
        stated.append((index, items(own, f"cone_corners of {where}", 3, MOST)))
    count = len(stated[0][1]) if stated else 3
    corners = np.zeros((len(contacts), count, 2))
    for index, own in stated:
        corners[index] = array(own, (count, 2), f"cone_corners of contact {index}")
    return corners, kinetic


def _check_cones(problem: Problem, cones: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Refuse cones that are no convex ones around the normal, or beyond Coulomb's.

    Raises:
        ValueError: Naming the contact.
    """
    most = problem.mu * (1.0 + tolerances.SAME)
    for index in range(problem.count):
        where, corners, kinetic = f"contact {index}", *cones[index]
        if not problem.cone[index]:
            along = float(problem.frames[index, 1:] @ problem.v[index] @ kinetic)
            if np.linalg.norm(kinetic) > most[index] or along > 0.0:
                raise ValueError(f"kinetic_friction of {where} is too large, or along its sliding")
            continue
        with np.errstate(invalid="ignore"):  # of corners that are one
            faces = faces_between(corners)
        outside = np.column_stack([np.ones(len(corners)), corners]) @ faces.T
        if not (faces[:, 0] < 0.0).all() or outside.max() > tolerances.SAME:
            raise ValueError(f"cone_corners of {where} are no convex polygon around its normal")
        if np.linalg.norm(corners, axis=1).max() > most[index]:
            raise ValueError(f"cone_corners of {where} are beyond its coefficient of friction")


def read_origin(document: dict[str, Any]) -> np.ndarray:
    """(3,) the point that moments are about, in the axes of the contact points."""
    if "object" not in document:
        return np.zeros(3)
    return array(entry(document["object"], "center_of_mass", "object"), (3,), "center_of_mass")


def read_mode(document: dict[str, Any], problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """(M,) contacts that the stated mode selects, and (M, 2) their signs."""
    selected, signs = [], []
    for index, contact in enumerate(document["contacts"]):
        where = f"contact {index}"
        selected.append(truth(entry(contact, "selected", where), f"selected of {where}"))
        pair = items(entry(contact, "signs", where), f"signs of {where}", 2, 2)
        signs.append([whole(sign, f"a sign of {where}", -1, 1) for sign in pair])
    return np.array(selected, dtype=bool), np.array(signs, dtype=int).reshape(problem.count, 2)


def read_forces(
    rows: object, problem: Problem, where: str, columns: np.ndarray | None = None
) -> Forces:
    """Return forces that stand in a document, with the columns of the objective's own."""
    return Forces(problem, array(rows, (problem.count, 3), where), columns)


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
