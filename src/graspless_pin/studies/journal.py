"""The journal of a study: rows on disk as they come, so that a killed study can be resumed.

The journal is a file beside the output. Each line has a checksum and a JSON object: first the
identity of the study, then the rows in the order of arrival. Rows that arrive together with the
same columns are one line, with a list for each column. An incomplete last line is left by a killed
run and dropped. Any other line with a wrong checksum is damage, and the journal is refused. (SQLite
would need checksums, too: it has none for its data.) Rows stay on disk: in memory is, for each
sample, where its line begins.
"""

from __future__ import annotations

import json
import os
import time
import zlib
from array import array
from collections.abc import Iterable, Iterator
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import portalocker

from graspless_pin.bounds import MOST_SAMPLES
from graspless_pin.caching import Bounded
from graspless_pin.errors import StudyError
from graspless_pin.studies.study import Row

_SYNC_EVERY = 2.0
"""Seconds between two fsync calls: the most that a power failure loses."""
JOURNAL_FORMAT = 4
_ROWS_OF_A_LINE = 64
_LINES_KEPT = 64
"""Parsed lines that are cached while rows are read."""
_CHECKSUM_DIGITS = 8
_NOWHERE = -1
"""Offset that stands for a sample without a row."""

_Columns = dict[str, list[Any]]
"""Cells by column, of rows with the same columns."""


class Journal:
    """The journal of one study, open and locked by this process.

    Attributes:
        path: The file.
        count: Number of samples with a row, from earlier runs, too.
    """

    def __init__(
        self, path: Path, identity: dict[str, Any], *, fresh: bool = False, overwrite: bool = False
    ) -> None:
        """Open the journal, or create it.

        Args:
            path: The file.
            identity: What identifies the study; rows of another study are refused.
            fresh: Whether to drop existing rows of this study.
            overwrite: Whether to drop content that is not of this study.

        Raises:
            StudyError: If the file cannot be written, another process has locked it, or it holds
                the rows of another study.
        """
        self.path = path
        self._clear_index()
        try:
            self._file = path.open("ab+")
        except OSError as error:
            raise StudyError(
                f"{path}: cannot be written ({error.strerror}); choose another output"
            ) from None
        try:
            self._open_rows(identity, fresh=fresh, overwrite=overwrite)
        except BaseException:
            self._file.close()
            raise

    def _clear_index(self) -> None:
        """Reset to no rows."""
        self.count = 0
        self._end = 0
        self._places = array("q")
        self._kinds: dict[tuple[str, ...], int] = {}

    def _open_rows(self, identity: dict[str, Any], *, fresh: bool, overwrite: bool) -> None:
        if not _try_lock(self._file):
            raise StudyError(
                f"{self.path}: another run is writing this file; wait until it ends, or choose "
                "another output"
            )
        self._file.seek(0)
        try:
            self._read_index(identity, fresh=fresh)
        except StudyError:
            if not overwrite:
                raise
            self._clear_index()
        self._file.truncate(self._end if self.count else 0)
        self._synced = time.monotonic()
        if not self.count:
            first_line = _encode_line(identity)
            self._write([first_line])
            self._end = len(first_line)
            self.sync()

    def _read_index(self, identity: dict[str, Any], *, fresh: bool) -> None:
        """Index the rows of this study in the file; none if it is empty, or with ``fresh``."""
        own_line = _encode_line(identity)
        first_line = self._file.readline()
        if first_line != own_line and own_line.startswith(first_line):
            return  # the run was killed while it wrote this line
        stored = _study_identity(first_line[:-1]) if first_line.endswith(b"\n") else None
        if stored is None:
            raise StudyError(
                f"{self.path}: is not the journal of a study, or its first line is damaged; choose "
                "another output, or replace it (--overwrite)"
            )
        differing = [key for key in identity if stored.get(key) != identity[key]]
        if "fingerprint" in differing:
            raise StudyError(
                f"{self.path}: holds the rows of another study, or of this study before it or its "
                "scene was changed; choose another output, or replace it (--overwrite)"
            )
        if fresh:
            return
        if differing:
            raise StudyError(
                f"{self.path}: was begun with other versions of the libraries; start again "
                "(--fresh), or choose another output"
            )
        self._end = len(first_line)
        for number, line in enumerate(self._file, start=2):
            if not line.endswith(b"\n"):
                break  # incomplete: the run was killed
            self._index_line(self._read_line(number, line[:-1]), len(line))

    def _index_line(self, columns: _Columns, length: int) -> None:
        """Store for the samples of the next line where it begins, and advance by its length."""
        places, samples = self._places, columns["sample"]
        first, last = min(samples), max(samples)
        if last >= len(places):
            places.extend([_NOWHERE] * (last + 1 - len(places)))
        for sample in samples:
            self.count += places[sample] == _NOWHERE
            places[sample] = self._end
        self._end += length
        names = tuple(columns)
        self._kinds[names] = min(self._kinds.get(names, first), first)

    def _read_line(self, number: int, line: bytes) -> _Columns:
        """Return the columns of a line; check samples, up to which the index takes memory."""
        try:
            columns = _decode_line(line)
            samples = columns["sample"]
            fits = bool(samples) and all(
                type(sample) is int and 0 <= sample < MOST_SAMPLES for sample in samples
            )
            fits = fits and all(len(cells) == len(samples) for cells in columns.values())
        except (ValueError, KeyError, TypeError):
            columns, fits = {}, False
        if not fits:
            raise StudyError(
                f"{self.path}:{number}: the line is damaged: its checksum or its samples are "
                "wrong; delete it to have its samples computed again, or start again (--fresh)"
            )
        return columns

    def __contains__(self, sample: int) -> bool:
        """Return whether a sample has a row."""
        return sample < len(self._places) and self._places[sample] != _NOWHERE

    @property
    def columns(self) -> list[str]:
        """Names of all columns, in the order of the first samples that have them."""
        kinds = sorted(self._kinds, key=lambda kind: self._kinds[kind])
        return [*dict.fromkeys(name for kind in kinds for name in kind)]

    def rows(self, samples: Iterable[int]) -> Iterator[Row]:
        """Yield the rows of samples, which all have one.

        Raises:
            StudyError: If the file has changed since it was opened.
        """
        lines: dict[int, dict[int, Row]] = Bounded(_LINES_KEPT)
        for sample in samples:
            place = self._places[sample]
            line = lines.get(place)
            if line is None:
                self._file.seek(place)
                try:
                    columns = _decode_line(self._file.readline()[:-1])
                except ValueError:
                    raise StudyError(f"{self.path}: was changed while it was in use") from None
                rows = [
                    dict(zip(columns, cells, strict=True))
                    for cells in zip(*columns.values(), strict=True)
                ]
                line = lines[place] = {row["sample"]: row for row in rows}
            yield line[sample]

    def append(self, rows: Iterable[Row]) -> None:
        """Append rows, and fsync if the last time is long ago."""
        by_columns: dict[tuple[str, ...], list[Row]] = {}
        for row in rows:
            by_columns.setdefault(tuple(row), []).append(row)
        lines = []
        for names, same_columns in by_columns.items():
            for start in range(0, len(same_columns), _ROWS_OF_A_LINE):
                batch = [row.values() for row in same_columns[start : start + _ROWS_OF_A_LINE]]
                cells = map(list, zip(*batch, strict=True))
                columns = dict(zip(names, cells, strict=True))
                lines.append(_encode_line(columns))
                self._index_line(columns, len(lines[-1]))
        self._write(lines)
        if time.monotonic() - self._synced > _SYNC_EVERY:
            self.sync()

    def sync(self) -> None:
        """Wait until all rows are on the disk (fsync)."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def close(self, *, remove: bool = False) -> None:
        """Close the file; with ``remove`` delete it, once the table has all rows."""
        if remove:
            self.path.unlink(missing_ok=True)
        else:
            self.sync()
        self._file.close()

    def _write(self, lines: list[bytes]) -> None:
        self._file.write(b"".join(lines))
        self._file.flush()


def journal_of(output: Path) -> Path:
    """Return the path of the journal of an output."""
    return output.with_name(f"{output.name}.journal")


def discard(path: Path, fingerprint: str) -> None:
    """Delete a leftover journal of a finished study; journals of other studies stay."""
    try:
        with path.open("rb") as file:
            identity = _study_identity(file.readline().removesuffix(b"\n")) or {}
            if identity.get("fingerprint") == fingerprint and _try_lock(file):
                path.unlink()
    except OSError:
        return


def _encode_line(item: dict[str, Any]) -> bytes:
    """Return the line of an object, with checksum and line end."""
    return _with_checksum(json.dumps(item).encode()) + b"\n"


def _with_checksum(text: bytes) -> bytes:
    return b"%0*x %s" % (_CHECKSUM_DIGITS, zlib.crc32(text), text)


def _decode_line(line: bytes) -> dict[str, Any]:
    """Return the object of a line, which is given without its end.

    Raises:
        ValueError: If the checksum is wrong.
    """
    text = line[_CHECKSUM_DIGITS + 1 :]
    if line != _with_checksum(text):
        raise ValueError("it does not fit its checksum")
    return json.loads(text)


def _study_identity(line: bytes) -> dict[str, Any] | None:
    """Return the identity in a journal's first line; None if it is no such line."""
    with suppress(ValueError):
        return _decode_line(line)
    return None


def _try_lock(file: IO[bytes]) -> bool:
    """Lock a file for this process; return False if another process has locked it."""
    try:
        portalocker.lock(file, portalocker.LockFlags.EXCLUSIVE | portalocker.LockFlags.NON_BLOCKING)
    except portalocker.LockException:
        return False
    return True
