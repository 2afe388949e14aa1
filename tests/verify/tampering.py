"""Tamper with documents and ask the checker: every false claim must be refused.

Whether a tampered document claims anything false is decided without the checker: the problem that
it states is solved again by the package, and its figures are held against that truth. What stays
true, such as a smaller multiplier that still proves, need not be refused; what is off by less than
ten tolerances is left open. `forgeries` has those that were made by hand, of verdicts and
disturbances, too.

Run it with ``make tampering``.
"""

from __future__ import annotations

import argparse
import copy
import sys
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parents[2]))

from forgeries import FORGERIES, REFUSED, bases, failing_before, follow
from tests.core.scenes import random_arguments, rescaled, scene, structured_arguments
from verified_documents import SCALES, Document, documented, refused, slab

from graspless_pin import (
    QuasistaticProblem,
    Status,
    TorqueSolution,
    enumerate_modes,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import GrasplessPinError
from graspless_pin.modes.kinematics import VirtualKinematics, requirements_of
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem.quasistatic import contact_map
from graspless_pin.report.reading import read_solution
from graspless_pin.report.verify import verify_document

_SURELY = 1e-5
"""Of the load: a figure that is off by more is false."""
_FOUND = (Status.OPTIMAL, Status.OPTIMAL_IN_MODE, Status.LIMIT_REACHED)
_INFEASIBLE = (Status.INFEASIBLE_FORCES, Status.INFEASIBLE_MODES, Status.INFEASIBLE_IN_MODE,
               Status.INFEASIBLE_MODE)  # fmt: skip

Tamper = Callable[[Document, np.random.Generator, list[Document]], None]


@dataclass(frozen=True)
class Outcome:
    """What became of one tampered document.

    Attributes:
        kind: How it was tampered with.
        false: Whether it surely claims something false.
        refused: Whether the checker refused it.
        why: What is false.
    """

    kind: str
    false: bool
    refused: bool
    why: str


# documents


@cache
def originals() -> list[Document]:
    """Thirteen documents over six scales, five of them of infeasible answers; not to be changed."""
    planar = QuasistaticProblem(**structured_arguments(4, "planar", 7))
    fingers = QuasistaticProblem(**random_arguments(1, 4, slides=1))
    cases: list[tuple[QuasistaticProblem, str, float, dict[str, Any]]] = [
        (scene("rest"), "torque", 0.1, {}),
        (scene("up"), "margin", 0.0, {}),
        (scene("sphere"), "torque", 0.1, {"scale": "limits"}),
        (planar, "torque", 1.0, {"sign_rule": "exact", "sliding_rule": "constrained"}),
        (slab(), "margin", 0.0, {"sign_rule": "nonzero"}),
        (scene("rest"), "torque", 0.1, {"static_friction": "coulomb"}),
        (scene("rest"), "torque", 0.1, {"regularization": 1e-2}),
        (fingers, "torque", 0.1, {"scale": "limits"}),
        (scene("rest"), "torque", 40.0, {}),
        (scene("up"), "margin", 0.0, {"sliding_rule": "constrained"}),
        (weak("sphere", 50.0), "torque", 0.1, {}),
        (weak("rest", 1e7), "torque", 0.1, {"scale": "limits"}),
        (weak("down", 1e12), "margin", 0.0, {}),
    ]
    documents = []
    for index, (problem, algorithm, margin, options) in enumerate(cases):
        force, length = SCALES[index % len(SCALES)]
        problem = rescaled(problem, force, length)
        documents.append(documented(_solved(problem, algorithm, margin * force, **options)))
    return documents


def weak(name: str, limit: float) -> QuasistaticProblem:
    """One of the paper's scenes with motors too weak for it, and limits of normal forces."""
    return scene(name).with_changes(torque_limits=(-0.5, 0.5), max_normal_force=limit)


def _solved(
    problem: QuasistaticProblem, algorithm: str, margin: float, **options: Any
) -> TorqueSolution:
    if algorithm == "margin":
        return maximize_margin(problem, **options)
    return minimize_torque(problem, margin, **options)


# the truth


def falsehood(document: Document, original: Document) -> str:
    """Return what a document surely claims that is false; empty if nothing is."""
    for path in _places(original):
        with suppress(KeyError, IndexError, TypeError):
            place, key = _at(document, path)
            if not _is_number(place[key]):
                return f"no number: {path}"
    try:
        return _falsehood(document, original)
    except GrasplessPinError as error:
        return f"malformed: {error}"
    except (TypeError, ValueError, KeyError, OverflowError) as error:
        return f"malformed: {error}"


def _is_number(value: object) -> bool:
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value is None  # a figure that an answer of another status does not have
    return abs(value) < 1e300


def _falsehood(document: Document, original: Document) -> str:
    claimed = read_solution(document)
    problem, scales = claimed.problem, claimed.problem.scales
    if document["found"] != (claimed.status in _FOUND):
        return "found"
    if not document["message"].startswith(claimed.status.message[:20]):
        return "message"
    stated = document["scales"]["force"], document["scales"]["length"]
    if not np.allclose(stated, [scales.force, scales.length], rtol=_SURELY, atol=0.0):
        return "scales"
    reach = document["certificate"]["force_reach"]
    if reach < min(1e8 * scales.force, problem.max_normal_force.max()) * (1.0 - _SURELY):
        return "reach"
    truth = _truth(claimed)
    if claimed.found:
        if document["certificate"]["infeasibility"] > 0.0:
            return "infeasibility"
        return _stray_multiplier(document, claimed) or _false_answer(document, claimed, truth)
    if claimed.status in _INFEASIBLE:
        if truth.status is not claimed.status:
            return f"status: it is {truth.status.name}"
        stated = document["certificate"]["infeasibility"]
        if stated > original["certificate"]["infeasibility"] * 1.0005 + 1e-12:
            # The data may be others: there the true violation is found anew.
            # A document states less than its search has proven where limits are far.
            found = documented(truth)["certificate"]["infeasibility"]
            found = max(found, truth.certificate.infeasibility)
            if stated > found * 1.0005 + 1e-12:
                return "infeasibility"
    return ""


def _stray_multiplier(document: Document, claimed: TorqueSolution) -> str:
    """Return the name of multipliers that state something of constraints that are not there."""
    if claimed.algorithm != "torque":
        return ""
    stated = document["multipliers"]
    bounds = "normal_upper", "normal_lower"
    return next((key for key in bounds if np.any(stated[key])), "")


_known: dict[str, TorqueSolution] = {}


def _truth(claimed: TorqueSolution) -> TorqueSolution:
    """The solution of the problem that a document states."""
    problem = claimed.problem
    parts = [problem.positions, problem.normals, problem.external_wrench, problem.jacobian,
             problem.friction, problem.tangents, problem.sliding, problem.lower_torque,
             problem.upper_torque, problem.max_normal_force, problem.gravity_torques]  # fmt: skip
    key = repr([part.tobytes() for part in parts]) + repr(
        (problem.cone_edges, claimed.objective, claimed.rules, claimed.given_mode)
    )
    if key not in _known:
        _known[key] = solve_problem(
            problem, claimed.objective, SolveOptions(claimed.rules), mode=claimed.given_mode
        )
    return _known[key]


def _false_answer(document: Document, claimed: TorqueSolution, truth: TorqueSolution) -> str:
    problem = claimed.problem
    scales = problem.scales
    forces = claimed.contact_forces
    room = _SURELY * scales.force
    balance = problem.W @ forces.ravel() + problem.external_wrench
    if np.abs(balance[:3]).max() > room or np.abs(balance[3:]).max() > room * scales.length:
        return "balance"
    if claimed.margin < claimed.required_margin - room:
        return "required margin"
    torques = claimed.torques
    over = np.maximum(torques - problem.upper_torque, problem.lower_torque - torques)
    if (over > _SURELY * scales.joints).any():
        return "torque limits"
    pressing = np.einsum("ij,ij->i", problem.normals, forces)
    kinetic = forces - pressing[:, None] * problem.kinetic_directions
    if np.abs(kinetic[~problem.has_cone]).max(initial=0.0) > room:
        return "kinetic friction"
    joints = document["joints"]
    for key, found in (("torque", claimed.torques), ("torque_contact", claimed.contact_torques)):
        said = np.array([joint[key] for joint in joints])
        if (np.abs(said - found) > _SURELY * scales.joints).any():
            return key
    if abs(document["margin"] - claimed.margin) > room:
        return "margin"
    if abs(document["max_torque"] - claimed.max_torque) > _SURELY * scales.joints.max(initial=0.0):
        return "largest torque"
    units = {unit for unit, torque in zip(problem.joint_units, claimed.torques, strict=True)
             if abs(torque) > claimed.max_torque - _SURELY * scales.joints.max()}  # fmt: skip
    if document["max_torque_unit"] not in (units or {"N m"}):
        return "unit"
    return _false_mode(document, claimed) or _false_optimum(document, claimed, truth)


def _false_mode(document: Document, claimed: TorqueSolution) -> str:
    """Whether friction, rules and motion contradict the stated mode."""
    problem, mode, rules = claimed.problem, claimed.mode, claimed.rules
    friction = np.einsum("lij,li->lj", problem.tangents, claimed.contact_forces)
    friction[~problem.has_cone] = 0.0
    wrong = np.where(mode.signs == 0, np.abs(friction), mode.signs * friction)
    if (wrong > _SURELY * problem.scales.force).any():
        return "friction against the mode"
    if rules.static_friction is StaticFriction.COULOMB and claimed.given_mode is None:
        rubs = np.abs(friction) > _SURELY * problem.scales.force
        return "" if (mode.signs[rubs] != 0).all() else "signs that describe the friction"
    zeros = (mode.signs == 0).sum(axis=1)[mode.selection]
    if (zeros > (rules.sign == "exact")).any():
        return "rule on signs"
    always = problem.is_sliding & (rules.sliding == "constrained")
    if (mode.selection & ~problem.has_cone & ~always).any():
        return "selection of a contact without a cone"
    if (always & ~mode.selection).any():
        return "selection of sliding contacts"
    if not mode.selection.any():
        return ""
    motion = document["proof"]["motion"]
    if motion is None:
        return "no motion"
    twist = np.concatenate([motion["object"], -np.array(motion["joints"])])
    velocities = contact_map(problem) @ twist
    required = requirements_of(mode)
    # Ten times the tolerances of what vanishes, a tenth of what must not.
    lenient = VirtualKinematics(problem, 1e-7)
    size = np.linalg.norm(velocities)
    tidy = np.where(np.abs(velocities) < 1e-7 * size, 0.0, velocities)
    counts = VirtualKinematics(problem).meets_requirements(velocities, required, rules.sign)
    return "" if counts or lenient.meets_requirements(tidy, required, rules.sign) else "motion"


def _false_optimum(document: Document, claimed: TorqueSolution, truth: TorqueSolution) -> str:
    """Whether the answer is no optimum, or bound and gap are not so."""
    if not truth.found:
        return f"status: it is {truth.status.name}"
    own, best = _value(claimed), _value(truth)
    unit = _unit(claimed)
    room = _SURELY * max(unit, abs(best))
    if claimed.status is not Status.LIMIT_REACHED and own > best + room:
        return f"optimum: {own:.6g} against {best:.6g}"
    certificate = document["certificate"]
    sign = -1.0 if claimed.algorithm == "margin" else 1.0
    bound = sign * certificate["bound"]
    if bound > best + room:
        return "bound"
    if abs(certificate["gap"] - (own - bound)) > room:
        return "gap"
    if claimed.status is not Status.LIMIT_REACHED and abs(own - bound) > room:
        return "bound of an optimum"
    if abs(certificate["duality_gap"]) > _SURELY * max(1.0, abs(best) / unit):
        return "duality gap"
    if abs(certificate["primal_residual"]) > _SURELY:
        return "primal residual"
    return ""


def _value(solution: TorqueSolution) -> float:
    """The objective of a solution's forces, minimised, in its own unit."""
    problem = solution.problem
    curved = 0.5 * solution.regularization * _unit(solution) * float(
        (solution.contact_forces**2).sum()
    ) / problem.scales.force**2  # fmt: skip
    if solution.algorithm == "margin":
        return curved - solution.margin
    if not solution.objective.by_limits:
        return curved + solution.max_torque
    with np.errstate(divide="ignore", invalid="ignore"):
        sides = np.where(solution.torques > 0.0, problem.upper_torque, problem.lower_torque)
        shares = np.where(sides != 0.0, solution.torques / sides, 0.0)
    return curved + float(shares.max(initial=0.0))


def _unit(solution: TorqueSolution) -> float:
    problem = solution.problem
    if solution.algorithm == "margin":
        return problem.scales.force
    if not solution.objective.by_limits:
        return float(problem.scales.joints.max(initial=0.0)) or problem.scales.force
    limits = np.concatenate([problem.upper_torque, -problem.lower_torque])
    counts = np.isfinite(limits) & (limits > 0.0)
    shares = np.tile(problem.scales.joints, 2)[counts] / limits[counts]
    return min(float(shares.max(initial=0.0)), 1.0) or 1.0


# tampering


def _places(value: Any, path: tuple[str | int, ...] = ()) -> Iterator[tuple[str | int, ...]]:
    """The ways to all numbers of a document, statistics and words left out."""
    items = value.items() if isinstance(value, dict) else enumerate(value)
    for key, item in items:
        if key in ("provenance", "modes_examined", "nodes", "force_programs", "kinematic_programs",
                   "solver", "format"):  # fmt: skip
            continue
        if isinstance(item, dict | list):
            yield from _places(item, (*path, key))
        elif isinstance(item, int | float) and not isinstance(item, bool):
            yield (*path, key)


def _at(document: Document, path: tuple[str | int, ...]) -> tuple[Any, Any]:
    place: Any = document
    for key in path[:-1]:
        place = place[key]
    return place, path[-1]


def _perturbed(value: float, rng: np.random.Generator) -> float:
    """Relatively by a thousandth or more, of the other sign, zero, or far larger."""
    ways = (1.001, 0.999, -1.0, 0.0, 2.0, 1e3, 1e-3)
    return float(value * ways[rng.integers(len(ways))])


def any_number(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Change one number anywhere."""
    places = [path for path in _places(document) if path[0] != "multipliers"]
    place, key = _at(document, places[rng.integers(len(places))])
    value = place[key]
    if isinstance(value, int) and not isinstance(value, bool):
        place[key] = int(value + rng.choice([-1, 1]))
    else:
        place[key] = _perturbed(value, rng)


def stated_figure(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Change one stated figure."""
    certificate = document["certificate"]
    places = [(document, key) for key in ("margin", "max_torque")]
    figures = "bound", "gap", "duality_gap", "primal_residual", "infeasibility", "force_reach"
    places += [(certificate, key) for key in figures]
    places += [(document["scales"], key) for key in ("force", "length")]
    places += [(joint, key) for joint in document["joints"] for key in ("torque", "torque_contact")]
    place, key = places[rng.integers(len(places))]
    if place[key] is None:
        place[key] = 1.0
    elif abs(place[key]) < 1e-9 * document["scales"]["force"]:
        place[key] = float(rng.choice([1e-3, -1e-3, 1.0]) * document["scales"]["force"])
    else:
        place[key] = _perturbed(place[key], rng)


def swapped_contacts(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Swap something between two contacts."""
    contacts = document["contacts"]
    first, second = rng.choice(len(contacts), 2, replace=False)
    key = ("force", "signs", "selected", "position", "normal", "friction")[rng.integers(6)]
    one, two = contacts[first], contacts[second]
    one[key], two[key] = two[key], one[key]


def shifted_forces(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Change forces, and all figures that follow from them."""
    if not document["found"]:
        return
    size = document["scales"]["force"] * 10.0 ** rng.uniform(-4.0, 0.0)
    for contact in document["contacts"]:
        contact["force"] = (np.array(contact["force"]) + size * rng.normal(size=3)).tolist()
    _follow(document)


def _follow(document: Document) -> None:
    """Make all figures fit the forces, and let the certificate say that nothing is amiss."""
    follow(document)
    claimed = read_solution(document)
    document["max_torque_unit"] = str(claimed.max_torque_unit)
    value = _value(claimed)
    bound = -value if claimed.algorithm == "margin" else value
    document["certificate"] |= {"bound": bound, "gap": 0.0, "duality_gap": 0.0}


def _worse(document: Document, rng: np.random.Generator) -> None:
    """Put forces of a worse answer in the place of the optimum's, with a mode and motion of theirs.

    The truth of the same problem under another objective or a smaller friction.
    """
    claimed = read_solution(document)
    problem = claimed.problem
    for _ in range(10):
        smaller = problem.with_changes(friction=problem.friction * rng.uniform(0.75, 0.99))
        margin = claimed.required_margin + problem.scales.force * rng.choice([0.0, 1e-3, 0.05])
        algorithm = "torque" if rng.random() < 0.7 else "margin"
        other = _solved(smaller, algorithm, margin, **claimed.rules.options())
        if other.found:
            break
    else:
        return
    made = documented(other)
    for contact, new in zip(document["contacts"], made["contacts"], strict=True):
        contact |= {key: new[key] for key in ("force", "selected", "signs")}
    document["proof"]["motion"] = made["proof"]["motion"]
    document["multipliers"] = made["multipliers"]
    _follow(document)


def worse_answer(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """A worse answer with every figure made to fit, and the proof of the true one."""
    if document["found"]:
        _worse(document, rng)


def forged_proof(document: Document, rng: np.random.Generator, others: list[Document]) -> None:
    """A worse answer with a proof that was tampered with, too."""
    if not document["found"]:
        # Claim of something feasible that it is infeasible, with the proof that there is.
        feasible = others[rng.integers(len(others))]
        if feasible["found"]:
            status = document["status"], document["message"]
            proof = document["proof"]
            document.clear()
            document |= copy.deepcopy(feasible)
            document["status"], document["message"], document["found"] = *status, False
            for key in ("margin", "max_torque", "max_torque_unit"):
                document[key] = None
            for contact in document["contacts"]:
                contact |= {"force": None, "selected": None, "signs": None}
            for joint in document["joints"]:
                joint |= {"torque": None, "torque_contact": None}
            document["proof"]["motion"] = None
            document["proof"] |= {key: proof[key] for key in ("forces",) if key in proof}
    else:
        _worse(document, rng)
    nodes = document["proof"]["nodes"]
    count = len(document["contacts"])
    way = rng.integers(7)
    if way == 0 and len(nodes) > 1:
        del nodes[rng.integers(len(nodes))]
    elif way == 1:
        made_up = [[c, axis, float(rng.normal())] for c in range(count) for axis in range(3)]
        nodes[:] = [{"kind": "kinematic", "combination": made_up}]
    elif way == 2:
        nodes[:] = [{"kind": "kinematic", "combination": []}]
    elif way == 3:
        for node in nodes:
            if node["kind"] == "bound":
                _times(node["multipliers"], 10.0 ** rng.uniform(-3.0, 12.0))
    elif way == 4:
        for node in nodes:
            if node["kind"] == "bound":
                node["objective"] = not node["objective"]
    elif way == 5:
        nodes[:] = [{"kind": "conflict", "items": [], "open": None, "combinations": [[]]}]
    else:
        document["certificate"]["force_reach"] *= 10.0 ** rng.uniform(-6.0, 6.0)


def _times(multipliers: dict[str, Any], factor: float) -> None:
    for key, values in multipliers.items():
        if key == "faces":
            multipliers[key] = [[c, k, v * factor] for c, k, v in values]
        else:
            multipliers[key] = [v * factor for v in values]


def forged_motion(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Another motion, of any size."""
    motion = document["proof"]["motion"]
    if motion is None:
        return
    size = 10.0 ** rng.uniform(-9.0, 9.0)
    twist = np.array(motion["object"]) * rng.choice([0.0, 1.0, -1.0])
    twist += size * rng.normal(size=6) * rng.choice([0.0, 1.0])
    motion["object"] = twist.tolist()
    if rng.random() < 0.3:
        motion["joints"] = (size * rng.normal(size=len(motion["joints"]))).tolist()


def forged_mode(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Another mode of the same rules, feasible or not, with all else as it was."""
    if not document["found"]:
        return
    contacts = document["contacts"]
    contact = contacts[rng.integers(len(contacts))]
    way = rng.integers(3)
    if way == 0:
        contact["selected"] = not contact["selected"]
        contact["signs"] = [1, -1] if contact["selected"] else [0, 0]
    elif way == 1:
        contact["signs"] = [int(rng.choice([-1, 1])), int(rng.choice([-1, 0, 1]))]
    else:
        problem = read_solution(document).problem
        for index, mode in enumerate(enumerate_modes(problem, maximal=True)):
            if index == rng.integers(1, 4):
                for one, chosen, signs in zip(contacts, mode.selection, mode.signs, strict=True):
                    one |= {"selected": bool(chosen), "signs": signs.tolist()}
                break


def relabelled(document: Document, rng: np.random.Generator, others: list[Document]) -> None:
    """Another rule, option or status."""
    way = rng.integers(6)
    rules = document["rules"]
    if way == 0:
        rules["sign_rule"] = str(rng.choice(["strict", "exact", "nonzero"]))
    elif way == 1:
        rules["sliding_rule"] = str(rng.choice(["exempt", "constrained"]))
    elif way == 2:
        rules["static_friction"] = str(rng.choice(["coulomb", "virtual_sliding"]))
    elif way == 3:
        document["scale"] = str(rng.choice(["absolute", "limits"]))
    elif way == 4:
        document["regularization"] = float(rng.choice([0.0, 1e-3, 1.0]))
    else:
        other = others[rng.integers(len(others))]
        document |= {key: other[key] for key in ("status", "message", "found")}


def other_problem(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Other data of the problem: limits, friction, load, margin, Jacobian."""
    way = rng.integers(7)
    factor = float(rng.choice([0.5, 0.99, 1.001, 1.5, 1e4]))
    if way == 0:
        for contact in document["contacts"]:
            contact["max_normal_force"] *= factor
    elif way == 1:
        for contact in document["contacts"]:
            contact["friction"] = min(contact["friction"] * factor, 10.0)
    elif way == 2:
        joint = document["joints"][rng.integers(len(document["joints"]))]
        joint["upper"], joint["lower"] = joint["upper"] * factor, joint["lower"] * factor
    elif way == 3:
        document["external_wrench"] = [factor * one for one in document["external_wrench"]]
    elif way == 4:
        document["required_margin"] *= factor
    elif way == 5:
        document["cone_edges"] = int(rng.choice([3, 5, 12]))
    else:
        contact = document["contacts"][rng.integers(len(document["contacts"]))]
        contact["jacobian"] = (factor * np.array(contact["jacobian"])).tolist()


def no_number(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """Something that is no number in a number's place."""
    places = list(_places(document))
    place, key = _at(document, places[rng.integers(len(places))])
    wrong = (float("nan"), float("inf"), "1.0", [], {}, True, 10**400)
    place[key] = wrong[rng.integers(len(wrong))]


def stray_multipliers(document: Document, rng: np.random.Generator, _: list[Document]) -> None:
    """State multipliers of constraints that the program may not have, or a common violation."""
    if not document["found"] or rng.random() < 0.2:
        stated = document["certificate"]["infeasibility"]
        document["certificate"]["infeasibility"] = stated + 10.0 ** rng.uniform(-4.0, 3.0)
        return
    key = ("normal_upper", "normal_lower")[rng.integers(2)]
    values = document["multipliers"][key]
    values[rng.integers(len(values))] = 10.0 ** rng.uniform(-6.0, 6.0)


KINDS: dict[str, Tamper] = {
    one.__name__: one
    for one in (
        any_number, stated_figure, swapped_contacts, shifted_forces, worse_answer, forged_proof,
        forged_motion, forged_mode, relabelled, other_problem, no_number,
        stray_multipliers,
    )
}  # fmt: skip


def tampered(count: int, seed: int = 0) -> Iterator[Outcome]:
    """Yield what becomes of so many tampered documents."""
    documents = originals()
    names = list(KINDS)
    for number in range(count):
        rng = np.random.default_rng([seed, number])
        original = documents[number % len(documents)]
        document = copy.deepcopy(original)
        kind = names[number % len(names)]
        KINDS[kind](document, rng, documents)
        why = "" if repr(document) == repr(original) else falsehood(document, original)
        yield Outcome(kind, bool(why), refused(document), why)


def main() -> None:
    """Print a table of the kinds, and fail if a false claim was accepted."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("count", type=int, nargs="?", default=1000)
    parser.add_argument("--seed", type=int, default=0)
    arguments = parser.parse_args()
    wrong = [index for index, one in enumerate(originals()) if not verify_document(one).proven]
    counts: Counter[tuple[str, bool, bool]] = Counter()
    missed = []
    for number, outcome in enumerate(tampered(arguments.count, arguments.seed)):
        counts[outcome.kind, outcome.false, outcome.refused] += 1
        if outcome.false and not outcome.refused:
            missed.append((number, outcome))
    print(f"{'':18}{'false':>8}{'refused':>9}{'not false':>11}{'refused':>9}")
    for kind in KINDS:
        row = [counts[kind, true, gone] for true in (True, False) for gone in (True, False)]
        print(f"{kind:18}{row[0] + row[1]:8}{row[0]:9}{row[2] + row[3]:11}{row[2]:9}")
    for number, outcome in missed:
        print(f"accepted: number {number}, {outcome.kind}: {outcome.why}")
    passed = [one.name for one in FORGERIES if not one.is_refused()]
    altered = [name for name in bases() if failing_before(name) != REFUSED.get(name, set())]
    print(
        f"{len(FORGERIES)} made by hand; accepted: {passed}; originals of these refused: {altered}"
    )
    print(f"{len(missed)} false claims accepted; originals refused: {wrong}")
    raise SystemExit(bool(missed or wrong or passed or altered))


if __name__ == "__main__":
    main()
