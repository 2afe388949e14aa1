"""Affine policies: contact forces affine in the unknowns, and what they prove for a whole set.

See Ben-Tal, Goryashko, Guslitzer and Nemirovski, "Adjustable robust solutions of uncertain linear
programs", Math. Program. 99, 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from itertools import product

import numpy as np
from numpy.typing import NDArray

from graspless_pin.algorithms.uncertain_members import Weight, errors_of, under_load
from graspless_pin.algorithms.uncertainty import Uncertainty
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import Corner, Member, shared_commands
from graspless_pin.problem.scales import coordinate_units
from graspless_pin.programs.objectives import Objective
from graspless_pin.records import Brief

_DRAWN = 8


@dataclass(frozen=True, eq=False, repr=False)
class Unknowns(Brief):
    """D figures d in a product of unit balls, and their effects on load and torques.

    A ball of one figure is an interval.

    Attributes:
        loads: (K, P, D) change of the wrench of each corner per unit of each figure, N and N m.
        moved: (9, D) change of a corner's centre of mass, force and moment per unit of each figure.
        nominal: The nominal problem as a corner.
        balls: (D,) number of the ball of each figure; figures of one ball are adjacent.
        joints: (D,) joint whose torque error the figure is, -1 where it belongs to the load.
        shares: (L,) error of a joint's torque over its largest |command|.
        offsets: (L,) further error of the joint's torque, N m (N).
        words: Name and unit of each ball, in words.
    """

    loads: FloatArray
    moved: FloatArray
    nominal: Corner
    balls: NDArray[np.int_]
    joints: NDArray[np.int_]
    shares: FloatArray
    offsets: FloatArray
    words: tuple[tuple[str, str], ...]

    @property
    def count(self) -> int:
        """Number of figures, D."""
        return len(self.balls)

    @property
    def of_errors(self) -> NDArray[np.int_]:
        """Numbers of the figures that are errors of torques."""
        return np.flatnonzero(self.joints >= 0)

    def sizes_of(self, slopes: FloatArray) -> FloatArray:
        """Return (...,) the maximum of slopes . d over all d, for slopes (..., D)."""
        starts = np.flatnonzero(np.diff(self.balls, prepend=-1))
        return np.sqrt(np.add.reduceat(slopes**2, starts, axis=-1)).sum(axis=-1)

    def worst(self, slopes: FloatArray) -> FloatArray:
        """Return (..., D) the d that maximises slopes . d, for slopes (..., D)."""
        squares = slopes[..., None, :] ** 2 * (self.balls[:, None] == self.balls)
        lengths = np.sqrt(squares.sum(axis=-1))
        return np.divide(slopes, lengths, out=np.zeros_like(slopes), where=lengths > 0.0)

    def member(
        self, number: int, corner: Member, d: FloatArray, signs: FloatArray | float = 1.0
    ) -> Member:
        """Return the member of a corner at d: with its loads, centre of mass and torque errors.

        Args:
            number: Number of the corner.
            corner: The corner.
            d: (D,) figures.
            signs: Signs of the commands of the joints with errors, one for each of them.
        """
        problem, at, erring = corner.problem, corner.corner or self.nominal, self.of_errors
        factors, offsets = corner.factors.copy(), corner.offsets.copy()
        factors[self.joints[erring]] += self.shares[self.joints[erring]] * d[erring] * signs
        offsets[self.joints[erring]] += self.offsets[self.joints[erring]] * d[erring]
        wrench = problem.external_wrench + self.loads[number] @ d
        off, force, moment = np.split(self.moved @ d, 3)
        moved = replace(
            at,
            center_of_mass=read_only(at.center_of_mass + off),
            force=read_only(at.force + force),
            moment=read_only(at.moment + moment),
        )
        parts = [] if corner.words == "nominal" else [corner.words]
        words = ", ".join([*parts, *self._words_at(d)]) or "nominal"
        loaded = under_load(problem, wrench, problem.gravity_torques)
        return Member(loaded, factors, offsets, words, moved)

    def _words_at(self, d: FloatArray) -> list[str]:
        """Return d in words."""
        parts, values = [], np.where(self.joints < 0, self.moved.sum(axis=0), 1.0) * d
        for ball, (name, unit) in enumerate(self.words):
            own = self.balls == ball
            if np.abs(d[own]).max() > 1e-9:
                parts.append(f"{name} [{', '.join(f'{x:+.3g}' for x in values[own])}] {unit}")
        return parts


def unknowns_of(
    problem: QuasistaticProblem,
    uncertainty: Uncertainty,
    of_corners: Uncertainty,
    weight: Weight,
    corners: Sequence[Member],
) -> Unknowns:
    """Return the figures of a set that its corners leave out.

    Args:
        problem: The nominal one.
        uncertainty: The set.
        of_corners: The part of the set whose corners are enumerated.
        weight: Which part of the load is weight.
        corners: K corners.
    """
    zero = np.zeros(3)
    nominal = Corner(0.0, zero, weight.down, zero, zero, np.zeros(problem.contact_count))
    # For each: its first of the nine rows, name, unit, sizes along axes, and whether it is a ball.
    parts: list[tuple[int, str, str, FloatArray, bool]] = []
    for first, name, unit in ((3, "force", "N"), (6, "moment", "N m")):
        box = zero if getattr(of_corners, name).any() else getattr(uncertainty, name)
        radius = np.full(3, getattr(uncertainty, f"{name}_radius"))
        beside = f"{name} beside" if box.any() else name
        parts += [(first, name, unit, box, False), (first, beside, unit, radius, True)]
    radius = np.full(3, uncertainty.center_of_mass_radius)
    parts.append((0, "centre of mass", "m", radius, True))
    words, balls, moved = list[tuple[str, str]](), list[int](), list[FloatArray]()
    for first, name, unit, sizes, is_ball in parts:
        for axis in np.flatnonzero(sizes).tolist():
            if axis == 0 or not is_ball:
                words.append((name if is_ball else f"{name} {'xyz'[axis]}", unit))
            balls.append(len(words) - 1)
            moved.append(sizes[axis] * np.eye(9)[first + axis])
    shares, offsets = errors_of(problem, uncertainty)
    if any(part.any() for part in errors_of(problem, of_corners)):
        shares, offsets = np.zeros_like(shares), np.zeros_like(offsets)
    joints = np.flatnonzero((shares > 0.0) | (offsets > 0.0))
    of_joint = np.concatenate([np.full(len(balls), -1), joints]).astype(int)
    balls += range(len(words), len(words) + len(joints))
    words += [(f"error of {problem.joint_names[one]}", "of its largest") for one in joints]
    moves = np.zeros((9, len(balls)))
    moves[:, : len(moved)] = np.reshape(moved, (-1, 9)).T
    maps = np.zeros((len(corners), problem.passive_count, 9))
    if moved:  # only for one free object
        maps[:, :, 3:] = np.eye(6)
        for number, one in enumerate(corners):
            at = one.corner or nominal
            maps[number, 3:, :3] = np.cross(weight.axes.T, weight.pull(at.mass, at.down)).T
    return Unknowns(
        maps @ moves, moves, nominal, np.array(balls, dtype=int), of_joint, shares, offsets,
        tuple(words),
    )  # fmt: skip


def extreme_members(
    corners: Sequence[Member], unknowns: Unknowns, numbers: Sequence[int] | None = None
) -> list[Member]:
    """Return members of the corners at both ends of some unknowns, or at random extreme d.

    Args:
        corners: The corners.
        unknowns: The figures d.
        numbers: Unknowns, one at a time; None: all at once, drawn from a seeded generator.
    """
    drawn = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWN, unknowns.count))
    ends = unknowns.worst(drawn) if numbers is None else np.eye(unknowns.count)[numbers]
    return [
        unknowns.member(number, corner, sign * d)
        for (number, corner), d, sign in product(enumerate(corners), ends, (1.0, -1.0))
    ]


def far_apart(
    points: FloatArray, chosen: Sequence[int], count: int, distances: FloatArray | None = None
) -> list[int]:
    """Return numbers of points (K, n) that are far from each other: farthest-point sampling.

    The greedy choice of Gonzalez, Theor. Comput. Sci. 38, 1985.

    Args:
        points: The points.
        chosen: Numbers of the points to begin with.
        count: Number of points to choose, those included, unless there are fewer.
        distances: (K,) upper bounds on the distances to the chosen points; None: infinite.
    """
    to_chosen = np.full(len(points), np.inf) if distances is None else distances
    chosen, begin = [], list(chosen)
    while len(chosen) < min(count, len(points)):
        chosen.append(begin.pop(0) if begin else int(to_chosen.argmax()))
        to_chosen = np.minimum(to_chosen, np.linalg.norm(points - points[chosen[-1]], axis=1))
        to_chosen[chosen] = -1.0
    return chosen


@dataclass(frozen=True, eq=False, repr=False)
class ForcePolicy(Brief):
    """Forces f_k + F_k d of each corner k: they prove torques for the whole set.

    All figures are in world axes. `residual`, `least_margin` and `max_torque` hold for the whole
    set: each is evaluated for the worst d of each row.

    Attributes:
        corners: K members, at d = 0.
        unknowns: The figures d.
        forces: (K, M, 3) f_k, N.
        slopes: (K, M, 3, D) F_k, N.
        errors: (L, D) deviation of torques from commands per unit of each figure, N m (N).
        directions: (L, d) what feedback may add to commands; None: nothing.
        active: Corner and d of the members with active rows, the largest multipliers first.
    """

    corners: tuple[Member, ...]
    unknowns: Unknowns
    forces: FloatArray
    slopes: FloatArray
    errors: FloatArray
    directions: FloatArray | None
    active: tuple[tuple[int, FloatArray], ...]

    @cached_property
    def commands(self) -> FloatArray:
        """(K, L) commanded torques of each corner at d = 0, N m (N)."""
        each = zip(self.corners, self.forces, strict=True)
        return np.array([one.commanded(one.problem.J.T @ force.ravel()) for one, force in each])

    @cached_property
    def added(self) -> FloatArray:
        """(K, L, D) change of the commands per unit of each figure, N m (N)."""
        each = zip(self.corners, self._flat_slopes, strict=True)
        made = [one.problem.J.T @ slopes / one.factors[:, None] for one, slopes in each]
        return np.array(made) - self.errors

    @property
    def _flat_slopes(self) -> FloatArray:
        return self.slopes.reshape(len(self.corners), self.forces[0].size, self.unknowns.count)

    @cached_property
    def rooms(self) -> FloatArray:
        """(K, L) the largest change of commands over all d, N m (N); zero without feedback."""
        if self.directions is None:
            return np.zeros_like(self.commands)
        return self.unknowns.sizes_of(self.added)

    @property
    def driven(self) -> range:
        """Numbers of the corners whose commands count: without feedback, the first alone."""
        return range(1 if self.directions is None else len(self.corners))

    @property
    def largest_commands(self) -> FloatArray:
        """(L,) the largest |command| of each joint in any member, N m (N)."""
        return (np.abs(self.commands) + self.rooms)[self.driven].max(axis=0)

    @property
    def max_torque(self) -> float:
        """The largest |command| in any member, N m or N."""
        return float(self.largest_commands.max(initial=0.0))

    @property
    def least_margin(self) -> float:
        """The margin that the forces of all members keep, N."""
        return float(self.margins.min())

    def value(self, objective: Objective) -> float:
        """Return the worst value of one of the paper's objectives in any member, in its unit."""
        if objective.maximizes:
            return self.least_margin
        return self._largest_limit_share if objective.by_limits else self.max_torque

    @cached_property
    def margins(self) -> FloatArray:
        """(K,) the least margins over all d, N: of side faces, and of both ends of normal forces.

        The pyramids of the problem stand inside its round cones.
        """
        least = []
        for corner, force, slopes in zip(self.corners, self.forces, self._flat_slopes, strict=True):
            problem = corner.problem
            faces = problem.H.T[problem.H.any(axis=0)]
            rows = np.vstack([faces, -problem.N.T, problem.N.T])
            sides = np.zeros(len(rows))
            sides[-problem.contact_count :] = problem.max_normal_force
            slack = sides - rows @ force.ravel() - self.unknowns.sizes_of(rows @ slopes)
            least.append(slack.min())
        return np.array(least)

    @property
    def _largest_limit_share(self) -> float:
        """The largest share of a joint's limit that is commanded in any member."""
        largest = 0.0
        for number in self.driven:
            problem, nominal = self.corners[number].problem, self.commands[number]
            limits = (problem.upper_torque, nominal), (-problem.lower_torque, -nominal)
            for limit, torque in limits:
                limited = np.isfinite(limit) & (limit > 0.0)
                shares = (torque + self.rooms[number])[limited] / limit[limited]
                largest = max(largest, float(shares.max(initial=0.0)))
        return largest

    def residual(self) -> float:
        """Return the residual of balance and shared commands over the load, for the worst d.

        Torque errors below those that the set states count as a residual, too.
        """
        problem, unknowns = self.corners[0].problem, self.unknowns
        units = coordinate_units(problem.scales, problem.passive_units)
        shared, _ = shared_commands(self.corners, self.directions)
        wrenches = np.array([one.problem.external_wrench for one in self.corners])
        flat = self.forces.reshape(len(wrenches), -1)
        off = np.abs(flat @ problem.W.T + wrenches)
        off += unknowns.sizes_of(problem.W @ self._flat_slopes + unknowns.loads)
        mismatch = np.abs((self.commands - self.commands[0]) @ shared.T)
        mismatch = (mismatch + unknowns.sizes_of(shared @ self.added)) @ np.abs(shared)
        needed = unknowns.shares * self.largest_commands + unknowns.offsets
        shortfalls = (needed - self.errors.sum(axis=1)) / units[problem.passive_count :]
        worst = float((np.hstack([off, mismatch]) / units).max())
        return max(worst, float(shortfalls.max(initial=0.0)))

    def critical(self, count: int) -> list[Member]:
        """Return the members with the largest multipliers, and as many others far from each other.

        Args:
            count: Number of the former.
        """
        first = self.corners[0].problem
        units = coordinate_units(first.scales, first.passive_units)
        loads = [
            np.concatenate([
                self.corners[corner].problem.external_wrench + self.unknowns.loads[corner] @ d,
                self.errors @ d,
            ]) / units
            for corner, d in self.active
        ]  # fmt: skip
        kept = [*range(min(count, len(loads)))]
        chosen = far_apart(np.reshape(loads, (len(loads), -1)), kept, 2 * count)
        return [self.member(*self.active[number]) for number in chosen]

    def member(self, corner: int, d: FloatArray) -> Member:
        """Return the member of a corner at d, with errors as shares of the command at that d."""
        joints = self.unknowns.joints[self.unknowns.of_errors]
        commanded = self.commands[corner] + self.added[corner] @ d
        signs = np.where(commanded[joints] < 0.0, -1.0, 1.0)
        return self.unknowns.member(corner, self.corners[corner], d, signs)
