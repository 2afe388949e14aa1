"""The subject of a report: a solution, with its scene where that is available."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.errors import ArgumentError, GrasplessPinError
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.problem.checks import FloatArray
from graspless_pin.report.document import solution_document
from graspless_pin.report.provenance import file_sha256, same_problem, solve_command
from graspless_pin.report.reading import document_bodies, document_origin, read_solution
from graspless_pin.report.verdict_data import read_motion, read_small_motion
from graspless_pin.report.verify import Verification, verify_document
from graspless_pin.scene import Scene, load_scene
from graspless_pin.scene.robust_answer import RobustAnswer, without_torques
from graspless_pin.solution import TorqueSolution
from graspless_pin.visualization import Picture, draw_scene
from graspless_pin.visualization.contacts import draw_contacts
from graspless_pin.visualization.motion import (
    MovingPicture,
    draw_motion,
    draw_small_motion,
    draw_virtual_sliding,
)


@dataclass(frozen=True, eq=False)
class Case:
    """The subject of a report. See the example of `case_of_scene`.

    Attributes:
        title: Name of the scene, or a general one.
        solution: The solution, found or not.
        document: Its JSON document.
        bodies: M names of the bodies that touch the object; None: not known.
        points: (M, 3) contact points in the picture's frame, m.
        picture: The static picture.
        motion: The motion of an outcome, or the growing small motion, that the document's verdict
            states of one free object; None: it states none.
        sliding: The picture along the mode's virtual motion; None: there is none, or not of one
            free object.
        missing: Why the picture lacks the scene's bodies; empty: it has them.
        command: The command that solves it again; None: there is none.
        scene: The scene; None: it is not known, or has changed.
        off: The tolerances of the torques; None: they were not computed.
    """

    title: str
    solution: TorqueSolution
    document: dict[str, Any]
    bodies: tuple[str, ...] | None
    points: FloatArray
    picture: Picture
    motion: MovingPicture | None
    sliding: MovingPicture | None
    missing: str
    command: str | None
    scene: Scene | None
    off: Tolerances | None = None

    @cached_property
    def verification(self) -> Verification:
        """The checks of its document, with numpy alone.

        Raises:
            ArgumentError: If the document is not complete.
        """
        try:
            return verify_document(self.document)
        except ValueError as error:
            raise ArgumentError("document", str(error)) from None


def case_with_tolerances(case: Case, tolerances: Tolerances) -> Case:
    """Return a case with the tolerances of its torques, and the region of the centre of mass.

    Args:
        case: The case of a scene.
        tolerances: Of the scene's `tolerances`, for the solution's torques.

    Raises:
        ArgumentError: If the case has no scene.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report.html import case_of_scene, case_with_tolerances, report_html
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> solution = scene.solve()
        >>> off = scene.tolerances(solution.torques, static_friction="coulomb")
        >>> case = case_with_tolerances(case_of_scene(scene, solution), off)
        >>> "How far may each quantity be off?" in report_html(case)
        True
    """
    if case.scene is None:
        raise ArgumentError("case", f"must have its scene. {case.missing}")
    picture = draw_scene(case.scene, case.solution, tolerances=tolerances)
    origin = case.scene.object.center_of_mass_world
    sliding = draw_virtual_sliding(picture, case.solution, case.scene.hand, origin)
    return replace(case, picture=picture, sliding=sliding, off=tolerances)


def case_of_scene(
    scene: Scene,
    solution: TorqueSolution,
    file: Path | None = None,
    verdict: StabilityVerdict | None = None,
    answer: RobustAnswer | None = None,
) -> Case:
    """Return the case of a scene and a solution of its problem.

    Args:
        scene: The scene.
        solution: A solution of its problem.
        file: The scene file, for the command that solves it again; None: the scene was made or
            changed in Python.
        verdict: The verdict on whether the object stays with the solution's torques; None: there is
            none.
        answer: The robust answer over the scene's uncertainty, whose solution this is then; None:
            the scene is nominal.

    Raises:
        ArgumentError: If the contacts of the solution are not the scene's.
        MeshError: If a mesh file is missing or unreadable.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report.html import case_of_scene, report_html
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> case = case_of_scene(scene, scene.solve())
        >>> report_html(case).startswith("<!")
        True
    """
    document = solution_document(solution, scene, verdict, answer=answer)
    if answer is not None and not answer.found:
        solution = without_torques(answer.nominal, solution)
    command = None if file is None else solve_command(answer.nominal if answer else solution, file)
    return _case_with_pictures(scene.name, solution, document, scene, "", command)


def case_of_document(document: dict[str, Any], scene_file: Path | None = None) -> Case:
    """Return the case of a document, with its scene's bodies where the scene has not changed.

    Args:
        document: A document of `solution_document`. No file that it names is opened.
        scene_file: The scene file; None: only contacts and forces are drawn.

    Raises:
        ArgumentError: If it is no such document.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import solution_document
        >>> from graspless_pin.report.html import case_of_document
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> case = case_of_document(solution_document(scene.solve()))
        >>> case.points.shape
        (6, 3)
    """
    solution = read_solution(document)
    title = str(document.get("scene", "A problem made from arrays"))
    scene = _scene_or_reason(document, solution, scene_file)
    if scene_file is None or isinstance(scene, str):
        return _case_with_pictures(title, solution, document, None, str(scene), None)
    return _case_with_pictures(
        title, solution, document, scene, "", solve_command(solution, scene_file)
    )


def _case_with_pictures(
    title: str,
    solution: TorqueSolution,
    document: dict[str, Any],
    scene: Scene | None,
    missing: str,
    command: str | None,
) -> Case:
    """Return a case with its pictures: of the scene, or of the document's contacts alone."""
    problem, motion = solution.problem, read_motion(document)
    if scene is None:
        hand, origin, bodies = None, document_origin(document), document_bodies(document)
        picture = draw_contacts(problem, solution, origin=origin, bodies=bodies)
    else:
        hand, origin = scene.hand, scene.object.center_of_mass_world
        bodies, picture = scene.contacts.bodies, draw_scene(scene, solution)
    moving, is_free = None, problem.wrench_matrix is None
    if is_free and motion is not None:
        moving = draw_motion(problem, motion, scene=scene, origin=origin)
    elif is_free and (small := read_small_motion(document)):
        moving = draw_small_motion(picture, problem, *small, hand, origin)
    sliding = draw_virtual_sliding(picture, solution, hand, origin)
    points = problem.positions + origin
    return Case(
        title, solution, document, bodies, points, picture, moving, sliding, missing, command, scene
    )


def _scene_or_reason(
    document: dict[str, Any], solution: TorqueSolution, path: Path | None
) -> Scene | str:
    """Return the scene of a document from its file, or why it cannot be used."""
    provenance = document.get("provenance")
    provenance = provenance if isinstance(provenance, dict) else {}
    if path is None:
        name = provenance.get("scene_file")
        if not isinstance(name, str):
            return "The document names no scene file."
        return f"The scene file was not given; the document names {name}."
    if file_sha256(path) != provenance.get("scene_sha256"):
        return f"The scene file {path} is not that of the document, or has changed since."
    try:
        scene = load_scene(path)
        problem = scene.problem()
    except GrasplessPinError as error:
        return f"The scene file {path} cannot be loaded: {error}."
    if not same_problem(problem, solution.problem):
        return (
            f"The scene file {path} no longer gives the problem of the document: a model that it "
            "names has changed, or the scene was changed in Python."
        )
    return scene
