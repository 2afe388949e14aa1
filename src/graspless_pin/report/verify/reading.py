"""Readers of a document: the problem, the rules, the mode and the multipliers.

Multipliers of constraints that the problem does not have count as zero.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import KNOWN_CONES, SIZED, WHOLE, Part, stacked
from graspless_pin.report.verify.own_objective import read_own_objective
from graspless_pin.report.verify.problem import Problem, faces_between
from graspless_pin.report.verify.values import MOST, array, entry, items


def read_problem(document: object) -> Problem:
    """Return the problem of a document.

    Raises:
        ValueError: Naming the key that is missing or wrong.
    """
    sizes: dict[str, int] = {}
    stated = Part("document", document, WHOLE, sizes)
    contacts, joints, rules = stated["contacts"], stated["joints"], stated["rules"]
    sizes |= {"M": len(contacts), "L": len(joints)}
    given_map, turns = _read_coordinates(stated, sizes)
    cone = stated["cone"] if "cone" in stated.stated else "edges"
    edges, corners, kinetic = stated["cone_edges"], None, None
    if cone not in KNOWN_CONES:
        corners, kinetic = _read_cones(contacts, cone, sizes)
        edges = corners.shape[1]
    sizes["r"] = edges = 0 if cone == "round" else edges
    own, algorithm = None, "own"
    if entry(document, "algorithm", WHOLE) is not None:
        algorithm = stated["algorithm"]
    elif edges == 0:
        raise ValueError("an objective of your own is not supported together with round cones")
    else:
        own = read_own_objective(stated["objective"], found=stated["found"])
    lower, upper = stacked(joints, "lower"), stacked(joints, "upper")
    problem = Problem(
        p=stacked(contacts, "position") - read_origin(stated),
        frames=np.hstack([stacked(contacts, "normal")[:, None], stacked(contacts, "tangents")]),
        mu=stacked(contacts, "friction"),
        limit=stacked(contacts, "max_normal_force"),
        v=stacked(contacts, "sliding"),
        J=stacked(contacts, "jacobian"),
        w=stated["external_wrench"],
        edges=edges,
        lower=np.where(np.isnan(lower), -np.inf, lower),
        upper=np.where(np.isnan(upper), np.inf, upper),
        gravity=stacked(joints, "torque_gravity"),
        units=tuple(joint["unit"] for joint in joints),
        is_moment=turns,
        stated_map=given_map,
        algorithm=algorithm,
        e0=stated["required_margin"],
        by_limits=stated["scale"] == "limits" and algorithm == "torque",
        epsilon=stated["regularization"],
        sign_rule=rules["sign_rule"],
        constrained=rules["sliding_rule"] == "constrained",
        coulomb=rules["static_friction"] == "coulomb",
        own=own,
        corners=corners,
        kinetic=kinetic,
        coulombs_law=cone in KNOWN_CONES or stated["coulombs_law"],
    )
    if corners is not None and kinetic is not None:
        _check_cones(problem, [*zip(corners, kinetic, strict=True)])
    for name, wrong in {
        "friction must not be negative": problem.mu < 0.0,
        "max_normal_force must be positive": problem.limit <= 0.0,
        "torque_gravity must be a number": ~np.isfinite(problem.gravity),
        "lower must not be above upper": problem.lower > problem.upper,
        "required_margin must not be negative": np.array(problem.e0 < 0.0),
        "required_margin must be 0 in Algorithm 1": np.array(
            problem.is_margin and problem.e0 != 0.0
        ),
        "regularization must not be negative": np.array(problem.epsilon < 0.0),
    }.items():
        if wrong.any():
            raise ValueError(name)
    for joint in joints:
        joint["name"]  # raises if it is invalid
    return problem


def _read_coordinates(stated: Part, sizes: dict[str, int]) -> tuple[np.ndarray | None, np.ndarray]:
    """Return the (M, 3, P) stated map of passive coordinates, and which have loads in N m.

    Without a map (None) they are the force and the moment on one object.
    """
    rows, sizes["P"] = stated.stated.get("wrench_matrix"), 6
    if rows is not None:
        sizes["P"] = len(items(rows, "wrench_matrix", 1, MOST))
    if rows is None:
        if stated.stated.get("passive_units") is not None:
            raise ValueError("passive_units requires a wrench_matrix, which the document lacks")
        return None, np.repeat([False, True], 3)
    turns = np.array([unit == "N m" for unit in stated["passive_units"]])
    return stated["wrench_matrix"].T.reshape(sizes["M"], 3, sizes["P"]), turns


def _read_cones(
    contacts: list[Part], cone: str, sizes: dict[str, int]
) -> tuple[np.ndarray, np.ndarray]:
    """(M, r, 2) corners and (M, 2) kinetic friction that a document states of its cones."""
    stated, kinetic = {}, np.zeros((len(contacts), 2))
    for index, contact in enumerate(contacts):
        sliding = contact.get("kinetic_friction")
        if sliding is not None:
            kinetic[index] = sliding
            continue
        where = f"contact {index}, whose cone {cone!r} is neither edges nor round,"
        own = entry(contact.stated, "cone_corners", where)
        sizes.setdefault("r", len(items(own, f"cone_corners of contact {index}", 3, MOST)))
        stated[index] = contact["cone_corners"]
    corners = np.zeros((len(contacts), sizes.setdefault("r", 3), 2))
    for index, own in stated.items():
        corners[index] = own
    return corners, kinetic


def _check_cones(problem: Problem, cones: list[tuple[np.ndarray, np.ndarray]]) -> None:
    """Refuse cones that are not convex around the normal, or larger than Coulomb's.

    Raises:
        ValueError: Naming the contact.
    """
    most = problem.mu * (1.0 + tolerances.SAME)
    for index in range(problem.count):
        where, corners, kinetic = f"contact {index}", *cones[index]
        if not problem.has_cone[index]:
            along = float(problem.frames[index, 1:] @ problem.v[index] @ kinetic)
            if np.linalg.norm(kinetic) > most[index] or along > 0.0:
                raise ValueError(
                    f"kinetic_friction of {where} must not exceed its friction coefficient, and "
                    "must oppose its sliding"
                )
            continue
        with np.errstate(invalid="ignore"):  # where two corners coincide
            faces = faces_between(corners)
        outside = np.column_stack([np.ones(len(corners)), corners]) @ faces.T
        if not (faces[:, 0] < 0.0).all() or outside.max() > tolerances.SAME:
            raise ValueError(f"cone_corners of {where} must be a convex polygon around its normal")
        if np.linalg.norm(corners, axis=1).max() > most[index]:
            raise ValueError(f"cone_corners of {where} must not exceed its friction coefficient")


def read_origin(stated: Part) -> np.ndarray:
    """(3,) the reference point of moments, in the axes of the contact points."""
    return np.zeros(3) if "object" not in stated.stated else stated["object"]["center_of_mass"]


def stated_mass(stated: Part) -> float | None:
    """Return the mass of a document's object, kg; None where that is not known."""
    body = stated.get("object")
    return None if body is None else body.get("mass")


def read_mode(document: object, problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    """(M,) contacts that the stated mode selects, and (M, 2) their signs."""
    contacts = problem.part(document)["contacts"]
    return stacked(contacts, "selected"), stacked(contacts, "signs")


@dataclass(frozen=True, eq=False)
class StatedMultipliers:
    """Stated multipliers of the constraints, in the objective's unit over the constraint's own.

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
        strays: Names of stated multipliers whose constraints do not exist.
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
    strays: tuple[str, ...]

    @property
    def torque(self) -> np.ndarray:
        """(L,) net multiplier of each joint's torque."""
        return self.torque_upper - self.torque_lower + self.share_upper - self.share_lower


def stated_multipliers(given: object, problem: Problem, where: str) -> StatedMultipliers:
    """Return the multipliers that a document states; those without a constraint count as 0.

    Raises:
        ValueError: If one is negative or missing.
    """
    stated, exists = _stated_values(given, problem, where), _existing_constraints(problem)
    strays = [key for key, one in stated.items() if np.where(exists[key], 0.0, one).any()]
    unknown = given.keys() - _multiplier_names(problem) if isinstance(given, dict) else set()
    # A first entry that rounding has left slightly too small is raised.
    cones: np.ndarray = stated["round"]
    cones[:, 0] = np.maximum(cones[:, 0], _lengths_rounded_up(cones[:, 1:]))
    return StatedMultipliers(
        balance=problem.part(given, where, "multipliers")["balance"],
        **{key: np.where(exists[key], one, 0.0) for key, one in stated.items()},
        strays=(*strays, *sorted(repr(key)[:40] for key in unknown)[:10]),
    )


def _stated_values(given: object, problem: Problem, where: str) -> dict[str, np.ndarray]:
    """Return all multipliers but those of the balance as they are stated, by attribute."""
    own, stated = problem.own, problem.part(given, where, "multipliers")
    values: dict[str, np.ndarray] = {
        key: np.zeros(problem.sizes[size]) for key, size in SIZED.items()
    }
    values["faces"], cones = np.zeros((problem.count, problem.edges)), np.zeros((problem.count, 3))
    if problem.is_round:
        cones = stated["round_cones"]
    else:
        values["faces"] = stated["faces"]
    for key in SIZED if own is None else own.multipliers.intersection(SIZED):
        values[key] = stated[key]
    values["own_upper"], values["own_lower"] = _own_multipliers(given, problem, where)
    for key, one in values.items():
        if (one < 0.0).any():
            raise ValueError(f"{key} of {where} has a negative multiplier")
    return {**values, "round": cones}


def _existing_constraints(problem: Problem) -> dict[str, np.ndarray]:
    """Return which constraints the program has, by attribute: only their multipliers count."""
    (up, down), own, absent = problem.share_torques, problem.own, np.zeros(0, dtype=bool)
    cone = problem.has_cone[:, None]
    return {
        "normal_upper": np.full(problem.count, problem.has_normal_rows("normal_upper")),
        "normal_lower": ~problem.has_cone & problem.has_normal_rows("normal_lower"),
        "torque_upper": np.isfinite(problem.upper),
        "torque_lower": np.isfinite(problem.lower),
        "share_upper": up > 0.0,
        "share_lower": down > 0.0,
        "own_upper": absent if own is None else np.isfinite(own.rows.high),
        "own_lower": absent if own is None else np.isfinite(own.rows.low),
        "faces": cone,
        "round": cone,
    }


def _multiplier_names(problem: Problem) -> set[str]:
    """Return all names under which a document states multipliers."""
    names, own = {"balance", "round_cones" if problem.is_round else "faces"}, problem.own
    if own is None:
        return names.union(SIZED)
    for name, sign, _ in own.rows.blocks:
        names |= {f"{name}_upper", f"{name}_lower"} if sign == "either" else {name}
    return names | own.multipliers.intersection(SIZED)


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


def _lengths_rounded_up(pairs: np.ndarray) -> np.ndarray:
    """(M,) lengths of (M, 2) pairs, rounded up."""
    return np.hypot(pairs[:, 0], pairs[:, 1]) * (1.0 + tolerances.STATED)
