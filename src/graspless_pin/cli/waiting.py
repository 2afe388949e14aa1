"""Say on a terminal what takes more than a second, while it does."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

from graspless_pin.scene import Scene, load_scene

_PATIENCE = 1.0  # s; what is done by then needs no word
_OFTEN = 0.2  # s


@contextmanager
def waiting_for(what: str) -> Iterator[Callable[[str], None]]:
    """Show on standard error, if that is a terminal, what is being done; print nothing inside.

    Args:
        what: In words, such as ``looking for a verdict``.

    Returns:
        Takes how far it is, in words.
    """
    said = [what]

    def say(how_far: str) -> None:
        said[0] = f"{what}: {how_far}"

    if not sys.stderr.isatty():
        yield say
        return
    done = threading.Event()
    thread = threading.Thread(target=_show, args=(said, done), daemon=True)
    thread.start()
    try:
        yield say
    finally:
        done.set()
        thread.join()


def loaded_scene(path: Path) -> Scene:
    """Load a scene, and say so where it takes long: a mesh may have a million triangles."""
    with waiting_for(f"loading {path}"):
        return load_scene(path)


def _show(said: list[str], done: threading.Event) -> None:
    if done.wait(_PATIENCE):
        return
    from rich.console import Console

    with Console(stderr=True).status("") as status:
        while True:
            status.update(f"{said[0]} (Ctrl-C ends it)")
            if done.wait(_OFTEN):
                return
