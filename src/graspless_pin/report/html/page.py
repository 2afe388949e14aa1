"""The contexts of page templates, and 3-D views of a picture as plain data."""

from __future__ import annotations

import base64
import gzip
import json
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.algorithms.options import OBJECTIVES
from graspless_pin.errors import optional_import
from graspless_pin.findings import is_serious
from graspless_pin.holding.controller import TORQUES_OF_HELD_JOINTS
from graspless_pin.holding.verdict import Holding, Stability
from graspless_pin.holding.verdict_words import lead_and_words
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.analysis_objectives import AtTorques
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.report.html.case import Case
from graspless_pin.report.html.sections import (
    check_rows,
    contact_rows,
    friction_figures,
    joined_ranges,
    joint_rows,
    motion_rows,
    range_figure,
    range_rows,
    scene_in_words,
    tolerance_figures,
    torque_figure,
    unknown_rows,
    window_figures,
)
from graspless_pin.report.verdict_data import read_motion, read_small_motion
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solution.active_limits import joint_limit_words, margin_limit_words
from graspless_pin.solution.tables import coordinate, decimals, torque_size
from graspless_pin.visualization import DARK, LIGHT, Picture, Role
from graspless_pin.visualization.motion import MovingPicture
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

if TYPE_CHECKING:
    from graspless_pin.planning.squeeze_window import SqueezeWindow

FILES = Path(__file__).with_name("files")
"""Templates, styles and scripts of pages."""
_MODEL_STEPS = 65535
_MODEL_DIGITS = 7
_REFERENCE_ROLES = (Role.AXES, Role.GRAVITY, Role.FORCE_SCALE)
_SUGGESTION = "- "
_PLAYED = 2.6  # s, duration of a motion on the page
_MARKS = {
    Stability.STRONG: "good",
    Stability.WEAK: "bad",
    Stability.NONE: "bad",
    Stability.UNDECIDED: "care",
}


def report_html(
    case: Case,
    bounds: ContactForceBounds | None = None,
    lapse: dict[str, Any] | None = None,
    rest_bounds: ContactForceBounds | None = None,
    window: SqueezeWindow | None = None,
) -> str:
    """Return a case as one HTML page that fetches nothing.

    Args:
        case: The subject of the report.
        bounds: The force ranges of the solution's torques, of `contact_force_bounds`. Unproven ones
            are marked. None: the page has none.
        lapse: A simulation of the solution's torques, of `time_lapse`; None: the page has none.
        rest_bounds: The ranges over all outcomes of rest: with ``static_friction="coulomb"`` and
            round cones. They are shown beside `bounds`.
        window: The squeeze window around the solution's torques; None: the page has none.

    Raises:
        GrasplessPinError: If Jinja2 or matplotlib is not installed.
        ArgumentError: If the case's document is not complete.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report.html import case_of_scene, report_html
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> case = case_of_scene(scene, scene.solve())
        >>> report_html(case).startswith("<!")
        True
    """
    further = {
        "lapse": lapse,
        "window": window,
        "window_figures": [] if window is None else window_figures(window),
        "off": case.off,
        "off_figures": [] if case.off is None else tolerance_figures(case.off),
    }
    return render("report.html", lambda: _page_context(case, bounds, rest_bounds) | further)


def _page_context(
    case: Case, bounds: ContactForceBounds | None, rest_bounds: ContactForceBounds | None
) -> dict[str, Any]:
    solution = case.solution
    problem, why = solution.problem, solution.explanation.splitlines()
    load, length, _ = problem.scales
    torques = solution.torques if solution.found else problem.gravity_torques
    algorithm, aim = _algorithm_and_aim(solution)
    findings = solution.findings
    checks = check_rows(case) if solution.found else []
    context: dict[str, Any] = {
        "case": case,
        "findings": findings,
        "serious": is_serious(findings),
        "solution": solution,
        "problem": problem,
        "proof": solution.certificate,
        "found": solution.found,
        "failed": [row["name"] for row in checks if row["verdict"] == "FAILED"],
        "algorithm": algorithm,
        "aim": aim,
        "joints": joint_rows(solution),
        "held": TORQUES_OF_HELD_JOINTS if _holds_joints(case) else "",
        "largest_joint": problem.joint_names[int(np.abs(torques).argmax())] if len(torques) else "",
        "contacts": contact_rows(case),
        "title": case.title,
        "scene_view": view_context(
            "view",
            "the scene",
            case.picture,
            scene_in_words(case.picture),
            "contact numbers",
            case.sliding,
            played="virtual sliding",
        ),
        **_verdict_context(case),
        "unknown": unknown_rows(case),
        "made_of": _stated_provenance(case.document),
        "download": base64.b64encode(json.dumps(case.document, indent=2).encode()).decode("ascii"),
        "force": partial(_figure_text, size=load),
        "place": lambda value: coordinate(value, length).replace("-", "−"),
        "torque": partial(_figure_text, size=torque_size(problem, torques)),
        "why": [line for line in why if not line.startswith(_SUGGESTION)],
        "suggestions": [line[2:] for line in why if line.startswith(_SUGGESTION)],
    }
    if solution.found:
        context |= {
            "limits": [margin_limit_words(solution, case.bodies), joint_limit_words(solution)],
            "torque_figure": torque_figure(solution) if problem.joint_count else "",
            "friction_figures": friction_figures(solution),
            "checks": checks,
            **_range_context(
                case, bounds, rest_bounds, partial(_figure_text, size=load, signed=True)
            ),
        }
    return context


def _stated_provenance(document: dict[str, Any]) -> dict[str, Any]:
    """Return the provenance that a document states; None or empty where it is malformed."""
    given = document.get("provenance")
    given = given if isinstance(given, dict) else {}
    versions = given.get("versions")
    return {
        **{key: given.get(key) for key in ("scene_file", "scene_sha256", "problem_sha256")},
        "versions": versions if isinstance(versions, dict) else {},
    }


def _holds_joints(case: Case) -> bool:
    """Return whether joints keep their positions, whatever torques that takes."""
    if case.scene is not None:
        return case.scene.controller.holds_joints
    return bool((case.document.get("stability") or {}).get("joints_held"))


def _verdict_context(case: Case) -> dict[str, Any]:
    """Return the context of the document's verdict, and of the view of its motion."""
    stated, motion = case.document.get("stability"), read_motion(case.document)
    if stated is None:
        return {"verdict": None, "motion_view": None}
    lead, words = lead_and_words(str(stated["message"]).replace("^2", "²"))
    status = Stability(stated["status"])
    mark = _MARKS[status]
    holds = (case.document.get("holding") or {}).get("status") == Holding.HOLDS
    if status is Stability.STRONG and not holds:
        mark = "care"
    context: dict[str, Any] = {
        "verdict": {"lead": lead[:1].upper() + lead[1:], "words": words, "mark": mark},
        "motion_view": None,
    }
    if case.motion is None:
        return context
    small = read_small_motion(case.document) if motion is None else None
    shows = "the table lists the contact states" if small is None else "no contact slips or opens"
    return context | {
        "motion_view": view_context(
            "motion-view",
            "the motion",
            case.motion.picture,
            f"Shows the object and the bodies that touch it in this motion; {shows}.",
            "contact numbers",
            case.motion,
        ),
        "slower": max(1, round(_PLAYED / float(case.motion.times[-1]))),
        "motion_rows": [] if motion is None else motion_rows(case.solution.problem, motion),
        "growth": None if small is None else small[1],
    }


def _algorithm_and_aim(solution: TorqueSolution) -> tuple[str, str]:
    """Return the name of the algorithm or objective, and its aim."""
    if solution.algorithm is Algorithm.MARGIN:
        return "1", "largest margin"
    if solution.algorithm is Algorithm.TORQUE:
        return "2", f"smallest torque at a margin of {solution.required_margin:g} N"
    if solution.objective.name == AtTorques.name:
        return AtTorques.name, "largest margin"
    listed = OBJECTIVES.get(solution.objective.name)
    return solution.objective.name, "an objective of your own" if listed is None else listed.aim


def _range_context(
    case: Case,
    bounds: ContactForceBounds | None,
    rest_bounds: ContactForceBounds | None,
    figure: Callable[..., str],
) -> dict[str, Any]:
    """Return the context of the force ranges of the solution's torques, or why there are none."""
    if bounds is None:
        return {"bounds": None, "no_bounds": "they were not requested."}
    if not bounds.found:
        return {"bounds": None, "no_bounds": f"{bounds.message}."}
    ranges = range_rows(bounds, figure)
    at_rest = range_rows(rest_bounds, figure) if rest_bounds and rest_bounds.found else ranges
    return {
        "bounds": bounds,
        "proven": bounds.status is Status.OPTIMAL,
        "ranges": joined_ranges(ranges, at_rest),
        "differ": at_rest != ranges,
        "starred": any(cell["words"].endswith("*") for row in ranges + at_rest for cell in row),
        "range_figure": range_figure(bounds, case.solution),
        "rest_bounds": rest_bounds,
        "squeezed": (rest_bounds or bounds).squeeze_words(case.bodies),
    }


def _figure_text(
    value: float | None, *, size: float, signed: bool = False, rounding: float | None = None
) -> str:
    """Return a figure as `decimals` does, with a true minus sign; a dash for none."""
    if value is None or np.isnan(value):
        return "–"
    if np.isinf(value):
        return ("+∞" if signed else "∞") if value > 0.0 else "−∞"
    return decimals(value, size, "+" if signed else "", rounding).replace("-", "−")


def view_context(
    name: str,
    label: str,
    picture: Picture,
    words: str,
    numbered: str,
    moving: MovingPicture | None = None,
    *,
    played: str = "",
) -> dict[str, Any]:
    """Return the template context of a 3-D view.

    Args:
        name: Its id, unique in the page.
        label: What the view shows.
        picture: The picture.
        words: Text alternative of the picture.
        numbered: Label of the numbers in the picture.
        moving: The motion of the picture, whose numbers go with the object; None: it stands still.
        played: Label of a motion that is played only on request; empty: the motion is played at
            once.
    """
    # Escaped: a ``</script>`` in a name must not end the script.
    model = json.dumps(model_data(picture, moving) | {"plays": not played}, allow_nan=False)
    return {
        "name": name,
        "label": label,
        "words": words,
        "legend": _legend_layers(picture),
        "fingers": picture.fingers,
        "force_scale": picture.force_scale,
        "model": model.replace("<", "\\u003c"),
        "numbered": numbered,
        "moves": (played or "motion") if moving is not None else "",
    }


def _legend_layers(picture: Picture) -> list[dict[str, Any]]:
    """Return the layers of a picture in the order of `Role`; axes, gravity and scale are one."""
    found = [
        {"roles": role, "label": role.label, "swatch": role, "shown": role not in HIDDEN_AT_FIRST}
        for role in Role
        if picture.of(role) and role not in _REFERENCE_ROLES
    ]
    references = [role for role in _REFERENCE_ROLES if picture.of(role)]
    labels = ", ".join(role.label for role in references)
    words = {"roles": " ".join(references), "label": labels, "swatch": Role.AXES, "shown": True}
    return [*found, words]


def model_data(picture: Picture, moving: MovingPicture | None = None) -> dict[str, Any]:
    """Return a picture as plain data for `json.dumps`.

    Vertices are rounded to 1/65535 of their mesh's size. ``data`` is base64 of the gzipped bytes
    of all vertices (uint16 triples, mesh by mesh), padded to a multiple of 4, then of all
    faces (uint32 triples).

    Args:
        picture: The picture.
        moving: The motion of its meshes, if any: ``paths`` of poses, three rows of four numbers
            each, and the index ``path`` of each mesh among them.
    """
    meshes, corners, faces = [], [], []
    for mesh in picture.meshes:
        low = mesh.vertices.min(axis=0)
        size = mesh.vertices.max(axis=0) - low
        steps = (mesh.vertices - low) / np.where(size > 0.0, size, 1.0)
        corners.append(np.round(_MODEL_STEPS * steps).astype("<u2").tobytes())
        faces.append(np.ascontiguousarray(mesh.faces, dtype="<u4").tobytes())
        moves = {} if moving is None else {"path": moving.path_of.get(mesh.name)}
        meshes.append(
            {
                **moves,
                "role": str(mesh.role),
                "framed": mesh.role not in HIDDEN_AT_FIRST,
                "opacity": mesh.opacity,
                "contact": mesh.contact,
                "finger": None if mesh.finger is None else mesh.finger % len(LIGHT.fingers),
                "vertices": len(mesh.vertices),
                "faces": len(mesh.faces),
                "low": _rounded_floats(low),
                "size": _rounded_floats(size),
            }
        )
    first = b"".join(corners)
    first += bytes(-len(first) % 4)
    data = gzip.compress(first + b"".join(faces), compresslevel=6, mtime=0)
    motion = {}
    if moving is not None:
        paths = [[_rounded_floats(pose[:3].ravel()) for pose in path] for path in moving.paths]
        motion = {"seconds": float(moving.times[-1]), "paths": paths}
    return {
        **motion,
        "center": _rounded_floats(picture.center),
        "radius": picture.radius,
        "up": _rounded_floats(picture.up),
        "views": {
            "fit": _rounded_floats(picture.view_from),
            **{name: _rounded_floats(direction) for name, direction in picture.views.items()},
        },
        "floors": [_rounded_floats(plane) for plane in picture.floors],
        "marks": [
            {
                "text": mark.text,
                "role": mark.role,
                "at": _rounded_floats(mark.position),
                "contact": mark.contact,
                "words": mark.words,
            }
            for mark in picture.marks
        ],
        "meshes": meshes,
        "data": base64.b64encode(data).decode("ascii"),
    }


def _rounded_floats(values: FloatArray) -> list[float]:
    return [round(float(value), _MODEL_DIGITS) for value in values]


def render(template: str, context: Callable[[], dict[str, Any]]) -> str:
    """Return a page: a template filled with its own context and the one common to all pages.

    Args:
        template: Its file name.
        context: Returns the page's own context; called after the imports have succeeded.

    Raises:
        GrasplessPinError: If Jinja2 or matplotlib is not installed.
    """
    with optional_import("reports need Jinja2 and matplotlib", "report"):
        import matplotlib  # noqa: F401
        from jinja2 import Environment, FileSystemLoader, StrictUndefined
    environment = Environment(
        loader=FileSystemLoader(FILES),
        autoescape=True,
        undefined=StrictUndefined,
        keep_trailing_newline=True,
        trim_blocks=True,
        lstrip_blocks=True,
    )
    common = {
        "palettes": {"light": LIGHT, "dark": DARK},
        "style": (FILES / "style.css").read_text(encoding="utf-8"),
        "script": (FILES / "view.js").read_text(encoding="utf-8"),
    }
    return environment.get_template(template).render(common | context())
