"""Progress messages for work that takes more than a second."""

from __future__ import annotations

import sys
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager

_SHOWN_AFTER = 1.0  # s; shorter work is not shown
_SHOWN_EVERY = 0.2  # s
_DOING: list[list[str]] = []  # texts of the work under way: what it is, and its status


@contextmanager
def waiting_for(what: str, *, everywhere: bool = False) -> Iterator[Callable[[str], None]]:
    """Show on standard error, if that is a terminal, the work in the block; print nothing inside.

    Nested work is shown behind the outer one.

    Args:
        what: A text, such as ``looking for a verdict``.
        everywhere: Whether to write a line even if standard error is no terminal.

    Returns:
        A function that sets the status text.
    """
    texts = [what]

    def update(status: str) -> None:
        texts[1:] = [status]

    on_terminal = sys.stderr.isatty()
    if not on_terminal and not everywhere:
        yield update
        return
    shown_already = on_terminal and len(_DOING) > 0
    _DOING.append(texts)
    done = threading.Event()
    thread = threading.Thread(
        target=_show_status if on_terminal else _write_line, args=(what, done), daemon=True
    )
    if not shown_already:
        thread.start()
    try:
        yield update
    finally:
        done.set()
        _DOING[:] = [item for item in _DOING if item is not texts]
        if not shown_already:
            thread.join()


def _show_status(_: str, done: threading.Event) -> None:
    if done.wait(_SHOWN_AFTER):
        return
    from rich.console import Console
    from rich.text import Text

    def status_text() -> Text:
        return Text(f"{': '.join(word for one in _DOING for word in one)} (Ctrl-C ends it)")

    if done.is_set():  # while rich was being imported
        return
    with Console(stderr=True).status(status_text()) as status:
        while not done.wait(_SHOWN_EVERY):
            status.update(status_text())


def _write_line(what: str, done: threading.Event) -> None:
    if not done.wait(_SHOWN_AFTER):
        sys.stderr.write(f"{what}\n")
        sys.stderr.flush()
