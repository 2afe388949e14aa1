"""What a report is of: a solution, and as much of its scene as there is."""

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
    """What a report is of. See the example of `case_of_scene`.

    Attributes:
        title: Of the scene, or a plain word.
        solution: The solution, found or not.
        document: Its JSON document.
        bodies: M names of what touches the object; None: not known.
        points: (M, 3) contact points in the picture's frame, m.
        picture: What there is to see.
        motion: What would happen, where the document's verdict states a motion of one free object,
            or a small one that grows.
        sliding: The picture along the mode's virtual motion; None: there is none, or not of one
            free object.
        missing: Why the picture lacks the scene's bodies; empty: it does not.
        command: The command that solves it again; None: there is none.
        scene: The scene, where it still is the same.
        off: How far each thing may be off under the torques; None: that was not asked.
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
    """Return a case with what its torques bear, and where the centre of mass may be drawn.

    Args:
        case: The case of a scene.
        tolerances: Of the scene's `tolerances`, of the solution's torques.

    Raises:
        ArgumentError: If the case has no scene.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report.html import case_of_scene, case_with_tolerances, report_html
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> solution = scene.solve()
        >>> off = scene.tolerances(solution.torques, static_friction="coulomb")
        >>> case = case_with_tolerances(case_of_scene(scene, solution), off)
        >>> "How far may each be off?" in report_html(case)
        True
    """
    if case.scene is None:
        raise ArgumentError("case", f"needs the scene. {case.missing}")
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
        file: The scene file that leads to it, for the command that solves it again; None: the scene
            was changed in Python, or made there.
        verdict: Whether the object stays with the solution's torques; None: it was not asked.
        answer: What was found for all that is not known of the scene; None: the scene is
            nominal. The solution is then the answer's.

    Raises:
        ArgumentError: If the solution is of other contacts.
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
    return _case(scene.name, solution, document, scene, "", command)


def case_of_document(document: dict[str, Any], scene_file: Path | None = None) -> Case:
    """Return the case of a document, with the bodies of its scene where they still are the same.

    Args:
        document: A document of `solution_document`. No file that it names is opened.
        scene_file: The scene that it is of; None: contacts and forces are drawn alone.

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
    found = _scene_of(document, solution, scene_file)
    if scene_file is None or isinstance(found, str):
        return _case(title, solution, document, None, str(found), None)
    return _case(title, solution, document, found, "", solve_command(solution, scene_file))


def _case(
    title: str,
    solution: TorqueSolution,
    document: dict[str, Any],
    scene: Scene | None,
    missing: str,
    command: str | None,
) -> Case:
    """Return a case with its pictures: of the scene, or of what the document says of contacts."""
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


def _scene_of(document: dict[str, Any], solution: TorqueSolution, path: Path | None) -> Scene | str:
    """Return the scene of a document from its file, or why it cannot be used."""
    made_of = document.get("provenance")
    made_of = made_of if isinstance(made_of, dict) else {}
    if path is None:
        name = made_of.get("scene_file")
        if not isinstance(name, str):
            return "The document names no scene file."
        return f"The scene file was not given; the document names {name}."
    if file_sha256(path) != made_of.get("scene_sha256"):
        return f"The scene file {path} is another one, or has changed since."
    try:
        scene = load_scene(path)
        problem = scene.problem()
    except GrasplessPinError as error:
        return f"The scene file {path} cannot be loaded: {error}."
    if not same_problem(problem, solution.problem):
        return (
            f"The scene file {path} now leads to another problem: a model that it names has "
            "changed, or the scene was changed in Python."
        )
    return scene
