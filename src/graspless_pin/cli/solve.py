"""``graspless-pin solve``: a scene and its solution."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Container, Iterator, Mapping
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, TypeVar, get_args, get_origin

import typer

from graspless_pin.algorithms.force_bounds import ContactForceBounds, contact_force_bounds
from graspless_pin.algorithms.options import (
    AIMS,
    OBJECTIVES,
    RequiredStability,
    Search,
    TorqueScale,
    figure_types,
)
from graspless_pin.cli.outcome import (
    ControllerOption,
    exit_code,
    loaded_scene,
    plain_errors,
    show_findings,
    with_controller,
)
from graspless_pin.cli.outputs import OutputKind, OverwriteOption, check_output
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.findings import emit
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT, NODE_LIMIT, StabilityVerdict
from graspless_pin.modes.rules import SignRule, SlidingRule, StaticFriction
from graspless_pin.progress import waiting_for
from graspless_pin.report import scene_solution_text
from graspless_pin.scene import Scene
from graspless_pin.scene.problem_data import rest_problem
from graspless_pin.scene.scene_stability import solution_verdict
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.scene.robust_answer import RobustAnswer

_RANGE_NODES = 100
"""Node limit of each search for the margin at worst."""
_RANGES_TIME = 20.0  # s; reached only in scenes with many contacts

_FIGURES: dict[str, tuple[Any, str]] = {
    "margin": (float, "Required margin e0 of Algorithm 2, N."),
    "scale": (
        TorqueScale,
        "Minimize the largest |torque| (absolute) or the largest |torque| / limit (limits).",
    ),
    "regularization": (float, "Weight of the sum of squared contact forces."),
}
"""Type and help of the figures of Algorithms 1 and 2; other objectives annotate their own."""

_DEPENDED_ON = "stability", "sign_rule"
"""Options that decide whether others have an effect; the scene may state them."""

_Command = TypeVar("_Command", bound=Callable[..., None])


def with_objective_options(command: _Command) -> _Command:
    """Add the objectives' names as choices of ``algorithm``, and an option for each figure.

    Args:
        command: Gets the figures that are no arguments of its own in ``**figures``; None: not
            given.
    """
    signature = inspect.signature(command, eval_str=True)
    options: list[inspect.Parameter] = []
    for param in signature.parameters.values():
        if param.kind is inspect.Parameter.VAR_KEYWORD:
            continue
        options.append(param)
        if param.name == "algorithm":
            names: Any = Literal[*OBJECTIVES]
            choices = Annotated[names | None, param.annotation.__metadata__[0]]
            options[-1:] = [
                param.replace(annotation=choices),
                *_figure_options(signature.parameters),
            ]
    function: Any = command
    function.__signature__ = signature.replace(parameters=options)
    return command


def _figure_options(taken_names: Container[str]) -> Iterator[inspect.Parameter]:
    """Yield an option for each figure that is a single value and not among the taken names."""
    figures = dict(_FIGURES)
    for key, annotated in figure_types().items():
        kind, *metadata = get_args(annotated) if get_origin(annotated) is Annotated else [annotated]
        plain = get_origin(kind) is Literal or (
            isinstance(kind, type) and issubclass(kind, int | float | str)
        )
        if plain:
            descriptions = [
                item.description for item in metadata if getattr(item, "description", "")
            ]
            figures.setdefault(key, (kind, "".join(descriptions[-1:])))
    for key, (kind, description) in figures.items():
        if key not in taken_names:
            yield inspect.Parameter(
                key,
                inspect.Parameter.POSITIONAL_OR_KEYWORD,
                default=None,
                annotation=Annotated[kind | None, typer.Option(help=description)],
            )


@with_objective_options
def solve_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML).")],
    algorithm: Annotated[
        str | None, typer.Option(help=f"Default: that of the scene file. {AIMS}.")
    ] = None,
    json_file: Annotated[
        str | None, typer.Option("--json", metavar="FILE|-", help="Write the solution as JSON.")
    ] = None,
    sign_rule: Annotated[
        SignRule | None, typer.Option(help="Rule on the signs of virtual sliding.")
    ] = None,
    sliding_rule: Annotated[
        SlidingRule | None,
        typer.Option(help="Whether contacts in actual sliding limit virtual motions, too."),
    ] = None,
    static_friction: Annotated[
        StaticFriction | None, typer.Option(help="coulomb: friction needs no virtual sliding.")
    ] = None,
    solver: Annotated[str | None, typer.Option(help="auto, piqp, proxqp, highs, ...")] = None,
    search: Annotated[
        Search | None, typer.Option(help="enumerate: list all modes instead of searching.")
    ] = None,
    node_limit: Annotated[int | None, typer.Option(help="Node limit of the search.")] = None,
    time_limit: Annotated[float | None, typer.Option(help="Time limit of the search, s.")] = None,
    direction_gap: Annotated[
        float | None, typer.Option(help="Relative optimality gap of --sign-rule direction.")
    ] = None,
    stability: Annotated[
        RequiredStability | None,
        typer.Option(help="strong: torques under which rest is the only outcome."),
    ] = None,
    verdict_nodes: Annotated[
        int | None,
        typer.Option(
            help=f"Node limit (sets of outcomes) of a verdict. Default: {BRIEF_NODE_LIMIT}, or "
            f"{NODE_LIMIT} with --stability strong."
        ),
    ] = None,
    controller: ControllerOption = None,
    no_verdict: Annotated[
        bool,
        typer.Option(
            "--no-verdict",
            help="Skip the verdict on whether the object stays, the margin at worst and the check "
            "of the proof.",
        ),
    ] = False,
    overwrite: OverwriteOption = False,
    **figures: Any,
) -> None:
    """Solve a scene: joint torques, how robust they are, and whether the object stays.

    Exit code 0: found; 1: infeasible; 2: bad input; 3: neither found nor proven infeasible; 4:
    found, and something serious is wrong with the scene, such as a hand that touches nothing.

    Examples:
        graspless-pin solve scene.yaml
        graspless-pin solve scene.yaml --algorithm torque --margin 0.2
        graspless-pin solve scene.yaml --json solution.json
    """
    with plain_errors():
        check_output("--json", json_file, OutputKind.SOLUTION, overwrite=overwrite)
        loaded = with_controller(loaded_scene(scene), controller)
        given: dict[str, Any] = {
            "sign_rule": sign_rule,
            "sliding_rule": sliding_rule,
            "static_friction": static_friction,
            "solver": solver,
            "search": search,
            "node_limit": node_limit,
            "time_limit": time_limit,
            "direction_gap": direction_gap,
            "stability": stability,
            **figures,
        }
        _refuse_idle_options(loaded, given, verdict_nodes, controller, no_verdict=no_verdict)
        if json_file is not None:
            options = {name: value for name, value in given.items() if value is not None}
            loaded.objective_and_options(algorithm, **options)[1].rules.need_signs("a document")
        solution, answer, verdict, note = judged_solution(
            loaded, algorithm, verdict_nodes, no_verdict=no_verdict, **given
        )
        bounds = None
        if solution.found and not no_verdict:
            bounds = _force_bounds(loaded, solution)
        if json_file != "-":
            typer.echo(scene_solution_text(loaded, solution, note, bounds, answer))
            if answer is not None and answer.found:
                typer.echo(f"\nHow far each quantity may be off: graspless-pin tolerances {scene}")
        # After what was found: not every answer has a document, and not every file can be written.
        if json_file is not None:
            from graspless_pin.report import solution_document, write_document

            write_document(solution_document(solution, loaded, verdict, answer=answer), json_file)
    raise typer.Exit(exit_code(solution))


def _refuse_idle_options(
    scene: Scene,
    given: Mapping[str, Any],
    verdict_nodes: int | None,
    controller: str | None,
    *,
    no_verdict: bool,
) -> None:
    """Refuse command-line options that have no effect in combination with the others.

    Raises:
        ArgumentError: Naming the first of them, and the option that makes it idle.
    """
    requested = {name: given[name] or scene.solve_options.get(name) for name in _DEPENDED_ON}
    is_strong = requested["stability"] == RequiredStability.STRONG
    is_coulomb = given["static_friction"] == StaticFriction.COULOMB
    idle = [
        ("--verdict-nodes", verdict_nodes is not None and no_verdict and not is_strong,
         "--no-verdict; leave one out"),
        ("--controller",
         controller is not None and no_verdict and not is_strong and scene.uncertainty is None,
         "--no-verdict; leave one out"),
        ("--direction-gap",
         given["direction_gap"] is not None and requested["sign_rule"] != SignRule.DIRECTION,
         "this sign rule; ask for --sign-rule direction, or leave it out"),
        ("--search", given["search"] == Search.ENUMERATE and is_coulomb,
         "--static-friction coulomb, which has only one mode; leave one out"),
    ]  # fmt: skip
    for option, is_idle, beside in idle:
        if is_idle:
            raise ArgumentError(option, f"has no effect with {beside}")


def solution_and_answer(
    scene: Scene, algorithm: str | None = None, **options: Any
) -> tuple[TorqueSolution, RobustAnswer | None]:
    """Return the solution of a scene, and the robust answer if the scene has an uncertainty.

    Args:
        scene: The scene.
        algorithm: See `Scene.solve`.
        options: See `Scene.solve`; None: not given.

    Returns:
        The solution, and None for a scene without uncertainty. Else the solution under the robust
        torques; where there are none, that of the joined problem, without torques.
    """
    options = {name: value for name, value in options.items() if value is not None}
    with waiting_for("solving"):
        if scene.uncertainty is None:
            return scene.solve(algorithm, **options), None
        # Imported here: scenes without uncertainty do not need it.
        from graspless_pin.scene.robust_answer import robust_answer

        try:
            answer = robust_answer(scene, algorithm, **options)
        except ArgumentError as error:
            if error.argument != "uncertainty" or scene.path is None:
                raise
            raise SceneError(f"{scene.path}: {error}") from None
        return answer.solution.with_source(scene), answer


def solved_scene(
    path: Path, algorithm: str | None = None, controller: str | None = None, **options: Any
) -> tuple[Scene, TorqueSolution]:
    """Load a scene, solve it and show all findings; end the command if there are no torques.

    Args:
        path: The scene file.
        algorithm: See `Scene.solve`.
        controller: See `with_controller`.
        options: See `solution_and_answer`.

    Raises:
        typer.Exit: If there are no torques.
    """
    scene = with_controller(loaded_scene(path), controller)
    solution, answer = solution_and_answer(scene, algorithm, **options)
    emit(*solution.findings)
    show_findings()
    if not solution.found:
        for_all = "" if answer is None else " that serve the scene's whole uncertainty"
        typer.echo(f"no torques were found{for_all}: {solution.status.message}")
        if answer is not None:
            typer.echo(f"which members are in conflict, and what helps: graspless-pin solve {path}")
        raise typer.Exit(exit_code(solution))
    return scene, solution


def judged_solution(
    scene: Scene,
    algorithm: str | None,
    verdict_nodes: int | None,
    *,
    no_verdict: bool,
    **options: Any,
) -> tuple[TorqueSolution, RobustAnswer | None, StabilityVerdict | None, str]:
    """Solve a scene, check the proof, ask for the verdict, and show all findings.

    Args:
        scene: The scene.
        algorithm: See `Scene.solve`.
        verdict_nodes: Node limit (sets of outcomes) of each verdict; None: the default.
        no_verdict: Whether to skip verdicts and the check of the proof.
        options: See `solution_and_answer`.

    Returns:
        Solution and answer of `solution_and_answer`, the verdict or None, and a note on it.
    """
    solution, answer = solution_and_answer(scene, algorithm, verdict_nodes=verdict_nodes, **options)
    verdict, note = None, ""
    if answer is not None and not no_verdict:
        from graspless_pin.scene.robust_answer import with_corner_verdicts

        answer = proven_answer(answer)
        solution = answer.solution.with_source(scene)
        # Not every scene has verdicts.
        with waiting_for("computing verdicts at the corners"), suppress(ArgumentError):
            answer = with_corner_verdicts(scene, answer, verdict_nodes)
    if not no_verdict and (answer is None or answer.found):
        solution, verdict, note = proven_and_verdict(scene, solution, verdict_nodes)
    emit(*solution.findings)
    show_findings()
    return solution, answer, verdict, note


def proven_answer(answer: RobustAnswer) -> RobustAnswer:
    """Return a robust answer whose status is what the document of its joined problem proves."""
    from graspless_pin.report.document import with_proven_claims

    with waiting_for("checking the proof for all members"):
        # Without torques take the solution with its explanation, which is slow to compute anew.
        solution, _ = with_proven_claims(
            answer.robust.solution if answer.found else answer.solution
        )
    return replace(answer, robust=replace(answer.robust, solution=solution))


def _force_bounds(scene: Scene, solution: TorqueSolution) -> ContactForceBounds | None:
    """Return the margins (32) under the torques, within limits of nodes and time."""
    if solution.rules.sign is SignRule.DIRECTION:
        return None
    with waiting_for("searching for the margin at worst"):
        return contact_force_bounds(
            rest_problem(scene, solution.problem, solution.torques),
            solution.torques,
            ranges=False,
            node_limit=_RANGE_NODES,
            time_limit=_RANGES_TIME,
            **solution.rules.options(),
        )


def proven_and_verdict(
    scene: Scene, solution: TorqueSolution, nodes: int | None = None
) -> tuple[TorqueSolution, StabilityVerdict | None, str]:
    """Return a solution with its proven status, the stability verdict, and a note on it.

    Args:
        scene: The scene.
        solution: The solution of the search.
        nodes: Node limit (sets of outcomes) of the verdict; None: `BRIEF_NODE_LIMIT`. The verdict
            is None where there can be none.
    """
    from graspless_pin.report.document import with_proven_claims

    limit = BRIEF_NODE_LIMIT if nodes is None else nodes
    verdict, reason = None, ""
    if solution.found:
        try:
            with waiting_for("computing the verdict"):
                verdict = solution_verdict(scene, solution, node_limit=limit)
        except ArgumentError as error:
            reason = f"no verdict: {error}"
    with waiting_for("checking the proof"):
        solution, verdict = with_proven_claims(solution, scene, verdict)
    note = reason if verdict is None else verdict.full_message("--verdict-nodes {}")
    return solution, verdict, note if solution.found else ""
