"""Results as a tidy table, one row a sample: to and from Parquet and CSV."""

from __future__ import annotations

import json
import os
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from graspless_pin.drafts import draft_of
from graspless_pin.errors import StudyError
from graspless_pin.studies.sample_evaluation import LARGEST_TORQUE, Failure, Row
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
    "verdict",
    "smallest_margin_N",
    "largest_margin_N",
    "disturbance_N",
    "minimum_friction_factor",
    "contacts",
    "nodes",
    "reason",
    "error",
)
_TEXT = ("status", "verdict", "reason", "error")
_ATTRS = "PANDAS_ATTRS"
"""Where ``pandas.read_parquet`` finds ``DataFrame.attrs``."""
_CSV_MARK = f"# {KEY} "


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
        "seed": sampling.seed if sampling.method != "grid" else None,
        "versions": versions(),
        "entry": study.entry.model_dump(mode="json", by_alias=True, exclude_defaults=True),
    }


def results_table(study: Study, rows: Mapping[int, Row]) -> pd.DataFrame:
    """Return the table of a study's rows, in the order of its samples."""
    import pandas as pd

    ordered = [rows[number] for number in range(len(study.samples))]
    columns: dict[str, Any] = {"sample": pd.Series(range(len(ordered)), dtype="int64")}
    for index, variable in enumerate(study.variables):
        values = pd.Series([sample[index] for sample in study.samples])
        columns[variable.column] = values.astype("str") if values.dtype == object else values
    seen = dict.fromkeys(name for row in ordered for name in row if name != "sample")
    largest = [name for name in _LARGEST if name in seen] or _LARGEST[:1]
    torques = [name for name in seen if name not in (*_FIRST, *_LARGEST, *_LAST)]
    last = [name for name in _LAST if name in seen or name in (*_COUNTS, "reason", "error")]
    for name in (*_FIRST, *largest, *torques, *last):
        columns[name] = pd.Series([row.get(name) for row in ordered], dtype=_type(name))
    table = pd.DataFrame(columns)
    table.attrs[KEY] = study_metadata(study)
    return table


def _type(name: str) -> str:
    if name == "found":
        return "bool"
    if name in _COUNTS:
        return "Int64"
    return "str" if name in _TEXT else "float64"


def write_results(table: pd.DataFrame, output: Path) -> None:
    """Write a table beside its final name, then move it there in one step.

    Raises:
        StudyError: If it cannot be written.
    """
    about = table.attrs[KEY]
    try:
        with draft_of(output) as draft:
            if format_of(output) == "csv":
                types = {name: str(kind) for name, kind in table.dtypes.items()}
                head = _CSV_MARK + json.dumps(about | {"columns": types})
                body = table.to_csv(index=False, lineterminator="\n")
                draft.write_text(f"{head}\n{body}", encoding="utf-8")
            else:
                _write_parquet(table, about, draft)
            with draft.open("rb") as written:
                os.fsync(written.fileno())
    except OSError as error:
        raise StudyError(
            f"{output}: cannot be written ({error.strerror}); the rows stay in the journal"
        ) from error


def _write_parquet(table: pd.DataFrame, about: dict[str, Any], file: Path) -> None:
    import pyarrow as pa
    import pyarrow.parquet as pq

    bare = table.copy()
    bare.attrs = {}
    content = pa.Table.from_pandas(bare, preserve_index=False)
    said = {KEY: json.dumps(about), _ATTRS: json.dumps({KEY: about})}
    kept = {**(content.schema.metadata or {}), **said}
    pq.write_table(content.replace_schema_metadata(kept), file)


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
        >>> from graspless_pin.studies import Study, results_summary
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> study = Study.from_data(data, folder=".")
        >>> with TemporaryDirectory() as folder:
        ...     table = run_study(study, f"{folder}/results.csv", workers=1, progress=False)
        ...     again = read_results(f"{folder}/results.csv")
        >>> table["margin_N"].round(3).tolist()
        [1.65, 1.875]
        >>> print(results_summary(again).splitlines()[0])
        2 samples: 2 found, 0 infeasible, 0 failed
    """
    require_tables()
    file = Path(path)
    kind = format_of(file)
    if not file.is_file():
        raise StudyError(f"{file}: there is no such file; check the path")
    try:
        table, about = _read_csv(file) if kind == "csv" else _read_parquet(file)
    except (OSError, ValueError, KeyError) as error:
        raise StudyError(f"{file}: holds no results of a study ({error})") from None
    table.attrs[KEY] = about
    return table


def _read_parquet(file: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    import pyarrow.parquet as pq

    content = pq.read_table(file)
    about = json.loads((content.schema.metadata or {})[KEY.encode()])
    return content.to_pandas(), about


def _read_csv(file: Path) -> tuple[pd.DataFrame, dict[str, Any]]:
    import pandas as pd

    with file.open(encoding="utf-8") as lines:
        head = next(lines, "")
    if not head.startswith(_CSV_MARK):
        raise ValueError("its first line does not tell the study")
    about = json.loads(head.removeprefix(_CSV_MARK))
    types: dict[str, str] = about.pop("columns")
    table = pd.read_csv(file, skiprows=1, dtype="str", keep_default_na=False, na_values=[""])
    for name, kind in types.items():
        if kind == "bool":
            table[name] = table[name] == "True"
        elif kind != "str":
            # Python reads every digit that was written; pandas' own reader may round the last.
            numbers = [None if text != text else float(text) for text in table[name]]
            table[name] = pd.Series(numbers, dtype="float64").astype(kind)
    return table, about


def results_summary(table: pd.DataFrame) -> str:
    """Return how many samples were found, infeasible and failed, and the best and worst margin.

    Examples:
        >>> from tempfile import TemporaryDirectory
        >>> from graspless_pin import read_results, run_study
        >>> from graspless_pin.studies import Study, results_summary
        >>> vary = {"object.mass": {"values": [1.0, 2.0]}}  # kg
        >>> data = {"scene": "examples/paper/cuboid_at_rest.yaml", "vary": vary}
        >>> study = Study.from_data(data, folder=".")
        >>> with TemporaryDirectory() as folder:
        ...     table = run_study(study, f"{folder}/results.csv", workers=1, progress=False)
        ...     again = read_results(f"{folder}/results.csv")
        >>> table["margin_N"].round(3).tolist()
        [1.65, 1.875]
        >>> print(results_summary(again).splitlines()[0])
        2 samples: 2 found, 0 infeasible, 0 failed
    """
    rows: Any = table
    failures = {why: int((rows["status"] == why.value).sum()) for why in Failure}
    found = int(rows["found"].sum())
    many = "samples" if len(table) > 1 else "sample"
    infeasible = len(table) - found - sum(failures.values())
    lines = [f"{len(table)} {many}: {found} found, {infeasible} infeasible"]
    for why, count in failures.items():
        if count or why is Failure.FAILED:
            lines[0] += f", {count} {why.value.replace('_', ' ')}"
    if found:
        margins = rows.loc[rows["found"], "margin_N"]
        names = list(rows.columns[1 : rows.columns.get_loc("status")])
        for word, number in (("largest", margins.idxmax()), ("smallest", margins.idxmin())):
            values = ", ".join(f"{name} {_short(rows.at[number, name])}" for name in names)
            margin = rows.at[number, "margin_N"]
            lines.append(f"{word} margin {margin:.4g} N at sample {number}: {values}")
    if any(failures.values()):
        number = int(rows["status"].isin([why.value for why in Failure]).idxmax())
        lines.append(f"first failure at sample {number}: {rows.at[number, 'error']}")
    return "\n".join(lines)


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)
