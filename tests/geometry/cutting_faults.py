"""What CoACD may do instead of cutting a mesh; the process that it is done in loads little else."""

from __future__ import annotations

import ctypes
import re
import time
from typing import Any


def no_pieces(*_: Any) -> list[Any]:
    return []


def never(*_: Any) -> list[Any]:
    """A native call that lets no other thread of its process run, for years."""
    re.match(r"(a+)+$", 60 * "a" + "b")
    return []


def crashes(*_: Any) -> list[Any]:
    ctypes.string_at(0)
    return []


def slow(vertices: Any, *_: Any) -> list[Any]:
    time.sleep(0.3)
    return [vertices]
