"""``graspless-pin place``: find places of the hand where it holds the object."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import ExitCode, echo_note, loaded_scene, plain_errors, three_numbers
from graspless_pin.cli.outputs import OutputKind, OverwriteOption, check_output
from graspless_pin.errors import ArgumentError
from graspless_pin.findings import emit
from graspless_pin.holding.verdict import BRIEF_NODE_LIMIT
from graspless_pin.planning import place_hand
from graspless_pin.progress import waiting_for
from graspless_pin.scene.saving import scene_text, write_scene_file
from graspless_pin.scene.scene_findings import figure_findings


def place(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML); the hand may be anywhere.")],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="FILE", help="The scene file to write.")
    ],
    approach: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Direction in which the palm approaches the object, world axes. Default: all "
            "directions are tried.",
        ),
    ] = None,
    point: Annotated[
        str | None,
        typer.Option(
            metavar="X,Y,Z",
            help="Point that the palm approaches, world axes, m. Default: points in the object.",
        ),
    ] = None,
    finger: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Use this finger; may be repeated. Default: all."),
    ] = None,
    margin: Annotated[
        float | None,
        typer.Option(help="Margin that a place must have, N. Default: the scene's, or 0.1."),
    ] = None,
    carry: Annotated[
        bool,
        typer.Option(
            "--carry", help="Accept only grips that carry the object without its supports."
        ),
    ] = False,
    press: Annotated[
        bool,
        typer.Option(
            "--press",
            help="Accept all places that hold the object, even without a grip, and rank them by "
            "the margin with supports.",
        ),
    ] = False,
    together: Annotated[
        bool,
        typer.Option(
            "--together", help="Move all mounts as one body. Default: each is placed by itself."
        ),
    ] = False,
    move_base: Annotated[
        bool,
        typer.Option(
            "--move-base",
            help="Move the base of an arm. Default: the base stays, and the arm moves the palm.",
        ),
    ] = False,
    all_places: Annotated[
        bool,
        typer.Option(
            "--all",
            help="Compute the verdict of all places, not only of the best, and print their table.",
        ),
    ] = False,
    rank: Annotated[int, typer.Option(min=1, help="Rank of the place to write; 1: the best.")] = 1,
    seed: Annotated[int, typer.Option(min=0, help="Seed of all random choices.")] = 0,
    candidates: Annotated[int, typer.Option(min=1, help="Number of candidates to try.")] = 600,
    time_limit: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Time limit of the search; places found by then are kept.",
        ),
    ] = 60.0,
    verdict_nodes: Annotated[
        int,
        typer.Option(min=0, help="Node limit (sets of outcomes) of each verdict; 0: no verdicts."),
    ] = BRIEF_NODE_LIMIT,
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine. Default: one for each core."),
    ] = None,
    overwrite: OverwriteOption = False,
) -> None:
    """Find where the hand holds the object, and write that scene.

    Open hands are brought to the object and closed. The best place that holds it is written.
    The same seed finds the same places, unless --time-limit ends the search.

    Exit code 0: written; 1: no place was found, and the reasons are printed; 2: bad input; 4:
    written, and something serious is wrong with the scene.

    Examples:
        graspless-pin place scene.yaml -o placed.yaml
        graspless-pin place scene.yaml -o placed.yaml --approach 0,0,-1 --seed 1
    """
    with plain_errors():
        if carry and press:
            raise ArgumentError("--carry", "cannot be combined with --press; give one of them")
        check_output("--output", output, OutputKind.SCENE, overwrite=overwrite)
        loaded = loaded_scene(scene, findings=False)
        if loaded.hand is not None and len(loaded.hand.mounts) > 1 and not together:
            echo_note("each mount is placed by itself; --together moves all as one body")
        emit(*figure_findings(loaded))

        def placed_scene_text(target: Path) -> str:
            with waiting_for("placing the hand") as update:
                placing = place_hand(
                    loaded,
                    approach=None if approach is None else three_numbers("--approach", approach),
                    point=None if point is None else three_numbers("--point", point),
                    fingers=finger,
                    margin=margin,
                    aim="carry" if carry else "press" if press else "grip",
                    together=together,
                    move_base=move_base,
                    seed=seed,
                    candidates=candidates,
                    time_limit=time_limit,
                    verdict_nodes=verdict_nodes,
                    verdicts=None if all_places else 5,
                    workers=workers,
                    progress=lambda done, of, good: update(f"{done} of {of} tried, {good} hold"),
                )
            typer.echo(placing)
            if all_places and placing.places:
                typer.echo(placing.table)
            if not placing.places:
                raise typer.Exit(ExitCode.INFEASIBLE)
            if rank > len(placing.places):
                raise ArgumentError("--rank", f"is {rank}; places found: {len(placing.places)}")
            return scene_text(placing.places[rank - 1].scene, target)

        typer.echo(f"wrote {write_scene_file(output, placed_scene_text, overwrite=overwrite)}")
        typer.echo(f"next: graspless-pin solve {output}")
