"""Tables of results: written from the journal of a run; read whole, in parts or as a summary."""

from __future__ import annotations

import json
import os
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from contextlib import ExitStack
from operator import itemgetter
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspless_pin.atomic_write import draft_of
from graspless_pin.errors import StudyError, optional_import
from graspless_pin.intake.files import FileKind, kind_of_file, read_bytes, refuse_other_kind
from graspless_pin.studies.journal import Journal, journal_of
from graspless_pin.studies.sample_evaluation import (
    FINDINGS,
    LARGEST_TORQUE,
    OBJECTIVE_VALUE,
    ROBUST_COLUMNS,
    Failure,
)
from graspless_pin.studies.study import NOT_PLACED, Study
from graspless_pin.suggestions import names_in_words
from graspless_pin.versions import versions

if TYPE_CHECKING:
    import pandas as pd


KEY = "graspless_pin"
"""Name of the metadata in Parquet files and in ``DataFrame.attrs``."""
_COUNTS = ("contacts", "nodes")
_OF_HANDS = ("place_rank", "places_found", "open_fingers")
_FIRST = ("status", "found", "margin_N")
_LARGEST = tuple(f"{LARGEST_TORQUE}{unit}" for unit in ("Nm", "N"))
_LAST = (
    *_OF_HANDS,
    OBJECTIVE_VALUE,
    "verdict",
    "holding",
    "stiffness_needed",
    "growth_rate",
    "mode",
    "smallest_margin_N",
    "largest_margin_N",
    "disturbance_N",
    "minimum_friction_factor",
    *ROBUST_COLUMNS,
    "contacts",
    "nodes",
    FINDINGS,
    "reason",
    "error",
)
_EXTREMES = {
    "margin_N": ("margin", "N"),
    "max_torque_Nm": ("max |torque|", "N m"),
    "max_torque_N": ("max |force of a prismatic joint|", "N"),
}
"""Columns whose extremes a summary has: their label and unit."""
_ALWAYS = (*_COUNTS, FINDINGS, "reason", "error")
_TYPES = {
    "found": "bool",
    "robust_found": "boolean",
    **dict.fromkeys((*_COUNTS, "place_rank", "places_found"), "Int64"),
    **dict.fromkeys(
        ("status", "verdict", "holding", "mode", "open_fingers", FINDINGS, "reason", "error",
         "robust_status", "robust_coverage"),
        "str",
    ),
}  # fmt: skip
"""Types of columns; all others are float64."""
_FORMATS = {".parquet": "parquet", ".pq": "parquet", ".csv": "csv"}
_TABLE = FileKind("table of results", 64, StudyError)
_ATTRS = "PANDAS_ATTRS"
"""Metadata key from which ``pandas.read_parquet`` restores ``DataFrame.attrs``."""
CSV_MARK = f"# {KEY} "
"""Beginning of the first line of a CSV file."""
PART_ROWS = 2**14
"""Rows in memory at a time; the size of a row group in Parquet."""


def require_tables() -> None:
    """Check that the libraries for tables are installed.

    Raises:
        StudyError: Naming the packages to install.
    """
    with optional_import("studies need pandas and pyarrow", "studies", StudyError):
        import pandas  # noqa: F401
        import pyarrow  # noqa: F401


def format_of(output: Path) -> str:
    """Return ``parquet`` or ``csv`` by a file's ending.

    Raises:
        StudyError: If it is neither.
    """
    if output.suffix.lower() not in _FORMATS:
        raise StudyError(
            f"{output}: {output.suffix or 'no ending'!r} is not a known format; the name must end "
            "with .parquet or .csv"
        )
    return _FORMATS[output.suffix.lower()]


def check_columns(study: Study) -> None:
    """Refuse variables whose column has the name of another column of the results.

    Raises:
        StudyError: Naming the variable.
    """
    taken = {"sample", *_FIRST, *_LARGEST, *_LAST}
    for variable in study.variables:
        if variable.column in taken or variable.column.startswith("torque_"):
            raise study.source.error(
                ("vary", variable.name),
                f"its column {variable.column!r} would have the name of another column of the "
                "results; give the variable another name, and its scene key as 'key'",
            )
        taken.add(variable.column)


def study_metadata(study: Study) -> dict[str, Any]:
    """Return the metadata of a table: the study, its hash, seed and versions."""
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


def _table_parts(study: Study, journal: Journal) -> Iterator[pd.DataFrame]:
    """Yield the table of a study in parts of `PART_ROWS` rows, in the order of its samples."""
    columns = journal.columns
    largest = [name for name in _LARGEST if name in columns] or _LARGEST[:1]
    torques = [name for name in columns if name not in ("sample", *_FIRST, *_LARGEST, *_LAST)]
    last = [name for name in _LAST if name in columns or name in _ALWAYS]
    names = [*_FIRST, *largest, *torques, *last]
    for begin in range(0, len(study.samples), PART_ROWS):
        numbers = range(len(study.samples))[begin : begin + PART_ROWS]
        rows = [*journal.rows(numbers)]
        yield _table_part(study, numbers, {name: [row.get(name) for row in rows] for name in names})


def _table_part(study: Study, numbers: range, results: dict[str, list[Any]]) -> pd.DataFrame:
    """Return the part of a table with the given samples and result columns."""
    import pandas as pd

    columns: dict[str, Any] = {"sample": pd.Series(numbers, dtype="int64")}
    values_by_variable = zip(*[study.samples[number] for number in numbers], strict=True)
    for variable, values in zip(study.variables, values_by_variable, strict=True):
        kind = pd.Series(variable.extremes()).dtype
        column = pd.Series(values, dtype=kind)
        columns[variable.column] = column.astype("str") if kind == "object" else column
    for name, values in results.items():
        columns[name] = pd.Series(values, dtype=_TYPES.get(name, "float64"))
    return pd.DataFrame(columns)


def write_results(study: Study, journal: Journal, output: Path) -> None:
    """Write the table of all rows, part by part, to a draft that then gets the final name.

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
            write(_table_parts(study, journal), study_metadata(study), draft)
            with draft.open("rb") as written:
                os.fsync(written.fileno())
    except OSError as error:
        raise StudyError(
            f"{output}: cannot be written ({error.strerror}); the rows are kept in the journal"
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

    added = {KEY: json.dumps(about), _ATTRS: json.dumps({KEY: about})}
    with ExitStack() as stack:
        writer = None
        for part in parts:
            content = pa.Table.from_pandas(part, preserve_index=False)
            content = content.replace_schema_metadata({**(content.schema.metadata or {}), **added})
            if writer is None:
                writer = stack.enter_context(pq.ParquetWriter(file, content.schema))
            writer.write_table(content)


def read_results(path: str | Path) -> pd.DataFrame:
    """Read results back.

    Args:
        path: A Parquet or CSV file that `run_study` has written.

    Returns:
        The table; ``attrs["graspless_pin"]`` holds the study, its hash, seed and versions.

    Raises:
        StudyError: If there is no such file or it holds no results.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin import read_results, run_study
        >>> from graspless_pin.studies import Study
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> with TemporaryDirectory() as folder:
        ...     file = f"{folder}/results.csv"
        ...     _ = run_study(Study.from_data(data), file, workers=1, progress=False)
        ...     table = read_results(file)
        >>> table["margin_N"].round(3).tolist()
        [1.65, 1.875]
    """
    import pandas as pd

    table = pd.concat(results_parts(path), ignore_index=True)
    table.attrs[KEY] = results_about(path)
    return table


def results_parts(path: str | Path, columns: Sequence[str] | None = None) -> Iterator[pd.DataFrame]:
    """Read results back in parts, of which only one is in memory at a time.

    Args:
        path: A Parquet or CSV file that `run_study` has written.
        columns: Which columns; None: all.

    Yields:
        Tables of some ten thousand rows each, in the order of the samples.

    Raises:
        StudyError: See `read_results`.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.studies import Study, compute_study, results_parts
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> with TemporaryDirectory() as folder:
        ...     file = f"{folder}/results.parquet"
        ...     compute_study(Study.from_data(data), file, workers=1, progress=False)
        ...     for part in results_parts(file, ["sample", "margin_N"]):
        ...         print(part["margin_N"].round(3).tolist())
        [1.65, 1.875]
    """
    _, existing = _about_and_columns(path)
    file = Path(path)
    names = None if columns is None else [*columns]
    for name in names or ():
        if name not in existing:
            raise StudyError(f"{file}: has no column {name!r}; {names_in_words(name, existing)}")
    try:
        if format_of(file) == "csv":
            yield from _csv_parts(file, names)
        else:
            yield from _parquet_parts(file, names)
    except (OSError, ValueError, KeyError) as error:
        raise _no_results_error(file, error) from None


def results_about(path: str | Path) -> dict[str, Any]:
    """Return the metadata of results: the study's entry, its hash, seed and versions.

    Args:
        path: A Parquet or CSV file that `run_study` has written.

    Raises:
        StudyError: See `read_results`.
    """
    return _about_and_columns(path)[0]


def _about_and_columns(path: str | Path) -> tuple[dict[str, Any], list[str]]:
    """Return the metadata of results, and the names of their columns."""
    require_tables()
    import pyarrow.parquet as pq

    file = Path(path)
    if file.suffix.lower() not in _FORMATS:
        refuse_other_kind(file, _TABLE, kind_of_file(file, read_bytes(file, _TABLE)))
    kind = format_of(file)
    if not file.is_file():
        is_begun = journal_of(file).is_file()
        raise StudyError(
            f"{file}: there is no such file; "
            + (
                "its study is not complete: run it again to continue"
                if is_begun
                else "check the path"
            )
        )
    try:
        if kind == "csv":
            about = _csv_about(file)
            return about, [*about.pop("columns")]
        schema = pq.read_schema(file)
        return json.loads((schema.metadata or {})[KEY.encode()]), schema.names
    except (OSError, ValueError, KeyError) as error:
        raise _no_results_error(file, error) from None


def _no_results_error(file: Path, error: Exception) -> StudyError:
    return StudyError(f"{file}: does not hold results of a study ({error})")


def _parquet_parts(file: Path, names: list[str] | None) -> Iterator[pd.DataFrame]:
    import pyarrow.parquet as pq

    with pq.ParquetFile(file) as content:
        for group in range(content.num_row_groups):
            part = content.read_row_group(group, columns=names).to_pandas()
            part.attrs = {}
            yield part


def _csv_about(file: Path) -> dict[str, Any]:
    with file.open(encoding="utf-8") as lines:
        head = next(lines, "")
    if not head.startswith(CSV_MARK):
        raise ValueError("its first line does not state a study")
    return json.loads(head.removeprefix(CSV_MARK))


def _csv_parts(file: Path, names: list[str] | None) -> Iterator[pd.DataFrame]:
    import pandas as pd

    types: dict[str, str] = _csv_about(file)["columns"]
    chosen = names or [*types]
    kinds: Any = {name: types[name] for name in chosen}
    # Since version 3.1 of pandas numbers are read to their last digit.
    with pd.read_csv(
        file, skiprows=1, dtype=kinds, keep_default_na=False, na_values=[""], usecols=chosen,
        chunksize=PART_ROWS,
    ) as parts:  # fmt: skip
        for part in parts:
            yield part.reset_index(drop=True)[chosen]


def results_summary(table: pd.DataFrame | str | Path) -> str:
    """Return counts of samples found, infeasible and failed, and extremes of figures, as text.

    Samples with serious findings, such as a hand that touches nothing, are counted separately, and
    their margins and torques are left out.

    Args:
        table: What `read_results` returns, or a file, which is read part by part.

    Raises:
        StudyError: If it is a file, see `read_results`.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin.studies import Study, results_summary, run_study
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> with TemporaryDirectory() as folder:
        ...     file = f"{folder}/results.csv"
        ...     _ = run_study(Study.from_data(data), file, workers=1, progress=False)
        ...     print(results_summary(file).splitlines()[0])
        2 samples: 2 found, 0 infeasible, 0 failed
    """
    parts: Iterable[Any] = [table]
    if isinstance(table, str | Path):
        parts = results_parts(table)
    statuses, count, found, serious, asked, served = Counter[str](), 0, 0, 0, 0, 0
    shown: dict[str, Any] = {}  # by what the summary shows them for
    part: Any
    for part in parts:
        count += len(part)
        found += int(part["found"].sum())
        statuses.update(part["status"])
        if "robust_found" in part:
            asked += int(part["robust_found"].notna().sum())
            served += int(part["robust_found"].sum())
        has_findings = part[FINDINGS].notna() if FINDINGS in part else part["found"] & False
        is_sound = part["found"] & ~has_findings
        serious += int((part["found"] & ~is_sound).sum())
        for column in [key for key in _EXTREMES if key in part]:
            values = part.loc[is_sound, column].dropna()
            if len(values):
                for word, choose, row in (
                    ("largest", max, part.loc[values.idxmax()]),
                    ("smallest", min, part.loc[values.idxmin()]),
                ):
                    # Of equal rows the one of the first part stays.
                    previous = shown.get(f"{word} {column}", row)
                    shown[f"{word} {column}"] = choose(previous, row, key=itemgetter(column))
        for label, selected in (
            ("finding", has_findings),
            ("failure", part["status"].isin([*Failure])),
        ):
            if selected.any() and label not in shown:
                shown[label] = part.loc[selected.idxmax()]
    unplaced, failures = statuses[NOT_PLACED], {kind: statuses[kind.value] for kind in Failure}
    lines = [f"{count} {'samples' if count > 1 else 'sample'}: {found} found"]
    if serious:
        lines[0] += f" ({serious} of them with serious findings)"
    lines[0] += f", {count - found - unplaced - sum(failures.values())} infeasible"
    lines[0] += f", {unplaced} not placed" if unplaced else ""
    for kind, number in failures.items():
        if number or kind is Failure.FAILED:
            lines[0] += f", {number} {kind.value.replace('_', ' ')}"
    if asked:
        lines.append(f"torques that serve the whole uncertainty: {served} of {asked} found")
    for column, (label, unit) in _EXTREMES.items():
        extremes = {word: shown.get(f"{word} {column}") for word in ("largest", "smallest")}
        figures = {f"{row[column]:.4g}" for row in extremes.values() if row is not None}
        if len(figures) == 1 and found - serious > 1:
            without = " without serious findings" if serious else ""
            lines.append(f"{label} {figures.pop()} {unit} at all samples found{without}")
            continue
        for word, row in extremes.items():
            if row is not None:
                names = row.index[1 : row.index.get_loc("status")]
                values = ", ".join(f"{name} {_short_text(row[name])}" for name in names)
                figure = f"{word} {label} {row[column]:.4g} {unit}"
                lines.append(f"{figure} at sample {row['sample']}: {values}")
    if (finding := shown.get("finding")) is not None:
        lines.append(f"first serious finding at sample {finding['sample']}: {finding[FINDINGS]}")
    if (failure := shown.get("failure")) is not None:
        lines.append(f"first failure at sample {failure['sample']}: {failure['error']}")
    return "\n".join(lines)


def _short_text(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
