"""Forgeries of an attacker's mind: each makes a claim of a document false, as well as it can.

Each starts from a document that is proven and ends as one that no checker may pass. They are tried
by ``make tampering`` and by the tests.
"""

from __future__ import annotations

import copy
import json
import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import test_kept_disturbances
from rest_documents import CASES, ONE_KILOGRAM, G, leaves, times
from rest_documents import document as at_rest
from test_guarantee import document as guaranteed
from tests.core.scenes import scene
from verified_documents import SOLUTIONS, Document, documented

from graspless_pin import (
    QuasistaticProblem,
    load_scene,
    maximize_margin,
    minimize_torque,
    stability,
)
from graspless_pin.report import solution_document
from graspless_pin.report.reading import read_solution
from graspless_pin.report.verify import verify_document

Forge = Callable[[Document], None]
ZERO6 = [0.0] * 6
OPTIMAL = "optimal over all feasible virtual-sliding modes"


@dataclass(frozen=True)
class Forgery:
    """A way to make a claim of a document false.

    Attributes:
        name: What is forged.
        base: Name of the document that it starts from, see `base`.
        forge: Changes a copy of it in place.
    """

    name: str
    base: str
    forge: Forge

    def is_refused(self) -> bool:
        """Return whether a check fails that does not fail of what it starts from."""
        return bool(failing(self.made()) - failing_before(self.base))

    def made(self) -> Document:
        """Return the forged document."""
        document = copy.deepcopy(base(self.base))
        self.forge(document)
        return document


FORGERIES: list[Forgery] = []
"""All of them."""


def forgery(base_name: str) -> Callable[[Forge], Forge]:
    """Put a function among the forgeries of a document."""

    def add(forge: Forge) -> Forge:
        FORGERIES.append(Forgery(forge.__name__, base_name, forge))
        return forge

    return add


# what they start from


def _verdict(problem: QuasistaticProblem, torques: Any, **options: Any) -> Document:
    solution = maximize_margin(problem, static_friction="coulomb", **options)
    made = solution_document(solution, verdict=stability(problem, torques))
    return json.loads(json.dumps(made))


def squeezed() -> QuasistaticProblem:
    """A body of 1 kg between walls without friction; two hybrid fingers hold it with 10 N each."""
    jacobian = np.zeros((12, 2))
    jacobian[7, 0], jacobian[10, 1] = -1.0, 1.0
    return QuasistaticProblem(
        [[0.05, 0, 0], [-0.05, 0, 0], [0, 0.05, 0], [0, -0.05, 0]],
        [[-1, 0, 0], [1, 0, 0], [0, -1, 0], [0, 1, 0]], [0, 0, -G, 0, 0, 0], jacobian,
        friction=[0.0, 0.0, 0.8, 0.8], cone="round", joint_units=["N", "N"],
        torque_limits=(10.0, 10.0), object_inertia=ONE_KILOGRAM,
        joint_inertia=np.zeros((2, 2)),
    )  # fmt: skip


def _far() -> Document:
    """An answer of huge forces, and far from the optimum, with the true bound and its proof.

    It is refused as it is: its multipliers are those of another program.
    """
    wide = scene("rest").with_changes(max_normal_force=1e7, torque_limits=(-1e7, 1e7))
    true = documented(minimize_torque(wide, 0.1))
    found = documented(minimize_torque(wide, 1e5))
    made = copy.deepcopy(found)
    made["required_margin"], made["status"] = 0.1, "limit_reached"
    made["message"] = "the best found"
    made["proof"]["nodes"] = true["proof"]["nodes"]
    made["certificate"]["bound"] = true["certificate"]["bound"]
    made["certificate"]["gap"] = made["max_torque"] - true["certificate"]["bound"]
    return made


_BASES: dict[str, Callable[[], Document]] = {
    **{name: (lambda name=name: at_rest(name)) for name in CASES},
    **{
        f"borne {name}": (lambda name=name: test_kept_disturbances.document(name))
        for name in ("flat", "slot", "on wall", "bare")
    },
    "guaranteed": lambda: guaranteed("strong"),
    "not guaranteed": lambda: guaranteed("strong_not_found"),
    **{name: (lambda name=name: documented(SOLUTIONS[name]())) for name in (
        "margin", "torque", "tree", "shares", "in a mode", "limit", "infeasible forces", "nonzero",
        "infeasible modes", "infeasible in a mode", "infeasible mode", "round tree", "coulomb",
        "one-sided joints",
    )},
    "squeeze": lambda: _verdict(squeezed(), [10.0, 10.0]),
    "far": _far,
    "walls of a scene": lambda: _of_scene(),
}  # fmt: skip


def _of_scene() -> Document:
    walls = load_scene("examples/box_between_walls.yaml")
    solution = walls.solve()
    verdict = stability(solution.problem, solution.torques)
    return json.loads(json.dumps(solution_document(solution, walls, verdict=verdict)))


@cache
def base(name: str) -> Document:
    """Return a document that forgeries start from; not to be changed in place."""
    return _BASES[name]()


def bases() -> list[str]:
    """Return the names of all documents that forgeries start from."""
    return sorted({one.base for one in FORGERIES})


REFUSED = {
    "far": {"gap left by the multipliers", "duality gap as stated"},
    "unrest": {"torques J^T f + g as stated"},
}
"""What fails already of documents that forgeries start from; of all others nothing does."""


def failing(document: Document) -> set[str]:
    """Return the names of the checks that fail; a document that cannot be read fails, too."""
    try:
        return {one.name for one in verify_document(document).checks if one.passed is False}
    except ValueError as error:
        return {str(error)}


@cache
def failing_before(name: str) -> frozenset[str]:
    """Return the names of the checks that fail already of a document that forgeries start from."""
    return frozenset(failing(base(name)))


# help


def _leaf(document: Document, **more: Any) -> dict[str, Any]:
    """A root alone, with multipliers of zero."""
    count = len(document["contacts"])
    motion = [0.0] * (6 + len(document["joints"]))
    zero = {"motion": motion, "normal": [0.0] * count, "tangential": [[0.0, 0.0]] * count}
    return {"contact": -1, "state": "free", "slip": None, "multipliers": zero, "forced": [],
            "sides": [], "children": 0, **more}  # fmt: skip


def _proof(document: Document, nodes: list[Any]) -> dict[str, Any]:
    return {"loads": [], "forces": None, "nodes": nodes,
            "force_limit": 1e6 * document["scales"]["force"]}  # fmt: skip


def _coarse(document: Document, resolution: float) -> None:
    said = document["stability"]
    factor = resolution / said["acceleration_resolution"]
    said["acceleration_resolution"] = resolution
    said["acceleration_limit"] *= factor


def _as_strong(document: Document, nodes: list[Any]) -> None:
    document["stability"] |= {
        "status": "strong", "message": "holds: rest is the only outcome", "motion": None,
        "no_rest": None, "proof": _proof(document, nodes),
    }  # fmt: skip


def _as_weak(document: Document, acceleration: Any, forces: Any, speed: float) -> None:
    joints = len(document["joints"])
    document["stability"] |= {
        "status": "weak", "message": "may fail: the object can move", "proof": None,
        "motion": {
            "object_acceleration": list(acceleration), "joint_accelerations": [0.0] * joints,
            "contact_forces": np.asarray(forces, dtype=float).tolist(),
            "states": ["open"] * len(document["contacts"]), "point_acceleration": speed,
        },
    }  # fmt: skip


def follow(document: Document) -> None:
    """Make margin and torques fit the forces."""
    claimed = read_solution(document)
    document["margin"], document["max_torque"] = claimed.margin, claimed.max_torque
    for index, joint in enumerate(document["joints"]):
        joint["torque"] = float(claimed.torques[index])
        joint["torque_contact"] = float(claimed.contact_torques[index])


def set_optimum(document: Document, value: float) -> None:
    """Make bound and gap fit what the document claims."""
    document["certificate"] |= {"bound": value, "gap": 0.0, "duality_gap": 0.0}


def _bound(document: Document, value: float) -> None:
    """State a bound of an answer that is not said to be the best, and the gap to it."""
    document["certificate"] |= {"bound": value, "gap": document["max_torque"] - value}


def put(*path: Any, to: Any = None, by: Callable[[Any], Any] | None = None) -> Forge:
    """Return what puts a value in a place, or what is made of the value that is there.

    Where the path has ``...`` it goes to all entries of a list.
    """

    def forge(document: Document) -> None:
        found: list[Any] = [document]
        for key in path[:-1]:
            found = [one for place in found for one in (place if key is ... else [place[key]])]
        for place in found:
            place[path[-1]] = copy.deepcopy(to) if by is None else by(place[path[-1]])

    return forge


def in_turn(*steps: Forge) -> Forge:
    """Return what goes one step after the other."""

    def forge(document: Document) -> None:
        for step in steps:
            step(document)

    return forge


def more(term: float) -> Callable[[float], float]:
    return lambda value: value + term


def says(status: str, message: str) -> Forge:
    """Return what states another status with its message."""
    return in_turn(put("status", to=status), put("message", to=message))


def _is_the_best(document: Document) -> None:
    says("optimal", OPTIMAL)(document)
    set_optimum(document, document["max_torque"])


def _direction(document: Document) -> dict[str, Any]:
    return document["disturbances"]["directions"][0]


# resolutions: how fast an object is that counts as at rest


@forgery("walls")
def rest_at_thirty_loads_over_mass(document: Document) -> None:
    """One node with multipliers of zero proves that nothing accelerates by more than a load."""
    _as_strong(document, [_leaf(document)])
    _coarse(document, 30.0)


@forgery("borne flat")
def disturbance_of_ten_loads_at_a_coarse_resolution(document: Document) -> None:
    _coarse(document, 1e3)
    claim = _direction(document)
    claim["guaranteed"] = claim["possible"]
    claim["spans"][-1][1]["magnitude"] = claim["possible"]
    claim["spans"][-1][1]["rest_forces"] = claim["forces"]
    claim["failing"] = claim["failure"] = None


@forgery("slope")
def no_motion_faster_than_a_limit_below_zero(document: Document) -> None:
    _as_weak(document, ZERO6, document["stability"]["rest_forces"], 0.0)
    _coarse(document, -1.0)


@forgery("slope")
def rounding_is_a_motion(document: Document) -> None:
    """A motion of 1e-9 m/s^2, with a resolution that makes it count."""
    _as_weak(document, [1e-9, 0, 0, 0, 0, 0], document["stability"]["rest_forces"], 1e-9)
    _coarse(document, 1e-13)


# motions: tolerances that grow with what is stated


@forgery("squeeze")
def commanded_forces_are_none_beside_a_squeeze(document: Document) -> None:
    """The body falls: neither finger presses, is said beside 1e8 N of two walls."""
    _as_weak(document, [0, 0, -G, 0, 0, 0],
             [[-1e8, 0, 0], [1e8, 0, 0], [0, 0, 0], [0, 0, 0]], G)  # fmt: skip


@forgery("squeeze")
def commanded_forces_hold_no_more_beside_a_squeeze(document: Document) -> None:
    """They press, but the friction that holds the body is left out."""
    _as_weak(document, [0, 0, -G, 0, 0, 0],
             [[-1e8, 0, 0], [1e8, 0, 0], [0, -10.0, 0], [0, 10.0, 0]], G)  # fmt: skip


@forgery("gliding")
def walls_squeeze_by_1e8_newtons(document: Document) -> None:
    """They rub, and would stop the glide."""
    forces = np.array(document["stability"]["motion"]["contact_forces"])
    forces[3, 1], forces[4, 1] = 1e8, -1e8
    document["stability"]["motion"]["contact_forces"] = forces.tolist()


@forgery("slope")
def forces_and_motion_times_1e6(document: Document) -> None:
    forces = 1e6 * np.array(document["stability"]["rest_forces"])
    forces -= (1e6 - 1.0) * np.array(document["stability"]["rest_forces"]).mean(axis=0)
    _as_weak(document, [1.0, 0, 0, 0, 0, 0], forces, 1.0)


@forgery("slope")
def stale_motion_of_another_scene(document: Document) -> None:
    other = base("corners")["stability"]["rest_forces"][:3]
    _as_weak(document, [G, 0, 0, 0, 0, 0], other, G)


@forgery("lost")
def lost_motion_is_kept(document: Document) -> None:
    document["stability"] |= {
        key: copy.deepcopy(base("kept")["stability"][key]) for key in ("status", "message", "proof")
    }
    document["stability"]["motion"] = None
    for node in document["stability"]["proof"]["nodes"]:
        for one in [side["multipliers"] for side in node["sides"]]:
            one["motion"] = one["motion"][:-1]


@forgery("lost")
def lost_motion_is_no_outcome_times_1e30(document: Document) -> None:
    """Multipliers of any size, of a goal that only has to be below zero."""
    leaf = _leaf(document)["multipliers"]
    huge = leaf | {"normal": [1e30, -1e30, 1e30, -1e30]}
    node = _leaf(document, multipliers=None, sides=[{"goal": 0, "multipliers": huge}])
    document["stability"] |= {"status": "strong", "message": "keeps its motion", "motion": None,
                              "proof": _proof(document, [node])}  # fmt: skip


@forgery("kept")
def one_goal_twelve_times(document: Document) -> None:
    for node in document["stability"]["proof"]["nodes"]:
        if len(node["sides"]) > 1:
            node["sides"] = [node["sides"][-1]] * len(node["sides"])


# proofs of rest


@forgery("slope")
def node_stands_for_its_sibling(document: Document) -> None:
    nodes = document["stability"]["proof"]["nodes"]
    first, second = leaves(nodes)[:2]
    nodes[second[0]] = copy.deepcopy(nodes[first[0]])


@forgery("slope")
def contact_is_left_out_of_the_tree(document: Document) -> None:
    """All that the tree says of one contact, and the branches under it, go."""
    proof = document["stability"]["proof"]
    proof["nodes"] = [node for node in proof["nodes"] if node["contact"] != 2]
    for index, node in enumerate(proof["nodes"]):
        node["children"] = 0 if index else len(proof["nodes"]) - 1


@forgery("walls")
def open_leaf_alone(document: Document) -> None:
    """What happens where contacts are closed is said to be open, too."""
    root = _leaf(document, multipliers=None, children=2)
    leaf = _leaf(document, contact=0, state="open")
    _as_strong(document, [root, leaf, copy.deepcopy(leaf)])


@forgery("corners")
def arc_of_more_than_all_directions(document: Document) -> None:
    for node in document["stability"]["proof"]["nodes"]:
        if node["slip"] is not None:
            node["slip"] = [node["slip"][0], 40.0]


@forgery("corners")
def arcs_leave_a_gap(document: Document) -> None:
    node = next(n for n in document["stability"]["proof"]["nodes"] if n["slip"] is not None)
    node["slip"][1] -= 1e-9


@forgery("walls")
def multipliers_of_1e30_swallow_the_load(document: Document) -> None:
    """Their sum is 1 in truth; with 53 bits of it nothing is left."""
    leaf = _leaf(document)
    leaf["multipliers"]["motion"] = [0.0, 0.0, 1e30, 0.0, 0.0, 0.0]
    _as_strong(document, [leaf])


@forgery("pressed")
def least_force_of_huge_multipliers(document: Document) -> None:
    load = document["stability"]["proof"]["loads"][0]
    load["force"] *= 1.5
    load["multipliers"] = {key: times(1e17)(one) for key, one in load["multipliers"].items()}


@forgery("smooth")
def certificate_of_forces_that_pull(document: Document) -> None:
    document["external_wrench"] = [0.0, 0.0, G, 0.0, 0.0, 0.0]
    for where in (document["stability"], document["stability"]["proof"]):
        for key in ("rest_forces", "forces"):
            if key in where:
                where[key] = times(-1.0)(where[key])


@forgery("unrest")
def unrest_is_rest(document: Document) -> None:
    document["stability"] |= {
        key: copy.deepcopy(base("pressed")["stability"][key])
        for key in ("status", "message", "proof", "rest_forces", "no_rest", "motion")
    }


@forgery("pressed")
def rest_is_unrest_by_a_huge_motion(document: Document) -> None:
    z = times(1e30)(base("unrest")["stability"]["no_rest"])
    document["stability"] |= {"status": "none", "message": "fails: rest is no outcome",
                              "no_rest": z, "motion": None, "proof": None}  # fmt: skip


@forgery("walls")
def weak_is_strong_by_its_certificate_of_rest(document: Document) -> None:
    _as_strong(document, [])
    document["stability"]["proof"] |= {
        "nodes": None, "forces": document["stability"]["rest_forces"], "force_limit": None,
    }  # fmt: skip


# inertias


@forgery("walls")
def mass_is_small_along_x_alone(document: Document) -> None:
    """Accelerations count in load over mass: a mass of nothing makes all of them rest."""
    document["object_inertia"][0][0] = 1e-6
    _as_strong(document, [_leaf(document)])
    document["stability"]["acceleration_limit"] *= 1e6


@forgery("walls of a scene")
def mass_is_not_that_of_the_scene(document: Document) -> None:
    document["object_inertia"] = times(1e-3)(document["object_inertia"])
    said = document["stability"]
    said["acceleration_limit"] *= 1e3
    if said["motion"] is not None:
        for key in ("object_acceleration", "point_acceleration"):
            said["motion"][key] = times(1e3)(said["motion"][key])


# disturbances


@forgery("borne flat")
def nothing_beyond_was_looked_at(document: Document) -> None:
    """As much as was looked at can be balanced, is said of a push that nothing balances."""
    claim = _direction(document)
    claim["possible"], claim["no_rest"] = 1e4, None
    document["disturbances"]["largest"] = 1e4
    forces = np.array(claim["forces"])
    claim["forces"] = (forces * 1e4 / np.abs(forces).max()).tolist()


# answers: forces, figures and limits


@forgery("torque")
def limit_below_the_torque(document: Document) -> None:
    """Four times the limit, beside which the load is large."""
    for joint in document["joints"]:
        joint["upper"], joint["lower"] = abs(joint["torque"]) / 4.21, -abs(joint["torque"]) / 4.21


@forgery("one-sided joints")
def limit_is_missed_by_three_millionths(document: Document) -> None:
    joint = max(document["joints"], key=lambda one: abs(one["torque"]))
    key = "upper" if joint["torque"] > 0.0 else "lower"
    joint[key] = joint["torque"] * (1.0 - 3e-6)


@forgery("tree")
def normal_limit_is_missed_by_three_millionths(document: Document) -> None:
    contact = min(document["contacts"], key=lambda one: abs(np.dot(one["force"], one["normal"])))
    contact["max_normal_force"] = float(np.dot(contact["force"], contact["normal"])) * (1.0 - 3e-6)
    contact["max_normal_force"] -= 1e-4


@forgery("far")
def bound_of_a_far_answer_is_half_too_large(document: Document) -> None:
    """A millionth of such an answer is no tolerance of the bound."""
    document["certificate"]["bound"] *= 1.05
    document["certificate"]["gap"] = document["max_torque"] - document["certificate"]["bound"]


@forgery("tree")
def optimum_is_guaranteed(document: Document) -> None:
    says("strong", "the best found of the torques that guarantee rest")(document)
    document["guarantee"] = {"best_case": document["max_torque"], "gap": 0.0, "tried": 1}


@forgery("guaranteed")
def guaranteed_torques_are_the_best_case(document: Document) -> None:
    torque = document["max_torque"]
    document["guarantee"] |= {"best_case": torque, "gap": 0.0}
    document["certificate"] |= {"bound": torque, "gap": 0.0}


@forgery("limit")
def proof_of_the_optimum_is_that_of_a_larger_bound(document: Document) -> None:
    """With leaves that each prove something, of other parts of the modes."""
    nodes = copy.deepcopy(base("tree")["proof"]["nodes"])
    leaf = [node for node in nodes if node["kind"] == "bound"][-1]
    document["proof"]["nodes"] = [leaf if node["kind"] == "bound" else node for node in nodes]
    _bound(document, 0.5 * (base("tree")["max_torque"] + document["max_torque"]))


@forgery("tree")
def torques_of_two_joints_are_swapped(document: Document) -> None:
    first, second = document["joints"]
    for key in ("torque", "torque_contact"):
        first[key], second[key] = second[key] + 0.01, first[key]


@forgery("one-sided joints")
def limits_of_two_joints_are_swapped(document: Document) -> None:
    joints = document["joints"]
    limits = [{key: one[key] for key in ("lower", "upper")} for one in joints]
    for joint, other in zip(joints, [*limits[1:], limits[0]], strict=True):
        joint |= {"upper": -abs(other["upper"] or 1.0), "lower": -1e3}


@forgery("shares")
def limit_of_the_worst_joint_is_left_out(document: Document) -> None:
    """Without a limit it has no share: the other's share is said to be the least."""
    joints = document["joints"]
    worst = max(joints, key=lambda one: abs(one["torque"]))
    worst["upper"] = worst["lower"] = None
    other = min(joints, key=lambda one: abs(one["torque"]))
    set_optimum(document, abs(other["torque"]) / other["upper"])


@forgery("margin")
def load_and_forces_are_none(document: Document) -> None:
    document["external_wrench"] = ZERO6
    for contact in document["contacts"]:
        contact["force"] = [0.0, 0.0, 0.0]
    document["scales"]["force"] = min(c["max_normal_force"] for c in document["contacts"])
    follow(document)
    set_optimum(document, document["margin"])


@forgery("limit")
def multipliers_of_1e15_beside_small_ones(document: Document) -> None:
    """Two of them take each other away but for the bound that they should prove."""
    for node in document["proof"]["nodes"]:
        if node["kind"] == "bound":
            up, down = node["multipliers"]["share_upper"], node["multipliers"]["share_lower"]
            node["multipliers"]["share_upper"] = [one + 1e15 for one in up]
            node["multipliers"]["share_lower"] = [one + 1e15 for one in down]
    _bound(document, document["max_torque"])


@forgery("limit")
def multipliers_of_1e40(document: Document) -> None:
    for node in document["proof"]["nodes"]:
        if node["kind"] == "bound":
            node["multipliers"]["balance"] = times(1e40)(node["multipliers"]["balance"])
            node["multipliers"]["share_upper"] = times(1e40)(node["multipliers"]["share_upper"])
            node["multipliers"]["share_lower"] = times(1e40)(node["multipliers"]["share_lower"])
    _bound(document, document["max_torque"])


# some figures or words


_TABLE: tuple[tuple[Any, ...], ...] = (
    ("resolution_just_too_coarse", "slope", lambda d: _coarse(d, 0.0101)),
    ("kept_motion_at_a_coarse_resolution", "kept", lambda d: _coarse(d, 0.5)),
    ("guaranteed_torques_at_a_coarse_resolution", "guaranteed", lambda d: _coarse(d, 2.0)),
    ("force_limit_is_null_with_a_tree", "slope", put("stability", "proof", "force_limit", to=None)),
    ("force_limit_is_null_with_loads", "pressed",
     put("stability", "proof", "force_limit", to=None)),
    ("least_forces_hold_for_small_forces_alone", "pressed",
     put("stability", "proof", "force_limit", to=20.0)),
    ("weak_says_that_it_holds", "walls",
     put("stability", "message", to="holds: rest is the only outcome (proof: 3 LPs)")),
    ("hybrid_finger_is_a_joint_of_no_mass", "hybrid", put("joint_inertia", to=[[1e-20]])),
    ("inertia_is_not_symmetric", "slope", put("object_inertia", 0, 4, to=0.01)),
    ("inertia_is_negative", "slope", put("object_inertia", 4, 4, by=times(-1.0))),
    ("disturbance_without_spans_is_borne", "borne flat",
     put("disturbances", "directions", 0, "spans", to=[])),
    ("direction_is_turned_up", "borne flat",
     put("disturbances", "directions", 0, "direction", to=[0.0, 0.8, 0.6, 0.0, 0.0, 0.0])),
    ("direction_is_no_unit", "borne flat",
     put("disturbances", "directions", 0, "direction", by=times(0.5))),
    ("gap_of_a_far_answer", "far", put("certificate", "gap", by=more(-0.05))),
    ("margin_of_a_far_answer", "far", put("margin", by=more(1e-3))),
    ("infeasible_under_a_rule_that_was_not_asked_for", "infeasible modes",
     put("rules", "sliding_rule", to="exempt")),
    ("violation_is_a_hundredth_larger", "infeasible forces",
     put("certificate", "infeasibility", by=times(1.01))),
    ("proof_looks_at_small_forces_alone", "tree", put("certificate", "force_reach", to=10.0)),
    ("torque_is_a_share_of_the_limits", "torque", put("scale", to="limits")),
    ("share_of_the_limits_is_a_torque", "shares", put("scale", to="absolute")),
    ("rule_of_friction_is_coulombs", "tree", put("rules", "static_friction", to="coulomb")),
    ("round_cones_are_edges", "round tree", put("cone", to="edges")),
    ("cones_have_three_edges", "tree", put("cone_edges", to=3)),
    ("smaller_margin_with_the_same_optimum", "tree", put("required_margin", to=0.01)),
    ("load_is_turned", "tree", put("external_wrench", by=times(-1.0))),
    ("bound_is_larger_by_three_millionths", "limit",
     lambda d: _bound(d, d["certificate"]["bound"] * (1.0 + 3e-6))),
    ("bound_is_the_answer_itself", "limit", lambda d: _bound(d, d["max_torque"])),
    ("margin_is_the_word_nan", "tree", put("margin", to="NaN")),
    ("torque_is_not_a_number", "tree", put("joints", 0, "torque", to=math.nan)),
    ("normal_limit_is_null", "tree", put("contacts", 0, "max_normal_force", to=None)),
    ("normal_limit_is_subnormal", "tree", put("contacts", 0, "max_normal_force", to=5e-324)),
    ("force_is_null", "tree", put("contacts", 0, "force", to=None)),
    ("infinity_is_written_as_a_large_number", "tree", put("joints", 0, "upper", to=1e308)),
    ("selected_is_a_number", "tree", put("contacts", 0, "selected", to=1)),
    ("index_is_no_whole_number", "tree", put("multipliers", "faces", 0, 0, to=0.0)),
    ("contact_is_left_out_of_the_problem", "tree",
     put("contacts", by=lambda contacts: contacts[:-1])),
    ("infeasible_in_a_mode_is_infeasible", "infeasible in a mode",
     says("infeasible_forces", "infeasible: no contact forces")),
    ("infeasible_by_modes_is_infeasible_by_forces", "infeasible modes",
     says("infeasible_forces", "infeasible: no contact forces")),
    ("best_found_is_optimal", "limit", _is_the_best),
    ("far_answer_is_optimal", "far", _is_the_best),
    ("falling_box_of_a_scene_is_at_rest", "walls of a scene", rest_at_thirty_loads_over_mass),
    ("motion_of_another_size", "walls",
     put("stability", "motion", "object_acceleration", by=times(1e7)),
     put("stability", "motion", "point_acceleration", by=times(1e7))),
    ("hybrid_finger_commands_half_of_it", "hybrid", put("joints", ..., "torque", by=times(0.5))),
    ("moments_count_ten_times", "borne flat",
     put("disturbances", "characteristic_length", by=times(10.0)),
     put("disturbances", "directions", 0, "direction", to=[0.0, 0.6, 0.0, 0.8, 0.0, 0.0])),
    ("span_is_wider", "borne flat",
     put("disturbances", "directions", 0, "spans", -1, 1, "magnitude", by=times(1.1)),
     put("disturbances", "directions", 0, "guaranteed", by=times(1.1)),
     put("disturbances", "directions", 0, "failing", by=times(1.1))),
    ("weight_is_borne_without_inertia_to_1e9_loads", "borne bare",
     put("disturbances", "largest", to=1e9),
     put("disturbances", "directions", 0, "guaranteed", to=1e9),
     put("disturbances", "directions", 0, "possible", to=1e9),
     put("disturbances", "directions", 0, "spans", -1, 1, "magnitude", to=1e9)),
    ("torque_of_a_far_answer", "far", put("joints", 0, "torque", by=more(1e-4)),
     put("joints", 0, "torque_contact", by=more(1e-4))),
    ("largest_torque_of_a_far_answer", "far", put("max_torque", by=more(-1e-3)),
     put("certificate", "gap", by=more(-1e-3))),
    ("balance_of_a_far_answer", "far", put("contacts", 0, "force", 2, by=more(1e-3)), follow),
    ("optimum_of_a_mode_is_one_of_all", "in a mode",
     put("contacts", 1, "signs", by=lambda signs: [-one for one in signs]),
     says("optimal", OPTIMAL)),
    ("feasible_margin_is_infeasible", "infeasible forces", put("required_margin", to=0.1),
     put("certificate", "infeasibility", to=0.0)),
    ("mode_without_motion_has_none_of_forces", "infeasible mode",
     put("contacts", ..., "selected", to=False), put("contacts", ..., "signs", to=[0, 0])),
    ("not_found_is_impossible", "not guaranteed",
     says("infeasible_strong", "infeasible: no torques guarantee rest")),
    ("normal_is_turned", "tree", put("contacts", 0, "normal", by=times(-1.0)),
     put("contacts", 0, "tangents", by=lambda pair: pair[::-1])),
    ("normal_and_force_are_turned", "tree", put("contacts", ..., "normal", by=times(-1.0)),
     put("contacts", ..., "force", by=times(-1.0)), follow),
    ("frames_are_scaled", "tree", put("contacts", ..., "normal", by=times(0.5))),
    ("forces_in_kilonewtons", "tree", put("contacts", ..., "force", by=times(1e-3)), follow,
     lambda d: set_optimum(d, d["max_torque"])),
    ("lengths_in_millimetres", "tree", put("contacts", ..., "position", by=times(1e3)),
     put("scales", "length", by=times(1e3))),
    ("limits_are_a_thousand_times_as_wide", "shares", put("joints", ..., "upper", by=times(1e3)),
     put("joints", ..., "lower", by=times(1e3)), put("certificate", "bound", by=times(0.9e-3))),
    ("torque_limits_are_left_out", "infeasible forces", put("joints", ..., "upper", to=None),
     put("joints", ..., "lower", to=None), put("contacts", ..., "max_normal_force", to=1e9),
     put("certificate", "force_reach", to=1e9)),
    ("rule_of_signs_is_another", "tree", put("rules", "sign_rule", to="nonzero"),
     put("contacts", 0, "selected", to=True), put("contacts", 0, "signs", to=[0, 1])),
    ("stale_motion_of_another_mode", "tree", put("proof", "motion", "object", by=times(-1.0)),
     put("proof", "motion", "joints", by=times(-1.0))),
    ("conflict_of_nothing", "limit",
     put("proof", "nodes",
         to=[{"kind": "conflict", "items": [], "open": None, "combinations": [[]]}]),
     lambda d: _bound(d, d["max_torque"])),
    ("leaf_proves_that_there_is_nothing", "tree",
     put("proof", "nodes", by=lambda nodes: [nodes[-1] | {"objective": False}])),
    ("figure_is_a_whole_number_beyond_double", "tree",
     put("certificate", "force_reach", to=2**53 + 1),
     put("contacts", 0, "max_normal_force", to=10**400)),
    ("load_of_1e8_beside_the_same_limits", "torque", *(put(*path, by=times(1e8)) for path in (
         ("external_wrench",), ("contacts", ..., "force"), ("contacts", ..., "max_normal_force"),
         ("joints", ..., "torque"), ("joints", ..., "torque_contact"),
         ("joints", ..., "torque_gravity"), ("margin",), ("max_torque",), ("required_margin",),
         ("certificate", "bound"),
         ("certificate", "gap"), ("certificate", "force_reach"), ("scales", "force"),
     ))),
)  # fmt: skip
FORGERIES += [Forgery(name, source, in_turn(*steps)) for name, source, *steps in _TABLE]
