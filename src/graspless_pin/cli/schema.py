"""``graspless-pin schema``: what may stand in a scene file."""

from __future__ import annotations

import json

import typer

from graspless_pin.scene import scene_json_schema


def schema() -> None:
    """Print the JSON schema of a scene file."""
    typer.echo(json.dumps(scene_json_schema(), indent=2))
