"""Versions of the packages that results depend on, for studies and reports."""

from __future__ import annotations

from functools import cache
from importlib.metadata import PackageNotFoundError, version

from graspless_pin import compiled

# Packages that can change results: geometry, numerics and solvers.
_PACKAGES = (
    "graspless-pin", "numpy", "scipy", "pin", "coal", "trimesh", "coacd",
    "qpsolvers", "piqp", "proxsuite", "highspy", "clarabel",
)  # fmt: skip


def has_compiled_loops() -> bool:
    """Return whether the compiled loops are available; otherwise numpy does their work."""
    return compiled.core is not None


def versions() -> dict[str, str]:
    """Return the version of each package that results depend on, by name.

    It also has whether compiled loops are used, whose rounding differs from numpy's.
    """
    return {"compiled loops": "yes" if has_compiled_loops() else "no", **_installed_versions()}


@cache
def _installed_versions() -> dict[str, str]:
    """Return the versions of the installed packages; the lookup takes 10 ms."""
    by_name = {}
    for name in _PACKAGES:
        try:
            by_name[name] = version(name)
        except PackageNotFoundError:
            continue
    return by_name
