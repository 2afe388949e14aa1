"""What the programs of all problems with the same cones share: columns, cone rows, constants.

A planner or a study asks for thousands of problems whose contacts have the same friction cones and
differ in numbers only; these parts are made once and handed to each of them, read-only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.cones import cone_faces_local

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
        bare: (M,) bool, contacts without one.
        owner: (n,) contact of each column.
        axes: (n,) index of each column's axis among the contacts' n, t1, t2, one after the other.
        places: (n, 3) places of each column's entries in the flat (3M, n) basis.
    """

    size: int
    normal: NDArray[np.int_]
    tangent: NDArray[np.int_]
    cones: NDArray[np.int_]
    cone_contacts: tuple[int, ...]
    friction: NDArray[np.int_]
    bare: NDArray[np.bool_]
    owner: NDArray[np.int_]
    axes: NDArray[np.int_]
    places: NDArray[np.int_]


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Rows and constants of Algorithms 1 and 2 that only depend on the friction cones.

    Attributes:
        sides: (s, n + 1) faces x + e, n^T f + e and, without a cone, -n^T f + e; e is the last.
        faces: (k, n) the first k of them, less their last column.
        normal: (M, n) the next M, likewise.
        face_owner: (k,) contact of each face.
        face_places: (k,) place of each face among (M, r), flat.
        reach: (2, n) bounds of forces inside cones, each in limits of its contact's normal force.
        free: (2, n + 1) -inf and inf.
        last: (n + 1,) one for the last variable, else zero.
        minus_last: (n + 1,) minus that.
        flat: (n + 1,) zeros.
    """

    sides: FloatArray
    faces: FloatArray
    normal: FloatArray
    face_owner: NDArray[np.int_]
    face_places: NDArray[np.int_]
    reach: FloatArray
    free: FloatArray
    last: FloatArray
    minus_last: FloatArray
    flat: FloatArray


def layout_of(problem: QuasistaticProblem) -> ForceLayout:
    """Return the layout of a problem's force coordinates."""
    return _layout(problem.has_cone.tobytes())


def cone_rows(problem: QuasistaticProblem) -> ConeRows:
    """Return the rows of a problem's friction cones."""
    return _cone_rows(problem.has_cone.tobytes(), problem.friction.tobytes(), problem.cone_edges)


@lru_cache(maxsize=_MOST_KEPT)
def _layout(mask: bytes) -> ForceLayout:
    has_cone = np.frombuffer(mask, dtype=np.bool_)
    widths = np.where(has_cone, 3, 1)
    normal = np.cumsum(widths) - widths
    size = int(widths.sum())
    cones = np.flatnonzero(has_cone)
    owner = np.repeat(np.arange(len(widths)), widths)
    places = (3 * owner[:, None] + _FRAME) * size + np.arange(size)[:, None]
    arrays = {
        "normal": normal,
        "tangent": np.where(has_cone[:, None], normal[:, None] + _FRAME[1:], -1),
        "cones": cones,
        "friction": normal[cones, None] + _FRAME[1:],
        "bare": ~has_cone,
        "owner": owner,
        "axes": 3 * owner + np.arange(size) - normal[owner],
        "places": places,
    }
    for array in arrays.values():
        array.setflags(write=False)
    return ForceLayout(size, cone_contacts=tuple(cones.tolist()), **arrays)


@lru_cache(maxsize=_MOST_KEPT)
def _cone_rows(mask: bytes, friction: bytes, edges: int) -> ConeRows:
    layout = _layout(mask)
    size, count, cones = layout.size, len(layout.normal), layout.cones
    faces = np.zeros((len(cones), edges, size))
    columns = layout.normal[cones, None] + _FRAME
    coefficients = np.frombuffer(friction)[cones]
    blocks = cone_faces_local(coefficients, edges)
    faces[np.arange(len(cones))[:, None], :, columns] = blocks
    normal = np.zeros((count, size))
    normal[np.arange(count), layout.normal] = 1.0
    low = -normal[layout.bare]
    parts = [faces.reshape(-1, size), normal, low]
    sides = np.ones((sum(map(len, parts)), size + 1), order="F")
    sides[:, :-1] = np.concatenate(parts)
    reach = np.zeros((2, size))
    reach[1, layout.normal] = 1.0
    reach[1, columns[:, 1:]] = coefficients[:, None]
    reach[0, columns[:, 1:]] = -coefficients[:, None]
    last = np.zeros(size + 1)
    last[-1] = 1.0
    free = np.full((2, size + 1), np.inf)
    free[0] = -np.inf
    read_only(sides)
    return ConeRows(
        sides=sides,
        faces=sides[: len(cones) * edges, :-1],
        normal=sides[len(cones) * edges : len(cones) * edges + count, :-1],
        face_owner=np.repeat(cones, edges),
        face_places=(cones[:, None] * edges + np.arange(edges)).ravel(),
        reach=read_only(reach),
        free=read_only(free),
        last=read_only(last),
        minus_last=read_only(-last),
        flat=read_only(np.zeros(size + 1)),
    )
