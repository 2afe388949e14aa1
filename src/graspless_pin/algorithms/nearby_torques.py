"""Whether torques like those of an earlier state serve all members of a set.

The earlier forces, in contact frames, are moved by as little as the mean load asks for. Under the
torques that they take each member is a small program by itself. That proves a margin, and refutes
none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from graspless_pin.algorithms.joined_optimum import common_motions, member_margins
from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.errors import UndecidedMotionError
from graspless_pin.modes.kinematics import Conflict, requirements_of
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.members import Member
from graspless_pin.programs.forces import force_coordinates

_CANCELS = 1e-9
"""Of the load, or of what else there is: what rounding may leave of a figure."""


class EarlierForces(NamedTuple):
    """Forces of an earlier state.

    Attributes:
        mean: (M, 3) of members under the same commands, along n, t1 and t2 of the contacts, N.
        margin: That each of them keeps, N.
        mode: The one mode that they are in; None: plain Coulomb friction.
    """

    mean: FloatArray
    margin: float
    mode: SlidingMode | None


def earlier_forces(robust: RobustSolution) -> EarlierForces:
    """Return the forces of torques that serve the corners of a set in one mode."""
    frames, mode = robust.members[0].problem.frames, robust.solution.given_mode
    if mode is not None:
        size = len(frames)
        mode = SlidingMode(mode.selection[:size], mode.signs[:size])
    mean = robust.contact_forces.mean(axis=0)
    return EarlierForces((mean[:, None] @ frames)[:, 0], robust.margin, mode)


def are_served(
    members: Sequence[Member],
    earlier: EarlierForces,
    margin: float,
    options: SolveOptions,
    *,
    directions: FloatArray | None = None,
) -> bool:
    """Tell whether torques near those of earlier forces keep a margin for all members.

    Args:
        members: K members, with as many contacts as there are earlier forces.
        earlier: Forces of an earlier state.
        margin: N.
        options: How margins are looked for.
        directions: What feedback may add, see `feedback_torques`.

    Returns:
        Whether they are proven to do; False leaves it open.
    """
    if margin > earlier.margin:
        return False
    commands, mode = _commands(members, earlier), earlier.mode
    if commands is None:
        return False
    margins = member_margins(
        members, commands, options, Limits.of(options), directions=directions, mode=mode,
        enough=margin,
    )  # fmt: skip
    slack = _CANCELS * max(margin, members[0].problem.scales.force)
    proven = (margins >= margin - slack).all()
    return bool(proven) and (mode is None or _moves(members, mode, options))


def _commands(members: Sequence[Member], earlier: EarlierForces) -> FloatArray | None:
    """Return (L,) commands of forces near earlier ones that balance the mean load; None: none."""
    first, mode = members[0].problem, earlier.mode
    coordinates = force_coordinates(first)
    layout, kept = coordinates.layout, np.ones(coordinates.layout.size, dtype=bool)
    if mode is not None:
        kept[layout.friction] = mode.signs[layout.cones] != 0
    basis = coordinates.basis[:, kept]
    load = np.mean([one.problem.external_wrench for one in members], axis=0)
    balance = np.linalg.pinv(first.W @ basis, rcond=_CANCELS)
    least = basis @ (balance @ -load)
    inner = coordinates.basis @ earlier.mean.ravel()[layout.axes]
    inner -= basis @ (balance @ (first.W @ inner))
    start, added = members[0].commanded(first.J.T @ least), first.J.T @ inner / members[0].factors
    # The largest margin is mostly at limits of torques: then a part of the inner forces will do.
    room = np.where(added > 0.0, first.upper_torque - start, start - first.lower_torque)
    needed = np.abs(added)
    counts = needed > _CANCELS * needed.max(initial=0.0)
    share = (1.0 - _CANCELS) * float((room[counts] / needed[counts]).min(initial=1.0))
    commands, loaded = start + share * added, first.J.any(axis=0)
    within = (commands >= first.lower_torque) & (commands <= first.upper_torque)
    return commands if within[loaded].all() else None


def _moves(members: Sequence[Member], mode: SlidingMode, options: SolveOptions) -> bool:
    """Return whether all members together may slide in a mode."""
    motions = common_motions(members[0].problem, len(members))
    try:
        verdict = motions.solve(requirements_of(mode), options.rules.sign)
    except UndecidedMotionError:
        return False
    return not isinstance(verdict, Conflict)
