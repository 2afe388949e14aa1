"""Say what takes more than a second, while it does."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SHOWN_AFTER = 1.0  # s; what is done by then needs no word
_SHOWN_EVERY = 0.2  # s
_DOING: list[list[str]] = []  # in words: what, and how far it is


@contextmanager
def waiting_for(what: str, *, everywhere: bool = False) -> Iterator[Callable[[str], None]]:
    """Show on standard error, if that is a terminal, what is being done; print nothing inside.

    What is done inside of something else is shown behind it.

    Args:
        what: In words, such as ``looking for a verdict``.
        everywhere: Whether to write a line, too, where standard error is no terminal.

    Returns:
        Takes how far it is, in words.
    """
    own = [what]

    def update(status: str) -> None:
        own[1:] = [status]

    on_terminal = sys.stderr.isatty()
    if not on_terminal and not everywhere:
        yield update
        return
    shown_already = on_terminal and len(_DOING) > 0
    _DOING.append(own)
    done = threading.Event()
    thread = threading.Thread(
        target=_show if on_terminal else _write, args=(what, done), daemon=True
    )
    if not shown_already:
        thread.start()
    try:
        yield update
    finally:
        done.set()
        _DOING[:] = [one for one in _DOING if one is not own]
        if not shown_already:
            thread.join()


def _show(_: str, done: threading.Event) -> None:
    if done.wait(_SHOWN_AFTER):
        return
    from rich.console import Console
    from rich.text import Text

    def words() -> Text:
        return Text(f"{': '.join(word for one in _DOING for word in one)} (Ctrl-C ends it)")

    if done.is_set():  # while rich was being imported
        return
    with Console(stderr=True).status(words()) as status:
        while not done.wait(_SHOWN_EVERY):
            status.update(words())


def _write(what: str, done: threading.Event) -> None:
    if not done.wait(_SHOWN_AFTER):
        sys.stderr.write(f"{what}\n")
        sys.stderr.flush()
