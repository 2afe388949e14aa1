"""Read the figures of a document: the problem, the rules, and what is stated of the answer."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify.own_objective import read_own_objective
from graspless_pin.report.verify.problem import Forces, Problem
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


def read_problem(document: dict[str, Any]) -> Problem:
    """Return the problem of a document.

    Raises:
        ValueError: Naming the key that is missing or wrong.
    """
    where = "the document"
    contacts = items(entry(document, "contacts", where), "contacts", 1, MOST)
    joints = items(entry(document, "joints", where), "joints", 0, MOST)
    edges = whole(entry(document, "cone_edges", where), "cone_edges", 3, MOST)
    if word(document.get("cone", "edges"), "cone", ("edges", "round")) == "round":
        edges = 0
    rules = entry(document, "rules", where)
    algorithm, own = entry(document, "algorithm", where), None
    if algorithm is None:
        if edges == 0:
            raise ValueError("an objective of one's own stands in no document with round cones")
        found = entry(document, "found", where) is True
        given = entry(document, "objective", where)
        algorithm, own = "own", read_own_objective(given, len(contacts), found=found)
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
    said = {key: word(entry(rules, key, "rules"), key, known) for key, known in options.items()}
    scale = word(entry(document, "scale", where), "scale", ("absolute", "limits"))
    frames = np.concatenate([column("normal", (3,))[:, None], column("tangents", (2, 3))], axis=1)
    problem = Problem(
        p=column("position", (3,)) - read_origin(document),
        frames=frames,
        mu=column("friction", ()),
        limit=column("max_normal_force", ()),
        v=column("sliding", (3,)),
        J=column("jacobian", (3, len(joints))),
        w=array(entry(document, "external_wrench", where), (6,), "external_wrench"),
        edges=edges,
        lower=limits("lower", -np.inf),
        upper=limits("upper", np.inf),
        gravity=limits("torque_gravity", np.nan),
        units=tuple(
            word(entry(j, "unit", f"joint {i}"), "unit", ("N m", "N")) for i, j in enumerate(joints)
        ),
        algorithm=algorithm,
        e0=number(entry(document, "required_margin", where), "required_margin"),
        by_limits=algorithm == "torque" and scale == "limits",
        epsilon=number(entry(document, "regularization", where), "regularization"),
        sign_rule=said["sign_rule"],
        constrained=said["sliding_rule"] == "constrained",
        coulomb=said["static_friction"] == "coulomb",
        own=own,
    )
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
