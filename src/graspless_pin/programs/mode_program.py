"""Force program and virtual-sliding modes as one mixed-integer program (big-M form).

An independent statement of the whole problem for cross-checks: the mode (B, S) becomes binary
variables beside the forces, and the virtual motion [V; theta_dot] becomes continuous ones.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from graspless_pin.modes.rules import Rules, SignRule, SlidingMode, candidate_contacts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.force_programs import ForceCoordinates
from graspless_pin.programs.program import Program

LARGEST_MOTION = 1e5
"""Virtual sliding of at least 1 is asked of a motion with entries up to this."""


@dataclass(frozen=True, eq=False)
class ModeProgram:
    """Minimise c^T x subject to l <= G x <= u, lb <= x <= ub, some x binary.

    Attributes:
        c: (n,) objective.
        G: (k, n) rows.
        l: (k,) lower sides.
        u: (k,) upper sides.
        lb: (n,) lower bounds.
        ub: (n,) upper bounds.
        binary: (n,) bool.
        selection: (M,) column of b_l, -1 where a contact cannot be selected.
        signs: (M, 2, 2) columns of "virtually slides along +t_m" and "along -t_m"; -1 likewise.
    """

    c: FloatArray
    G: FloatArray
    l: FloatArray  # noqa: E741 - the letter of the docstring's program
    u: FloatArray
    lb: FloatArray
    ub: FloatArray
    binary: np.ndarray
    selection: np.ndarray
    signs: np.ndarray

    def mode(self, x: FloatArray) -> SlidingMode:
        """Return the mode that a solution's binaries say."""
        chosen = np.round(x).astype(int)
        selection = np.where(self.selection >= 0, chosen[self.selection], 0).astype(bool)
        taken = np.where(self.signs >= 0, chosen[self.signs], 0)
        return SlidingMode(selection, (taken[:, :, 0] - taken[:, :, 1]) * selection[:, None])


def mode_program(
    problem: QuasistaticProblem,
    coordinates: ForceCoordinates,
    program: Program,
    motion_rows: FloatArray,
    rules: Rules,
) -> ModeProgram:
    """State force program and modes together.

    Args:
        problem: The problem.
        coordinates: Its force coordinates.
        program: Algorithm 1 or 2 without (27) and (31), linear.
        motion_rows: (M, 3, d) relative velocities along n, t1, t2 of a scaled virtual motion.
        rules: The reading of the constraint.
    """
    contacts = np.flatnonzero(candidate_contacts(problem, rules))
    motions = motion_rows.shape[2]
    forces = len(program.c)
    first = forces + motions
    selection = np.full(problem.contact_count, -1)
    signs = np.full((problem.contact_count, 2, 2), -1)
    for position, contact in enumerate(contacts):
        start = first + 5 * position
        selection[contact] = start
        signs[contact] = start + 1 + np.arange(4).reshape(2, 2)
    size = first + 5 * len(contacts)
    rows: list[FloatArray] = []
    lower: list[float] = []

    def at_least(value: float, terms: list[tuple[int, float]], motion: FloatArray | None) -> None:
        """Add the row motion . nu + sum of coefficient * x >= value."""
        row = np.zeros(size)
        if motion is not None:
            row[forces:first] = motion
        for column, coefficient in terms:
            row[column] += coefficient
        rows.append(row)
        lower.append(value)

    for contact in contacts:
        b = int(selection[contact])
        normal, *tangents = motion_rows[contact]
        large = 1.0 + LARGEST_MOTION * float(np.abs(motion_rows[contact]).sum(axis=1).max())
        for row in (normal, -normal):
            at_least(-large, [(b, -large)], row)
        ways = [(int(signs[contact, m, k]), m, 1.0 - 2.0 * k) for m in range(2) for k in range(2)]
        for column, m, sign in ways:
            least = 0.0 if rules.sign is SignRule.NONZERO else 1.0
            at_least(least - large, [(column, -large)], sign * tangents[m])
        for m in range(2):
            plus, minus = (int(column) for column in signs[contact, m])
            at_least(0.0, [(b, 1.0), (plus, -1.0), (minus, -1.0)], None)
            if rules.sign is not SignRule.EXACT:
                at_least(0.0, [(b, -1.0), (plus, 1.0), (minus, 1.0)], None)
                continue
            for row in (tangents[m], -tangents[m]):
                at_least(-large, [(plus, large), (minus, large), (b, -large)], row)
        if rules.sign is SignRule.EXACT:
            at_least(0.0, [(b, -1.0), *((column, 1.0) for column, _, _ in ways)], None)
        if rules.sign is SignRule.NONZERO:
            for i, _, first_sign in ways[:2]:
                for j, _, second_sign in ways[2:]:
                    total = first_sign * tangents[0] + second_sign * tangents[1]
                    at_least(1.0 - 4.0 * large, [(i, -2.0 * large), (j, -2.0 * large)], total)
        if problem.has_cone[contact]:
            for m in range(2):
                column = int(coordinates.tangent[contact, m])
                reach = float(program.box[1, column])
                # Friction is opposite to the sliding: positive only against a negative sliding.
                at_least(0.0, [(column, -1.0), (int(signs[contact, m, 1]), reach)], None)
                at_least(0.0, [(column, 1.0), (int(signs[contact, m, 0]), reach)], None)
    pad = np.zeros((len(program.A), size - forces))
    low, high = program.reach
    sliding = problem.is_sliding[contacts]
    return ModeProgram(
        c=np.concatenate([program.c, np.zeros(size - forces)]),
        G=np.vstack(
            [
                np.hstack([program.A, pad]),
                np.hstack([program.G, np.zeros((len(program.G), size - forces))]),
                *rows,
            ]
        ),
        l=np.concatenate([program.b, program.l, lower]),
        u=np.concatenate([program.b, program.u, np.full(len(lower), np.inf)]),
        lb=np.concatenate(
            [
                low,
                np.full(motions, -LARGEST_MOTION),
                np.kron(sliding.astype(float), [1.0, 0.0, 0.0, 0.0, 0.0]),
            ]
        ),
        ub=np.concatenate([high, np.full(motions, LARGEST_MOTION), np.ones(5 * len(contacts))]),
        binary=np.arange(size) >= first,
        selection=selection,
        signs=signs,
    )
