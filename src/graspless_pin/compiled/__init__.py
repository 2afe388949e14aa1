"""Loops in C for many states, bounds of outcomes and small programs.

They are compiled when the package is installed, if there is a C compiler. Where they are not,
states are solved one after the other, numpy bounds outcomes and HiGHS solves the programs, with
the same results to rounding.
"""

from __future__ import annotations

try:
    from graspless_pin.compiled import core
except ImportError:  # installed without a C compiler
    core = None

__all__ = ["core"]
