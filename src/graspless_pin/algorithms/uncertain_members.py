"""The members of an uncertain set that stand for all of it: the vertices of its boxes."""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from itertools import product
from math import cos, pi, prod, sin, tan

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.uncertainty import Uncertainty, each_of, polygon
from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only
from graspless_pin.problem.members import Corner, Member
from graspless_pin.problem.scales import coordinate_units
from graspless_pin.records import Brief, Record, changed

MOST_MEMBERS = 20_000
"""Largest number of corners of a set, before the convex hull of its loads is taken."""
MOST_ERRORS = 8
"""Largest number of torque errors beside balls whose corners are enumerated: no hull drops any."""
_SIDES = 12
"""Sides of the polygon around the circle of gravity's tilt: 3.5 % wider at its corners."""
_SAME = 1e-9
"""Over the load: loads that differ by less in a direction are the same in it."""
_OF_LOAD = "scales", "strictness", "limit_tolerances"
"""Attributes that are derived from a problem's load."""
_MOST_DIMENSIONS = 6
"""Largest dimension of loads whose hull is taken; in more, nearly all loads are its vertices."""


@dataclass(frozen=True, eq=False, repr=False)
class Weight(Record, Brief):
    """The parts of a problem's load and torques that are weight.

    Attributes:
        force: (3,) N, the object's weight.
        steady: (3,) N, further force in proportion to its mass, which does not turn with gravity.
        lever: (3,) m, from the reference point to the centre of mass.
        axes: (3, 3) columns: the axes of `Uncertainty.center_of_mass` in the world's.
        other: (6, 3) times a unit vector along gravity: the wrench of other weight.
        links: (L, 3) times that vector: the torques that carry the links; None: not known.
        mass: kg, the object's; NaN: not known.
    """

    force: FloatArray
    steady: FloatArray
    lever: FloatArray
    axes: FloatArray
    other: FloatArray
    links: FloatArray | None
    mass: float = math.nan

    @cached_property
    def down(self) -> FloatArray:
        """(3,) unit vector along gravity; zero where the object has no weight."""
        size = np.linalg.norm(self.force)
        return self.force / size if size > 0.0 else np.zeros(3)

    def wrench(self, mass: ArrayLike, off: FloatArray, down: FloatArray) -> FloatArray:
        """Return the (..., 6) wrench of all weight under gravity along another vector.

        Args:
            mass: (...,) share by which the object's mass is larger.
            off: (..., 3) m, displacement of its centre of mass, in `axes`.
            down: (..., 3) gravity over its nominal size, world axes.
        """
        pull = self.pull(mass, down)
        moment = np.cross(self.lever + off @ self.axes.T, pull)
        return np.concatenate([pull, moment], axis=-1) + down @ self.other.T

    def pull(self, mass: ArrayLike, down: FloatArray) -> FloatArray:
        """Return the (..., 3) force on the object's own centre of mass, see `wrench`."""
        more = 1.0 + np.asarray(mass)[..., None]
        return more * (np.linalg.norm(self.force) * down + self.steady)


_NO_WEIGHT = Weight(np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3), np.zeros((6, 3)), None)


def weight_of_arrays(problem: QuasistaticProblem) -> Weight:
    """Return the weight of a problem without a scene: all of its external wrench counts.

    Raises:
        ArgumentError: If the problem is not one of one free object, or has no force.
    """
    if problem.passive_count != 6 or problem.wrench_matrix is not None:
        raise ArgumentError(
            "problem", "has a wrench_matrix; an uncertainty requires one free object"
        )
    force, moment = problem.external_wrench[:3], problem.external_wrench[3:]
    lever = np.cross(force, moment) / max(float(force @ force), np.finfo(float).tiny)
    links = None if problem.gravity_torques.any() else np.zeros((problem.joint_count, 3))
    return Weight(force, np.zeros(3), lever, np.eye(3), np.zeros((6, 3)), links)


def known_weight(
    problem: QuasistaticProblem, uncertainty: Uncertainty, weight: Weight | None
) -> Weight:
    """Return the given weight; None: all of the external wrench, where a weight is needed."""
    if weight is not None:
        return weight
    return weight_of_arrays(problem) if uncertainty.is_of_load else _NO_WEIGHT


def mass_share(uncertainty: Uncertainty, weight: Weight) -> float:
    """Return the share by which an object's mass may be smaller or larger.

    Raises:
        ArgumentError: If kilograms are given and the mass is not known, or it may vanish.
    """
    if uncertainty.mass_offset == 0.0:
        return uncertainty.mass
    if math.isnan(weight.mass):
        raise ArgumentError(
            "mass_offset", "is in kg, but arrays do not state a mass; use a scene, or give mass"
        )
    share = uncertainty.mass + uncertainty.mass_offset / weight.mass
    if share >= 1.0:
        beside = f" together with a share of {uncertainty.mass:g}" if uncertainty.mass else ""
        raise ArgumentError(
            "uncertainty",
            f"mass_offset is {uncertainty.mass_offset:g} kg{beside}, but the object has "
            f"{weight.mass:.4g} kg and its mass must stay positive; give less",
        )
    return share


def members_of(
    problem: QuasistaticProblem, uncertainty: Uncertainty, weight: Weight | None = None
) -> tuple[Member, ...]:
    """Return the members of a set whose convex combinations are all others, once each.

    Wrench and torques are multi-affine in mass, centre of mass, gravity's vector and pushes, so
    their values on a product of polytopes lie in the hull of those at its corners (a polygon stands
    around the circle of tilts). Static friction has its lower end, whose cone all others contain.
    Kinetic coefficients are one interval for each contact, and corners are enough: with the others
    fixed, those for which forces exist are an interval. Balls are left out.

    Args:
        problem: The nominal one.
        uncertainty: The set.
        weight: Which part of its load is weight; None: all of its external wrench.

    Raises:
        ArgumentError: If the set has too many corners, or needs data that the problem lacks.
    """
    count, joints = problem.contact_count, problem.joint_count
    weight = known_weight(problem, uncertainty, weight)
    friction = each_of("friction", uncertainty.friction, count, "contacts")
    factors, offsets = errors_of(problem, uncertainty)
    effort = each_of("effort", uncertainty.effort, joints, "joints")
    sliding = np.flatnonzero(problem.is_sliding)
    _check_size(problem, uncertainty)
    ends = {
        "mass": _box_corners(np.array([mass_share(uncertainty, weight)])),
        "center_of_mass": _box_corners(uncertainty.center_of_mass),
        "tilt": gravities(weight, uncertainty.tilt),
        "force": _box_corners(uncertainty.force),
        "moment": _box_corners(uncertainty.moment),
        "friction": _box_corners(friction[sliding]),
        "torque": _box_corners(factors),
        "torque_offset": _box_corners(offsets),
    }
    less = np.where(problem.is_sliding, problem.friction, (1.0 - friction) * problem.friction)
    base = problem
    if friction.any() or effort.any():
        base = problem.with_changes(
            friction=less, torque_limits=_scale_limits(problem, 1.0 - effort)
        )
    kinetic_ends, factor_ends = ends.pop("friction"), ends.pop("torque")
    picked = np.indices([*map(len, ends.values())]).reshape(len(ends), -1)
    mass, off, down, force, moment, offset = (
        one[row] for one, row in zip(ends.values(), picked, strict=True)
    )
    mass = mass[:, 0]
    wrench, carried = _changed_loads(problem, weight, mass, off, down, np.hstack([force, moment]))
    points = np.hstack([wrench, carried - offset])
    if uncertainty.center_of_mass_radius > 0.0:  # equal loads may differ in their weight
        points = np.hstack([points, weight.pull(mass, down)])
    kept = _hull(problem, points)
    found: list[Member] = []
    for kinetic, factor in product(kinetic_ends, factor_ends):
        along, own = np.zeros(count), base
        if kinetic.any():
            along[sliding] = kinetic
            own = base.with_changes(friction=(1.0 + along) * less)
        for k in kept:
            corner = Corner(float(mass[k]), off[k], down[k], force[k], moment[k], along)
            kilograms = weight.mass if uncertainty.mass_offset > 0.0 else math.nan
            words = _member_words(problem, weight, corner, kilograms, factor, offset[k], effort)
            loaded = under_load(own, wrench[k], carried[k])
            found.append(Member(loaded, 1.0 + factor, offset[k], words, corner))
    return tuple(found)


def under_load(
    problem: QuasistaticProblem, wrench: FloatArray, carried: FloatArray
) -> QuasistaticProblem:
    """Return a problem under another load, without checking it anew.

    Args:
        problem: The problem.
        wrench: (P,) N and N m.
        carried: (L,) torques that carry the links, N m (N).
    """
    return changed(
        problem, *_OF_LOAD,
        external_wrench=read_only(wrench), gravity_torques=read_only(carried),
    )  # fmt: skip


def member_at(
    problem: QuasistaticProblem,
    weight: Weight,
    corner: Corner,
    factor: FloatArray,
    offset: FloatArray,
) -> Member:
    """Return the member of a problem with the deviations of a corner.

    Args:
        problem: The nominal one.
        weight: Which part of its load is weight.
        corner: Deviations of the load; its kinetic friction enters the member's words alone.
        factor: (L,) shares by which joints make more torque than is commanded.
        offset: (L,) torque errors on top, N m (N).
    """
    loaded = under_load(problem, *_load_of_corner(problem, weight, corner))
    words = _member_words(problem, weight, corner, math.nan, factor, offset)
    return Member(loaded, 1.0 + factor, offset, words, corner)


def scaled_member(
    member: Member,
    weight: Weight,
    uncertainty: Uncertainty,
    scaled: Callable[[str, ArrayLike], FloatArray],
) -> Member:
    """Return a member with the figures of another set; one that is no corner stays as it is.

    Args:
        member: The member.
        weight: Which part of its load is weight.
        uncertainty: The set of the member.
        scaled: Returns the figure in the other set, by name and value in this one; the signs of a
            corner's figures are kept.
    """
    before, problem = member.corner, member.problem
    if before is None:
        return member
    friction = each_of("friction", uncertainty.friction, problem.contact_count, "contacts")
    effort = each_of("effort", uncertainty.effort, problem.joint_count, "joints")
    kilograms = weight.mass if uncertainty.mass_offset > 0.0 else math.nan
    beside = 0.0 if math.isnan(kilograms) else uncertainty.mass_offset / kilograms
    beside = np.copysign(beside, before.mass)
    mass = scaled("mass", before.mass - beside) + scaled("mass_offset", beside)
    down, tilt = before.down, float(scaled("tilt", uncertainty.tilt))
    if uncertainty.tilt > 0.0:  # to the frustum around the other circle of tilts
        along = float(down @ weight.down)
        ring = int(along > cos(0.5 * uncertainty.tilt))
        (height, reach), (_, whole) = _rings(tilt)[ring], _rings(uncertainty.tilt)[ring]
        down = height * weight.down + reach / whole * (down - along * weight.down)
    # Static friction has its lower end, kinetic friction either end.
    off = np.where(problem.is_sliding, before.kinetic, -friction)
    more = scaled("friction", off)
    corner = Corner(
        float(mass), scaled("center_of_mass", before.center_of_mass), down,
        scaled("force", before.force), scaled("moment", before.moment),
        np.where(problem.is_sliding, more, 0.0),
    )  # fmt: skip
    shares = (1.0 - scaled("effort", effort)) / (1.0 - effort)
    load, known = (_load_of_corner(problem, weight, one) for one in (corner, before))
    changed_problem = problem.with_changes(
        friction=problem.friction / (1.0 + off) * (1.0 + more),
        torque_limits=_scale_limits(problem, shares),
        external_wrench=problem.external_wrench + (load[0] - known[0]),
        gravity_torques=problem.gravity_torques + (load[1] - known[1]),
    )
    factor, offset = scaled("torque", member.factors - 1.0), scaled("torque_offset", member.offsets)
    words = _member_words(problem, weight, corner, kilograms, factor, offset)
    return Member(changed_problem, 1.0 + factor, offset, words, corner)


def _scale_limits(problem: QuasistaticProblem, shares: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return torque limits times shares (L,), also above 1; those that exclude zero stay.

    Raises:
        ArgumentError: If nothing is left between them.
    """
    low, high = problem.lower_torque, problem.upper_torque
    weaker = np.where(low < 0.0, shares, 1.0) * low, np.where(high > 0.0, shares, 1.0) * high
    for joint in np.flatnonzero(weaker[0] > weaker[1]).tolist():
        name, unit = problem.joint_names[joint], problem.joint_units[joint]
        raise ArgumentError(
            "effort",
            f"is {1.0 - shares[joint]:g} and leaves no torque for joint {name!r}, whose limits are "
            f"{low[joint]:g} to {high[joint]:g} {unit}; give less, or limits nearer to zero",
        )
    return weaker


def _load_of_corner(
    problem: QuasistaticProblem, weight: Weight, corner: Corner
) -> tuple[FloatArray, FloatArray]:
    """Return wrench (P,) and torques that carry the links (L,) with a corner's deviations."""
    push = np.concatenate([corner.force, corner.moment])
    return _changed_loads(problem, weight, corner.mass, corner.center_of_mass, corner.down, push)


def _changed_loads(
    problem: QuasistaticProblem,
    weight: Weight,
    mass: ArrayLike,
    off: FloatArray,
    down: FloatArray,
    push: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Return wrenches (..., P) and torques that carry the links (..., L) with deviations (...,)."""
    wrench = problem.external_wrench + np.zeros((*np.shape(mass), 1))
    if problem.passive_count == 6:
        nominal = weight.wrench(0.0, np.zeros(3), weight.down)
        wrench = wrench + (weight.wrench(mass, off, down) - nominal) + push
    carried = problem.gravity_torques + np.zeros((*np.shape(mass), 1))
    if weight.links is not None:
        carried = carried + (down - weight.down) @ weight.links.T
    return wrench, carried


def errors_of(
    problem: QuasistaticProblem, uncertainty: Uncertainty
) -> tuple[FloatArray, FloatArray]:
    """Return (L,) shares and (L,) offsets, N m (N), by which torques of joints may be off.

    Errors of joints that move no contact are zero: they change no contact force.

    Raises:
        ArgumentError: If there are some for another number of joints, or by name.
    """
    joints, idle = problem.joint_count, ~problem.jacobian.any(axis=0)
    factors = each_of("torque", uncertainty.torque, joints, "joints")
    offsets = each_of("torque_offset", uncertainty.torque_offset, joints, "joints")
    return np.where(idle, 0.0, factors), np.where(idle, 0.0, offsets)


def part_of_corners(problem: QuasistaticProblem, uncertainty: Uncertainty) -> Uncertainty:
    """Return the part of a set whose corners are enumerated; forces are affine in the rest.

    That is all but balls if there are few corners. Else torque errors are left out first, then
    forces and moments along axes. A radius of the centre of mass stays, as it decides of which
    loads the hull is taken.

    Args:
        problem: The nominal one.
        uncertainty: The set.
    """
    part = changed(uncertainty, force_radius=0.0, moment_radius=0.0)
    errors = sum(map(np.count_nonzero, errors_of(problem, uncertainty)))
    corners = prod(_corner_counts(problem, part).values())
    if (errors > MOST_ERRORS and uncertainty.has_radii) or corners > MOST_MEMBERS:
        part = changed(part, torque=np.zeros(()), torque_offset=np.zeros(()))
        if prod(_corner_counts(problem, part).values()) > MOST_MEMBERS:
            part = changed(part, force=np.zeros(3), moment=np.zeros(3))
    return part


def nominal_member(problem: QuasistaticProblem) -> Member:
    """Return the member without deviations."""
    ones = np.ones(problem.joint_count)
    return Member(problem, ones, np.zeros_like(ones), "nominal")


def _hull(problem: QuasistaticProblem, loads: FloatArray) -> list[int]:
    """Return the indices of loads (K, P + L) on the hull of all; further columns are forces."""
    sizes = coordinate_units(problem.scales, problem.passive_units)
    further = np.full(loads.shape[1] - len(sizes), problem.scales.force)
    idle = np.zeros(loads.shape[1], dtype=bool)
    idle[problem.passive_count : len(sizes)] = ~problem.jacobian.any(axis=0)
    scaled = np.where(idle, 0.0, loads / np.concatenate([sizes, further]))
    scaled, kept = np.unique(scaled.round(12), axis=0, return_index=True)
    _, shares, directions = np.linalg.svd(scaled - scaled.mean(axis=0), full_matrices=False)
    rank = int((shares > _SAME * np.sqrt(len(scaled))).sum())
    points = scaled @ directions[:rank].T
    if rank == 1:
        kept = kept[[int(points.argmin()), int(points.argmax())]]
    elif 1 < rank <= _MOST_DIMENSIONS and len(points) > rank + 1:
        # Loaded here: scenes import this module without needing it.
        from scipy.spatial import ConvexHull, QhullError

        with suppress(QhullError):  # nearly flat: all of them serve as well
            kept = kept[ConvexHull(points).vertices]
    return sorted(kept.tolist())


def gravities(weight: Weight, tilt: float) -> FloatArray:
    """Return (K, 3) corners of a frustum around all tilted unit vectors of gravity.

    Its slanting faces touch the unit sphere where gravity is tilted most.

    Args:
        weight: Which part of the load is weight.
        tilt: Largest tilt to all sides, rad.

    Raises:
        ArgumentError: If the object has no weight, or the links' weight is not known.
    """
    down = weight.down
    if tilt == 0.0:
        return down[None]
    if not down.any():
        raise ArgumentError("tilt", "requires gravity, but the object has no weight")
    if weight.links is None:
        raise ArgumentError(
            "tilt", "turns the links' weight, which arrays do not state; use a scene"
        )
    across = np.linalg.svd(down[None])[2][1:]
    ring = polygon(_SIDES) @ across / cos(pi / _SIDES)
    return np.concatenate([reach * ring + height * down for height, reach in _rings(tilt)])


def _rings(tilt: float) -> tuple[tuple[float, float], tuple[float, float]]:
    """Return (height along gravity, radius) of both ends of that frustum."""
    return (cos(tilt), sin(tilt)), (1.0, tan(0.5 * tilt))


def _box_corners(halves: FloatArray) -> FloatArray:
    """Return the corners of a box about zero, without the directions in which it is flat."""
    wide = np.flatnonzero(halves)
    corners = np.zeros((2 ** len(wide), len(halves)))
    corners[:, wide] = list(product((-1.0, 1.0), repeat=len(wide)))
    return corners * halves


def _corner_counts(problem: QuasistaticProblem, uncertainty: Uncertainty) -> dict[str, int]:
    """Return the number of corners of each figure of a set, without its balls."""
    friction = each_of("friction", uncertainty.friction, problem.contact_count, "contacts")
    factors, offsets = errors_of(problem, uncertainty)
    boxes = {
        "mass": np.array([uncertainty.mass + uncertainty.mass_offset]),
        "center_of_mass": uncertainty.center_of_mass,
        "force": uncertainty.force, "moment": uncertainty.moment,
        "friction": friction[problem.is_sliding], "torque": factors, "torque_offset": offsets,
    }  # fmt: skip
    counts = {name: 2 ** int(np.count_nonzero(box)) for name, box in boxes.items()}
    return counts | {"tilt": 2 * _SIDES if uncertainty.tilt > 0.0 else 1}


def _check_size(problem: QuasistaticProblem, uncertainty: Uncertainty) -> None:
    """Refuse sets with too many corners, before these are made."""
    counts = _corner_counts(problem, uncertainty)
    corners = prod(counts.values())
    if corners > MOST_MEMBERS:
        listed = ", ".join(f"{name} {count}" for name, count in counts.items() if count > 1)
        raise ArgumentError(
            "uncertainty",
            f"has {corners} corners ({listed}); at most {MOST_MEMBERS} are supported: make fewer "
            "contacts or axes uncertain, each of which doubles the corners",
        )


def _member_words(
    problem: QuasistaticProblem,
    weight: Weight,
    corner: Corner,
    kilograms: float,
    factor: FloatArray,
    offset: FloatArray,
    effort: FloatArray | None = None,
) -> str:
    heavier = f"{100.0 * corner.mass:+.3g} %"
    if not math.isnan(kilograms):
        heavier = f"{corner.mass * kilograms:+.3g} kg ({heavier})"
    parts = [f"mass {heavier}"] if corner.mass else []
    for name, value, unit in (
        ("centre of mass", corner.center_of_mass, "m"),
        ("gravity", corner.down - weight.down, "of its size"), ("push", corner.force, "N"),
        ("moment", corner.moment, "N m"),
        ("kinetic friction", corner.kinetic[problem.is_sliding], "of each"),
    ):  # fmt: skip
        if value.any():
            parts.append(f"{name} [{', '.join(f'{x:+.3g}' for x in value.tolist())}] {unit}")
    for value, scale, unit in ((factor, 100.0, " %"), (offset, 1.0, "")):
        named = [
            f"{joint} {scale * x:+.3g}{unit or f' {kind}'}"
            for joint, kind, x in zip(
                problem.joint_names, problem.joint_units, value.tolist(), strict=True
            )
            if x
        ]
        parts += [f"torques of {', '.join(named)}"] if named else []
    if effort is not None and effort.any():
        parts.append(f"effort limits {-100.0 * effort.max():.3g} %")
    return ", ".join(parts) or "nominal"
