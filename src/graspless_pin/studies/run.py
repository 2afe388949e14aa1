"""Run a study: samples to workers, rows to the journal, at the end one table.

Before the run values that no scene can have are refused, and scenes without contact.

A study has one round of samples, or several where they are refined adaptively.
"""

from __future__ import annotations

import os
from array import array
from collections.abc import Callable, Iterable, Iterator
from concurrent.futures import Executor
from contextlib import ExitStack
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    TextColumn,
    TimeElapsedColumn,
    TimeRemainingColumn,
)

from graspless_pin.atomic_write import remove_stale_drafts
from graspless_pin.child_process import usable_cores
from graspless_pin.errors import GrasplessPinError, SceneError, StudyError
from graspless_pin.findings import capture
from graspless_pin.intake.yaml_source import validated
from graspless_pin.problem.checks import truth_values, whole_number
from graspless_pin.scene.keys import Tree
from graspless_pin.scene.load import build_scene
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.solvers import check_solver
from graspless_pin.studies.executors import Dispatch, Workforce, compute_here, local_processes
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal, discard, journal_of
from graspless_pin.studies.keys import Sample
from graspless_pin.studies.results import (
    check_columns,
    format_of,
    read_results,
    require_tables,
    results_about,
    results_parts,
    write_results,
)
from graspless_pin.studies.sample_evaluation import Failure
from graspless_pin.studies.sampling import AdaptiveSamples
from graspless_pin.studies.study import (
    NOT_PLACED,
    Row,
    SampleParts,
    Study,
    placement_of,
    posing_of,
    scene_and_posing,
)
from graspless_pin.studies.study_schema import PosingEntry
from graspless_pin.versions import versions

if TYPE_CHECKING:
    import pandas as pd


def rounds_of(
    study: Study, rows: Callable[[Iterable[int]], Iterator[Row]]
) -> Iterator[tuple[Study, range]]:
    """Yield for each round the study with its samples so far, and the numbers of the new ones.

    Args:
        study: The study with the samples of its first round.
        rows: Reads the rows of samples, which exist when the next round is asked for.

    Yields:
        The study and its new numbers.
    """
    border = study.entry.sampling.border or "found"
    outcomes: dict[str, int] = {}
    outcome_numbers = array("q")
    while len(outcome_numbers) < len(study.samples):
        numbers = range(len(outcome_numbers), len(study.samples))
        yield study, numbers
        if not isinstance(study.samples, AdaptiveSamples):
            return
        for row in rows(numbers):
            outcome_numbers.append(outcomes.setdefault(str(row.get(border)), len(outcomes)))
        samples = study.samples.refined(np.array(outcome_numbers))
        study = replace(study, samples=samples)


_MOST_SAMPLES_TRIED = 64


def check_study(study: Study) -> None:
    """Check a study: the extreme values of all variables, and samples until one can be computed.

    Raises:
        StudyError: If a value is one that its key cannot have, or none of up to 64 samples spread
            over the study gives a scene in which anything touches the object.
    """
    first = study.samples[0]
    for index, variable in enumerate(study.variables):
        for value in variable.extremes():
            sample = (*first[:index], value, *first[index + 1 :])
            # Before bodies move: an invalid pose cannot be moved.
            _check_values(study, variable.name, value, study.unmoved_tree_at(sample))
    try:
        check_solver(study.tree_at(first)["solve"].get("solver", "auto"))
    except GrasplessPinError as error:
        is_own = study.entry.compute.solver is not None
        where = f"{study.source.path}: compute" if is_own else f"{study.scene.path}: solve"
        raise StudyError(f"{where}.{error}") from None
    _check_any_touches(study)


def _check_values(study: Study, name: str, value: object, tree: Tree) -> None:
    scene_tree, posing_tree = scene_and_posing(tree)
    try:
        validated(replace(study.scene, data=scene_tree), SceneEntry)
        validated(replace(study.source, data=posing_tree), PosingEntry)
    except (SceneError, StudyError) as error:
        raise study.source.error(("vary", name), f"at {value!r}: {error}") from None


def _check_any_touches(study: Study) -> None:
    count = len(study.samples)
    numbers: list[int] = (
        np.linspace(0, count - 1, min(count, _MOST_SAMPLES_TRIED)).round().astype(int).tolist()
    )
    parts = SampleParts()
    failure: tuple[Sample, GrasplessPinError] | None = None
    for number in dict.fromkeys(numbers):
        sample = study.samples[number]
        try:
            _check_sample(study, sample, parts)
        except StudyError:
            raise
        except GrasplessPinError as error:
            failure = failure or (sample, error)
        except Exception:  # reported in the sample's row
            return
        else:
            return
    if failure is not None:
        variable_error = _single_variable_error(study, failure[0])
        if variable_error is not None:
            raise variable_error from failure[1]
        names = [variable.column for variable in study.variables]
        values = ", ".join(f"{n} = {v!r}" for n, v in zip(names, failure[0], strict=True))
        checked = "the only sample" if count == 1 else f"none of {len({*numbers})} samples"
        verb = "cannot" if count == 1 else "can"
        raise StudyError(
            f"{study.source.path}: {checked} {verb} be computed; with {values}: {failure[1]}"
        )


def _check_sample(study: Study, sample: Sample, parts: SampleParts) -> None:
    """Make a sample's problem, or, where the study places the hand, try one candidate.

    Raises:
        GrasplessPinError: If that fails.
    """
    if study.entry.place is None:
        study.scene_at(sample, parts).problem()
        return
    scene, tree = study.unposed_at(sample, parts), study.tree_at(sample)
    with study.source.errors_at(("place",)):
        # One candidate is enough to check the options.
        place = posing_of(scene, tree).place or study.entry.place
        placement_of(scene, place.model_copy(update={"candidates": 1, "verdict_nodes": 0}))


def _single_variable_error(study: Study, sample: Sample) -> GrasplessPinError | None:
    """Return the error of the variable whose value alone makes the scene invalid.

    None if the scene is invalid without it, too, or only a combination of values is.
    """

    def error_of(tree: Tree) -> GrasplessPinError | None:
        try:
            with capture():
                build_scene(Scene, replace(study.scene, data=scene_and_posing(tree)[0]))
        except GrasplessPinError as error:
            return error
        return None

    tree = study.scene.data
    if error_of(tree) is not None:
        return None
    for variable, value in zip(study.variables, sample, strict=True):
        if error := error_of(variable.with_value(tree, value)):
            return study.source.error(("vary", variable.name), f"at {value!r}: {error}")
    return None


_LONGEST_NAME = 220
"""Most bytes of an output's name; those of journal and draft are longer, with a limit of 255."""


def run_study(
    study: Study,
    output: str | Path,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: bool = True,
    overwrite: bool = False,
    fresh: bool = False,
) -> pd.DataFrame:
    """Compute all samples of a study, write the table and return it: see `compute_study`.

    Args:
        study: The study.
        output: The table's file; ``.parquet`` or ``.csv``.
        executor: Where to compute; None: processes on this machine.
        workers: Number of processes, or of workers of the executor; None: one for each core.
        progress: Whether to show a progress bar on standard error, and a note on a resumed run.
        overwrite: Whether an output or a journal of another study may be replaced.
        fresh: Whether to drop results of an earlier run of this study.

    Returns:
        The table, one row a sample in the order of the samples: the same for the same seed,
        however many workers there are.

    Raises:
        StudyError: If the study cannot be computed at all, the output cannot be written or belongs
            to another study, or there are no workers.
        ArgumentError: If an option has an invalid value.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.studies import Study, run_study
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> with TemporaryDirectory() as folder:
        ...     file = f"{folder}/results.csv"
        ...     table = run_study(Study.from_data(data), file, workers=1, progress=False)
        >>> table["margin_N"].round(3).tolist()
        [1.65, 1.875]
    """
    compute_study(
        study, output, executor=executor, workers=workers, progress=progress, overwrite=overwrite,
        fresh=fresh,
    )  # fmt: skip
    return read_results(output)


def compute_study(
    study: Study,
    output: str | Path,
    *,
    executor: Executor | None = None,
    workers: int | None = None,
    progress: bool = True,
    overwrite: bool = False,
    fresh: bool = False,
) -> None:
    """Compute all samples of a study and write the table, of which a part at a time is in memory.

    Rows are written to a journal beside the output (``results.parquet.journal``) as they come. A
    killed run is resumed from there, and a study with a complete output is not computed again.

    Args:
        study: The study.
        output: The table's file; ``.parquet`` or ``.csv``.
        executor: Where to compute; None: processes on this machine. Its workers need this package,
            and the scene's files at the same paths.
        workers: Number of processes, or of workers of the executor; None: the number of cores that
            this process may use.
        progress: Whether to show a progress bar on standard error, and a note on a resumed run.
        overwrite: Whether an output or a journal of another study may be replaced.
        fresh: Whether to drop results of an earlier run of this study.

    Raises:
        StudyError: If the study cannot be computed at all, the output cannot be written or belongs
            to another study, or there are no workers.
        ArgumentError: If an option has an invalid value.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.studies import Study, compute_study, results_parts
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> with TemporaryDirectory() as folder:
        ...     file = f"{folder}/results.parquet"
        ...     compute_study(Study.from_data(data), file, workers=1, progress=False)
        ...     for part in results_parts(file):
        ...         print(part["margin_N"].round(3).tolist())
        [1.65, 1.875]
    """
    truth_values(overwrite=overwrite, fresh=fresh)
    require_tables()
    file = Path(output)
    format_of(file)
    _check_output_name(file)
    check_columns(study)
    count = whole_number("workers", usable_cores() if workers is None else workers, 1)
    journal_file = journal_of(file)
    if not fresh:
        if _is_finished(study, file, overwrite=overwrite, goes_on=journal_file.exists()):
            discard(journal_file, study.fingerprint)
            remove_stale_drafts(file)
            if progress:
                _print_line(f"{file} is complete; to compute it again: --fresh")
            return
    elif file.is_file() and not overwrite:
        _own_metadata(study, file)
    _check_folder(file)
    check_study(study)
    identity = {"format": JOURNAL_FORMAT, "fingerprint": study.fingerprint, "versions": versions()}
    journal = Journal(journal_file, identity, fresh=fresh, overwrite=overwrite)
    complete = False
    try:
        computed = _compute_all_rounds(study, journal, executor, count, progress=progress)
        write_results(computed, journal, file)
        complete = True
    finally:
        journal.close(remove=complete)


def _unrecorded_samples(study: Study, rows: Iterable[Row]) -> set[int]:
    """Return the numbers of samples with a solution that is missing in the study's record."""
    if study.record is None:
        return set()
    failures = {*(failure.value for failure in Failure), NOT_PLACED}
    return {
        row["sample"]
        for row in rows
        if row["status"] not in failures and not study.record.has(row["sample"])
    }


def _check_output_name(file: Path) -> None:
    """Refuse a name that is too long for the names of journal and draft, or invalid."""
    length = len(os.fsencode(file.name))
    if length > _LONGEST_NAME:
        raise StudyError(
            f"{file}: its name has {length} bytes; it must have at most {_LONGEST_NAME}"
        )
    try:
        file.lstat()
    except (FileNotFoundError, NotADirectoryError):
        pass
    except (OSError, ValueError) as error:
        raise StudyError(f"{str(file)!r}: is not a valid path ({error})") from None


def _check_folder(file: Path) -> None:
    if file.is_dir():
        raise StudyError(f"{file}: is a folder; name a file in it")
    if not file.parent.is_dir():
        raise StudyError(f"{file}: there is no folder {str(file.parent)!r}; create it first")
    if not os.access(file.parent, os.W_OK):
        raise StudyError(f"{file}: its folder cannot be written to; choose another output")


def _own_metadata(study: Study, file: Path) -> dict[str, Any]:
    """Return the metadata of a table; refuse a table of another study."""
    try:
        about = results_about(file)
    except StudyError as error:
        raise StudyError(f"{error}; choose another output, or replace it (--overwrite)") from None
    if about["fingerprint"] != study.fingerprint:
        raise StudyError(
            f"{file}: holds the results of another study ({about['study']!r}), or of this study "
            "before it or its scene was changed; choose another output, or replace it "
            "(--overwrite)"
        )
    return about


def _is_finished(study: Study, file: Path, *, overwrite: bool, goes_on: bool) -> bool:
    """Return whether the output is complete already; refuse the output of another study."""
    if not file.is_file():
        return False
    try:
        about = _own_metadata(study, file)
    except StudyError:
        if overwrite:
            return False
        raise
    if about["versions"] != versions():
        if overwrite or goes_on:
            return False
        raise StudyError(
            f"{file}: was computed with other versions of the libraries ({about['versions']}); "
            "compute it again (--fresh), or choose another output"
        )
    parts = results_parts(file, ["sample", "status"])
    return not _unrecorded_samples(
        study, (row for part in parts for row in part.to_dict("records"))
    )


def _compute_all_rounds(
    study: Study, journal: Journal, executor: Executor | None, count: int, *, progress: bool
) -> Study:
    """Compute the samples of all rounds into the journal; return the study with all of them."""
    if progress and journal.count:
        _print_line(f"continues: an earlier run computed {journal.count} samples")
    dispatch: Dispatch | None = None
    with _progress_bar(progress) as bar, ExitStack() as stack:
        task = bar.add_task(study.name, total=len(study.samples))

        def keep(rows: list[Row]) -> None:
            journal.append(rows)
            bar.advance(task, len(rows))

        for round_study, numbers in rounds_of(study, journal.rows):
            study = round_study
            again = _unrecorded_samples(study, journal.rows(n for n in numbers if n in journal))
            remaining = sum(n not in journal for n in numbers) + len(again)
            bar.update(task, total=numbers.stop)
            bar.advance(task, len(numbers) - remaining)
            if not remaining:
                continue
            if dispatch is None:
                dispatch = Dispatch(study, _workers(study, executor, count, remaining), keep)
                stack.callback(dispatch.close)
            dispatch.study = study
            dispatch.run((n for n in numbers if n not in journal or n in again), remaining)
    return study


def _workers(study: Study, executor: Executor | None, count: int, remaining: int) -> Workforce:
    """Return the workers: local processes, no more than missing samples unless it is adaptive.

    A given executor is used instead, and is not closed.
    """
    if executor is not None:
        return Workforce(count, partial(executor.submit, compute_here), lambda: None)
    return local_processes(count if study.is_adaptive else min(count, remaining))


def _progress_bar(shown: bool) -> Progress:
    """Return a progress bar with samples done, elapsed time and time left."""
    return Progress(
        TextColumn("{task.description}"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeElapsedColumn(),
        TextColumn("time left:"),
        TimeRemainingColumn(),
        console=Console(stderr=True),
        disable=not shown,
    )


def _print_line(text: str) -> None:
    """Print a line on standard error."""
    Console(stderr=True).print(text, markup=False, highlight=False, soft_wrap=True)
