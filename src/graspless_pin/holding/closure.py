"""What the states of some contacts force on others, by kinematics alone.

Three closed corners of a face close the fourth; two contacts that stick keep a third from slipping.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from graspless_pin.holding.bounds import RANK, States, closing_tolerance, fixed_rows, kinematic_dual
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.verdict import ContactState, DualBound


@dataclass(frozen=True, eq=False)
class Forced:
    """A contact that can only be in one state.

    Attributes:
        contact: Its index.
        state: Closed or sticking.
        duals: What proves it: that u_n is at most the tolerance, or that u_t1 and u_t2 are.
        depends: Whether its rows depend on those of closed and sticking contacts.
    """

    contact: int
    state: ContactState
    duals: tuple[DualBound, ...]
    depends: bool


def forced_state(dynamics: Dynamics, states: States) -> Forced | None:
    """Return one contact whose state follows from the others', None where there is none."""
    tolerance, rows = closing_tolerance(dynamics), dynamics.rows
    held = dynamics.is_commanded
    fixed = fixed_rows(dynamics, states)
    still = null_space(fixed, rcond=RANK) if len(fixed) else np.eye(rows.shape[2])
    parting = np.flatnonzero(~held & states.are(ContactState.FREE, ContactState.OPEN))
    normals = rows[parting, 0] @ still
    for index, contact in enumerate(parting):
        others = np.delete(np.arange(len(parting)), index)
        shares, left = np.zeros(len(others)), float(np.linalg.norm(normals[index]))
        if left > tolerance and len(others):
            from scipy.optimize import nnls

            shares, left = nnls(normals[others].T, -normals[index])
        if left <= tolerance:
            weights = np.zeros(len(rows))
            weights[parting[others]] = shares
            goal = rows[contact, 0] + weights @ rows[:, 0]
            dual = kinematic_dual(dynamics, states, goal, weights)
            return Forced(int(contact), ContactState.CLOSED, (dual,), not shares.any())
    slipping = states.are(ContactState.CLOSED, ContactState.SLIPPING)
    for contact in np.flatnonzero(slipping):
        if np.linalg.norm(rows[contact, 1:] @ still) <= tolerance:
            none = np.zeros(len(rows))
            duals = [kinematic_dual(dynamics, states, row, none) for row in rows[contact, 1:]]
            return Forced(int(contact), ContactState.STICKING, tuple(duals), depends=True)
    return None
