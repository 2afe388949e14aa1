"""Files that are written beside their final name and moved there in one step."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """Give a file to write; it gets its final name when the block ends without an error.

    Its folder is made where there is none. Drafts of the same file that killed processes have left
    are removed.

    Args:
        path: The final name. What has it is replaced.

    Raises:
        OSError: If the file cannot be moved, or the block raises it.
    """
    make_folder_of(path)
    remove_stale_drafts(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


def make_folder_of(path: Path) -> None:
    """Make the folder that a file is to stand in, and those above it, where there are none.

    Raises:
        OSError: If it cannot be made.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        code = errno.ENOTDIR
        raise NotADirectoryError(code, os.strerror(code), str(path.parent)) from None


def remove_stale_drafts(path: Path) -> None:
    """Remove the drafts of a file whose processes are gone; nothing that goes wrong is told."""
    own = re.compile(rf"\.{re.escape(path.name)}\.([1-9][0-9]{{0,9}})\.part")
    with suppress(OSError):
        for other in path.parent.iterdir():
            match = own.fullmatch(other.name)
            if match and not _is_running(int(match[1])):
                other.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    """Return whether a process of this number runs; True where that cannot be told."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
