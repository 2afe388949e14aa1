"""``graspless-pin view``: a scene as an interactive page."""

from __future__ import annotations

from contextlib import suppress
from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import loaded_scene, plain_errors, show_findings
from graspless_pin.viewer.page import DEFAULT_PORT, view


def view_scene(
    scene: Annotated[Path, typer.Argument(help="Scene file (YAML).")],
    host: Annotated[
        str, typer.Option(help="Address to listen at. Default: reachable from this machine only.")
    ] = "127.0.0.1",
    port: Annotated[int, typer.Option(help="If it is taken, the next free one.")] = DEFAULT_PORT,
    no_open: Annotated[bool, typer.Option("--no-open", help="Do not open a browser.")] = False,
) -> None:
    """Show a scene on an interactive page until the command is interrupted (Ctrl-C).

    Examples:
        graspless-pin view scene.yaml
    """
    with plain_errors():
        loaded = loaded_scene(scene)
        show_findings()
        viewer = view(loaded, host=host, port=port, open_browser=not no_open)
    with suppress(KeyboardInterrupt):
        typer.echo(f"{viewer.url} (Ctrl-C ends it)")
        viewer.wait()
    viewer.stop()
