"""``graspless-pin schema``: the JSON schema of scene files."""

from __future__ import annotations

import json
from typing import Annotated

import typer

from graspless_pin.scene import scene_json_schema


def schema(
    study: Annotated[
        bool, typer.Option("--study", help="Print the schema of a study file.")
    ] = False,
) -> None:
    """Print the JSON schema of a scene file, or of a study file.

    Examples:
        graspless-pin schema > scene.schema.json
        graspless-pin schema --study > study.schema.json
    """
    found = scene_json_schema()
    if study:  # needs pandas, which scenes do not
        from graspless_pin.studies.study_schema import StudyEntry

        found = StudyEntry.model_json_schema()
    typer.echo(json.dumps(found, indent=2))
