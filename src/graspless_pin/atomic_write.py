"""Files that are written beside their final name and moved there in one step."""

from __future__ import annotations

import os
import re
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path


@contextmanager
def draft_of(path: Path) -> Iterator[Path]:
    """Give a file to write; it gets its final name when the block ends without an error.

    Drafts of the same file that killed processes have left are removed.

    Args:
        path: The final name. What has it is replaced.

    Raises:
        OSError: If the file cannot be moved, or the block raises it.
    """
    remove_stale_drafts(path)
    draft = path.with_name(f".{path.name}.{os.getpid()}.part")
    try:
        yield draft
        draft.replace(path)
    finally:
        draft.unlink(missing_ok=True)


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
