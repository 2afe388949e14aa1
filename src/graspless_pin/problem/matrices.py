"""The paper's matrices from contact arrays: one block a contact."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray, read_only

# p @ _CROSS, as a (3, 3) matrix, times f is the moment p x f.
_CROSS = np.zeros((3, 3, 3))
_CROSS[0, 1, 2] = _CROSS[1, 2, 0] = _CROSS[2, 0, 1] = -1.0
_CROSS[0, 2, 1] = _CROSS[1, 0, 2] = _CROSS[2, 1, 0] = 1.0
_CROSS = _CROSS.reshape(3, 9)
_IDENTITY = np.eye(3)[:, None, :]


def wrench_map(positions: FloatArray) -> FloatArray:
    """Return W, eq. (7): the (6, 3M) map from contact forces to the wrench on the object.

    Args:
        positions: (M, 3) contact points about the reference point, m.
    """
    count = len(positions)
    w = np.empty((6, count, 3))
    w[:3] = _IDENTITY
    w[3:] = (positions @ _CROSS).reshape(count, 3, 3).swapaxes(0, 1)
    return read_only(w.reshape(6, 3 * count))


def kinetic_directions(
    normals: FloatArray, friction: FloatArray, sliding: FloatArray, bare: NDArray[np.bool_]
) -> FloatArray:
    """Return (M, 3) n - mu v/|v|, the force per newton of normal force, where there is no cone.

    Args:
        normals: (M, 3) unit normals.
        friction: (M,) coefficients.
        sliding: (M, 3) sliding velocities v; n alone where they are zero.
        bare: (M,) contacts without a cone; the others get zeros.
    """
    speed = np.sqrt(np.einsum("ij,ij->i", sliding, sliding))
    share = friction / np.where(speed > 0.0, speed, np.inf)
    return read_only(np.where(bare[:, None], normals - share[:, None] * sliding, 0.0))


def cone_blocks(
    frames: FloatArray,
    friction: FloatArray,
    has_cone: NDArray[np.bool_],
    local: Callable[[float], FloatArray],
    otherwise: FloatArray,
) -> FloatArray:
    """Return a (3M, sum c_l) block-diagonal matrix whose blocks depend on the friction cones.

    Args:
        frames: (M, 3, 3) columns n, t1, t2 of each contact.
        friction: (M,) coefficients.
        has_cone: (M,) contacts with a cone.
        local: Gives a cone's (3, c) block along n, t1, t2 for its coefficient.
        otherwise: (M, 3) the one column, in world axes, of a contact without a cone.
    """
    return block_diagonal(
        [
            frame @ local(float(coefficient)) if coned else column[:, None]
            for frame, coefficient, coned, column in zip(
                frames, friction, has_cone, otherwise, strict=True
            )
        ]
    )


def block_diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Return the read-only block-diagonal matrix of (3, c) blocks."""
    matrix = np.zeros((3 * len(blocks), sum(block.shape[1] for block in blocks)))
    column = 0
    for row, block in enumerate(blocks):
        matrix[3 * row : 3 * row + 3, column : column + block.shape[1]] = block
        column += block.shape[1]
    return read_only(matrix)
