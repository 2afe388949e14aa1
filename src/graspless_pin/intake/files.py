"""Read a file within bounds: a regular file of at most so many bytes, or a clear refusal."""

from __future__ import annotations

import os
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from itertools import islice
from pathlib import Path

from graspless_pin.errors import GrasplessPinError, TextError
from graspless_pin.intake.recognition import encoding_in_words, kind_of_file, other_kind
from graspless_pin.suggestions import nearest_name

_MIB = 1 << 20
_MOST_NAMES = 1000
_TEXTS = (".yaml", ".yml", ".urdf", ".json")
_SPECIAL = (
    (stat.S_ISDIR, "directory"),
    (stat.S_ISFIFO, "pipe"),
    (stat.S_ISSOCK, "socket"),
    (stat.S_ISCHR, "device"),
    (stat.S_ISBLK, "device"),
)


@dataclass(frozen=True)
class FileKind:
    """A kind of file: what messages call it, how large it may be, what its errors are.

    Attributes:
        name: For messages, such as ``scene``.
        mebibytes: The largest size that is read.
        error: Makes the error of a message.
    """

    name: str
    mebibytes: int
    error: Callable[[str], GrasplessPinError]


def read_bytes(path: Path, kind: FileKind) -> bytes:
    """Return the content of a regular file.

    Never waits for a pipe and never reads more than the kind's size, whatever the file says of
    itself.

    Args:
        path: The file; a symbolic link is followed.
        kind: What it is.

    Raises:
        GrasplessPinError: The kind's error, if the file is missing, unreadable, too large or no
            regular file.
    """
    most = kind.mebibytes * _MIB
    try:
        _check_regular(path, path.stat().st_mode, kind)
        # A pipe may have taken the file's place by now; without O_NONBLOCK it would be waited for.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(handle, "rb") as file:
            _check_regular(path, os.fstat(handle).st_mode, kind)
            content = file.read(most + 1)
    except GrasplessPinError:
        raise
    except FileNotFoundError:
        stems = {Path(name).stem: name for name in _names_in(path.parent)}
        near = nearest_name(path.stem, stems, alike=0.75)
        advice = (
            "check the path" if near is None else f"did you mean '{path.parent / stems[near]}'?"
        )
        raise kind.error(f"{path}: there is no such file; {advice}") from None
    except OSError as error:
        raise kind.error(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise kind.error(f"{str(path)!r}: is no path of a file") from None
    if len(content) > most:
        raise _too_large(path, kind)
    return content


def check_file(path: Path, kind: FileKind) -> None:
    """Check a file that another library will open by its path.

    Raises:
        GrasplessPinError: See `read_bytes`.
    """
    try:
        state = path.stat()
    except (OSError, ValueError):
        read_bytes(path, kind)  # says why
        return
    _check_regular(path, state.st_mode, kind)
    if state.st_size > kind.mebibytes * _MIB:
        raise _too_large(path, kind)


def read_text(path: Path, kind: FileKind) -> str:
    """Return the content of a regular file of UTF-8 text; a byte-order mark is left out.

    Raises:
        GrasplessPinError: See `read_bytes`; or the file is not UTF-8, or of another kind.
    """
    content = read_bytes(path, kind)
    refuse_other_kind(path, kind, kind_of_file(path, content))
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind.error(
            f"{path}: is not UTF-8 text ({error.reason} at byte {error.start}); a {kind.name} is "
            f"a text file, and {encoding_in_words(content, error.start)}"
        ) from None


def refuse_other_kind(path: Path, kind: FileKind, found: str | None) -> None:
    """Refuse a file that is something else, and say what to call.

    Args:
        path: The file.
        kind: What it should be.
        found: What it is, as far as is known: see `kind_of_file` and `kind_of_data`.

    Raises:
        GrasplessPinError: The kind's error.
    """
    if message := other_kind(path, kind.name, found):
        raise kind.error(message)


@contextmanager
def errors_of_text(path: Path, kind: FileKind) -> Iterator[None]:
    """Have what is wrong with the text of a file name the file and the line.

    Raises:
        GrasplessPinError: The kind's error, for a `TextError`.
    """
    try:
        yield
    except TextError as error:
        line = f":{error.line}" if error.line else ""
        raise kind.error(f"{path}{line}: {error}") from None


def _too_large(path: Path, kind: FileKind) -> GrasplessPinError:
    return kind.error(
        f"{path}: has more than {kind.mebibytes} MiB, the most that a {kind.name} may have"
    )


def is_file(path: Path) -> bool:
    """Return whether there is a regular file; a path that no file can have is none."""
    try:
        return path.is_file()
    except (OSError, ValueError):
        return False


def _check_regular(path: Path, mode: int, kind: FileKind) -> None:
    if stat.S_ISREG(mode):
        return
    what = next((word for test, word in _SPECIAL if test(mode)), "special file")
    inside = _files_in(path) if stat.S_ISDIR(mode) else ""
    raise kind.error(f"{path}: is a {what}; a {kind.name} is a regular file{inside}")


def _files_in(folder: Path) -> str:
    """Return some files of a folder that may have been meant."""
    names = sorted(name for name in _names_in(folder) if name.endswith(_TEXTS))[:4]
    return f", such as {', '.join(names)} in it" if names else ""


def _names_in(folder: Path) -> list[str]:
    """Return some names in a folder; none where it cannot be read."""
    with suppress(OSError):
        return [item.name for item in islice(os.scandir(folder), _MOST_NAMES)]
    return []
