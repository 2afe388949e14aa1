"""The affinely adjustable robust counterpart of Algorithms 1 and 2: one conic program.

The forces of corner k are f_k + F d. Balance and shared commands hold for all d if they hold at
d = 0 and the coefficients of each d cancel. A row of the cones holds for all d in a product of
balls if it holds at d = 0 with the norms of its coefficients as slack: a linear program for
intervals, a second-order cone program for balls. Corners with the same contacts and the same loads
of d share F. Each corner has rows that stay below their sides, and its balance and torques.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.force_policy import ForcePolicy, Unknowns
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import Member, shared_commands
from graspless_pin.problem.scales import passive_levers
from graspless_pin.programs.answers import PRIMAL_TOLERANCE
from graspless_pin.programs.forces import ForceCoordinates, force_coordinates, force_rows
from graspless_pin.programs.objectives import Margin, Torque
from graspless_pin.solvers.conic_backends import Entries, SparseConic, diagonal
from graspless_pin.tree_search import NO_LIMITS, Limits

CANCELS = 1e-9
"""Largest residual of the balance for a unit unknown, scaled."""


class CornerGroup(NamedTuple):
    """Corners with the same contacts and the same loads of the unknowns, and their shared rows.

    The n columns are force coordinates, without those that the mode forbids.

    Attributes:
        corners: Numbers of the corners.
        coordinates: Force coordinates, forbidden ones included.
        kept: (n,) indices of the columns that the mode allows.
        rows: (R, n) rows of cones, limits and signs, at most `sides`.
        level: (R,) coefficient of the margin in each row.
        sides: (R,) right-hand sides of the rows.
        effects: (P + s, n) rows of the balance, then of the shared commands.
        inverse: (n, P + s) pseudo-inverse of the effects.
        torque: (L, n) commands, over the joint scale.
        loads: (P, D) right-hand sides of the balance for each unknown.
    """

    corners: list[int]
    coordinates: ForceCoordinates
    kept: NDArray[np.int_]
    rows: FloatArray
    level: FloatArray
    sides: FloatArray
    effects: FloatArray
    inverse: FloatArray
    torque: FloatArray
    loads: FloatArray

    def forces(self, x: FloatArray) -> FloatArray:
        """Return the (M, 3) contact forces, N, of the n kept coordinates."""
        whole = np.zeros(self.coordinates.layout.size)
        whole[self.kept] = x
        return self.coordinates.forces(whole)


def corner_groups(
    corners: Sequence[Member],
    unknowns: Unknowns,
    scale: ForceCoordinates,
    shared: FloatArray,
    mode: SlidingMode | None,
) -> list[CornerGroup]:
    """Return the corners in groups that may share the slopes F of their forces.

    Args:
        corners: K members.
        unknowns: The figures d.
        scale: The scales of all corners.
        shared: (s, L) combinations of scaled commands that are the same for all members.
        mode: The one mode of all forces; None: plain Coulomb friction.
    """
    groups: dict[bytes, CornerGroup] = {}
    weight = _balance_weights(corners[0], scale)
    for number, member in enumerate(corners):
        loads = -weight[:, None] * unknowns.loads[number] / scale.force_scale
        parts = loads.round(12) + 0.0, member.problem.friction, member.factors
        key = b"".join(one.tobytes() for one in parts)
        if key not in groups:
            groups[key] = _group_of_member(member, loads, scale, shared, mode)
        groups[key].corners.append(number)
    return list(groups.values())


def _balance_weights(corner: Member, scale: ForceCoordinates) -> FloatArray:
    """Return (P,) the factors from scaled loads to the rows of the balance."""
    return 1.0 / passive_levers(corner.problem.passive_units, scale.length_scale)


def _group_of_member(
    member: Member,
    loads: FloatArray,
    scale: ForceCoordinates,
    shared: FloatArray,
    mode: SlidingMode | None,
) -> CornerGroup:
    """Return the group of a member, with an empty list of corners: see `corner_groups`."""
    problem = member.problem
    if problem.cone_model.second_order:
        problem = problem.with_changes(cone="edges")  # inside the round cones
    coordinates = replace(scale, directions=force_coordinates(problem).directions)
    forces = force_rows(problem, coordinates)
    cones, lower_bounded = forces.cones, np.flatnonzero(forces.held_above_zero)
    rows = [cones.rows, forces.normal_rows, -forces.normal_rows[lower_bounded]]
    level = [cones.margin, np.ones(len(forces.normal_rows) + len(lower_bounded))]
    sides = [np.zeros(len(cones.rows)), forces.limit, np.zeros(len(lower_bounded))]
    kept = np.arange(forces.size)
    if mode is not None:
        columns, signs = coordinates.layout.friction_columns, mode.signs[coordinates.layout.cones]
        opposed = columns[signs != 0]
        rows.append(signs[signs != 0][:, None] * np.eye(forces.size)[opposed])
        level.append(np.zeros(len(opposed)))
        sides.append(np.zeros(len(opposed)))
        kept = np.setdiff1d(kept, columns[signs == 0])
    torque = forces.torque_rows[:, kept] / member.factors[:, None]
    effects = np.vstack([forces.balance_rows[:, kept], shared @ torque])
    inverse: FloatArray = np.asarray(np.linalg.pinv(effects, rcond=CANCELS), dtype=float)
    return CornerGroup(
        [], coordinates, kept, np.vstack(rows)[:, kept], np.concatenate(level),
        np.concatenate(sides), effects, inverse, torque, loads,
    )  # fmt: skip


_ACTIVE = 1e-3
"""Over the sum of all multipliers of a corner: rows with less do not count as active."""
_DIGITS = 3
"""Decimals of d to which members have to agree to count as one."""
_FAR = 1e6
"""Over the joint scale: torque limits from there on are no rows and are only checked at the end."""


def best_policy(
    corners: Sequence[Member],
    unknowns: Unknowns,
    objective: Margin | Torque,
    *,
    directions: FloatArray | None = None,
    modes: Sequence[SlidingMode | None] = (None,),
    limits: Limits = NO_LIMITS,
) -> tuple[ForcePolicy | None, list[int]]:
    """Return the best checked policy of affine forces over some modes; None: there is none.

    Args:
        corners: K members.
        unknowns: The figures d.
        objective: One of the paper's, without a regularisation.
        directions: (L, d) what feedback may add to commands, see `feedback_torques`.
        modes: Modes to search, each one for all forces; None is plain Coulomb friction.
        limits: When to stop.

    Returns:
        The best policy of all modes, and the numbers of unknowns that no forces balance in the last
        one, as along a motion that no contact resists: constant torques fit one load only there.
    """
    policies, free = list[ForcePolicy](), list[int]()
    for mode in modes:
        if limits.is_time_over:
            break
        program = _AffineProgram(corners, unknowns, objective, directions, mode)
        found, free = program.optimal_policy(limits), program.free
        policies += [] if found is None else [found]
    best = max if objective.maximizes else min
    return best(policies, key=lambda one: one.value(objective), default=None), free


class _AffineProgram:
    """The conic program of affine forces in one mode, and the policy that its solution states.

    Attributes:
        free: Numbers of unknowns that no forces balance, see `best_policy`.
    """

    def __init__(
        self,
        corners: Sequence[Member],
        unknowns: Unknowns,
        objective: Margin | Torque,
        directions: FloatArray | None,
        mode: SlidingMode | None,
    ) -> None:
        """Group the corners and scale their loads and commands.

        Args:
            corners: K members.
            unknowns: The figures d.
            objective: One of the paper's, without a regularisation.
            directions: (L, d) what feedback may add to commands, see `feedback_torques`.
            mode: The one mode of all forces; None: plain Coulomb friction.
        """
        first = corners[0].problem
        self.corners, self.unknowns, self.directions = corners, unknowns, directions
        self.objective = objective
        scale = force_coordinates(first, objective.required_margin)
        self.scale = scale
        shared = shared_commands(corners, directions)[0] * scale.joint_scale
        sizes = np.abs(shared).max(axis=1, initial=0.0)
        self.shared = shared / np.where(sizes > 0.0, sizes, 1.0)[:, None]
        self.groups = corner_groups(corners, unknowns, scale, self.shared, mode)
        still = np.zeros(first.joint_count)
        self.carried = np.array([one.commanded(still) for one in corners]) / scale.joint_scale
        wrenches = np.array([one.problem.external_wrench for one in corners])
        self.wrenches = -_balance_weights(corners[0], scale) * wrenches / scale.force_scale
        self.error_numbers = unknowns.of_errors
        self.joints = unknowns.joints[self.error_numbers]
        self.free = sorted({one for group in self.groups for one in self._unbalanced(group)})

    def optimal_policy(self, limits: Limits) -> ForcePolicy | None:
        """Solve the program and return its checked policy; None: there is none."""
        if self.free:
            return None
        self.conic = SparseConic()
        self._assemble()
        found = self.conic.solve(limits.seconds_left)
        return None if found is None else self._checked_policy(*found)

    def _sides(self, group: CornerGroup, errors: FloatArray) -> FloatArray:
        """Return (P + s, D) right-hand sides of the effects of each unknown; errors (L,) scaled."""
        commands = np.zeros((len(errors), len(self.unknowns.balls)))
        commands[self.joints, self.error_numbers] = errors[self.joints]
        return np.vstack([group.loads, self.shared @ commands])

    def _unbalanced(self, group: CornerGroup) -> list[int]:
        """Return the numbers of unknowns that no forces balance."""
        sides = self._sides(group, (self.unknowns.offsets > 0.0).astype(float))
        residual = np.abs(sides - group.effects @ (group.inverse @ sides)).max(axis=0, initial=0.0)
        tolerance = CANCELS * max(1.0, np.abs(sides).max(initial=0.0))
        return np.flatnonzero(residual > tolerance).tolist()

    def _assemble(self) -> None:
        built, unknowns, objective = self.conic, self.unknowns, self.objective
        count = len(self.groups[0].kept)
        self.f0 = [built.columns(count) for _ in self.corners]
        self.slope_columns = [[built.columns(count) for _ in unknowns.balls] for _ in self.groups]
        self.errors = built.columns(len(self.joints))
        margin: float | NDArray[np.int_]
        if isinstance(objective, Margin):
            margin = built.columns(1, cost=-1.0)
        else:
            margin = objective.required_margin / self.scale.force_scale
            self.largest = built.columns(1, cost=1.0)[0]
        self._add_balance()
        self.active: dict[int, NDArray[np.int_]] = {}
        for slopes, group in zip(self.slope_columns, self.groups, strict=True):
            self._add_cone_rows(group, slopes, margin)
            self._add_command_rows(group, slopes)

    def _add_balance(self) -> None:
        """Add balance and shared commands at d = 0, and the coefficients of each d, with errors."""
        passive = self.wrenches.shape[1]
        start = Entries.of(-self.groups[0].effects[passive:]).at(int(self.f0[0][0]))
        for slopes, group in zip(self.slope_columns, self.groups, strict=True):
            balance, torque = map(Entries.of, (group.effects[:passive], group.effects[passive:]))
            for number in group.corners:
                own = int(self.f0[number][0])
                self.conic.equal([balance.at(own)], self.wrenches[number])
                if number:
                    apart = self.carried[0] - self.carried[number]
                    self.conic.equal([torque.at(own), start], self.shared @ apart)
            effects = Entries.of(group.effects)
            sides = self._sides(group, np.zeros(len(self.scale.joint_scale)))
            for number, columns in enumerate(slopes):
                parts = [effects.at(int(columns[0]))]
                for error_index in np.flatnonzero(self.error_numbers == number):
                    error = np.zeros((len(sides), 1))
                    error[passive:, 0] = -self.shared[:, self.joints[error_index]]
                    parts.append(Entries.of(error).at(int(self.errors[error_index])))
                self.conic.equal(parts, sides[:, number])

    def _lengths(
        self,
        rows: Entries,
        count: int,
        slopes: list[NDArray[np.int_]],
        *,
        of_commands: bool,
    ) -> list[Entries]:
        """Add columns that bound the norms of the rows' coefficients from above, one for each ball.

        Args:
            rows: Entries of the rows.
            count: Number of rows.
            slopes: Columns of the coefficients.
            of_commands: Whether rows are those of joints, from which errors are subtracted.
        """
        added = []
        for ball in range(len(self.unknowns.words)):
            own = np.flatnonzero(self.unknowns.balls == ball)
            sizes = self.conic.columns(count)
            added.append(diagonal(sizes))
            inside = [rows.at(int(slopes[one][0])) for one in own]
            if len(own) > 1:
                self.conic.cones([diagonal(sizes, -1.0)], np.zeros(count), inside)
                continue
            parts = [inside[0]]
            erring = self.error_numbers == own[0]
            if of_commands and erring.any():
                parts.append(Entries(self.joints[erring], self.errors[erring], -np.ones(1)))
            for sign in (1.0, -1.0):
                signed = [one.at(0, times=sign) for one in parts]
                self.conic.below([*signed, diagonal(sizes, -1.0)], np.zeros(count))
        return added

    def _add_cone_rows(
        self, group: CornerGroup, slopes: list[NDArray[np.int_]], margin: float | NDArray[np.int_]
    ) -> None:
        """Keep the rows of a group's corners below their sides less the margin, for all d."""
        entries, sides, wide = Entries.of(group.rows), group.sides, list[Entries]()
        if isinstance(margin, np.ndarray):
            wide = [Entries.of(group.level[:, None]).at(int(margin[0]))]
        else:
            sides = sides - margin * group.level
        lengths = self._lengths(entries, len(sides), slopes, of_commands=False)
        for number in group.corners:
            parts = [entries.at(int(self.f0[number][0])), *wide, *lengths]
            self.active[number] = self.conic.below(parts, sides)

    def _add_command_rows(self, group: CornerGroup, slopes: list[NDArray[np.int_]]) -> None:
        """Bound commands by their limits and by t, and errors from below, for all d."""
        fed = self.directions is not None
        driven = group.corners if fed else [one for one in group.corners if one == 0]
        if not driven or not len(self.scale.joint_scale):
            return
        scale, torque = self.scale.joint_scale, group.torque
        lengths = (
            self._lengths(Entries.of(torque), len(scale), slopes, of_commands=True) if fed else []
        )
        loaded = torque.any(axis=1)
        shares = self.unknowns.shares[self.joints]
        offsets = -(self.unknowns.offsets / scale)[self.joints]

        def add_row(number: int, sign: float, joints: NDArray[np.int_], times: FloatArray,
                  side: FloatArray, more: list[Entries]) -> None:  # fmt: skip
            if not len(joints):
                return
            picked = Entries.of(times[:, None] * np.eye(len(scale))[joints])
            parts = [Entries.of(sign * times[:, None] * torque[joints]).at(int(self.f0[number][0]))]
            parts += [picked.at(int(one.columns[0])) for one in lengths]
            carried = sign * times * self.carried[number][joints]
            self.conic.below([*parts, *more], side - carried)

        for number in driven:
            own = self.corners[number].problem
            for sign, limit in ((1.0, own.upper_torque), (-1.0, -own.lower_torque)):
                # Limits far above the load spoil the scaling; they are checked at the end.
                joints = np.flatnonzero(loaded & (limit < _FAR * scale))
                add_row(number, sign, joints, np.ones(len(joints)), (limit / scale)[joints], [])
                add_row(number, sign, self.joints, shares, offsets, [diagonal(self.errors, -1.0)])
            if not isinstance(self.objective, Torque):
                continue
            for one in self.objective.sides(self.corners[0].problem, self.scale):
                more = [Entries.of(-one.level[:, None]).at(int(self.largest))]
                times = scale[one.joints] / one.unit
                add_row(number, one.sign, one.joints, times, np.zeros(len(times)), more)

    def _checked_policy(self, x: FloatArray, z: FloatArray) -> ForcePolicy | None:
        """Return the policy of a solver's answer, projected on the equalities; None: it fails."""
        joints, D = self.scale.joint_scale, self.unknowns.count
        base = np.array([x[one] for one in self.f0])
        first, passive = self.groups[0], self.wrenches.shape[1]
        balance = first.effects[:passive]
        base[0] += np.linalg.lstsq(balance, self.wrenches[0] - balance @ base[0])[0]
        start = self.shared @ (first.torque @ base[0] + self.carried[0])
        errors = np.zeros(len(joints))
        errors[self.joints] = x[self.errors]
        slopes = np.zeros((len(self.groups), base.shape[1], D))
        forces = np.zeros((len(base), self.corners[0].problem.contact_count, 3))
        spread = np.zeros((*forces.shape, D))
        active: list[tuple[float, int, FloatArray]] = []
        for number, group in enumerate(self.groups):
            F = np.array([x[one] for one in self.slope_columns[number]]).T
            slopes[number] = F + group.inverse @ (self._sides(group, errors) - group.effects @ F)
            for corner in group.corners:
                if corner:
                    commands = start - self.shared @ self.carried[corner]
                    sides = np.concatenate([self.wrenches[corner], commands])
                    base[corner] += group.inverse @ (sides - group.effects @ base[corner])
                forces[corner] = group.forces(base[corner])
                spread[corner] = np.stack([group.forces(one) for one in slopes[number].T], axis=-1)
                active += self._binding_members(corner, group.rows @ slopes[number], z)
        deviations = np.zeros((len(joints), D))
        deviations[self.joints, self.error_numbers] = (joints * errors)[self.joints]
        policy = ForcePolicy(
            tuple(self.corners), self.unknowns, read_only(forces), read_only(spread),
            read_only(deviations), self.directions, _distinct_members(active),
        )  # fmt: skip
        return policy if self._is_valid_policy(policy, base, slopes) else None

    def _binding_members(
        self, corner: int, rows: FloatArray, z: FloatArray
    ) -> list[tuple[float, int, FloatArray]]:
        """Return multiplier, corner and worst d of those rows (R, D) that bound the optimum."""
        weights = z[self.active[corner]]
        counts = np.flatnonzero(weights > _ACTIVE * max(float(weights.sum()), 1e-30))
        worst = self.unknowns.worst(rows[counts])
        return [(float(weights[one]), corner, d) for one, d in zip(counts, worst, strict=True)]

    def _is_valid_policy(self, policy: ForcePolicy, base: FloatArray, slopes: FloatArray) -> bool:
        """Return whether a policy keeps all constraints, evaluated anew for the worst d."""
        least = self.objective.required_margin - PRIMAL_TOLERANCE * self.scale.force_scale
        if not policy.residual() <= PRIMAL_TOLERANCE or policy.least_margin < least:
            return False
        for group, slope in zip(self.groups, slopes, strict=True):
            # Only these rows hold the signs that a mode requires of friction.
            violations = base[group.corners] @ group.rows.T - group.sides
            if (violations + self.unknowns.sizes_of(group.rows @ slope)).max() > PRIMAL_TOLERANCE:
                return False
        tolerance = PRIMAL_TOLERANCE * self.scale.joint_scale
        for number in policy.driven:
            problem, deviation = self.corners[number].problem, policy.rooms[number] - tolerance
            beyond = policy.commands[number] + deviation > problem.upper_torque
            if (beyond | (policy.commands[number] - deviation < problem.lower_torque)).any():
                return False
        return True


def _distinct_members(
    active: list[tuple[float, int, FloatArray]],
) -> tuple[tuple[int, FloatArray], ...]:
    """Return distinct members (corner, d), those with the largest sums of multipliers first."""
    if not active:
        return ()
    points = np.array([np.append(corner, d) for _, corner, d in active])
    _, first, owner = np.unique(
        points.round(_DIGITS), axis=0, return_index=True, return_inverse=True
    )
    sums = np.bincount(owner.ravel(), [weight for weight, _, _ in active])
    return tuple(active[place][1:] for place in first[np.argsort(-sums, kind="stable")])
