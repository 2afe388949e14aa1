"""Calls of CoACD and xacrodoc, in a module of their own: child processes load nothing else."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ITERATIONS = 60
"""Iterations of CoACD's search for each cut: more take longer and save few pieces."""
SEED = 0


def run_coacd(vertices: Any, faces: Any, concavity: float, most: int) -> list[Any]:
    """Return the vertices (V, 3) of the pieces that CoACD cuts a mesh into.

    Args:
        vertices: (V, 3) vertices.
        faces: (F, 3) indices of vertices.
        concavity: Largest depth of a hollow that a piece may fill, as a share of half the largest
            extent.
        most: Largest number of pieces; -1: no limit.
    """
    import coacd  # a large library
    import numpy as np

    coacd.set_log_level("error")
    solid = coacd.Mesh(np.asarray(vertices), np.asarray(faces, dtype=np.int32))
    cut = coacd.run_coacd(
        solid, threshold=concavity, max_convex_hull=most, mcts_iterations=ITERATIONS, seed=SEED
    )
    return [np.array(corners, dtype=np.float64) for corners, _ in cut]


def run_xacro(
    path: str, packages: Mapping[str, str], arguments: Mapping[str, str]
) -> tuple[str, list[Path]]:
    """Expand a xacro file: return the URDF and the included files; change the current folder.

    Args:
        path: The file.
        packages: Folders by package name, for ``$(find NAME)``.
        arguments: Values of its ``<xacro:arg>``.

    Raises:
        ValueError: xacro cannot expand it.
    """
    import xacro
    from xacrodoc import XacroDoc
    from xacrodoc import packages as finder

    os.chdir(Path(path).parent)  # xacrodoc resolves included paths there
    finder.update_package_cache(dict(packages))
    xacro.all_includes.clear()
    try:
        document = XacroDoc.from_file(path, subargs=dict(arguments), resolve_packages=False)
    except Exception as error:  # expressions in the file may raise anything
        raise ValueError(f"{type(error).__name__}: {error}") from None
    return document.to_urdf_string(), [Path(file).resolve() for file in xacro.all_includes]
