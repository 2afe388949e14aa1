"""Contact forces that are affine in what is not known, and what they prove of a whole set.

See Ben-Tal, Goryashko, Guslitzer and Nemirovski, "Adjustable robust solutions of uncertain linear
programs", Math. Program. 99, 2004.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
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
    """D figures d in a product of unit balls, and what they add to load and torques.

    A ball of one figure is an interval.

    Attributes:
        loads: (K, P, D) what 1 of each adds to the wrench of each corner, N and N m.
        moved: (9, D) what 1 of each adds to a corner's centre of mass, force and moment.
        nominal: What the nominal problem is, as a corner.
        balls: (D,) the ball of each; all of one ball stand side by side.
        joints: (D,) the joint whose torque it puts off, -1 where it is of the load.
        shares: (L,) of the largest |command| by which a joint's torque may be off.
        offsets: (L,) by which it may be off beside that, N m (N).
        words: What the balls are of, and (D,) sizes in words' units.
    """

    loads: FloatArray
    moved: FloatArray
    nominal: Corner
    balls: NDArray[np.int_]
    joints: NDArray[np.int_]
    shares: FloatArray
    offsets: FloatArray
    words: tuple[tuple[str, str], ...]
    sizes: FloatArray

    @property
    def count(self) -> int:
        """D."""
        return len(self.balls)

    def sizes_of(self, slopes: FloatArray) -> FloatArray:
        """Return (...,) the most that (..., D) slopes add for any d."""
        if not len(self.balls):
            return np.zeros(slopes.shape[:-1])
        starts = np.flatnonzero(np.diff(self.balls, prepend=-1))
        return np.sqrt(np.add.reduceat(slopes**2, starts, axis=-1)).sum(axis=-1)

    def worst(self, slopes: FloatArray) -> FloatArray:
        """Return (..., D) the d for which (..., D) slopes add that."""
        squares = slopes[..., None, :] ** 2 * (self.balls[:, None] == self.balls)
        lengths = np.sqrt(squares.sum(axis=-1))
        return np.divide(slopes, lengths, out=np.zeros_like(slopes), where=lengths > 0.0)

    def corner(self, corner: Corner | None, d: FloatArray) -> Corner:
        """Return what a corner is at d: pushed, and with its centre of mass elsewhere."""
        corner = corner or self.nominal
        off, force, moment = np.split(self.moved @ d, 3)
        return replace(
            corner,
            center_of_mass=read_only(corner.center_of_mass + off),
            force=read_only(corner.force + force),
            moment=read_only(corner.moment + moment),
        )

    def told(self, d: FloatArray) -> list[str]:
        """Return one d in words."""
        told = []
        for ball, (name, unit) in enumerate(self.words):
            own = self.balls == ball
            if np.abs(d[own]).max() > 1e-9:
                values = ", ".join(f"{x:+.3g}" for x in (self.sizes * d)[own].tolist())
                told.append(f"{name} [{values}] {unit}")
        return told


def unknowns_of(
    problem: QuasistaticProblem,
    uncertainty: Uncertainty,
    of_corners: Uncertainty,
    weight: Weight,
    corners: Sequence[Member],
) -> Unknowns:
    """Return what of a set is not in its corners.

    Args:
        problem: The nominal one.
        uncertainty: The set.
        of_corners: The part whose corners are looked at.
        weight: Which part of the load is weight.
        corners: K of them.
    """
    loads: list[FloatArray] = []
    moved: list[FloatArray] = []
    words: list[tuple[str, str]] = []
    balls: list[int] = []
    sizes: list[float] = []
    count, passive, zero = len(corners), problem.passive_count, np.zeros(3)
    nominal = Corner(0.0, zero, weight.down, zero, zero, np.zeros(problem.contact_count))

    def add(maps: FloatArray, first: int, named: tuple[str, str], scale: FloatArray, *,
            together: bool) -> None:  # fmt: skip
        """Add (K, P, 3) loads of three axes: those of a ball, or intervals that are not empty."""
        name, unit = named
        for axis in np.flatnonzero(scale):
            if not together or axis == 0:
                words.append((name if together else f"{name} {'xyz'[axis]}", unit))
            balls.append(len(words) - 1)
            sizes.append(float(scale[axis]))
            loads.append(scale[axis] * maps[:, :, axis])
            moved.append(scale[axis] * np.eye(9)[first + axis])

    for first, name, unit in ((0, "force", "N"), (3, "moment", "N m")):
        box, radius = getattr(uncertainty, name), getattr(uncertainty, f"{name}_radius")
        box = np.zeros(3) if getattr(of_corners, name).any() else box
        if box.any() or radius > 0.0:
            maps = np.broadcast_to(np.eye(6)[:, first : first + 3], (count, 6, 3))
            add(maps, 3 + first, (name, unit), box, together=False)
            beside = f"{name} beside" if box.any() else name
            add(maps, 3 + first, (beside, unit), np.full(3, radius), together=True)
    radius = uncertainty.center_of_mass_radius
    if radius > 0.0:
        maps = np.zeros((count, 6, 3))
        for number, one in enumerate(corners):
            at = one.corner or nominal
            maps[number, 3:] = np.cross(weight.axes.T, weight.pull(at.mass, at.down)).T
        add(maps, 0, ("centre of mass", "m"), np.full(3, radius), together=True)
    shares, offsets = errors_of(problem, uncertainty)
    if any(part.any() for part in errors_of(problem, of_corners)):
        shares, offsets = np.zeros_like(shares), np.zeros_like(offsets)
    joints = np.flatnonzero((shares > 0.0) | (offsets > 0.0))
    of_load = len(loads)
    for joint in joints.tolist():
        words.append((f"error of {problem.joint_names[joint]}", "of its largest"))
        balls.append(len(words) - 1)
        sizes.append(1.0)
        loads.append(np.zeros((count, passive)))
        moved.append(np.zeros(9))
    stacked = np.array(loads).reshape(len(loads), count, passive).transpose(1, 2, 0)
    of_joint = np.concatenate([np.full(of_load, -1), joints]).astype(int)
    return Unknowns(
        stacked, np.array(moved).reshape(-1, 9).T, nominal, np.array(balls, dtype=int), of_joint,
        shares, offsets, tuple(words), np.array(sizes),
    )  # fmt: skip


def extreme_members(
    corners: Sequence[Member], unknowns: Unknowns, of: Sequence[int] | None = None
) -> list[Member]:
    """Return corners at both ends of an unknown; without one, at ends of all of them at once.

    Args:
        corners: The corners.
        unknowns: What d is.
        of: Numbers of unknowns; None: ends of all, drawn from a seeded generator.
    """
    found, count = [], len(unknowns.balls)
    drawn = np.random.default_rng(0).choice([-1.0, 1.0], (_DRAWN, count))
    ends = unknowns.worst(drawn) if of is None else np.eye(count)[of]
    for (number, corner), d, sign in product(enumerate(corners), ends, (1.0, -1.0)):
        factors, offsets = corner.factors.copy(), corner.offsets.copy()
        of_joint = unknowns.joints >= 0
        joints, off = unknowns.joints[of_joint], sign * d[of_joint]
        factors[joints] += off * unknowns.shares[joints]
        offsets[joints] += off * unknowns.offsets[joints]
        wrench = corner.problem.external_wrench + unknowns.loads[number] @ (sign * d)
        found.append(_member_at(corner, unknowns, sign * d, wrench, factors, offsets))
    return found


def _member_at(
    member: Member,
    unknowns: Unknowns,
    d: FloatArray,
    wrench: FloatArray,
    factors: FloatArray,
    offsets: FloatArray,
) -> Member:
    """Return a member at d, under another wrench and with other errors of its joints."""
    return Member(
        under_load(member.problem, wrench, member.problem.gravity_torques),
        factors,
        offsets,
        _joined_words(member.words, unknowns.told(d)),
        unknowns.corner(member.corner, d),
    )


def _joined_words(words: str, told: list[str]) -> str:
    return ", ".join([*([] if words == "nominal" else [words]), *told]) or "nominal"


@dataclass(frozen=True, eq=False, repr=False)
class ForcePolicy(Brief):
    """Forces f_k + F_k d of each corner k: they prove torques for the whole set.

    All figures are in world axes. `residual`, `least_margin` and `max_torque` are what they prove,
    worked out from them for the worst d of each row.

    Attributes:
        corners: K members, at d = 0.
        unknowns: What d is.
        forces: (K, M, 3) f_k, N.
        slopes: (K, M, 3, D) F_k, N.
        errors: (L, D) by how much 1 of each puts torques off what is commanded, N m (N).
        directions: (L, d) what feedback may add to commands; None: nothing.
        active: Corner and d of members that the torques hardly serve, the most needed first.
    """

    corners: tuple[Member, ...]
    unknowns: Unknowns
    forces: FloatArray
    slopes: FloatArray
    errors: FloatArray
    directions: FloatArray | None
    active: tuple[tuple[int, FloatArray], ...]

    def commands(self, corner: int) -> tuple[FloatArray, FloatArray]:
        """Return (L,) commanded torques of a corner at d = 0, and (L, D) what d adds to them."""
        member = self.corners[corner]
        J = member.problem.J.T
        slopes = J @ self.slopes[corner].reshape(J.shape[1], -1)
        nominal = member.commanded(J @ self.forces[corner].ravel())
        return nominal, slopes / member.factors[:, None] - self.errors

    def added(self, corner: int) -> FloatArray:
        """Return (L,) the most that d adds to commands, N m (N); zero where none is fed back."""
        nominal, slopes = self.commands(corner)
        return np.zeros_like(nominal) if self.directions is None else self._sizes(slopes)

    def most(self, corner: int) -> FloatArray:
        """Return (L,) the largest |command| of each joint, N m (N)."""
        return np.abs(self.commands(corner)[0]) + self.added(corner)

    @property
    def max_torque(self) -> float:
        """The largest |command| in any member, N m or N."""
        driven = range(1 if self.directions is None else len(self.corners))
        return max(float(self.most(one).max(initial=0.0)) for one in driven)

    @property
    def least_margin(self) -> float:
        """The margin that the forces of all members keep, N."""
        return min(map(self.margin, range(len(self.corners))))

    def value(self, objective: Objective) -> float:
        """Return the worst value of one of the paper's objectives in any member, in its unit."""
        if objective.maximizes:
            return self.least_margin
        if not objective.by_limits:
            return self.max_torque
        return max(self._share(one) for one in range(len(self.corners)))

    def margin(self, corner: int) -> float:
        """Return the least margin over all d, N: of side faces, and of both ends of normal forces.

        The pyramids of the problem stand inside its round cones.
        """
        problem = self.corners[corner].problem
        faces = problem.H.T[problem.H.any(axis=0)]
        rows = np.vstack([faces, -problem.N.T, problem.N.T])
        zero = np.zeros(len(faces) + problem.contact_count)
        sides = np.concatenate([zero, problem.max_normal_force])
        slopes = rows @ self.slopes[corner].reshape(rows.shape[1], -1)
        return float((sides - rows @ self.forces[corner].ravel() - self._sizes(slopes)).min())

    def _share(self, corner: int) -> float:
        """Return the largest share of a joint's limit that is commanded."""
        problem, nominal = self.corners[corner].problem, self.commands(corner)[0]
        room = self.added(corner)
        most = 0.0
        for limit, torque in ((problem.upper_torque, nominal), (-problem.lower_torque, -nominal)):
            there = np.isfinite(limit) & (limit > 0.0)
            most = max(most, float(((torque + room)[there] / limit[there]).max(initial=0.0)))
        return most

    def _sizes(self, slopes: FloatArray) -> FloatArray:
        return self.unknowns.sizes_of(slopes)

    def residual(self) -> float:
        """Return what balance and shared commands are off by, of the load, for the worst d.

        Errors of torques that are smaller than they may be count as well.
        """
        first, worst = self.corners[0], 0.0
        units = coordinate_units(first.problem.scales, first.problem.passive_units)
        passive = first.problem.passive_count
        shared, _ = shared_commands(self.corners, self.directions)
        start = self.commands(0)[0]
        needed = np.zeros(len(start))
        for number, member in enumerate(self.corners):
            problem = member.problem
            nominal, slopes = self.commands(number)
            flat = self.slopes[number].reshape(3 * problem.contact_count, -1)
            off = np.concatenate([
                np.abs(problem.W @ self.forces[number].ravel() + problem.external_wrench)
                + self._sizes(problem.W @ flat + self.unknowns.loads[number]),
                np.abs(shared.T)
                @ (np.abs(shared @ (nominal - start)) + self._sizes(shared @ slopes)),
            ])  # fmt: skip
            worst = max(worst, float(np.abs(off / units).max()))
            most = self.most(number) if number == 0 or self.directions is not None else 0.0
            needed = np.maximum(needed, most)
        needed = self.unknowns.shares * needed + self.unknowns.offsets
        return max(
            worst, float(((needed - self.errors.sum(axis=1)) / units[passive:]).max(initial=0))
        )

    def critical(self, count: int) -> list[Member]:
        """Return members that need the torques most, and as many of the others far from each other.

        Args:
            count: Of the first.
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
        kept = list(range(min(count, len(loads))))
        points = np.array(loads).reshape(len(loads), -1)
        distances = np.full(len(loads), np.inf)
        while len(kept) < min(2 * count, len(loads)):
            for one in kept:
                distances = np.minimum(distances, np.linalg.norm(points - points[one], axis=1))
            kept.append(int(distances.argmax()))
        return [self.member(*self.active[one]) for one in kept]

    def member(self, corner: int, d: FloatArray) -> Member:
        """Return the member of a corner at d: errors are shares of what is commanded just there."""
        member, unknowns = self.corners[corner], self.unknowns
        factors, offsets = member.factors.copy(), member.offsets.copy()
        of = np.flatnonzero(unknowns.joints >= 0)
        joints, (nominal, slopes) = unknowns.joints[of], self.commands(corner)
        commanded = nominal[joints] + slopes[joints] @ d
        factors[joints] += unknowns.shares[joints] * d[of] * np.where(commanded < 0.0, -1.0, 1.0)
        offsets[joints] += unknowns.offsets[joints] * d[of]
        wrench = member.problem.external_wrench + unknowns.loads[corner] @ d
        return _member_at(member, unknowns, d, wrench, factors, offsets)
