"""Work that processes share: what all parts of it need is sent to each process once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from typing import Any, TypeVar
from uuid import uuid4

from graspless_pin.caching import Derived
from graspless_pin.child_process import ChildProcesses

_Part = TypeVar("_Part")
_Found = TypeVar("_Found")
_MOST_SHARED = 4
"""Things that a process keeps for the parts of work to come."""


def shared_work(
    compute: Callable[[Any, _Part], _Found],
    shared: object,
    parts: Sequence[_Part],
    workers: int,
    processes: ChildProcesses,
) -> Iterator[_Found]:
    """Yield what is found of parts of some work, in their order.

    Parts that were not begun when the caller stops are left out; those that were are waited for.

    Args:
        compute: Finds it, from what is shared and a part; a function that a module has under its
            name. It never returns None.
        shared: What all parts need; a process keeps it, with what it has learned, for the next.
        parts: The parts.
        workers: How many processes work at a time.
        processes: Where to take them from.

    Raises:
        CrashError: If a process dies.
        Exception: What the function raises.
    """
    token = _token_of(shared)

    def found(part: _Part) -> _Found:
        child = processes.taken(_found_there)
        try:
            there = child.call(_found_there, compute, token, None, part)
            if there is None:
                there = child.call(_found_there, compute, token, shared, part)
            return there
        finally:
            processes.give_back(child)

    with ThreadPoolExecutor(workers, thread_name_prefix="graspless-work") as threads:
        try:
            yield from threads.map(found, parts)
        finally:
            threads.shutdown(wait=True, cancel_futures=True)


_token_of: Derived[Any, str] = Derived(lambda _: uuid4().hex, most=math.inf)
"""What tells something from all else, in any process."""
_SHARED: dict[str, Any] = {}
"""What this process was sent, by token."""


def _found_there(
    compute: Callable[[Any, Any], Any], token: str, shared: object | None, part: Any
) -> Any:
    """Return what is found of a part in another process; None: what is shared is not there yet."""
    if shared is not None:
        if len(_SHARED) >= _MOST_SHARED:
            del _SHARED[next(iter(_SHARED))]
        _SHARED[token] = shared
    return compute(_SHARED[token], part) if token in _SHARED else None
