"""Results read back: as one table, in parts, or in a few words."""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspless_pin.errors import StudyError
from graspless_pin.studies.rows import FINDINGS
from graspless_pin.studies.sample_evaluation import Failure
from graspless_pin.studies.tables import CSV_MARK, KEY, PART_ROWS, format_of, require_tables

if TYPE_CHECKING:
    import pandas as pd


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
    """Read results back in parts, so that no more than one of them is in memory.

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
    results_about(path)
    file = Path(path)
    names = None if columns is None else [*columns]
    try:
        if format_of(file) == "csv":
            yield from _csv_parts(file, names)
        else:
            yield from _parquet_parts(file, names)
    except (OSError, ValueError, KeyError) as error:
        raise _no_results(file, error) from None


def results_about(path: str | Path) -> dict[str, Any]:
    """Return what results say of their study: its entry, its hash, seed and versions.

    Args:
        path: A Parquet or CSV file that `run_study` has written.

    Raises:
        StudyError: See `read_results`.
    """
    require_tables()
    file = Path(path)
    kind = format_of(file)
    if not file.is_file():
        raise StudyError(f"{file}: there is no such file; check the path")
    try:
        about = _csv_about(file) if kind == "csv" else _parquet_about(file)
        return {name: item for name, item in about.items() if name != "columns"}
    except (OSError, ValueError, KeyError) as error:
        raise _no_results(file, error) from None


def _no_results(file: Path, error: Exception) -> StudyError:
    return StudyError(f"{file}: holds no results of a study ({error})")


def _parquet_about(file: Path) -> dict[str, Any]:
    import pyarrow.parquet as pq

    return json.loads((pq.read_schema(file).metadata or {})[KEY.encode()])


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
        raise ValueError("its first line does not tell the study")
    return json.loads(head.removeprefix(CSV_MARK))


def _csv_parts(file: Path, names: list[str] | None) -> Iterator[pd.DataFrame]:
    import pandas as pd

    types: dict[str, str] = _csv_about(file)["columns"]
    chosen = names or [*types]
    with pd.read_csv(
        file, skiprows=1, dtype="str", keep_default_na=False, na_values=[""], usecols=chosen,
        chunksize=PART_ROWS,
    ) as parts:  # fmt: skip
        for part in parts:
            table = part.reset_index(drop=True)[chosen]
            for name in chosen:
                kind = types[name]
                if kind == "bool":
                    table[name] = table[name] == "True"
                elif kind != "str":
                    # Python reads every digit that was written; pandas' reader may round the last.
                    numbers = [None if text != text else float(text) for text in table[name]]
                    table[name] = pd.Series(numbers, dtype="float64").astype(kind)
            yield table


def results_summary(table: pd.DataFrame | str | Path) -> str:
    """Return how many samples were found, infeasible and failed, and the best and worst margin.

    Samples with serious findings, such as a hand that touches nothing, are counted apart, and their
    margins do not count.

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
    failures, count, found, serious = dict.fromkeys(Failure, 0), 0, 0, 0
    largest: Any = None
    smallest: Any = None
    failure: Any = None
    finding: Any = None
    part: Any
    for part in parts:
        count += len(part)
        found += int(part["found"].sum())
        for why in Failure:
            failures[why] += int((part["status"] == why.value).sum())
        told = part[FINDINGS].notna() if FINDINGS in part else part["found"] & False
        sound = part["found"] & ~told
        serious += int((part["found"] & ~sound).sum())
        margins = part.loc[sound, "margin_N"]
        if len(margins):
            high, low = part.loc[margins.idxmax()], part.loc[margins.idxmin()]
            largest = high if largest is None or high.margin_N > largest.margin_N else largest
            smallest = low if smallest is None or low.margin_N < smallest.margin_N else smallest
        if finding is None and told.any():
            finding = part.loc[told.idxmax()]
        failed = part["status"].isin([*Failure])
        if failure is None and failed.any():
            failure = part.loc[failed.idxmax()]
    lines = [f"{count} {'samples' if count > 1 else 'sample'}: {found} found"]
    if serious:
        lines[0] += f" ({serious} of them with serious findings)"
    lines[0] += f", {count - found - sum(failures.values())} infeasible"
    for why, times in failures.items():
        if times or why is Failure.FAILED:
            lines[0] += f", {times} {why.value.replace('_', ' ')}"
    for word, row in (("largest", largest), ("smallest", smallest)):
        if row is not None:
            names = row.index[1 : row.index.get_loc("status")]
            values = ", ".join(f"{name} {_short(row[name])}" for name in names)
            lines.append(f"{word} margin {row.margin_N:.4g} N at sample {row['sample']}: {values}")
    if finding is not None:
        lines.append(f"first serious finding at sample {finding['sample']}: {finding[FINDINGS]}")
    if failure is not None:
        lines.append(f"first failure at sample {failure['sample']}: {failure['error']}")
    return "\n".join(lines)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
