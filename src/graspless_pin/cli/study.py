"""``graspless-pin study``: compute a study into one table."""

from __future__ import annotations

import time
from contextlib import nullcontext, suppress
from dataclasses import replace
from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.atomic_write import make_folder_of
from graspless_pin.cli import INTERRUPTED
from graspless_pin.cli.outcome import ExitCode, plain_errors
from graspless_pin.report.document import SampleDocuments
from graspless_pin.studies import compute_study, load_study, results_parts, results_summary
from graspless_pin.studies.executors import dask_executor
from graspless_pin.studies.sample_evaluation import FINDINGS


def study(
    file: Annotated[Path, typer.Argument(help="Study file (YAML).")],
    output: Annotated[
        Path, typer.Option("--output", "-o", help="Table to write: .parquet or .csv.")
    ],
    workers: Annotated[
        int | None,
        typer.Option(min=1, help="Processes on this machine. Default: one for each core."),
    ] = None,
    dask: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Compute on the workers of this Dask scheduler."),
    ] = None,
    overwrite: Annotated[
        bool,
        typer.Option("--overwrite", help="Replace a file of another study, or of no study."),
    ] = False,
    fresh: Annotated[
        bool, typer.Option("--fresh", help="Discard the results of an earlier run of this study.")
    ] = False,
    progress: Annotated[bool, typer.Option(help="Show a progress bar.")] = True,
    proofs: Annotated[
        Path | None,
        typer.Option(metavar="DIR", help="Folder for each sample's document with its proof."),
    ] = None,
) -> None:
    """Compute a study, or continue one that was interrupted or killed.

    Exit code 0: torques were found for some samples; 1: for none; 2: bad input; 4: found, and some
    of these samples have serious findings, such as a hand that touches nothing; 130: interrupted.

    Examples:
        graspless-pin study study.yaml -o results.parquet
    """
    with plain_errors():
        loaded = load_study(file)
        if proofs is not None:
            loaded = replace(loaded, record=SampleDocuments(proofs.absolute()))
        # A folder that cannot be made is reported by the run.
        with suppress(OSError):
            make_folder_of(output)
        begin = time.monotonic()
        try:
            remote = nullcontext((None, None)) if dask is None else dask_executor(dask)
            with remote as (executor, threads):
                compute_study(
                    loaded, output, executor=executor, workers=workers or threads,
                    progress=progress, overwrite=overwrite, fresh=fresh,
                )  # fmt: skip
        except KeyboardInterrupt:
            typer.echo("interrupted; run the same command again to continue", err=True)
            raise typer.Exit(INTERRUPTED) from None
        typer.echo(results_summary(output))
        typer.echo(f"{output} after {time.monotonic() - begin:.1f} s")
        parts = [
            (part["found"].any(), (part["found"] & part[FINDINGS].notna()).any())
            for part in results_parts(output, ["found", FINDINGS])
        ]
    code = ExitCode.FOUND if any(found for found, _ in parts) else ExitCode.INFEASIBLE
    raise typer.Exit(ExitCode.DOUBTFUL if any(serious for _, serious in parts) else code)
