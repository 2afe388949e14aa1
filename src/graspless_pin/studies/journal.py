"""Rows on disk as they come, so that a study that is killed goes on where it stopped.

The journal stands beside the output: the checksum of one JSON object and the object on each line,
the study first, then the rows in the order in which they came. A last line without its end is what
a killed run leaves, and is dropped. Any other line that does not fit its checksum is damage: the
journal is refused. (SQLite would need checksums of its own, too: it has none for what it stores.)
"""

from __future__ import annotations

import json
import os
import time
import zlib
from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path
from typing import IO, Any

import portalocker

from graspless_pin.errors import StudyError
from graspless_pin.studies.sample_evaluation import Row

_SYNC_EVERY = 2.0
"""Seconds between two times that the disk is waited for: a power failure costs no more."""
JOURNAL_FORMAT = 2
_WITHOUT_CHECKSUMS = 1
_CHECKSUM_DIGITS = 8


class Journal:
    """The journal of one study, open and locked for this process alone.

    Attributes:
        path: The file.
        rows: Row by sample number, those of earlier runs included.
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
        self.rows: dict[int, Row] = {}
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

    def _begin(self, identity: dict[str, Any], *, fresh: bool, overwrite: bool) -> None:
        if not _locked(self._file):
            raise StudyError(
                f"{self.path}: another run writes it now; wait for its end, or choose another "
                "output"
            )
        self._file.seek(0)
        content = self._file.read()
        kept = content[: content.rfind(b"\n") + 1]
        try:
            rows = self._read(content, identity, fresh=fresh)
        except StudyError:
            if not overwrite:
                raise
            rows = {}
        self.rows = rows
        self._file.truncate(len(kept) if rows else 0)
        self._synced = time.monotonic()
        if not rows:
            self._append([identity])
            self.sync()

    def _read(self, content: bytes, identity: dict[str, Any], *, fresh: bool) -> dict[int, Row]:
        """Return the rows of this study in a journal; none if it is empty or to be dropped."""
        if _packed(identity).startswith(content):
            return {}  # it was killed when it began
        first, *lines = content[: content.rfind(b"\n") + 1].split(b"\n")[:-1] or [b""]
        found = _identity(first)
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
            return {}
        if differing:
            raise StudyError(
                f"{self.path}: was begun with other versions of the libraries; begin anew "
                "(--fresh), or choose another output"
            )
        rows = [self._row(number, line) for number, line in enumerate(lines, start=2)]
        return dict(rows)

    def _row(self, number: int, line: bytes) -> tuple[int, Row]:
        """Return the number of a sample and its row."""
        try:
            row = _unpacked(line)
            return int(row["sample"]), row
        except (ValueError, KeyError, TypeError):
            raise StudyError(
                f"{self.path}:{number}: is damaged: it does not fit its checksum; delete this "
                "line to have its sample computed again, or begin anew (--fresh)"
            ) from None

    def append(self, rows: Iterable[Row]) -> None:
        """Write rows."""
        new = list(rows)
        self.rows.update((int(row["sample"]), row) for row in new)
        self._append(new)
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

    def _append(self, items: list[dict[str, Any]]) -> None:
        self._file.write(b"".join(map(_packed, items)))
        self._file.flush()


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
    """Return what a journal's first line says of its study; None if it is none.

    Version 0.1 wrote no checksums. Its journals are known by that, so that they are refused for
    their versions and not as another program's file.
    """
    with suppress(ValueError):
        return _unpacked(line)
    with suppress(ValueError):
        found: Any = json.loads(line)
        if isinstance(found, dict) and found.get("format") == _WITHOUT_CHECKSUMS:
            return found
    return None


def _locked(file: IO[bytes]) -> bool:
    """Take the lock of a file for this process, if nobody has it."""
    try:
        portalocker.lock(file, portalocker.LockFlags.EXCLUSIVE | portalocker.LockFlags.NON_BLOCKING)
    except portalocker.LockException:
        return False
    return True
