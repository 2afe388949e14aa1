"""``graspless-pin close`` and ``settle``: write the scene that results."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import numpy as np
import typer

from graspless_pin.cli.outcome import ExitCode, loaded_scene, plain_errors
from graspless_pin.cli.outputs import OutputKind, OverwriteOption, check_output
from graspless_pin.findings import emit
from graspless_pin.progress import waiting_for
from graspless_pin.scene import close_fingers, settle
from graspless_pin.scene.contact_arrays import contacts_of

_Source = Annotated[Path, typer.Argument(help="Scene file (YAML).")]
_Output = Annotated[
    Path, typer.Option("--output", "-o", metavar="FILE", help="The scene file to write.")
]


def close_scene(
    scene: _Source,
    output: _Output,
    finger: Annotated[
        list[str] | None,
        typer.Option(metavar="NAME", help="Close this finger; may be repeated. Default: all."),
    ] = None,
    wrap: Annotated[
        bool,
        typer.Option("--wrap", help="After a link touches, continue with the joints beyond it."),
    ] = False,
    overwrite: OverwriteOption = False,
) -> None:
    """Close fingers until they touch the object or reach their limits, and write that scene.

    Exit code 0: each of these fingers touches; 1: not all of them do; 2: bad input; 4: each
    touches, and something serious is wrong with the scene.

    Examples:
        graspless-pin close scene.yaml -o closed.yaml
        graspless-pin close scene.yaml -o closed.yaml --finger index --wrap
    """
    with plain_errors():
        check_output("--output", output, OutputKind.SCENE, overwrite=overwrite)
        loaded = loaded_scene(scene, findings=False)
        with waiting_for("closing the fingers"):
            closed = close_fingers(loaded, fingers=finger, wrap=wrap)
        if closed.closing.all_touch:
            contacts_of(closed.scene)  # raises if the object is deep in a support
        written = closed.scene.save(output, overwrite=overwrite)
        emit(*closed.scene.findings)
        typer.echo(f"{closed.closing}\nwrote {written}")
    raise typer.Exit(ExitCode.FOUND if closed.closing.all_touch else ExitCode.INFEASIBLE)


def settle_scene(scene: _Source, output: _Output, overwrite: OverwriteOption = False) -> None:
    """Move the object along gravity until it rests on a support, and write that scene.

    The hand stays where it is and can be placed or closed afterwards; therefore findings about the
    hand are not reported.

    Exit code 0: written; 2: bad input; 4: written, and something serious is wrong with the scene.

    Examples:
        graspless-pin settle scene.yaml -o settled.yaml
    """
    with plain_errors():
        check_output("--output", output, OutputKind.SCENE, overwrite=overwrite)
        loaded = loaded_scene(scene, findings=False)
        settled = settle(loaded)
        displacement = settled.object.T_world_object[:3, 3] - loaded.object.T_world_object[:3, 3]
        distance = float(displacement @ loaded.gravity) / float(np.linalg.norm(loaded.gravity))
        direction = "down" if distance >= 0.0 else "up"
        moved = f"object '{settled.object.name}' moves {direction} by {1e3 * abs(distance):.3f} mm"
        written = settled.save(output, overwrite=overwrite)
        emit(*(finding for finding in settled.findings if finding.key[:1] != ("hand",)))
        typer.echo(f"{moved}\nwrote {written}")
