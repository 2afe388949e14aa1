"""The paper's matrices from contact arrays, with one block per contact; wrenches and load texts.

In wrenches of this package forces come first; in some other packages moments do.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import (
    FREE_BODY,
    FloatArray,
    JointUnit,
    finite_array,
    read_only,
    real_array,
    torque_mask,
)

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
    normals: FloatArray, friction: FloatArray, sliding: FloatArray, without_cone: NDArray[np.bool_]
) -> FloatArray:
    """Return (M, 3) n - mu v/|v|, the force per newton of normal force, where there is no cone.

    Args:
        normals: (M, 3) unit normals.
        friction: (M,) coefficients.
        sliding: (M, 3) sliding velocities v; n alone where they are zero.
        without_cone: (M,) contacts without a cone; the others get zeros.
    """
    speed = np.sqrt(np.einsum("ij,ij->i", sliding, sliding))
    share = friction / np.where(speed > 0.0, speed, np.inf)
    return read_only(np.where(without_cone[:, None], normals - share[:, None] * sliding, 0.0))


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
        local: Function from a coefficient to the cone's (3, c) block along n, t1, t2.
        otherwise: (M, 3) the single column, in world axes, of each contact without a cone.
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


def moment_first(wrench: ArrayLike) -> FloatArray:
    """Reorder [force; moment], as everywhere in this package, to [moment; force].

    The reference point and the axes stay as they are. A twist is reordered in the same way, from
    [linear; angular] to [angular; linear].

    Args:
        wrench: (6,), or (N, 6) for several, N and N m.

    Returns:
        A copy of the same shape with moments first, as in Drake.

    Raises:
        ArgumentError: If the shape is another one or an entry is not a number.

    Examples:
        >>> from graspless_pin import moment_first
        >>> moment_first([4.0, 5.0, 6.0, 0.1, 0.2, 0.3])
        array([0.1, 0.2, 0.3, 4. , 5. , 6. ])
    """
    return _with_halves_swapped(wrench)


def force_first(wrench: ArrayLike) -> FloatArray:
    """Reorder [moment; force] to [force; moment], as everywhere in this package.

    The reference point and the axes stay as they are: an external wrench also has to be about the
    object's centre of mass and in world axes.

    Args:
        wrench: (6,), or (N, 6) for several, N m and N.

    Returns:
        A copy of the same shape with forces first.

    Raises:
        ArgumentError: If the shape is another one or an entry is not a number.

    Examples:
        >>> from graspless_pin import force_first
        >>> force_first([0.1, 0.2, 0.3, 4.0, 5.0, 6.0])
        array([4. , 5. , 6. , 0.1, 0.2, 0.3])
    """
    return _with_halves_swapped(wrench)


def load_words(load: FloatArray, units: tuple[JointUnit, ...], *, joined: str) -> str:
    """Return a load on passive coordinates as text: its components in N, then those in N m.

    Args:
        load: (P,) N and N m.
        units: P units.
        joined: Separator of the two parts.
    """
    turns = torque_mask(units)
    force, moment = np.round(load[~turns], 4) + 0.0, np.round(load[turns], 5) + 0.0
    words = [f"force {force.tolist()} N"] if force.size else []
    words += [f"moment {moment.tolist()} N m"] if moment.size else []
    return joined.join(words)


def _with_halves_swapped(wrench: ArrayLike) -> FloatArray:
    try:
        rows = np.ndim(wrench) == 2
    except ValueError:  # rows of several lengths: the check below says so
        rows = False
    return np.roll(real_array("wrench", wrench, (None, 6) if rows else (6,)), 3, axis=-1)


def body_wrench_matrix(points: ArrayLike, bodies: ArrayLike, centers: ArrayLike) -> FloatArray:
    """Return the map from contact forces to the wrenches on several free bodies.

    Args:
        points: (M, 3) contact points in world axes, m.
        bodies: (M, 2) numbers of the body on which the contact's force acts, into which its normal
            points, and of the body on which the reaction acts; -1: none of the bodies, that is a
            support or a finger.
        centers: (B, 3) reference points of the bodies' moments, m: their centres of mass, if the
            inertia is block diagonal.

    Returns:
        (6B, 3M) read-only, the `wrench_matrix` of a `QuasistaticProblem` whose external wrench
        and inertia are those of body 0, then of body 1 and so on.

    Raises:
        ArgumentError: Naming the argument, the index and the value that is wrong.

    Examples:
        A brick of 1 kg lies on another one, which lies on the ground.

        >>> import numpy as np
        >>> from graspless_pin import QuasistaticProblem, body_wrench_matrix
        >>> corners = np.array([[x, y, 0.0] for x in (-0.1, 0.1) for y in (-0.1, 0.1)])
        >>> points = np.vstack([corners, corners + [0.0, 0.0, 0.06]])  # m
        >>> bodies = [[0, -1]] * 4 + [[1, 0]] * 4
        >>> W = body_wrench_matrix(points, bodies, [[0.0, 0.0, 0.03], [0.0, 0.0, 0.09]])
        >>> weights = [0.0, 0.0, -9.8, 0.0, 0.0, 0.0] * 2  # N, N m
        >>> problem = QuasistaticProblem(
        ...     points, [[0.0, 0.0, 1.0]] * 8, weights, friction=0.5, wrench_matrix=W
        ... )
        >>> problem.passive_count
        12
    """
    positions = finite_array("points", points, (None, 3))
    references = finite_array("centers", centers, (None, 3))
    numbers = finite_array("bodies", bodies, (len(positions), 2))
    _check_body_pairs(numbers, len(references))
    matrix = np.zeros((len(references), len(FREE_BODY), len(positions), 3))
    for side, sign in ((0, 1.0), (1, -1.0)):
        for contact in np.flatnonzero(numbers[:, side] >= 0.0).tolist():
            body = int(numbers[contact, side])
            matrix[body, :, contact] = sign * wrench_map(
                positions[contact : contact + 1] - references[body]
            )
    return read_only(matrix.reshape(len(FREE_BODY) * len(references), 3 * len(positions)) + 0.0)


def _check_body_pairs(bodies: FloatArray, count: int) -> None:
    """Check that each row of ``bodies`` names a body and another one, or -1.

    Raises:
        ArgumentError: Naming the index and the value.
    """
    allowed = (
        f"0 to {count - 1}" if count > 1 else "0" if count else "nothing, as centers has no row"
    )
    least = np.array([0.0, -1.0])
    bad = (bodies != np.round(bodies)) | (bodies < least) | (bodies >= count)
    if bad.any():
        row, column = (int(index) for index in np.argwhere(bad)[0])
        allowed_at_entry = f"{allowed}{', or -1 for none of them' if column else ''}"
        rule = f"it must be a whole number, {allowed_at_entry}"
        raise ArgumentError(
            "bodies", f"is {bodies[row, column]:g} at index {(row, column)}; {rule}"
        )
    same = bodies[:, 0] == bodies[:, 1]
    if same.any():
        row = int(np.argmax(same))
        raise ArgumentError(
            "bodies",
            f"at index {row} is {bodies[row].astype(int).tolist()}: a body cannot touch itself",
        )
