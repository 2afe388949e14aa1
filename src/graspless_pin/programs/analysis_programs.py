"""Programs of the analyses for given torques: force sets (32), rays, disturbances, limits."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.force_programs import ForceCoordinates, ForceRows
from graspless_pin.programs.program import FARTHEST, Program


def force_set_program(
    rows: ForceRows, coordinates: ForceCoordinates, torque: FloatArray, reach: float
) -> Program:
    """The force set (32) of given torques without (27) and (31), no objective yet.

    There is no normal-force limit in (32); forces up to ``reach`` times F are looked at.

    Args:
        rows: Constraints of the problem.
        coordinates: Its force coordinates.
        torque: (L,) torques that the contacts must make, over the joint scale.
        reach: Largest normal force that is looked at, over F.
    """
    low, high = _cone_box(rows, coordinates, reach)
    imposed_high = np.full(rows.size, np.inf)
    imposed_high[coordinates.normal] = reach
    imposed_low = np.full(rows.size, -np.inf)
    imposed_low[coordinates.normal] = 0.0
    return Program(
        P=np.zeros(rows.size),
        c=np.zeros(rows.size),
        A=np.asfortranarray(np.vstack([rows.balance, rows.torque])),
        b=np.concatenate([rows.wrench, torque]),
        G=np.asfortranarray(rows.faces),
        l=np.full(len(rows.faces), -np.inf),
        u=np.zeros(len(rows.faces)),
        lb=imposed_low,
        ub=imposed_high,
        box=np.vstack([low, high]),
    )


def with_objective(program: Program, c: FloatArray) -> Program:
    """Return the program with another linear objective."""
    return replace(program, c=c)


def ray_program(force_set: Program, rows: ForceRows, coordinates: ForceCoordinates) -> Program:
    """A force set beside its own rays: variables (x, d) with x in the set and d a direction.

    d keeps balance and torques and stays in the cones, so x + s d is in the set for every s >= 0;
    its normal components are at most 1.
    """
    size = rows.size
    ray = force_set_program(rows, coordinates, np.zeros(len(rows.torque)), 1.0)
    zeros = np.zeros((len(force_set.A), size))
    gap = np.zeros((len(rows.faces), size))
    return Program(
        P=np.zeros(2 * size),
        c=np.zeros(2 * size),
        A=np.asfortranarray(np.block([[force_set.A, zeros], [zeros, force_set.A]])),
        b=np.concatenate([force_set.b, np.zeros(len(force_set.b))]),
        G=np.asfortranarray(np.block([[rows.faces, gap], [gap, rows.faces]])),
        l=np.full(2 * len(rows.faces), -np.inf),
        u=np.zeros(2 * len(rows.faces)),
        lb=np.concatenate([force_set.lb, ray.lb]),
        ub=np.concatenate([force_set.ub, ray.ub]),
        box=np.hstack([force_set.box, ray.box]),
    )


def held_margin_program(
    rows: ForceRows, coordinates: ForceCoordinates, torque: FloatArray
) -> Program:
    """Algorithm 1 with the torques given: minimise -e/F, e of either sign."""
    bare = -rows.normal[rows.bare]
    sides = np.vstack([rows.faces, rows.normal, bare])
    held = np.vstack([rows.balance, rows.torque])
    u = np.concatenate([np.zeros(len(rows.faces)), rows.limit, np.zeros(len(bare))])
    most = min(1e3 * float(rows.limit.max()), FARTHEST)
    low, high = _cone_box(rows, coordinates, most)
    imposed = np.full(rows.size + 1, -np.inf)
    imposed[coordinates.normal] = 0.0
    # The forces stay in their cones whatever the margin beyond the normal-force limit is.
    cones = np.hstack([rows.faces, np.zeros((len(rows.faces), 1))])
    return Program(
        P=np.zeros(rows.size + 1),
        c=np.append(np.zeros(rows.size), -1.0),
        A=np.asfortranarray(np.hstack([held, np.zeros((len(held), 1))])),
        b=np.concatenate([rows.wrench, torque]),
        G=np.asfortranarray(np.vstack([np.hstack([sides, np.ones((len(sides), 1))]), cones])),
        l=np.full(len(sides) + len(cones), -np.inf),
        u=np.concatenate([u, np.zeros(len(cones))]),
        lb=imposed,
        ub=np.full(rows.size + 1, np.inf),
        box=np.vstack([np.append(low, -most), np.append(high, float(rows.limit.max()))]),
    )


def disturbance_program(
    rows: ForceRows,
    coordinates: ForceCoordinates,
    direction: FloatArray,
    torque: FloatArray | None,
) -> Program:
    """The largest multiple of a disturbance wrench that contact forces still balance.

    Maximise s (last variable, over F) with W f = -(w_ext + s direction), forces inside cones and
    normal-force limits, torques fixed or within their limits.

    Args:
        rows: Constraints of the problem.
        coordinates: Its force coordinates.
        direction: (6,) wrench per newton of disturbance.
        torque: (L,) torques that the contacts must make, over the joint scale; None: any within
            the limits.
    """
    push = rows.weight * direction
    largest = int(np.argmax(np.abs(push)))
    reach = np.abs(rows.box).max(axis=0)
    most = float(np.abs(rows.balance[largest]) @ reach + abs(rows.wrench[largest]))
    most /= abs(push[largest])
    pad = np.zeros((len(rows.faces), 1))
    A = np.hstack([rows.balance, push[:, None]])
    b = rows.wrench
    held = np.hstack([rows.torque, np.zeros((len(rows.torque), 1))])
    G = np.hstack([rows.faces, pad])
    l, u = np.full(len(G), -np.inf), np.zeros(len(G))  # noqa: E741
    if torque is None:
        G = np.vstack([G, held])
        l, u = np.concatenate([l, rows.lower]), np.concatenate([u, rows.upper])  # noqa: E741
    else:
        A, b = np.vstack([A, held]), np.concatenate([b, torque])
    low, high = np.full(rows.size + 1, -np.inf), np.full(rows.size + 1, np.inf)
    low[coordinates.normal], high[coordinates.normal] = 0.0, rows.limit
    low[-1] = 0.0
    return Program(
        P=np.zeros(rows.size + 1),
        c=np.append(np.zeros(rows.size), -1.0),
        A=np.asfortranarray(A),
        b=b,
        G=np.asfortranarray(G),
        l=l,
        u=u,
        lb=low,
        ub=high,
        box=np.hstack([rows.box, [[0.0], [most + 1.0]]]),
    )


def relief_program(
    rows: ForceRows,
    coordinates: ForceCoordinates,
    margin: float,
    *,
    joint: int | None = None,
    normal: bool = False,
    wrench: bool = False,
) -> Program:
    """The smallest change of one kind of limit that makes a margin feasible.

    The last variable s >= 0 is how much is given: to one joint's limits (its joint scale) or to all
    joints' (the torque scale), to all normal-force limits (F), or as an outside help in the balance
    (F, the largest component of a wrench with moments over the length scale).

    Args:
        rows: Constraints of the problem.
        coordinates: Its force coordinates.
        margin: Required margin over F.
        joint: Widen this joint's limits; -1 widens those of all joints by the same amount.
        normal: Raise the normal-force limits.
        wrench: Help the balance.
    """
    size = rows.size
    # What is given reaches as far as ten times everything at hand: enough for any contact.
    most = 10.0 * (2.0 + margin + float(np.abs(rows.box).sum() + np.abs(rows.wrench).sum()))
    finite = np.concatenate([rows.lower, rows.upper])
    most += float(np.abs(finite[np.isfinite(finite)]).max(initial=0.0))
    most += float(np.abs(rows.torque).sum())
    given = np.zeros(len(rows.torque))
    if joint == -1:
        given[:] = coordinates.torque_scale / coordinates.joint_scale
    elif joint is not None:
        given[joint] = 1.0
    # A limit of zero beside a nonzero one is a direction that cannot be pushed: it stays.
    zero_low, zero_high = (limit + rows.gravity == 0.0 for limit in (rows.lower, rows.upper))
    up, down = given * ~(zero_high & ~zero_low), given * ~(zero_low & ~zero_high)
    help_ = -np.ones((6, 1)) if wrench else np.zeros((6, 1))
    face_pad = np.zeros((len(rows.faces), 1))
    G = np.vstack(
        [
            np.hstack([rows.faces, face_pad]),
            np.hstack([rows.torque, -up[:, None]]),
            np.hstack([-rows.torque, -down[:, None]]),
            np.hstack([rows.normal, -np.full((len(rows.normal), 1), float(normal))]),
            np.hstack([rows.balance, help_]),
            np.hstack([-rows.balance, help_]),
        ]
    )
    u = np.concatenate(
        [
            np.full(len(rows.faces), -margin),
            rows.upper,
            -rows.lower,
            rows.limit - margin,
            rows.wrench,
            -rows.wrench,
        ]
    )
    low = np.full(size + 1, -np.inf)
    low[coordinates.normal[rows.bare]] = margin
    low[-1] = 0.0
    reach = most if normal else 1.0
    box_low, box_high = _cone_box(rows, coordinates, max(reach, 1.0))
    return Program(
        P=np.zeros(size + 1),
        c=np.append(np.zeros(size), 1.0),
        A=np.zeros((0, size + 1), order="F"),
        b=np.zeros(0),
        G=np.asfortranarray(G),
        l=np.full(len(G), -np.inf),
        u=u,
        lb=low,
        ub=np.full(size + 1, np.inf),
        box=np.vstack([np.append(box_low, 0.0), np.append(box_high, most)]),
    )


def _cone_box(
    rows: ForceRows, coordinates: ForceCoordinates, reach: float
) -> tuple[FloatArray, FloatArray]:
    """Bounds of forces inside cones with normal components up to ``reach``."""
    widest = (
        rows.box[1]
        / rows.limit[np.searchsorted(coordinates.normal, np.arange(rows.size), "right") - 1]
    )
    high = reach * widest
    low = -high
    low[coordinates.normal] = 0.0
    return low, high
