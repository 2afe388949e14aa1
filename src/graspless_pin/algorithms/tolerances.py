"""Tolerances of given torques: how far each uncertain quantity may be off, in its own unit."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any, Unpack

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import ConvexHull

from graspless_pin.algorithms.attainable_tolerances import AttainableSearch, AttainableTolerance
from graspless_pin.algorithms.disturbances import disturbance_margin
from graspless_pin.algorithms.joined_optimum import member_margins
from graspless_pin.algorithms.options import SolveKeywords, SolveOptions
from graspless_pin.algorithms.robust_torques import Feedback, joint_stiffness
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.algorithms.tolerance_tables import Tolerance, Tolerances
from graspless_pin.algorithms.uncertain_members import (
    Weight,
    member_at,
    members_of,
    nominal_member,
    weight_of_arrays,
)
from graspless_pin.algorithms.uncertainty import MOST_TILT, Quantity, Uncertainty, polygon
from graspless_pin.errors import NoSolutionError
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.problem import QuasistaticProblem, checked_problem
from graspless_pin.problem.checks import FloatArray, finite_array, one_of, read_only
from graspless_pin.problem.members import Corner, Member, feedback_torques, under_commands
from graspless_pin.problem.scales import passive_levers
from graspless_pin.programs.objectives import Margin
from graspless_pin.solution.active_limits import limiting_contacts
from graspless_pin.tree_search import NO_LIMITS

_AT_LIMIT = 1e-4
"""Over a joint's torque: less slack counts as none."""
_CLOSE = 0.01
"""Relative width of brackets at which a search ends."""
_ROUNDS = 12
_FINE = 2e-5
"""The same where the joints at their limits have to be found."""
_AROUND = 16
"""Number of first directions in the plane."""
_CORNER_ROUNDS = 3
_DOUBLINGS = 20
"""Doublings of a torque error of the torques' own size until it counts as unlimited."""
_CERTAIN = 1e-6
"""Over the load: margins above minus this count as feasible."""


def tolerances(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    *,
    feedback: Feedback | None = None,
    weight: Weight | None = None,
    fingers: Mapping[str, str] = MappingProxyType({}),
    quantities: Collection[Quantity | str] = tuple(Quantity),
    attainable: bool = False,
    **options: Unpack[SolveKeywords],
) -> Tolerances:
    """Return how far mass, centre of mass, pushes, friction and torques may be off, one at a time.

    Torques stay as they are, contact forces are the best admissible ones. The loads and torques for
    which they exist are a convex set under plain Coulomb friction: rays find its boundary, and the
    hull of their ends is proven (Bretl and Lall, Testing Static Equilibrium for Legged Robots,
    2008). Friction and gravity's direction are found by bisection over `Uncertainty`.

    Args:
        problem: Contacts, load and joints.
        torques: (L,) motor torques, N m (N); those of joints that move no contact do not count.
        feedback: Joint stiffness that adds to the torques, N m/rad (N/m), or a controller.
        weight: Which part of the load is weight; None: all of the external wrench but a moment
            about its force.
        fingers: The finger of each joint that belongs to one, for a controller that names them.
        quantities: The quantities to look at; others take no time.
        attainable: Whether to find, too, how far each may be off if torques are chosen for it.
        options: See `SolveOptions.parse`; `time_limit` is that of all attainable ones together.

    Raises:
        ArgumentError: If an option is not known or a shape wrong.
        NoSolutionError: If no contact forces balance load and torques.

    Examples:
        >>> from graspless_pin import load_scene, minimize_torque, tolerances
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> torques = minimize_torque(problem, margin=0.5).torques
        >>> off = tolerances(problem, torques, static_friction="coulomb")
        >>> print(f"{100 * off.of('more mass').balanced:.0f} % more mass")
        93 % more mass
        >>> off = tolerances(
        ...     problem, torques, static_friction="coulomb", quantities=["push"], attainable=True
        ... )
        >>> given, attainable = off.of("push"), off.attainable[0]
        >>> print(f"push: {given.balanced:.1f} N; with torques for it {attainable.balanced:.0f} N")
        push: 3.2 N; with torques for it 8 N
    """
    checked_problem(problem)
    how = SolveOptions.parse(**options)
    named = [quantities] if isinstance(quantities, str) else quantities
    wanted = [Quantity(one_of([*Quantity], "quantities", one)) for one in named]
    if {*wanted} - {Quantity.FRICTION, Quantity.TILT}:
        how.rules.need_signs("tolerances")
    given = finite_array("torques", torques, (problem.joint_count,))
    weight = weight_of_arrays(problem) if weight is None else weight
    stiffness = joint_stiffness(problem, feedback, fingers)
    options.pop("time_limit", None)  # it limits the attainable ones alone
    search = _ToleranceSearch(problem, given, stiffness, SolveOptions.parse(**options), options)
    if search.is_unbalanced(0.0 * search.rest.external_wrench):
        raise NoSolutionError("No contact forces balance the load under these torques.")
    nominal = read_only(weight.wrench(0.0, np.zeros(3), weight.down)[:3].copy())
    each = tuple(search.tolerances_of(weight, wanted))
    found: list[AttainableTolerance] = []
    if attainable:
        chosen = AttainableSearch(problem, weight, stiffness, how)
        found = [chosen.find(one.quantity, one.balanced, given) for one in each]
    return Tolerances(problem, given, each, nominal, stiffness, search.convex, tuple(found))


class _ToleranceSearch:
    """Rays into the set of loads that contact forces balance, and bisections of other figures."""

    def __init__(
        self,
        problem: QuasistaticProblem,
        torques: FloatArray,
        stiffness: FloatArray | None,
        how: SolveOptions,
        options: SolveKeywords,
    ) -> None:
        self.problem, self.torques, self.how, self.options = problem, torques, how, options
        self.member, self.stiffness = nominal_member(problem), stiffness
        self.directions = feedback_torques(problem, stiffness)
        self.rest = under_commands(self.member, torques, self.directions)
        self.convex = how.rules.static_friction is StaticFriction.COULOMB

    def tolerances_of(self, weight: Weight, wanted: Collection[Quantity]) -> list[Tolerance]:
        """Return the tolerances of the wanted quantities, where the problem has them.

        Args:
            weight: Which part of the load is weight.
            wanted: The wanted quantities.
        """
        still, down, problem = np.zeros(3), weight.down, self.problem
        nominal = weight.wrench(0.0, still, down)
        heavier = self._passive_load(weight.wrench(1.0, still, down) - nominal)
        pushes = np.array([self._passive_load(one) for one in np.eye(6)])
        joints = np.flatnonzero(problem.jacobian.any(axis=0))
        tasks: dict[Quantity, Callable[[], Tolerance]] = {}
        if nominal[:3].any():
            level = np.linalg.svd(nominal[None, :3])[2][1:]
            off = [weight.wrench(0.0, weight.axes.T @ one, down) - nominal for one in level]
            tasks |= {
                Quantity.MASS_MORE: lambda: self._ray_tolerance(Quantity.MASS_MORE, heavier),
                Quantity.MASS_LESS: lambda: self._ray_tolerance(
                    Quantity.MASS_LESS, -heavier, most=1.0
                ),
                Quantity.CENTER: lambda: self._ball_tolerance(
                    Quantity.CENTER, level, np.array([self._passive_load(one) for one in off])
                ),
            }
        tasks |= {
            Quantity.PUSH: lambda: self._ball_tolerance(Quantity.PUSH, np.eye(3), pushes[:3]),
            Quantity.MOMENT: lambda: self._ball_tolerance(Quantity.MOMENT, np.eye(3), pushes[3:]),
        }
        if (problem.friction > 0.0).any():
            tasks[Quantity.FRICTION] = lambda: self._bisected_tolerance(
                Quantity.FRICTION, "friction", weight, 1.0
            )
        if nominal[:3].any() and weight.links is not None:
            tasks[Quantity.TILT] = lambda: self._bisected_tolerance(
                Quantity.TILT, "tilt", weight, MOST_TILT
            )
        if self.torques.any():
            more = self.torques[None]
            tasks |= {
                Quantity.TORQUE_MORE: lambda: self._error_tolerance(Quantity.TORQUE_MORE, more),
                Quantity.TORQUE_LESS: lambda: self._error_tolerance(
                    Quantity.TORQUE_LESS, -more, most=1.0
                ),
            }
        if len(joints):
            each = np.concatenate([np.eye(problem.joint_count)[joints]] * 2)
            each[len(joints) :] *= -1.0
            tasks[Quantity.JOINT] = lambda: self._error_tolerance(Quantity.JOINT, each)
        return [task() for quantity, task in tasks.items() if quantity in wanted]

    def is_unbalanced(self, load: FloatArray) -> bool:
        """Return whether no contact forces balance a load on top of the problem's own."""
        return not solve_problem(self._problem_under(load), Margin(), self.how).found

    def _problem_under(self, load: FloatArray) -> QuasistaticProblem:
        return self.rest.with_changes(external_wrench=self.rest.external_wrench + load)

    def _passive_load(self, wrench: FloatArray) -> FloatArray:
        return np.concatenate([wrench, np.zeros(self.rest.passive_count - len(wrench))])

    def _multiples(self, loads: FloatArray) -> FloatArray:
        """Return (K,) the largest balanced multiple of each load (K, Q); inf for a zero load."""
        length = self.rest.scales.length
        directions = loads / passive_levers(self.rest.passive_units, length)
        times, sizes = np.full(len(loads), np.inf), np.linalg.norm(directions, axis=1)
        some = sizes > 0.0
        if some.any():
            found = disturbance_margin(
                self.rest, directions=directions[some], characteristic_length=length, **self.options
            ).magnitudes
            is_some = found > _CERTAIN * self.problem.scales.force
            times[some] = np.where(is_some, found / sizes[some], 0.0)
        return times

    def _fields_at_end(self, load: FloatArray) -> dict[str, Any]:
        """Return `contacts`, `joints` and `deflection` at a load that is just balanced."""
        return self._limit_fields(self._problem_under((1.0 - _CERTAIN) * load))

    def _limit_fields(self, problem: QuasistaticProblem) -> dict[str, Any]:
        """Return `contacts`, `joints` and `deflection` at a problem that is just feasible."""
        found = solve_problem(problem, Margin(), self.how)
        if not found.found:
            return {"deflection": 0.0 if self.stiffness is None else np.nan}
        limits = limiting_contacts(found)
        contacts = tuple(sorted({contact for many in limits.values() for contact in many}))
        if self.stiffness is None:
            return {"contacts": contacts}
        rest, torques = found.problem, found.torques
        slack = np.minimum(rest.upper_torque - torques, torques - rest.lower_torque)
        full = slack <= _AT_LIMIT * np.maximum(np.abs(torques), self.problem.scales.joints)
        added, soft = np.abs(torques - self.torques), self.stiffness > 0.0
        return {
            "contacts": contacts,
            "joints": tuple(np.flatnonzero(full & soft).tolist()),
            "deflection": float((added[soft] / self.stiffness[soft]).max(initial=0.0)),
        }

    def _ray_tolerance(
        self, quantity: Quantity, load: FloatArray, most: float = np.inf
    ) -> Tolerance:
        times = float(self._multiples(load[None])[0])
        if times >= most:
            return self._unlimited_tolerance(quantity, most)
        return Tolerance(quantity, times, times, **self._fields_at_end(times * load))

    def _error_tolerance(
        self, quantity: Quantity, errors: FloatArray, most: float = np.inf
    ) -> Tolerance:
        """Return the tolerance to multiples of any of (k, L) torque errors.

        By rays without feedback. With feedback, limits bound the commands and not the torques that
        motors produce: such an error is no load, and its multiple is found by bisection.
        """
        if self.stiffness is None:
            return self._error_ray_tolerance(quantity, errors, most)

        def members(times: float) -> list[Member]:
            return [replace(self.member, offsets=times * one) for one in errors]

        end = most
        if np.isinf(most):
            end = float(self.problem.scales.joints.max()) if quantity is Quantity.JOINT else 1.0
            for _ in range(_DOUBLINGS):
                if self._worst_member(members(end))[0]:
                    break
                end *= 2.0
        low, high, worst = self._bracket(members, 0.0, end, _FINE)
        if np.isinf(high):
            return self._unlimited_tolerance(quantity, most)
        found: dict[str, Any] = {}
        # The end of the bracket may be infeasible within the tolerance.
        for inside in (_CERTAIN, 0.1 * _CLOSE, _CLOSE):
            one = members((1.0 - inside) * low)[worst]
            found = self._limit_fields(under_commands(one, self.torques, self.directions))
            if "contacts" in found:
                break
        if quantity is Quantity.JOINT:
            found["direction"] = read_only(errors[worst])
        return Tolerance(quantity, low, high, **found)

    def _error_ray_tolerance(
        self, quantity: Quantity, errors: FloatArray, most: float
    ) -> Tolerance:
        """Return the tolerance to multiples of errors (k, L) that are loads on the joints."""
        problems = [under_commands(self.member, self.torques + one) for one in errors]
        loads = np.array([one.external_wrench for one in problems]) - self.rest.external_wrench
        times = self._multiples(loads)
        worst = int(times.argmin())
        least = float(times[worst])
        if least >= most:
            return self._unlimited_tolerance(quantity, most)
        fields = self._fields_at_end(least * loads[worst])
        if quantity is Quantity.JOINT:
            fields["direction"] = read_only(errors[worst])
        return Tolerance(quantity, least, least, **fields)

    def _ball_tolerance(self, quantity: Quantity, axes: FloatArray, loads: FloatArray) -> Tolerance:
        """Return the tolerance to a change in any direction.

        Args:
            quantity: The quantity.
            axes: (k, 3) orthonormal directions of the change.
            loads: (k, Q) load of a unit change along each.
        """
        rays = polygon(_AROUND) if len(axes) == 2 else _cube_directions()
        times, balanced = self._multiples(rays @ loads), 0.0

        def add_rays(along: FloatArray) -> None:
            """Add the rays along further directions."""
            nonlocal rays, times
            more = along / np.linalg.norm(along, axis=1)[:, None]
            rays, times = np.vstack([rays, more]), np.append(times, self._multiples(more @ loads))

        for _ in range(_ROUNDS):
            least = float(times.min())
            if not least > _CERTAIN * float(times.max()):
                break  # in one direction no change is balanced
            sides = ConvexHull(times[:, None] * rays).equations
            balanced = float(-sides[:, -1].max())
            if balanced >= (1.0 - _CLOSE) * least:
                break
            # The nearest sides of the hull: further rays go through them.
            nearest = np.argsort(-sides[:, -1])[:8]
            nearest = nearest[-sides[nearest, -1] < (1.0 - _CLOSE) * least]
            add_rays(np.unique(sides[nearest, :-1].round(9), axis=0))
        for _ in range(_CORNER_ROUNDS if len(axes) == 2 else 0):
            add_rays(_possible_corners(times[:, None] * rays))
        worst = int(times.argmin())
        least = float(times[worst])
        return Tolerance(
            quantity,
            min(balanced, least) if self.convex else least,
            least,
            read_only(rays[worst] @ axes),
            boundary=read_only(times[:, None] * (rays @ axes)),
            **self._fields_at_end(least * (rays[worst] @ loads)),
        )

    def _bisected_tolerance(
        self, quantity: Quantity, name: str, weight: Weight, most: float
    ) -> Tolerance:
        """Return the tolerance to one figure of an `Uncertainty`."""

        def members(figure: float) -> tuple[Member, ...]:
            return members_of(self.problem, Uncertainty(**{name: figure}), weight)

        low, high, _ = self._bracket(members, 0.0, most)
        if np.isinf(high):
            return self._unlimited_tolerance(quantity, most)
        fields: dict[str, Any] = {}
        if quantity is Quantity.TILT:
            # The set has a polygon around the circle of tilts: what fails may be outside it.
            rays = polygon(_AROUND) @ np.linalg.svd(weight.down[None])[2][1:]
            _, high, worst = self._bracket(
                lambda tilt: self._tilted_members(weight, tilt, rays), low, most
            )
            fields = {"direction": read_only(rays[worst])} if np.isfinite(high) else {}
        if self.stiffness is not None:
            fields["deflection"] = np.nan
        return Tolerance(quantity, low, high, **fields)

    def _unlimited_tolerance(self, quantity: Quantity, most: float) -> Tolerance:
        """Return the tolerance of a quantity without a failing value up to its largest."""
        bend = np.inf if np.isinf(most) else np.nan
        return Tolerance(quantity, most, np.inf, deflection=0.0 if self.stiffness is None else bend)

    def _tilted_members(self, weight: Weight, tilt: float, rays: FloatArray) -> list[Member]:
        """Return members with gravity tilted towards each of (K, 3) directions normal to it."""
        zero, count = np.zeros(3), self.problem.contact_count
        no_errors = np.zeros(self.problem.joint_count)
        return [
            member_at(
                self.problem, weight,
                Corner(0.0, zero, np.sin(tilt) * ray + np.cos(tilt) * weight.down, zero, zero,
                       np.zeros(count)),
                no_errors, no_errors,
            )
            for ray in rays
        ]  # fmt: skip

    def _bracket(
        self,
        members: Callable[[float], Sequence[Member]],
        low: float,
        most: float,
        close: float = 0.5 * _CLOSE,
    ) -> tuple[float, float, int]:
        """Bisect between a feasible figure and the largest, to a share of the failing one.

        Returns:
            A feasible figure; one at which a member has no forces, inf where none fails; and the
            number of that member.
        """
        high = float(np.nextafter(most, 0.0))
        fails, worst = self._worst_member(members(high))
        if not fails:
            return most, np.inf, worst
        while high - low > close * max(high, 0.02 * most):
            middle = 0.5 * (low + high)
            fails, number = self._worst_member(members(middle))
            low, high, worst = (low, middle, number) if fails else (middle, high, worst)
        return low, high, worst

    def _worst_member(self, members: Sequence[Member]) -> tuple[bool, int]:
        """Return whether any member has no forces, and the number of that of least margin."""
        margins = member_margins(
            members, self.torques, self.how, NO_LIMITS, directions=self.directions
        )
        fails = not margins.min() >= -_CERTAIN * self.problem.scales.force
        return fails, int(margins.argmin())


def _possible_corners(ends: FloatArray) -> FloatArray:
    """Return possible corners of a convex region in the plane between its known points (K, 2).

    Between two neighbours a corner may be where the lines through each of them and its other
    neighbour meet.
    """
    around = ends[np.argsort(np.arctan2(ends[:, 1], ends[:, 0]))]
    before, first, second, after = (np.roll(around, k, axis=0) for k in (1, 0, -1, -2))
    size = float(np.abs(ends).max())
    side, after_side, chord = first - before, second - after, second - first
    turn = _cross_products(side, after_side)
    meet = np.abs(turn) > _CERTAIN * size**2
    share = np.divide(_cross_products(chord, after_side), turn, out=np.zeros_like(turn), where=meet)
    corners = first + share[:, None] * side
    meet &= (_cross_products(first, corners) > 0.0) & (_cross_products(corners, second) > 0.0)
    beyond = _cross_products(corners - first, chord) > _CLOSE * size * np.linalg.norm(chord, axis=1)
    return corners[meet & beyond]


def _cross_products(first: FloatArray, second: FloatArray) -> FloatArray:
    """Return the cross products of plane vectors (K, 2)."""
    return first[:, 0] * second[:, 1] - first[:, 1] * second[:, 0]


def _cube_directions() -> FloatArray:
    """Return 26 unit vectors: to the faces, edges and corners of a cube."""
    grid = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3), axis=-1).reshape(-1, 3)
    grid = grid[grid.any(axis=1)]
    return grid / np.linalg.norm(grid, axis=1)[:, None]
