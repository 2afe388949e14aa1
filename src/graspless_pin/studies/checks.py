"""What is refused before anything runs: values that no scene can have, scenes without contact."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.errors import GrasplessPinError, SceneError, StudyError
from graspless_pin.scene.messages import validated
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.solvers import check_solver
from graspless_pin.studies.keys import Tree
from graspless_pin.studies.sample_parts import Sample, SampleParts
from graspless_pin.studies.study import Study

_MOST_TRIED = 64


def check_study(study: Study) -> None:
    """Try a study out: the ends of every variable, and samples until one is a usable scene.

    Raises:
        StudyError: If a value is one that its key cannot have, or none of up to 64 samples spread
            over the study gives a scene in which anything touches the object.
    """
    first = study.samples[0]
    for index, variable in enumerate(study.variables):
        for value in variable.extremes():
            sample = (*first[:index], value, *first[index + 1 :])
            # Before bodies move: what is no pose cannot be moved.
            _check_values(study, variable.name, value, study.placed_at(sample))
    try:
        check_solver(study.tree_at(first)["solve"].get("solver", "auto"))
    except GrasplessPinError as error:
        raise StudyError(f"{study.source.path}: compute.{error}") from None
    _check_any_touches(study)


def _check_values(study: Study, name: str, value: object, tree: Tree) -> None:
    try:
        validated(replace(study.scene, data=tree), SceneEntry)
    except SceneError as error:
        raise study.source.error(("vary", name), f"at {value!r}: {error}") from None


def _check_any_touches(study: Study) -> None:
    count = len(study.samples)
    spread: list[int] = (
        np.linspace(0, count - 1, min(count, _MOST_TRIED)).round().astype(int).tolist()
    )
    parts = SampleParts()
    failure: tuple[Sample, GrasplessPinError] | None = None
    for number in dict.fromkeys(spread):
        sample = study.samples[number]
        try:
            study.scene_at(sample, parts).problem()
        except GrasplessPinError as error:
            failure = failure or (sample, error)
        except Exception:  # the sample's row will tell
            return
        else:
            return
    if failure is not None:
        names = [variable.column for variable in study.variables]
        values = ", ".join(f"{n} = {v!r}" for n, v in zip(names, failure[0], strict=True))
        tried = "the only sample" if count == 1 else f"none of {len({*spread})} samples"
        verb = "cannot" if count == 1 else "can"
        raise StudyError(
            f"{study.source.path}: {tried} {verb} be computed; with {values}: {failure[1]}"
        )
