"""A solution read back from its JSON document.

What a document may hold at most: looked at before anything is made of it.

The program of a document is dense: its size grows with the square of the contacts.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import Field, dataclass, fields
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.bounds import (
    LARGEST_STATED,
    MOST_COEFFICIENTS,
    MOST_CONE_EDGES,
    MOST_CONTACTS,
)
from graspless_pin.errors import ArgumentError, GrasplessPinError, SceneError, TextError
from graspless_pin.findings import Finding, FindingCode
from graspless_pin.intake.files import FileKind, kind_of_data, read_text, refuse_other_kind
from graspless_pin.intake.text import fault_of_name, parse_json
from graspless_pin.intake.yaml_text import parse_yaml
from graspless_pin.modes.rules import Rules, SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.derived_inertias import with_derived_inertias
from graspless_pin.programs.assembly import scaled_program
from graspless_pin.programs.objectives import Algorithm, Margin, Objective, Torque, TorqueShare
from graspless_pin.report.proof_data import (
    StatedObjective,
    as_number,
    as_numbers,
    cone_data,
    read_multipliers,
)
from graspless_pin.report.verify.fields import FORMAT
from graspless_pin.solution import FOUND, Certificate, Evidence, Guarantee, Status, TorqueSolution

_SAME = 1e-9
_ROUND_ROWS = 3
"""Rows of a round cone."""
_OWN_ROWS = 3
"""Rows of a contact beside those of its cone."""


def check_bounds(document: dict[str, Any]) -> None:
    """Refuse a document with too many contacts or joints, too long a name or too large a number.

    Values of wrong types pass: whoever reads them refuses them.

    Raises:
        ArgumentError: Naming the key, what was found and what would do.
    """
    contacts, joints = (_listed(document, key) for key in ("contacts", "joints"))
    rows = [(key, _listed(document, key)) for key in ("external_wrench", "wrench_matrix")]
    for key, entries in (("contacts", contacts), ("joints", joints), *rows):
        if len(entries) > MOST_CONTACTS:
            raise ArgumentError(
                "document", f"{key}: has {len(entries)} entries; at most {MOST_CONTACTS} are read"
            )
    size = _coefficients(document, len(contacts), len(joints))
    if size > MOST_COEFFICIENTS:
        raise ArgumentError(
            "document",
            f"contacts: {len(contacts)} of them, with their cones, make a program of {size:.2g} "
            f"coefficients; at most {MOST_COEFFICIENTS:.2g} are read: solve with fewer cone edges "
            "or points_per_patch",
        )
    for key, name in _names(document):
        if fault := fault_of_name(name):
            raise ArgumentError("document", f"{key}: {fault}")
    for key, value in document.items():
        _check_magnitudes(key, value)


def _coefficients(document: dict[str, Any], contacts: int, joints: int) -> int:
    """Return the rows times the columns of a document's program, or a little more."""
    edges, faces = document.get("cone_edges"), _ROUND_ROWS
    if isinstance(edges, int) and document.get("cone") != "round":
        stated = [
            len(_listed(contact, "cone_corners")) for contact in _listed(document, "contacts")
        ]
        faces = max([min(edges, MOST_CONE_EDGES), *stated])
    passive = len(_listed(document, "external_wrench"))
    rows, columns = contacts * (faces + _OWN_ROWS) + 2 * joints + passive, 3 * contacts + 1
    own = document.get("objective")
    if isinstance(own, dict):
        rows += sum(len(_listed(one, "unit")) for one in _listed(own, "rows"))
        columns += sum(len(_listed(one, "unit")) for one in _listed(own, "columns"))
    return rows * columns


def _names(document: dict[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield the names of a document with their keys."""
    for index, joint in enumerate(_listed(document, "joints")):
        yield f"joints[{index}].name", _text(joint, "name")
    for index, contact in enumerate(_listed(document, "contacts")):
        for body in _listed(contact, "bodies"):
            if isinstance(body, str):
                yield f"contacts[{index}].bodies", body
    yield "scene", _text(document, "scene")
    yield "object.name", _text(document.get("object"), "name")
    yield "certificate.solver", _text(document.get("certificate"), "solver")
    own = document.get("objective")
    yield "objective.name", _text(own, "name")
    for key in ("columns", "rows"):
        for index, one in enumerate(_listed(own, key)):
            yield f"objective.{key}[{index}].name", _text(one, "name")


def _check_magnitudes(key: str, value: Any) -> None:
    """Refuse numbers whose products no double holds, below one key."""
    waiting = [(key, value)]
    while waiting:
        where, item = waiting.pop()
        if isinstance(item, dict):
            waiting += [(f"{where}.{name}", one) for name, one in item.items()]
        elif isinstance(item, list):
            waiting += [(where, one) for one in item]
        elif isinstance(item, int | float) and LARGEST_STATED < abs(item) < math.inf:
            raise ArgumentError(
                "document",
                f"{where[:100]}: has the number {item!r:.30}; numbers up to {LARGEST_STATED:g} "
                "are read",
            )


def _listed(holder: Any, key: str) -> list[Any]:
    """Return what a mapping lists under a key; nothing where there is no such list."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, list) else []


def _text(holder: Any, key: str) -> str:
    """Return a text under a key; empty where there is none."""
    found = holder.get(key) if isinstance(holder, dict) else None
    return found if isinstance(found, str) else ""


DOCUMENT = FileKind("JSON document", 32, SceneError)


def read_document(path: Path) -> Any:
    """Read a JSON document within bounds; what it says is not checked yet.

    Raises:
        SceneError: If the file cannot be opened (see `read_bytes`) or is not JSON as
            `parse_json` reads it.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from pathlib import Path
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.report import read_document, solution_document, write_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> with TemporaryDirectory() as folder:
        ...     file = Path(folder, "solution.json")
        ...     write_document(solution_document(scene.solve()), file)
        ...     sorted(read_document(file))[:2]
        ['algorithm', 'certificate']
    """
    text = read_text(path, DOCUMENT)
    try:
        return parse_json(text)
    except TextError as error:
        if path.suffix.lower() != ".json":
            with suppress(TextError):
                refuse_other_kind(path, DOCUMENT, kind_of_data(parse_yaml(text).data))
        raise SceneError(f"{path}: {error}") from None


_IN_MODE = (Status.OPTIMAL_IN_MODE, Status.INFEASIBLE_IN_MODE, Status.INFEASIBLE_MODE)


@dataclass(frozen=True)
class _Stated:
    """What a document says is wrong with its scene."""

    findings: tuple[Finding, ...]


def read_solution(document: dict[str, Any]) -> TorqueSolution:
    """Return the solution that a document of `solution_document` is of.

    The proof over all modes stays in the document: `verify_document` checks it there.

    Raises:
        ArgumentError: If it is no such document, or has too many contacts, joints or coefficients,
            too long a name or too large a number (`graspless_pin.bounds`).

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import read_solution, solution_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> again = read_solution(solution_document(scene.solve()))
        >>> print(f"{again.margin:.4f} N")
        1.6504 N
    """
    if not isinstance(document, dict):
        raise ArgumentError("document", "is no JSON object; it must be one written by solve")
    _check_format(document)
    check_bounds(document)
    try:
        with np.errstate(over="raise", invalid="raise", divide="raise"):
            return _solution(document)
    except KeyError as error:
        raise ArgumentError("document", f"lacks the key {error}") from None
    except GrasplessPinError as error:
        raise ArgumentError("document", f"holds a problem that is none: {error}") from None
    except (TypeError, ValueError, IndexError, AttributeError, ArithmeticError) as error:
        raise ArgumentError("document", f"has a value of a wrong type or size: {error}") from None


def _check_format(document: dict[str, Any]) -> None:
    if "format" not in document:
        raise ArgumentError("document", "lacks the key 'format'; it must be one written by solve")
    if document["format"] != FORMAT:
        found = document["format"]
        raise ArgumentError(
            "document", f"has the format {found!r:.20}; {FORMAT} can be read: solve again"
        )


def document_origin(document: dict[str, Any]) -> FloatArray:
    """(3,) the point in world coordinates that the problem's positions are relative to, m."""
    return as_numbers(document.get("object", {}).get("center_of_mass", [0.0, 0.0, 0.0]))


def document_bodies(document: dict[str, Any]) -> tuple[str, ...] | None:
    """M names of what touches the object; None where the document knows none."""
    contacts = document["contacts"]
    if not all("bodies" in contact for contact in contacts):
        return None
    return tuple(str(contact["bodies"][0]) for contact in contacts)


def _solution(document: dict[str, Any]) -> TorqueSolution:
    status = Status[document["status"].upper()]
    rules, figures, contacts = document["rules"], document["certificate"], document["contacts"]
    problem = _problem(document)
    objective, own = _objective(document)
    _ = scaled_program(problem, objective)  # refuses what is no objective
    forces = mode = in_mode = added = balanced = None
    if all(c["selected"] is not None for c in contacts):
        mode = SlidingMode([c["selected"] for c in contacts], [c["signs"] for c in contacts])
    if status in FOUND:
        forces = read_only(as_numbers([c["force"] for c in contacts]).reshape(-1, 3))
        in_mode = read_multipliers(own, problem, objective) if status is not Status.STRONG else None
        stated = isinstance(objective, StatedObjective)
        added = objective.values if stated else _added(problem, objective, forces)
    elif "forces" in document.get("proof", {}):
        balanced = read_only(as_numbers(document["proof"]["forces"]).reshape(-1, 3))
        if isinstance(objective, StatedObjective):
            added = as_numbers(document["proof"]["columns"]) / objective.column_units
    relaxed = _relaxed(document)
    relaxation = read_multipliers(relaxed, problem, objective) if relaxed else in_mode
    return TorqueSolution(
        status,
        objective,
        Rules.parse(rules["sign_rule"], rules["sliding_rule"], rules["static_friction"]),
        Certificate(**{item.name: _figure(figures, item) for item in fields(Certificate)}),
        problem,
        mode if status in _IN_MODE else None,
        _forces=forces,
        _mode=mode,
        evidence=Evidence(relaxation, in_mode, added, balanced, _motion(document, problem)),
        guarantee=_guarantee(document),
        _explanation=str(document.get("explanation", "")),
        _source=_Stated(tuple(map(_finding, document.get("findings", [])))),
    )


def _finding(stated: dict[str, Any]) -> Finding:
    key = tuple(part if isinstance(part, int) else str(part) for part in stated["key"])
    subject, message, advice = (str(stated[name]) for name in ("subject", "message", "advice"))
    code = FindingCode(stated["code"])
    return Finding(code, subject, message, advice, key, str(stated["place"]))


def _guarantee(document: dict[str, Any]) -> Guarantee | None:
    """Return what is stated of a guarantee; its verdict stays in the document."""
    stated = document.get("guarantee")
    if stated is None:
        return None
    gap = np.nan if stated["gap"] is None else as_number(stated["gap"])
    return Guarantee(None, as_number(stated["best_case"]), gap, int(as_number(stated["tried"])))


def _objective(document: dict[str, Any]) -> tuple[Objective, dict[str, Any]]:
    """Return what was optimised, and the answer's own multipliers."""
    epsilon, scale = (
        real_number("regularization", document["regularization"], 0.0),
        document["scale"],
    )
    own = document.get("multipliers", {})
    required = as_number(document["required_margin"])
    if document["algorithm"] is None:
        stated = document["objective"]
        return StatedObjective(str(stated["name"]), stated, stated["maximizes"], required), own
    if Algorithm(document["algorithm"]) is Algorithm.MARGIN:
        return Margin(epsilon), own
    return (TorqueShare if scale == "limits" else Torque)(required, epsilon), own


def _added(problem: QuasistaticProblem, objective: Objective, forces: FloatArray) -> FloatArray:
    """(1,) the best value of the one column that an objective adds, at given forces, scaled."""
    coordinates, program, _ = scaled_program(problem, objective)
    high, coefficients = program.sides[1], program.rows[:, -1]
    rest = program.rows[:, :-1] @ coordinates.scaled(forces)
    # What is minimised is as small as the rows allow, what is maximised as large.
    rows = coefficients * program.c[-1] < 0.0
    values = (high - rest)[rows] / coefficients[rows]
    value = np.maximum(values.max(initial=-np.inf), program.lb[-1])
    if program.c[-1] < 0.0:
        value = np.minimum(values.min(initial=np.inf), program.ub[-1])
    return np.array([value])


def _motion(document: dict[str, Any], problem: QuasistaticProblem) -> FloatArray | None:
    """(P + L,) the virtual motion that the document states, if any."""
    stated = document.get("proof", {}).get("motion")
    if stated is None:
        return None
    motion = as_numbers([*stated["object"], *stated["joints"]])
    return read_only(motion.reshape(problem.passive_count + problem.joint_count))


def _relaxed(document: dict[str, Any]) -> dict[str, Any] | None:
    """Multipliers that bound every mode at once, if the proof has them."""
    nodes = document["proof"]["nodes"]
    return nodes[0]["multipliers"] if nodes and nodes[0]["kind"] == "bound" else None


def _problem(document: dict[str, Any]) -> QuasistaticProblem:
    contacts, joints = document["contacts"], document["joints"]
    rows = 3 * len(contacts)
    matrix = document.get("wrench_matrix")
    passive = len(as_numbers(document["external_wrench"]))
    sizes = {"object_inertia": passive, "joint_inertia": len(joints)}
    inertias = {
        # Of no joint JSON has one empty list, whatever the shape.
        name: finite_array(name, document[name] or np.zeros((0, 0)), (count, count))
        for name, count in sizes.items()
        if document.get(name) is not None
    }
    problem = QuasistaticProblem(
        as_numbers([c["position"] for c in contacts]) - document_origin(document),
        as_numbers([c["normal"] for c in contacts]),
        as_numbers(document["external_wrench"]),
        as_numbers([c["jacobian"] for c in contacts]).reshape(rows, len(joints)),
        friction=as_numbers([c["friction"] for c in contacts]),
        tangents=as_numbers([c["tangents"] for c in contacts]).transpose(0, 2, 1),
        sliding=as_numbers([c["sliding"] for c in contacts]),
        torque_limits=(
            [-np.inf if joint["lower"] is None else as_number(joint["lower"]) for joint in joints],
            [np.inf if joint["upper"] is None else as_number(joint["upper"]) for joint in joints],
        ),
        max_normal_force=as_numbers([c["max_normal_force"] for c in contacts]),
        cone_edges=document["cone_edges"],
        cone=document["cone"],
        joint_names=[joint["name"] for joint in joints],
        joint_units=[joint["unit"] for joint in joints],
        gravity_torques=as_numbers([joint["torque_gravity"] for joint in joints]),
        wrench_matrix=None if matrix is None else as_numbers(matrix),
        passive_units=document.get("passive_units"),
    )
    _check_cones(problem, contacts)
    # A URDF may state inertias that are none: solutions do not hang on them.
    return with_derived_inertias(problem, {name: lambda a=a: a for name, a in inertias.items()})


def _check_cones(problem: QuasistaticProblem, contacts: list[dict[str, Any]]) -> None:
    """Refuse a document whose cones are not those of the model of that name here."""
    for index, contact in enumerate(contacts):
        for key, own in cone_data(problem, index).items():
            stated = as_numbers(contact[key])
            if stated.shape != own.shape or not np.allclose(stated, own, rtol=0.0, atol=_SAME):
                raise ArgumentError(
                    "document",
                    f"contacts[{index}].{key}: are not those of the cone {problem.cone!r} here",
                )


def _figure(figures: dict[str, Any], item: Field[Any]) -> Any:
    """Read a figure: null in JSON does not exist."""
    value = figures[item.name]
    if item.name == "threshold_optima":
        return value and tuple(np.nan if one is None else as_number(one) for one in value)
    if item.name == "solver":
        return value
    return np.nan if value is None else type(value)(as_number(value))
