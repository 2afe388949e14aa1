"""The call of CoACD, alone in a module: the process that it is made in loads nothing else."""

from __future__ import annotations

from typing import Any

import numpy as np

ITERATIONS = 60
"""Of the search for each cut: more take longer and save few pieces."""
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

    coacd.set_log_level("error")
    solid = coacd.Mesh(np.asarray(vertices), np.asarray(faces, dtype=np.int32))
    cut = coacd.run_coacd(
        solid, threshold=concavity, max_convex_hull=most, mcts_iterations=ITERATIONS, seed=SEED
    )
    return [np.array(corners, dtype=np.float64) for corners, _ in cut]
