"""``graspless-pin verify``: check the claims of solution documents."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import ExitCode, plain_errors
from graspless_pin.errors import SceneError
from graspless_pin.report.reading import read_document
from graspless_pin.report.verify import Verification, verify_document


def verify(
    files: Annotated[
        list[Path],
        typer.Argument(metavar="FILE...", help="Solution documents (JSON)."),
    ],
) -> None:
    """Check solutions from their JSON with numpy alone: each figure, and the whole proof.

    Exit code 0: all that they claim is proven; 1: a check fails; 2: not a solution document;
    3: no check fails, but a document does not contain the proof of all that it claims.

    Examples:
        graspless-pin verify solution.json
        graspless-pin verify proofs/*.json
    """
    outcomes = {ExitCode.FOUND}
    for file in files:
        with plain_errors():
            document = read_document(file)
            try:
                checked = verify_document(document)
            except (ValueError, ArithmeticError) as error:
                raise SceneError(f"{file}: {error}") from error
        typer.echo(str(checked) if len(files) == 1 else _short_report(file, checked))
        if not checked.passed:
            outcomes.add(ExitCode.INFEASIBLE)
        elif not checked.proven:
            outcomes.add(ExitCode.NOT_PROVEN)
    raise typer.Exit(ExitCode.INFEASIBLE if ExitCode.INFEASIBLE in outcomes else max(outcomes))


def _short_report(file: Path, checked: Verification) -> str:
    """Return a line with the result for a file, and a line for each check that fails."""
    verdict = "proven" if checked.proven else "not all proven" if checked.passed else "FAILED"
    return "\n".join(
        [f"{file}: {verdict}", *(str(check) for check in checked.checks if not check.passed)]
    )
