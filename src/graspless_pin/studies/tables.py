"""Results as a tidy table, one row a sample, in Parquet or CSV: which columns, and how written."""

from __future__ import annotations

import json
import os
from collections.abc import Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspless_pin.atomic_write import draft_of
from graspless_pin.errors import StudyError
from graspless_pin.studies.journal import Journal
from graspless_pin.studies.rows import FINDINGS, LARGEST_TORQUE, OBJECTIVE_VALUE
from graspless_pin.studies.study import Study
from graspless_pin.versions import versions

if TYPE_CHECKING:
    import pandas as pd

KEY = "graspless_pin"
"""Name of the metadata in Parquet files and in ``DataFrame.attrs``."""
_COUNTS = ("contacts", "nodes")
_FIRST = ("status", "found", "margin_N")
_LARGEST = tuple(f"{LARGEST_TORQUE}{unit}" for unit in ("Nm", "N"))
_LAST = (
    OBJECTIVE_VALUE,
    "verdict",
    "mode",
    "smallest_margin_N",
    "largest_margin_N",
    "disturbance_N",
    "minimum_friction_factor",
    "contacts",
    "nodes",
    FINDINGS,
    "reason",
    "error",
)
_ALWAYS = (*_COUNTS, FINDINGS, "reason", "error")
_TEXT = ("status", "verdict", "mode", FINDINGS, "reason", "error")
_ATTRS = "PANDAS_ATTRS"
"""Where ``pandas.read_parquet`` finds ``DataFrame.attrs``."""
CSV_MARK = f"# {KEY} "
"""Begin of the first line of a CSV file."""
PART_ROWS = 2**14
"""Rows that are in memory at a time; a row group of Parquet."""


def require_tables() -> None:
    """Check that the libraries for tables are installed.

    Raises:
        StudyError: Naming what to install.
    """
    try:
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401
    except ImportError as error:
        raise StudyError(
            f"studies need pandas and pyarrow ({error}): pip install 'graspless-pin[studies]'"
        ) from None


def format_of(output: Path) -> str:
    """Return ``parquet`` or ``csv`` by a file's ending.

    Raises:
        StudyError: If it is neither.
    """
    known = {".parquet": "parquet", ".pq": "parquet", ".csv": "csv"}
    if output.suffix.lower() not in known:
        raise StudyError(
            f"{output}: {output.suffix or 'no ending'!r} is no known format; end the name with "
            ".parquet or .csv"
        )
    return known[output.suffix.lower()]


def check_columns(study: Study) -> None:
    """Refuse variables that are called like another column of the results.

    Raises:
        StudyError: Naming the variable.
    """
    taken = {"sample", *_FIRST, *_LARGEST, *_LAST}
    for variable in study.variables:
        if variable.column in taken or variable.column.startswith("torque_"):
            raise study.source.error(
                ("vary", variable.name),
                f"its column would be called {variable.column!r} like another one of the results; "
                "rename it and give its 'key'",
            )
        taken.add(variable.column)


def study_metadata(study: Study) -> dict[str, Any]:
    """Return what is kept beside the rows: the study, its hash, seed and versions."""
    sampling = study.entry.sampling
    return {
        "study": study.name,
        "fingerprint": study.fingerprint,
        "samples": len(study.samples),
        "method": sampling.method,
        "seed": None if sampling.method in ("grid", "adaptive") else sampling.seed,
        "versions": versions(),
        "entry": study.entry.model_dump(mode="json", by_alias=True, exclude_defaults=True),
    }


def _made_parts(study: Study, journal: Journal) -> Iterator[pd.DataFrame]:
    """Yield the table of a study's rows in parts, in the order of its samples."""
    seen = journal.columns
    largest = [name for name in _LARGEST if name in seen] or _LARGEST[:1]
    torques = [name for name in seen if name not in ("sample", *_FIRST, *_LARGEST, *_LAST)]
    last = [name for name in _LAST if name in seen or name in _ALWAYS]
    names = [*_FIRST, *largest, *torques, *last]
    for begin in range(0, len(study.samples), PART_ROWS):
        numbers = range(len(study.samples))[begin : begin + PART_ROWS]
        results = map(list, zip(*journal.cells(numbers, names), strict=True))
        yield _part(study, numbers, dict(zip(names, results, strict=True)))


def _part(study: Study, numbers: range, results: dict[str, list[Any]]) -> pd.DataFrame:
    """Return a part of a table."""
    import pandas as pd

    columns: dict[str, Any] = {"sample": pd.Series(numbers, dtype="int64")}
    varied = zip(*[study.samples[number] for number in numbers], strict=True)
    for variable, values in zip(study.variables, varied, strict=True):
        kind = pd.Series(variable.extremes()).dtype
        column = pd.Series(values, dtype=kind)
        columns[variable.column] = column.astype("str") if kind == "object" else column
    for name, values in results.items():
        columns[name] = pd.Series(values, dtype=_type(name))
    return pd.DataFrame(columns)


def _type(name: str) -> str:
    if name == "found":
        return "bool"
    if name in _COUNTS:
        return "Int64"
    return "str" if name in _TEXT else "float64"


def write_results(study: Study, journal: Journal, output: Path) -> None:
    """Write the table of all rows, part by part, beside its final name; then move it there.

    Args:
        study: The study, whose samples all have a row.
        journal: The rows.
        output: The table's file.

    Raises:
        StudyError: If it cannot be written.
    """
    write = _write_csv if format_of(output) == "csv" else _write_parquet
    try:
        with draft_of(output) as draft:
            write(_made_parts(study, journal), study_metadata(study), draft)
            with draft.open("rb") as written:
                os.fsync(written.fileno())
    except OSError as error:
        raise StudyError(
            f"{output}: cannot be written ({error.strerror}); the rows stay in the journal"
        ) from error


def _write_csv(parts: Iterator[pd.DataFrame], about: dict[str, Any], file: Path) -> None:
    with file.open("w", encoding="utf-8", newline="") as lines:
        for k, part in enumerate(parts):
            if not k:
                types = {name: str(kind) for name, kind in part.dtypes.items()}
                lines.write(f"{CSV_MARK}{json.dumps(about | {'columns': types})}\n")
            part.to_csv(lines, index=False, header=not k, lineterminator="\n")


def _write_parquet(parts: Iterator[pd.DataFrame], about: dict[str, Any], file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    said = {KEY: json.dumps(about), _ATTRS: json.dumps({KEY: about})}
    with ExitStack() as stack:
        writer = None
        for part in parts:
            content = pa.Table.from_pandas(part, preserve_index=False)
            content = content.replace_schema_metadata({**(content.schema.metadata or {}), **said})
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(file, content.schema))
            writer.write_table(content)
