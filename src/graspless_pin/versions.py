"""The versions of what the figures depend on, for studies and reports."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version

from graspless_pin import compiled

# What can change a figure: geometry, numerics and solvers.
_PACKAGES = (
    "graspless-pin", "numpy", "scipy", "pin", "coal", "trimesh", "coacd",
    "qpsolvers", "piqp", "proxsuite", "highspy", "clarabel",
)  # fmt: skip


def has_compiled_loops() -> bool:
    """Return whether compiled loops run; numpy does their work where they do not."""
    return compiled.core is not None


def versions() -> dict[str, str]:
    """Return the version of each package that makes the figures, by name.

    Beside them stands whether the compiled loops do, which round otherwise than numpy.
    """
    return {"compiled loops": "yes" if has_compiled_loops() else "no", **_installed()}


@cache
def _installed() -> dict[str, str]:
    """Return what is installed; finding it takes 10 ms."""
    found = {}
    for name in _PACKAGES:
        try:
            found[name] = version(name)
        except PackageNotFoundError:
            continue
    return found
