"""``graspless-pin report``: a solution as a page."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Annotated, Any

import typer

from graspless_pin.algorithms.force_bounds import ContactForceBounds, contact_force_bounds
from graspless_pin.algorithms.options import AIMS
from graspless_pin.cli.outcome import (
    ControllerOption,
    ExitCode,
    echo_error,
    echo_note,
    exit_code,
    loaded_scene,
    plain_errors,
    with_controller,
)
from graspless_pin.cli.outputs import (
    OutputKind,
    OverwriteOption,
    check_inputs_stay,
    check_output,
)
from graspless_pin.cli.simulate import simulation_summary
from graspless_pin.cli.solve import judged_solution, with_objective_options
from graspless_pin.cli.tolerances import tolerances_under
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.planning.squeeze_window import SqueezeWindow, squeeze_window
from graspless_pin.progress import waiting_for
from graspless_pin.report.document import write_text
from graspless_pin.report.html import (
    Case,
    case_of_document,
    case_of_scene,
    case_with_tolerances,
    report_html,
)
from graspless_pin.report.reading import read_document
from graspless_pin.report.simulation import time_lapse
from graspless_pin.scene import Scene
from graspless_pin.scene.problem_data import rest_problem
from graspless_pin.simulation import simulate
from graspless_pin.solution import TorqueSolution


@with_objective_options
def report(
    source: Annotated[
        Path,
        typer.Argument(
            metavar="SCENE|SOLUTION.json", help="Scene file, or a document that solve wrote."
        ),
    ],
    scene: Annotated[
        Path | None,
        typer.Option(
            metavar="SCENE",
            help="Scene file of the document, to draw the bodies. Files that a document names are "
            "never opened.",
        ),
    ] = None,
    algorithm: Annotated[
        str | None, typer.Option(help=f"Default: that of the scene file. {AIMS}.")
    ] = None,
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE|-", help="The page to write.")
    ] = Path("report.html"),
    ranges: Annotated[
        bool,
        typer.Option(help="Compute the force ranges; takes minutes if many contacts stick."),
    ] = True,
    ranges_time: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Time limit for the force ranges. Ranges not proven by then are shown as far as "
            "they are known, and marked.",
        ),
    ] = 60.0,
    verdict_nodes: Annotated[
        int | None,
        typer.Option(
            help=f"Node limit (sets of outcomes) of the verdict. Default: {BRIEF_NODE_LIMIT}."
        ),
    ] = None,
    no_verdict: Annotated[
        bool, typer.Option("--no-verdict", help="Skip the verdict on whether the object stays.")
    ] = False,
    simulated: Annotated[
        bool,
        typer.Option(
            "--simulate", help="Simulate the scene under the torques with MuJoCo; add a time-lapse."
        ),
    ] = False,
    controller: ControllerOption = None,
    squeeze: Annotated[
        bool,
        typer.Option(
            "--squeeze", help="Add how hard the hand may squeeze; computes about 30 verdicts."
        ),
    ] = False,
    tolerances: Annotated[
        bool,
        typer.Option(
            "--tolerances",
            help="Add how far mass, pushes, friction and torques may be off, under these torques "
            "and with torques chosen for each. The first is always shown for a scene with an "
            "uncertainty.",
        ),
    ] = False,
    overwrite: OverwriteOption = False,
    **figures: Any,
) -> None:
    """Write a solution as one self-contained HTML page: 3-D view, torques, proof.

    To use other options of solve, write its solution with --json and give that document to report.
    The page then shows the verdict in the document.

    Exit code 0: found; 1: infeasible, and the page says why; 2: bad input; 3: neither found nor
    proven infeasible; 4: found, and something serious is wrong with the scene, or a check of
    the document fails.

    Examples:
        graspless-pin report scene.yaml -o report.html
        graspless-pin report scene.yaml --algorithm torque --margin 0.2
        graspless-pin report solution.json --scene scene.yaml
    """
    with plain_errors():
        check_output("--output", output, OutputKind.PAGE, overwrite=overwrite)
        options = {"algorithm": algorithm, "verdict_nodes": verdict_nodes, **figures}
        if source.suffix.lower() == ".json":
            scene_only = {"controller": controller, "no_verdict": no_verdict or None, **options}
            case = _case_from_document(source, scene, scene_only)
        elif scene is not None:
            raise ArgumentError("--scene", "has an effect only with a document (.json)")
        else:
            case = _case_from_scene(source, controller, no_verdict=no_verdict, **options)
        lapse = window = None
        if simulated and (option_scene := _scene_for_option(case, "--simulate")):
            with waiting_for("simulating"):
                found = simulate(option_scene, case.solution.torques)
                lapse = time_lapse(option_scene, found, simulation_summary(option_scene, found))
        if squeeze and (option_scene := _scene_for_option(case, "--squeeze")):
            window = _squeeze_window(option_scene, case.solution)
        is_unknown = case.scene is not None and case.scene.uncertainty is not None
        wants_tolerances = tolerances or (is_unknown and case.solution.found)
        if wants_tolerances and (option_scene := _scene_for_option(case, "--tolerances")):
            found = tolerances_under(option_scene, case.solution, attainable=tolerances)
            case = case_with_tolerances(case, found)
        bounds, rest_bounds = _force_ranges(case, ranges_time) if ranges else (None, None)
        with waiting_for("drawing"):
            page = report_html(case, bounds, lapse, rest_bounds, window)
        write_text(page, output, kind="report")
        if str(output) != "-":
            typer.echo(f"wrote {output} ({len(page.encode()) / 1e6:.1f} MB)")
        is_refused = source.suffix.lower() == ".json" and not case.verification.passed
        if is_refused:
            echo_error(f"{source}: a check fails; graspless-pin verify {source} shows which")
    raise typer.Exit(ExitCode.DOUBTFUL if is_refused else exit_code(case.solution))


def _squeeze_window(scene: Scene, solution: TorqueSolution) -> SqueezeWindow | None:
    """Return the squeeze window; None, with a note, where the hand does not squeeze the object."""
    try:
        with waiting_for("searching for the squeeze window"):
            return squeeze_window(scene, solution.torques)
    except ArgumentError as error:
        echo_note(f"--squeeze is left out: {error}")
    return None


def _force_ranges(
    case: Case, seconds: float
) -> tuple[ContactForceBounds | None, ContactForceBounds | None]:
    """Return the force bounds (32) under the rule, and under Coulomb friction; None: not asked."""
    solution = case.solution
    if not solution.found:
        return None, None
    problem, torques = solution.problem, solution.torques
    if case.scene is not None:
        problem = rest_problem(case.scene, problem, torques)
    with waiting_for("computing the force ranges"):
        bounds = contact_force_bounds(
            problem, torques, time_limit=seconds, **solution.rules.options()
        )
        if problem.is_sliding.any() or not problem.cone_model.is_coulomb:
            return bounds, None  # a sliding contact has no cone, and only Coulomb's law a round one
        return bounds, contact_force_bounds(
            problem.with_changes(cone="round"),
            torques,
            time_limit=seconds,
            static_friction=StaticFriction.COULOMB,
        )


def _case_from_document(
    source: Path, scene_file: Path | None, scene_only: Mapping[str, Any]
) -> Case:
    """Return the case of a document.

    Raises:
        ArgumentError: If an option is given that needs a scene.
    """
    for name, value in scene_only.items():
        if value is not None:
            option = f"--{name.replace('_', '-')}"
            raise ArgumentError(option, "requires a scene file; a document is solved already")
    document = read_document(source)
    check_inputs_stay()
    try:
        return case_of_document(document, scene_file)
    except ArgumentError as error:
        raise SceneError(f"{source}: {error}") from error


def _case_from_scene(source: Path, controller: str | None, **options: Any) -> Case:
    """Solve a scene and return its case, with the verdict unless that is switched off."""
    scene = with_controller(loaded_scene(source), controller)
    solution, answer, verdict, note = judged_solution(scene, **options)
    if note and verdict is None:
        echo_note(note)
    return case_of_scene(scene, solution, source, verdict, answer)


def _scene_for_option(case: Case, option: str) -> Scene | None:
    """Return the scene that an option needs; None, with a note, where there are no torques.

    Raises:
        ArgumentError: If the case has no scene.
    """
    if not case.solution.found:
        echo_note(f"{option} is left out: no torques were found")
        return None
    if case.scene is None:
        raise ArgumentError(option, f"needs the scene file. {case.missing}")
    return case.scene
