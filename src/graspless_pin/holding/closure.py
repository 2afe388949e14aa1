"""What the states of some contacts force on others, by kinematics alone.

Three closed corners of a face close the fourth; two contacts that stick keep a third from slipping.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from graspless_pin.holding.bounds import RANK, States, closing_tolerance, fixed_rows, kinematic_dual
from graspless_pin.holding.dynamics import Dynamics
from graspless_pin.holding.least_squares import nonnegative_squares
from graspless_pin.holding.verdict import ContactState, DualBound
from graspless_pin.problem.checks import FloatArray


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
    try:
        still = null_space(fixed, rcond=RANK) if len(fixed) else np.eye(rows.shape[2])
    except np.linalg.LinAlgError:
        return None
    parting = np.flatnonzero(~held & states.are(ContactState.FREE, ContactState.OPEN))
    normals = rows[parting, 0] @ still
    for index, contact in enumerate(parting):
        others = np.delete(np.arange(len(parting)), index)
        shares, left = np.zeros(len(others)), float(np.linalg.norm(normals[index]))
        if left > tolerance and len(others):
            found = nonnegative_squares(normals[others].T, -normals[index])
            if found is None:
                continue
            shares, left = found, float(np.linalg.norm(found @ normals[others] + normals[index]))
        if left <= tolerance:
            weights = np.zeros(len(rows))
            weights[parting[others]] = shares
            goal = rows[contact, 0] + weights @ rows[:, 0]
            dual = kinematic_dual(dynamics, states, goal, weights)
            if _is_proof(dynamics, dual, rows[contact, 0]):
                return Forced(int(contact), ContactState.CLOSED, (dual,), not shares.any())
    slipping = states.are(ContactState.CLOSED, ContactState.SLIPPING)
    for contact in np.flatnonzero(slipping):
        if np.linalg.norm(rows[contact, 1:] @ still) <= tolerance:
            none = np.zeros(len(rows))
            duals = [kinematic_dual(dynamics, states, row, none) for row in rows[contact, 1:]]
            if all(map(_is_proof, [dynamics] * 2, duals, rows[contact, 1:])):
                return Forced(int(contact), ContactState.STICKING, tuple(duals), depends=True)
    return None


def _is_proof(dynamics: Dynamics, dual: DualBound, row: FloatArray) -> bool:
    """Return whether multipliers leave nothing of a row but rounding, worked out of all rows."""
    rows = dynamics.rows
    left = row + dual.normal @ rows[:, 0] + np.einsum("li,lin->n", dual.tangential, rows[:, 1:])
    return bool(np.linalg.norm(left) <= closing_tolerance(dynamics))
