"""Calls of CoACD and xacrodoc, alone in a module: their processes load nothing else."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

ITERATIONS = 60
"""Of CoACD's search for each cut: more take longer and save few pieces."""
SEED = 0


def run_coacd(vertices: Any, faces: Any, concavity: float, most: int) -> list[Any]:
    """Return the corners (V, 3) of the pieces that CoACD cuts a mesh into.

    Args:
        vertices: (V, 3) corners.
        faces: (F, 3) indices of corners.
        concavity: Deepest hollow that a piece may fill, as a share of half the largest extent.
        most: Most pieces; -1: as many as it takes.
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
    """Return the URDF that a xacro file makes, and what it includes; change the current folder.

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

    os.chdir(Path(path).parent)  # xacrodoc looks there for files that are included by their path
    finder.update_package_cache(dict(packages))
    xacro.all_includes.clear()
    try:
        document = XacroDoc.from_file(path, subargs=dict(arguments), resolve_packages=False)
    except Exception as error:  # whatever an expression in the file raises
        raise ValueError(f"{type(error).__name__}: {error}") from None
    return document.to_urdf_string(), [Path(one).resolve() for one in xacro.all_includes]
