"""Files that are written under a temporary name and moved to their final name in one step."""

from __future__ import annotations

import errno
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """Yield the path of a draft, which gets its final name if the block ends without an error.

    A missing folder is created. Drafts of the same file left by killed processes are removed.

    Args:
        path: The final name. An existing file is replaced.

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
    """Create the folder of a file, and missing folders above it.

    Raises:
        OSError: If it cannot be created.
    """
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
    except FileExistsError:
        code = errno.ENOTDIR
        raise NotADirectoryError(code, os.strerror(code), str(path.parent)) from None


def remove_stale_drafts(path: Path) -> None:
    """Remove the drafts of a file whose processes have ended; errors are ignored."""
    own = re.compile(rf"\.{re.escape(path.name)}\.([1-9][0-9]{{0,9}})\.part")
    with suppress(OSError):
        for other in path.parent.iterdir():
            match = own.fullmatch(other.name)
            if match and not _is_running(int(match[1])):
                other.unlink(missing_ok=True)


def _is_running(process: int) -> bool:
    """Return whether a process with this number runs; True if that is unknown."""
    if os.name != "posix":
        return True
    try:
        os.kill(process, 0)
    except ProcessLookupError:
        return False
    except (OSError, OverflowError):
        return True
    return True
