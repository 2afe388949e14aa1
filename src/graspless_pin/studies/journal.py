"""Rows on disk as they come, so that a study that is killed goes on where it stopped.

The journal stands beside the output: the checksum of one JSON object and the object on each line,
the study first, then the rows in the order in which they came, those that came together and have
the same columns on one line: a list for each column. A last line without its end is what a killed
run leaves, and is dropped. Any other line that does not fit its checksum is damage: the journal is
refused. (SQLite would need checksums of its own, too: it has none for what it stores.) Rows stay on
the disk: of each, the process keeps where its line begins.
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
"""Seconds between two times that the disk is waited for: a power failure costs no more."""
JOURNAL_FORMAT = 4
_ROWS_OF_A_LINE = 64
_LINES_KEPT = 64
"""Lines that are kept while rows are read: what is read of a line in turn is parsed once."""
_CHECKSUM_DIGITS = 8
_NOWHERE = -1
"""Where the line of a sample begins that has none."""

_Columns = dict[str, list[Any]]
"""Rows that have the same columns: each column's cells."""


class Journal:
    """The journal of one study, open and locked for this process alone.

    Attributes:
        path: The file.
        count: How many samples have a row, those of earlier runs included.
    """

    def __init__(
        self, path: Path, identity: dict[str, Any], *, fresh: bool = False, overwrite: bool = False
    ) -> None:
        """Open a journal, or begin one.

        Args:
            path: The file.
            identity: What makes this study this study; the rows of another one are refused.
            fresh: Whether to drop the rows of this study that are there.
            overwrite: Whether to drop what is not of this study.

        Raises:
            StudyError: If the file cannot be written, another process writes it, or it holds the
                rows of another study.
        """
        self.path = path
        self._forget()
        try:
            self._file = path.open("ab+")
        except OSError as error:
            raise StudyError(
                f"{path}: cannot be written ({error.strerror}); choose another output"
            ) from None
        try:
            self._begin(identity, fresh=fresh, overwrite=overwrite)
        except BaseException:
            self._file.close()
            raise

    def _forget(self) -> None:
        """Begin with no rows."""
        self.count = 0
        self._end = 0
        self._places = array("q")
        self._kinds: dict[tuple[str, ...], int] = {}

    def _begin(self, identity: dict[str, Any], *, fresh: bool, overwrite: bool) -> None:
        if not _locked(self._file):
            raise StudyError(
                f"{self.path}: another run writes it now; wait for its end, or choose another "
                "output"
            )
        self._file.seek(0)
        try:
            self._read(identity, fresh=fresh)
        except StudyError:
            if not overwrite:
                raise
            self._forget()
        self._file.truncate(self._end if self.count else 0)
        self._synced = time.monotonic()
        if not self.count:
            first = _packed(identity)
            self._write([first])
            self._end = len(first)
            self.sync()

    def _read(self, identity: dict[str, Any], *, fresh: bool) -> None:
        """Find the rows of this study in a journal; none if it is empty or to be dropped."""
        own = _packed(identity)
        first = self._file.readline()
        if first != own and own.startswith(first):
            return  # it was killed when it began
        found = _identity(first[:-1]) if first.endswith(b"\n") else None
        if found is None:
            raise StudyError(
                f"{self.path}: is no journal of a study, or its first line is damaged; choose "
                "another output, or replace it (--overwrite)"
            )
        differing = [key for key in identity if found.get(key) != identity[key]]
        if "fingerprint" in differing:
            raise StudyError(
                f"{self.path}: holds the rows of another study, or of this one before it or its "
                "scene was changed; choose another output, or replace it (--overwrite)"
            )
        if fresh:
            return
        if differing:
            raise StudyError(
                f"{self.path}: was begun with other versions of the libraries; begin anew "
                "(--fresh), or choose another output"
            )
        self._end = len(first)
        for number, line in enumerate(self._file, start=2):
            if not line.endswith(b"\n"):
                break  # what a killed run leaves
            self._note(self._read_line(number, line[:-1]), len(line))

    def _note(self, columns: _Columns, length: int) -> None:
        """Keep where the line of rows begins, which is the last one."""
        places, samples = self._places, columns["sample"]
        first, last = min(samples), max(samples)
        if last >= len(places):
            places.extend([_NOWHERE] * (last + 1 - len(places)))
        for sample in samples:
            self.count += places[sample] == _NOWHERE
            places[sample] = self._end
        self._end += length
        kind = tuple(columns)
        self._kinds[kind] = min(self._kinds.get(kind, first), first)

    def _read_line(self, number: int, line: bytes) -> _Columns:
        """Return the rows of a line. Memory is taken for all samples before theirs."""
        try:
            columns = _unpacked(line)
            samples = columns["sample"]
            fits = bool(samples) and all(
                type(one) is int and 0 <= one < MOST_SAMPLES for one in samples
            )
            fits = fits and all(len(cells) == len(samples) for cells in columns.values())
        except (ValueError, KeyError, TypeError):
            columns, fits = {}, False
        if not fits:
            raise StudyError(
                f"{self.path}:{number}: is damaged: it does not fit its checksum, or no samples; "
                "delete this line to have its samples computed again, or begin anew (--fresh)"
            )
        return columns

    def __contains__(self, sample: int) -> bool:
        """Return whether a sample has a row."""
        return sample < len(self._places) and self._places[sample] != _NOWHERE

    @property
    def columns(self) -> list[str]:
        """What rows hold, in the order of the samples that have it first."""
        kinds = sorted(self._kinds, key=lambda kind: self._kinds[kind])
        return [*dict.fromkeys(name for kind in kinds for name in kind)]

    def rows(self, samples: Iterable[int]) -> Iterator[Row]:
        """Read the rows of samples that have one, a line at a time.

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
                    columns = _unpacked(self._file.readline()[:-1])
                except ValueError:
                    raise StudyError(f"{self.path}: was changed while it was in use") from None
                rows = [
                    dict(zip(columns, cells, strict=True))
                    for cells in zip(*columns.values(), strict=True)
                ]
                line = lines[place] = {row["sample"]: row for row in rows}
            yield line[sample]

    def append(self, rows: Iterable[Row]) -> None:
        """Write rows."""
        kinds: dict[tuple[str, ...], list[Row]] = {}
        for row in rows:
            kinds.setdefault(tuple(row), []).append(row)
        lines = []
        for kind, alike in kinds.items():
            for begin in range(0, len(alike), _ROWS_OF_A_LINE):
                some = [row.values() for row in alike[begin : begin + _ROWS_OF_A_LINE]]
                cells = map(list, zip(*some, strict=True))
                columns = dict(zip(kind, cells, strict=True))
                lines.append(_packed(columns))
                self._note(columns, len(lines[-1]))
        self._write(lines)
        if time.monotonic() - self._synced > _SYNC_EVERY:
            self.sync()

    def sync(self) -> None:
        """Wait until all rows are on the disk."""
        os.fsync(self._file.fileno())
        self._synced = time.monotonic()

    def close(self, *, remove: bool = False) -> None:
        """Close the file; remove it where the table has all of it."""
        if remove:
            self.path.unlink(missing_ok=True)
        else:
            self.sync()
        self._file.close()

    def _write(self, lines: list[bytes]) -> None:
        self._file.write(b"".join(lines))
        self._file.flush()


def journal_of(output: Path) -> Path:
    """Return the journal of an output."""
    return output.with_name(f"{output.name}.journal")


def discard(path: Path, fingerprint: str) -> None:
    """Remove the journal that a finished run of a study may have left; others stay."""
    try:
        with path.open("rb") as file:
            found = _identity(file.readline().removesuffix(b"\n")) or {}
            if found.get("fingerprint") == fingerprint and _locked(file):
                path.unlink()
    except OSError:
        return


def _packed(item: dict[str, Any]) -> bytes:
    """Return a line with its end."""
    return _line(json.dumps(item).encode()) + b"\n"


def _line(text: bytes) -> bytes:
    return b"%0*x %s" % (_CHECKSUM_DIGITS, zlib.crc32(text), text)


def _unpacked(line: bytes) -> dict[str, Any]:
    """Return the object of a line without its end.

    Raises:
        ValueError: If it does not fit its checksum.
    """
    text = line[_CHECKSUM_DIGITS + 1 :]
    if line != _line(text):
        raise ValueError("it does not fit its checksum")
    return json.loads(text)


def _identity(line: bytes) -> dict[str, Any] | None:
    """Return what a journal's first line says of its study; None if it is none."""
    with suppress(ValueError):
        return _unpacked(line)
    return None


def _locked(file: IO[bytes]) -> bool:
    """Take the lock of a file for this process, if nobody has it."""
    try:
        portalocker.lock(file, portalocker.LockFlags.EXCLUSIVE | portalocker.LockFlags.NON_BLOCKING)
    except portalocker.LockException:
        return False
    return True
