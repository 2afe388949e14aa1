"""Read the figures of a document: the problem, the rules, and what is stated of the answer."""

from __future__ import annotations

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
