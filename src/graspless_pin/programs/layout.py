"""Where the force coordinates of a problem stand among the columns of its programs.

A planner or a study asks for thousands of problems whose contacts have friction cones at the same
places: the layout is made once and handed to each of them, read-only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray, read_only

_FRAME = np.arange(3)
_MOST_KEPT = 16


@dataclass(frozen=True, eq=False)
class ForceLayout:
    """Where the n force coordinates stand: three for a contact with a cone, one for another.

    Attributes:
        size: n.
        normal: (M,) column of each contact's normal coordinate.
        tangent: (M, 2) columns of t1 and t2; -1 where there is no cone.
        cones: (c,) indices of the contacts with a cone.
        cone_contacts: The same as plain integers.
        friction: (c, 2) their columns of t1 and t2.
        without_cone: (M,) bool, contacts without one.
        owner: (n,) contact of each column.
        axes: (n,) index of each column's axis among the contacts' n, t1, t2, one after the other.
        places: (n, 3) places of each column's entries in the flat (3M, n) basis.
        picks: (M, n) picks n^T f / F.
    """

    size: int
    normal: NDArray[np.int_]
    tangent: NDArray[np.int_]
    cones: NDArray[np.int_]
    cone_contacts: tuple[int, ...]
    friction: NDArray[np.int_]
    without_cone: NDArray[np.bool_]
    owner: NDArray[np.int_]
    axes: NDArray[np.int_]
    places: NDArray[np.int_]
    picks: FloatArray


@lru_cache(maxsize=_MOST_KEPT)
def layout_of(mask: bytes) -> ForceLayout:
    """Return the layout of the force coordinates of a problem.

    Args:
        mask: Bytes of its `has_cone`.
    """
    has_cone = np.frombuffer(mask, dtype=np.bool_)
    widths = np.where(has_cone, 3, 1)
    normal = np.cumsum(widths) - widths
    size = int(widths.sum())
    cones = np.flatnonzero(has_cone)
    owner = np.repeat(np.arange(len(widths)), widths)
    places = (3 * owner[:, None] + _FRAME) * size + np.arange(size)[:, None]
    picks = np.zeros((len(widths), size))
    picks[np.arange(len(widths)), normal] = 1.0
    arrays = {
        "normal": normal,
        "tangent": np.where(has_cone[:, None], normal[:, None] + _FRAME[1:], -1),
        "cones": cones,
        "friction": normal[cones, None] + _FRAME[1:],
        "without_cone": ~has_cone,
        "owner": owner,
        "axes": 3 * owner + np.arange(size) - normal[owner],
        "places": places,
    }
    for array in arrays.values():
        array.setflags(write=False)
    return ForceLayout(size, cone_contacts=tuple(cones.tolist()), picks=read_only(picks), **arrays)
