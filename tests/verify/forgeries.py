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
import test_kept_motions
import test_rest
from scenes import scene  # pyright: ignore[reportMissingImports] - tests/core
from test_guarantee import document as guaranteed
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
G = 9.81
ZERO6 = [0.0] * 6


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
        return bool(failing(self.made()) - failing(base(self.base)))

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
        torque_limits=(10.0, 10.0), object_inertia=np.diag([1.0] * 3 + [1e-3] * 3),
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
    **{name: (lambda name=name: test_rest.document(name)) for name in test_rest.CASES},
    "unrest": lambda: test_rest.document("pressed", 0.1),
    "kept": lambda: test_kept_motions.document("kept"),
    "lost": lambda: test_kept_motions.document("lost"),
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
    "far": {"multipliers of these forces", "duality gap as stated"},
    "unrest": {"torques J^T f + g as stated"},
}
"""What fails already of documents that forgeries start from; of all others nothing does."""


def failing(document: Document) -> set[str]:
    """Return the names of the checks that fail; a document that cannot be read fails, too."""
    try:
        return {one.name for one in verify_document(document).checks if one.passed is False}
    except ValueError as error:
        return {str(error)}


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


def _follow(document: Document) -> None:
    """Make margin and torques fit the forces."""
    claimed = read_solution(document)
    document["margin"], document["max_torque"] = claimed.margin, claimed.max_torque
    for index, joint in enumerate(document["joints"]):
        joint["torque"] = float(claimed.torques[index])
        joint["torque_contact"] = float(claimed.contact_torques[index])


def _best(document: Document, value: float) -> None:
    document["certificate"] |= {"bound": value, "gap": 0.0, "duality_gap": 0.0}


def _torque(document: Document) -> float:
    return max(abs(joint["torque"]) for joint in document["joints"])


def _bound(document: Document, value: float) -> None:
    """State a bound of an answer that is not said to be the best, and the gap to it."""
    document["certificate"] |= {"bound": value, "gap": document["max_torque"] - value}


def _times(given: Any, factor: float) -> Any:
    """All numbers of nested lists, times a factor."""
    return [_times(one, factor) for one in given] if isinstance(given, list) else factor * given


def _direction(document: Document) -> dict[str, Any]:
    return document["disturbances"]["directions"][0]


# resolutions: how fast an object is that counts as at rest


@forgery("walls")
def rest_at_thirty_loads_over_mass(document: Document) -> None:
    """One node with multipliers of zero proves that nothing accelerates by more than a load."""
    _as_strong(document, [_leaf(document)])
    _coarse(document, 30.0)


@forgery("walls of a scene")
def falling_box_of_a_scene_is_at_rest(document: Document) -> None:
    _as_strong(document, [_leaf(document)])
    _coarse(document, 30.0)


@forgery("slope")
def resolution_just_too_coarse(document: Document) -> None:
    _coarse(document, 0.0101)


@forgery("kept")
def kept_motion_at_a_coarse_resolution(document: Document) -> None:
    _coarse(document, 0.5)


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


@forgery("guaranteed")
def guaranteed_torques_at_a_coarse_resolution(document: Document) -> None:
    _coarse(document, 2.0)


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


@forgery("walls")
def motion_of_another_size(document: Document) -> None:
    motion = document["stability"]["motion"]
    motion["object_acceleration"] = _times(motion["object_acceleration"], 1e7)
    motion["point_acceleration"] *= 1e7


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
def force_limit_is_null_with_a_tree(document: Document) -> None:
    document["stability"]["proof"]["force_limit"] = None


@forgery("pressed")
def force_limit_is_null_with_loads(document: Document) -> None:
    document["stability"]["proof"]["force_limit"] = None


@forgery("pressed")
def least_forces_hold_for_small_forces_alone(document: Document) -> None:
    document["stability"]["proof"]["force_limit"] = 20.0


@forgery("slope")
def tree_omits_a_child(document: Document) -> None:
    nodes = document["stability"]["proof"]["nodes"]
    (leaf, parent), *_ = [one for one in test_rest.leaves(nodes) if one[1] is not None]
    nodes[parent]["children"] -= 1
    del nodes[leaf]


@forgery("slope")
def node_stands_for_its_sibling(document: Document) -> None:
    nodes = document["stability"]["proof"]["nodes"]
    first, second = test_rest.leaves(nodes)[:2]
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


@forgery("slope")
def arc_of_more_than_all_directions(document: Document) -> None:
    for node in document["stability"]["proof"]["nodes"]:
        if node["slip"] is not None:
            node["slip"] = [node["slip"][0], 40.0]


@forgery("slope")
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
    load["multipliers"] = {key: _times(one, 1e17) for key, one in load["multipliers"].items()}


@forgery("smooth")
def certificate_of_forces_that_pull(document: Document) -> None:
    document["external_wrench"] = [0.0, 0.0, G, 0.0, 0.0, 0.0]
    for where in (document["stability"], document["stability"]["proof"]):
        for key in ("rest_forces", "forces"):
            if key in where:
                where[key] = _times(where[key], -1.0)


@forgery("unrest")
def unrest_is_rest(document: Document) -> None:
    document["stability"] |= {
        key: copy.deepcopy(base("pressed")["stability"][key])
        for key in ("status", "message", "proof", "rest_forces", "no_rest", "motion")
    }


@forgery("pressed")
def rest_is_unrest_by_a_huge_motion(document: Document) -> None:
    z = _times(base("unrest")["stability"]["no_rest"], 1e30)
    document["stability"] |= {"status": "none", "message": "fails: rest is no outcome",
                              "no_rest": z, "motion": None, "proof": None}  # fmt: skip


@forgery("walls")
def weak_says_that_it_holds(document: Document) -> None:
    document["stability"]["message"] = "holds: rest is the only outcome (proof: 3 LPs)"


@forgery("walls")
def weak_is_strong_by_its_certificate_of_rest(document: Document) -> None:
    _as_strong(document, [])
    document["stability"]["proof"] |= {
        "nodes": None, "forces": document["stability"]["rest_forces"], "force_limit": None,
    }  # fmt: skip


@forgery("hybrid")
def hybrid_finger_commands_half_of_it(document: Document) -> None:
    for joint in document["joints"]:
        joint["torque"] *= 0.5


@forgery("hybrid")
def hybrid_finger_is_a_joint_of_no_mass(document: Document) -> None:
    document["joint_inertia"] = [[1e-20]]


# inertias


@forgery("walls")
def mass_is_small_along_x_alone(document: Document) -> None:
    """Accelerations count in load over mass: a mass of nothing makes all of them rest."""
    document["object_inertia"][0][0] = 1e-6
    _as_strong(document, [_leaf(document)])
    document["stability"]["acceleration_limit"] *= 1e6


@forgery("walls of a scene")
def mass_is_not_that_of_the_scene(document: Document) -> None:
    document["object_inertia"] = _times(document["object_inertia"], 1e-3)
    said = document["stability"]
    said["acceleration_limit"] *= 1e3
    if said["motion"] is not None:
        for key in ("object_acceleration", "point_acceleration"):
            said["motion"][key] = _times(said["motion"][key], 1e3)


@forgery("slope")
def inertia_is_not_symmetric(document: Document) -> None:
    document["object_inertia"][0][4] = 0.01


@forgery("slope")
def inertia_is_negative(document: Document) -> None:
    document["object_inertia"][4][4] *= -1.0


# disturbances


@forgery("borne flat")
def disturbance_without_spans_is_borne(document: Document) -> None:
    _direction(document)["spans"] = []


@forgery("borne flat")
def disturbance_is_twice_as_large(document: Document) -> None:
    _direction(document)["guaranteed"] *= 2.0


@forgery("borne flat")
def span_is_wider(document: Document) -> None:
    claim = _direction(document)
    claim["spans"][-1][1]["magnitude"] *= 1.1
    claim["guaranteed"] *= 1.1
    claim["failing"] *= 1.1


@forgery("borne slot")
def first_span_is_left_out(document: Document) -> None:
    del _direction(document)["spans"][0]


@forgery("borne flat")
def moments_count_ten_times(document: Document) -> None:
    document["disturbances"]["characteristic_length"] *= 10.0
    claim = _direction(document)
    claim["direction"] = [0.0, 0.6, 0.0, 0.8, 0.0, 0.0]


@forgery("borne flat")
def direction_is_turned_up(document: Document) -> None:
    _direction(document)["direction"] = [0.0, 0.8, 0.6, 0.0, 0.0, 0.0]


@forgery("borne flat")
def direction_is_no_unit(document: Document) -> None:
    _direction(document)["direction"] = _times(_direction(document)["direction"], 0.5)


@forgery("borne flat")
def nothing_beyond_was_looked_at(document: Document) -> None:
    """As much as was looked at can be balanced, is said of a push that nothing balances."""
    claim = _direction(document)
    claim["possible"], claim["no_rest"] = 1e4, None
    document["disturbances"]["largest"] = 1e4
    forces = np.array(claim["forces"])
    claim["forces"] = (forces * 1e4 / np.abs(forces).max()).tolist()


@forgery("borne slot")
def failure_of_a_smaller_push(document: Document) -> None:
    claim = _direction(document)
    claim["failing"] = 0.9 * claim["guaranteed"]


@forgery("borne bare")
def weight_is_borne_without_inertia_to_1e9_loads(document: Document) -> None:
    claim = _direction(document)
    claim["guaranteed"] = claim["possible"] = document["disturbances"]["largest"] = 1e9
    claim["spans"][-1][1]["magnitude"] = 1e9


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


@forgery("torque")
def load_of_1e8_beside_the_same_limits(document: Document) -> None:
    """Millimetres typed as metres: the torque at several times its limit."""
    document["external_wrench"] = _times(document["external_wrench"], 1e8)
    for contact in document["contacts"]:
        contact["force"] = _times(contact["force"], 1e8)
        contact["max_normal_force"] *= 1e8
    for joint in document["joints"]:
        joint["torque"] *= 1e8
        joint["torque_contact"] *= 1e8
        joint["torque_gravity"] *= 1e8
    for key in ("margin", "max_torque", "required_margin"):
        document[key] *= 1e8
    for key in ("bound", "gap", "force_reach"):
        document["certificate"][key] *= 1e8
    document["scales"]["force"] *= 1e8


@forgery("far")
def bound_of_a_far_answer_is_half_too_large(document: Document) -> None:
    """A millionth of such an answer is no tolerance of the bound."""
    document["certificate"]["bound"] *= 1.05
    document["certificate"]["gap"] = document["max_torque"] - document["certificate"]["bound"]


@forgery("far")
def gap_of_a_far_answer(document: Document) -> None:
    document["certificate"]["gap"] -= 0.05


@forgery("far")
def far_answer_is_optimal(document: Document) -> None:
    document["status"] = "optimal"
    document["message"] = "optimal over all feasible virtual-sliding modes"
    _best(document, document["max_torque"])


@forgery("far")
def torque_of_a_far_answer(document: Document) -> None:
    document["joints"][0]["torque"] += 1e-4
    document["joints"][0]["torque_contact"] += 1e-4


@forgery("far")
def margin_of_a_far_answer(document: Document) -> None:
    document["margin"] += 1e-3


@forgery("far")
def largest_torque_of_a_far_answer(document: Document) -> None:
    document["max_torque"] -= 1e-3
    document["certificate"]["gap"] -= 1e-3


@forgery("far")
def balance_of_a_far_answer(document: Document) -> None:
    document["contacts"][0]["force"][2] += 1e-3
    _follow(document)


@forgery("limit")
def best_found_is_optimal(document: Document) -> None:
    document["status"] = "optimal"
    document["message"] = "optimal over all feasible virtual-sliding modes"
    _best(document, document["max_torque"])


@forgery("in a mode")
def optimum_of_a_mode_is_one_of_all(document: Document) -> None:
    document["contacts"][1]["signs"] = [-one for one in document["contacts"][1]["signs"]]
    document["status"] = "optimal"
    document["message"] = "optimal over all feasible virtual-sliding modes"


@forgery("infeasible in a mode")
def infeasible_in_a_mode_is_infeasible(document: Document) -> None:
    document["status"] = "infeasible_forces"
    document["message"] = "infeasible: no contact forces"


@forgery("infeasible modes")
def infeasible_by_modes_is_infeasible_by_forces(document: Document) -> None:
    document["status"] = "infeasible_forces"
    document["message"] = "infeasible: no contact forces"


@forgery("infeasible modes")
def infeasible_under_a_rule_that_was_not_asked_for(document: Document) -> None:
    document["rules"]["sliding_rule"] = "exempt"


@forgery("infeasible mode")
def mode_without_motion_has_none_of_forces(document: Document) -> None:
    for contact in document["contacts"]:
        contact["selected"], contact["signs"] = False, [0, 0]


@forgery("infeasible forces")
def violation_is_a_hundredth_larger(document: Document) -> None:
    document["certificate"]["infeasibility"] *= 1.01


@forgery("infeasible forces")
def feasible_margin_is_infeasible(document: Document) -> None:
    document["required_margin"] = 0.1
    document["certificate"]["infeasibility"] = 0.0


@forgery("not guaranteed")
def not_found_is_impossible(document: Document) -> None:
    document["status"] = "infeasible_strong"
    document["message"] = "infeasible: rest is the only outcome of no torques"


@forgery("tree")
def optimum_is_guaranteed(document: Document) -> None:
    document["status"] = "strong"
    document["message"] = "the best found of the torques of which rest is the only outcome"
    document["guarantee"] = {"best_case": document["max_torque"], "gap": 0.0, "tried": 1}


@forgery("guaranteed")
def guaranteed_torques_are_the_best_case(document: Document) -> None:
    torque = document["max_torque"]
    document["guarantee"] |= {"best_case": torque, "gap": 0.0}
    document["certificate"] |= {"bound": torque, "gap": 0.0}


@forgery("tree")
def proof_omits_a_child(document: Document) -> None:
    nodes = document["proof"]["nodes"]
    del nodes[next(index for index, one in enumerate(nodes) if one["kind"] == "bound")]


@forgery("limit")
def proof_of_the_optimum_is_that_of_a_larger_bound(document: Document) -> None:
    """With leaves that each prove something, of other parts of the modes."""
    nodes = copy.deepcopy(base("tree")["proof"]["nodes"])
    leaf = [node for node in nodes if node["kind"] == "bound"][-1]
    document["proof"]["nodes"] = [leaf if node["kind"] == "bound" else node for node in nodes]
    _bound(document, 0.5 * (base("tree")["max_torque"] + document["max_torque"]))


@forgery("limit")
def conflict_of_nothing(document: Document) -> None:
    document["proof"]["nodes"] = [
        {"kind": "conflict", "items": [], "open": None, "combinations": [[]]}
    ]
    _bound(document, document["max_torque"])


@forgery("tree")
def leaf_proves_that_there_is_nothing(document: Document) -> None:
    document["proof"]["nodes"] = [document["proof"]["nodes"][-1] | {"objective": False}]


@forgery("tree")
def proof_looks_at_small_forces_alone(document: Document) -> None:
    document["certificate"]["force_reach"] = 10.0


@forgery("tree")
def normal_is_turned(document: Document) -> None:
    contact = document["contacts"][0]
    contact["normal"] = _times(contact["normal"], -1.0)
    contact["tangents"] = [contact["tangents"][1], contact["tangents"][0]]


@forgery("tree")
def normal_and_force_are_turned(document: Document) -> None:
    for contact in document["contacts"]:
        contact["normal"] = _times(contact["normal"], -1.0)
        contact["force"] = _times(contact["force"], -1.0)
    _follow(document)


@forgery("tree")
def frames_are_scaled(document: Document) -> None:
    for contact in document["contacts"]:
        contact["normal"] = _times(contact["normal"], 0.5)


@forgery("tree")
def forces_in_kilonewtons(document: Document) -> None:
    """All forces, torques and figures of the answer, not the load."""
    for contact in document["contacts"]:
        contact["force"] = _times(contact["force"], 1e-3)
    _follow(document)
    _best(document, document["max_torque"])


@forgery("tree")
def lengths_in_millimetres(document: Document) -> None:
    for contact in document["contacts"]:
        contact["position"] = _times(contact["position"], 1e3)
    document["scales"]["length"] *= 1e3


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
    _best(document, abs(other["torque"]) / other["upper"])


@forgery("torque")
def torque_is_a_share_of_the_limits(document: Document) -> None:
    document["scale"] = "limits"


@forgery("shares")
def share_of_the_limits_is_a_torque(document: Document) -> None:
    document["scale"] = "absolute"


@forgery("shares")
def limits_are_a_thousand_times_as_wide(document: Document) -> None:
    for joint in document["joints"]:
        joint["upper"], joint["lower"] = 1e3 * joint["upper"], 1e3 * joint["lower"]
    document["certificate"]["bound"] *= 1e-3
    document["certificate"]["bound"] *= 0.9


@forgery("infeasible forces")
def torque_limits_are_left_out(document: Document) -> None:
    for joint in document["joints"]:
        joint["upper"] = joint["lower"] = None
    for contact in document["contacts"]:
        contact["max_normal_force"] = 1e9
    document["certificate"]["force_reach"] = 1e9


@forgery("tree")
def rule_of_friction_is_coulombs(document: Document) -> None:
    document["rules"]["static_friction"] = "coulomb"


@forgery("tree")
def rule_of_signs_is_another(document: Document) -> None:
    document["rules"]["sign_rule"] = "nonzero"
    document["contacts"][0] |= {"selected": True, "signs": [0, 1]}


@forgery("round tree")
def round_cones_are_edges(document: Document) -> None:
    document["cone"] = "edges"


@forgery("tree")
def cones_have_three_edges(document: Document) -> None:
    document["cone_edges"] = 3


@forgery("tree")
def smaller_margin_with_the_same_optimum(document: Document) -> None:
    document["required_margin"] = 0.01


@forgery("tree")
def load_is_turned(document: Document) -> None:
    document["external_wrench"] = _times(document["external_wrench"], -1.0)


@forgery("margin")
def load_and_forces_are_none(document: Document) -> None:
    document["external_wrench"] = ZERO6
    for contact in document["contacts"]:
        contact["force"] = [0.0, 0.0, 0.0]
    document["scales"]["force"] = min(c["max_normal_force"] for c in document["contacts"])
    _follow(document)
    _best(document, document["margin"])


@forgery("tree")
def stale_motion_of_another_mode(document: Document) -> None:
    motion = document["proof"]["motion"]
    motion["object"] = _times(motion["object"], -1.0)
    motion["joints"] = _times(motion["joints"], -1.0)


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
            node["multipliers"]["balance"] = _times(node["multipliers"]["balance"], 1e40)
            node["multipliers"]["share_upper"] = _times(node["multipliers"]["share_upper"], 1e40)
            node["multipliers"]["share_lower"] = _times(node["multipliers"]["share_lower"], 1e40)
    _bound(document, document["max_torque"])


@forgery("limit")
def bound_is_larger_by_three_millionths(document: Document) -> None:
    _bound(document, document["certificate"]["bound"] * (1.0 + 3e-6))


@forgery("limit")
def bound_is_the_answer_itself(document: Document) -> None:
    _bound(document, document["max_torque"])


# values that readers take for others


@forgery("tree")
def margin_is_the_word_nan(document: Document) -> None:
    document["margin"] = "NaN"


@forgery("tree")
def torque_is_not_a_number(document: Document) -> None:
    document["joints"][0]["torque"] = math.nan


@forgery("tree")
def normal_limit_is_null(document: Document) -> None:
    document["contacts"][0]["max_normal_force"] = None


@forgery("tree")
def normal_limit_is_subnormal(document: Document) -> None:
    document["contacts"][0]["max_normal_force"] = 5e-324


@forgery("tree")
def force_is_null(document: Document) -> None:
    document["contacts"][0]["force"] = None


@forgery("tree")
def infinity_is_written_as_a_large_number(document: Document) -> None:
    document["joints"][0]["upper"] = 1e308


@forgery("tree")
def figure_is_a_whole_number_beyond_double(document: Document) -> None:
    document["certificate"]["force_reach"] = 2**53 + 1
    document["contacts"][0]["max_normal_force"] = 10**400


@forgery("tree")
def selected_is_a_number(document: Document) -> None:
    document["contacts"][0]["selected"] = 1


@forgery("tree")
def format_is_true(document: Document) -> None:
    document["format"] = True


@forgery("tree")
def index_is_no_whole_number(document: Document) -> None:
    document["multipliers"]["faces"][0][0] = 0.0


@forgery("tree")
def unit_is_another(document: Document) -> None:
    document["max_torque_unit"] = "N"


@forgery("tree")
def contact_is_left_out_of_the_problem(document: Document) -> None:
    del document["contacts"][-1]
