"""What a friction cone is to a program: rows that keep forces a margin away from its surface.

A model's section gives the side faces, and round cones have rows of their own; problems whose
contacts have the same cones share them, read-only.

A planner or a study asks for thousands of problems whose contacts have friction cones at the same
places: where their force coordinates stand among the columns is found once and handed to each of
them, read-only.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.cone_model import ConeModel, Section

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
    arrays = {name: read_only(array) for name, array in arrays.items()}
    return ForceLayout(size, cone_contacts=tuple(cones.tolist()), picks=read_only(picks), **arrays)


@dataclass(frozen=True, eq=False)
class ConeRows:
    """Rows of all friction cones of a problem.

    Attributes:
        name: Name of their block.
        second_order: Three rows a cone, whose first is to be at least the length of the two others
            (rows x - margin e >= 0 in that order); otherwise each row is one side face,
            rows x + margin e <= 0 (42).
        rows: (k, n) coefficients of the forces.
        margin: (k,) coefficients of the margin e.
        owner: (k,) contact of each row.
        shape: Shape of their multipliers by contact.
        places: (k,) place of each row there, flat.
    """

    name: str
    second_order: bool
    rows: FloatArray
    margin: FloatArray
    owner: NDArray[np.int_]
    shape: tuple[int, int]
    places: NDArray[np.int_]


def cone_rows(problem: QuasistaticProblem) -> ConeRows:
    """Return the rows of a problem's friction cones."""
    mask, friction = problem.has_cone.tobytes(), problem.friction.tobytes()
    return _cone_rows(problem.cone_model, mask, friction, problem.cone_edges)


def face_rows(layout: ForceLayout, friction: FloatArray, section: Section) -> ConeRows:
    """Return the side faces of cones, h_m^T f + e <= 0 (42).

    Args:
        layout: Where the force coordinates stand.
        friction: (c,) coefficients of the contacts with a cone.
        section: Of all cones.
    """
    cones, edges = layout.cones, len(section.corners)
    faces = np.zeros((len(cones), edges, layout.size))
    columns = layout.normal[cones, None] + _FRAME
    faces[np.arange(len(cones))[:, None], :, columns] = section.faces(friction)
    rows = np.asfortranarray(faces.reshape(-1, layout.size))
    return _rows("faces", rows, np.ones(len(rows)), layout, edges)


def round_cones(layout: ForceLayout, friction: FloatArray) -> ConeRows:
    """Return Coulomb's cones as second-order cones, |f_t| <= mu f_n - sqrt(1 + mu^2) e.

    Args:
        layout: Where the force coordinates stand.
        friction: (c,) coefficients of the contacts with a cone.
    """
    cones = layout.cones
    rows = np.zeros((len(cones), 3, layout.size))
    columns = layout.normal[cones, None] + _FRAME
    rows[np.arange(len(cones))[:, None], _FRAME, columns] = 1.0
    rows[:, 0] *= friction[:, None]
    margin = np.zeros((len(cones), 3))
    margin[:, 0] = np.sqrt(1.0 + friction**2)
    flat = np.asfortranarray(rows.reshape(-1, layout.size))
    return _rows("round_cones", flat, margin.ravel(), layout, 3, second_order=True)


def _rows(
    name: str,
    rows: FloatArray,
    margin: FloatArray,
    layout: ForceLayout,
    each: int,
    *,
    second_order: bool = False,
) -> ConeRows:
    """Return the rows of a model that has as many for each cone."""
    places = (layout.cones[:, None] * each + np.arange(each)).ravel()
    owner, shape = np.repeat(layout.cones, each), (len(layout.normal), each)
    return ConeRows(name, second_order, read_only(rows), read_only(margin), owner, shape, places)


@lru_cache(maxsize=_MOST_KEPT)
def _cone_rows(model: ConeModel, mask: bytes, friction: bytes, edges: int) -> ConeRows:
    layout = layout_of(mask)
    coefficients = np.frombuffer(friction)[layout.cones]
    if model.second_order:
        return round_cones(layout, coefficients)
    return face_rows(layout, coefficients, model.section(edges))


@lru_cache(maxsize=_MOST_KEPT)
def reach_of(mask: bytes, friction: bytes) -> FloatArray:
    """Return `cone_reach` by the bytes of the problem's `has_cone` and `friction`."""
    layout = layout_of(mask)
    coefficients, tangent = np.frombuffer(friction)[layout.cones, None], layout.friction
    reach = np.zeros((2, layout.size))
    reach[1, layout.normal] = 1.0
    reach[1, tangent], reach[0, tangent] = coefficients, -coefficients
    return read_only(reach)


def cone_reach(problem: QuasistaticProblem) -> FloatArray:
    """Return (2, n) bounds of forces inside cones, each in limits of its contact's normal force."""
    return reach_of(problem.has_cone.tobytes(), problem.friction.tobytes())
