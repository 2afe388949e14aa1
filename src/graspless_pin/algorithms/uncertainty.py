"""What is not known exactly of a problem, and the members of the set that prove something of it."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from itertools import product
from math import cos, pi, prod, sin
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.problem.matrices import wrench_map
from graspless_pin.problem.members import Corner, Member
from graspless_pin.records import Brief, changed
from graspless_pin.suggestions import names_in_words

MOST_MEMBERS = 20_000
"""Corners that a set may have before its hull."""
_SIDES = 12
"""Of the polygon around the circle of gravity's tilt: it is 3.5 % wider at its corners."""
_SAME = 1e-9
"""Of the load: directions in which loads differ by less are none."""
_OF_LOAD = "scales", "strictness", "limit_tolerances"
"""What is derived from a problem's load."""
_MOST_DIMENSIONS = 6
"""Of loads whose hull is taken; in more, it has nearly all of them."""

_WORDS = {
    "mass": ("mass", 100.0, "%"), "center_of_mass": ("centre of mass", 100.0, "cm"),
    "tilt": ("gravity's direction", 180.0 / pi, "deg"), "force": ("push", 1.0, "N"),
    "moment": ("moment", 1.0, "N m"), "friction": ("friction", 100.0, "%"),
    "torque": ("torques", 100.0, "%"), "torque_offset": ("torques", 1.0, "N m"),
    "effort": ("effort limits", 100.0, "%"),
}  # fmt: skip
"""Of each figure: what it is of, what it is multiplied by where it is printed, and the unit."""

Figures = FloatArray | Mapping[str, float]
"""One figure, one for each contact or joint, or some by name."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Uncertainty(Brief):
    """By how much a load, friction and motors may differ from what a problem says, each by itself.

    Attributes:
        mass: The object's may be smaller or larger by this share.
        center_of_mass: (3,) m, how far it may be off along each axis, of the object in a scene
            and of the world for arrays.
        tilt: rad, how far gravity may be off its direction, to all sides, links included.
        force: (3,) N on the centre of mass that may push along each world axis, either way.
        moment: (3,) N m about each world axis.
        friction: Shares by which coefficients may be smaller or larger: one, or (M,), or in a scene
            by hand link, support, ``hand``, ``supports`` or ``default``; of others nothing is off.
        torque: Shares by which joints may make less or more torque than commanded: one, or (L,), or
            in a scene by joint, finger or ``default``.
        torque_offset: N m (N) that may be added to each joint's torque, either way: likewise.
        effort: Shares of their limits that motors may lack: likewise.

    Raises:
        ArgumentError: If a figure is negative or not finite, a share 1 or more, or a tilt 45
            degrees or more.

    Examples:
        >>> from graspless_pin import Uncertainty, load_scene, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> unknown = Uncertainty(mass=0.2, center_of_mass=0.01)  # m
        >>> nominal = minimize_torque(problem, 0.1, static_friction="coulomb")
        >>> robust = minimize_torque(
        ...     problem, 0.1, static_friction="coulomb", uncertainty=unknown
        ... )
        >>> print(f"{nominal.max_torque:.3f} N m, for the whole set {robust.max_torque:.3f} N m")
        0.928 N m, for the whole set 1.125 N m
    """

    mass: float
    center_of_mass: FloatArray
    tilt: float
    force: FloatArray
    moment: FloatArray
    friction: Figures
    torque: Figures
    torque_offset: Figures
    effort: Figures

    def __init__(
        self,
        *,
        mass: float = 0.0,
        center_of_mass: ArrayLike = 0.0,
        tilt: float = 0.0,
        force: ArrayLike = 0.0,
        moment: ArrayLike = 0.0,
        friction: ArrayLike | Mapping[str, float] = 0.0,
        torque: ArrayLike | Mapping[str, float] = 0.0,
        torque_offset: ArrayLike | Mapping[str, float] = 0.0,
        effort: ArrayLike | Mapping[str, float] = 0.0,
    ) -> None:
        """Check the figures and copy them: see the attributes; one number stands for all axes."""
        shares = {"friction": friction, "torque": torque, "effort": effort}
        vectors = {"center_of_mass": center_of_mass, "force": force, "moment": moment}
        vars(self).update(
            mass=_share("mass", real_number("mass", mass, 0.0)),
            tilt=real_number("tilt", tilt, 0.0),
            torque_offset=_amounts("torque_offset", torque_offset),
            **{name: _amounts(name, value, shares=True) for name, value in shares.items()},
            **{name: _vector(name, value) for name, value in vectors.items()},
        )
        if self.tilt >= pi / 4.0:
            raise ArgumentError("tilt", f"is {self.tilt:.4g} rad; it must be below 45 degrees")

    def __str__(self) -> str:
        """Return what may be off, in words: ``mass ±20 %, centre of mass ±1 cm``."""
        told = []
        for name, (of, scale, unit) in _WORDS.items():
            value, sign = getattr(self, name), "-" if name == "effort" else "±"
            if isinstance(value, Mapping):
                each = [f"{key} {sign}{scale * one:.3g}" for key, one in value.items() if one]
            else:
                numbers = np.unique(value) if np.ptp(value) == 0.0 else np.ravel(value)
                each = [f"{sign}{scale * one:.3g}" for one in numbers if numbers.any()]
            told += [f"{of} {', '.join(each)} {unit}"] if each else []
        return "; ".join(told) if any(", " in one for one in told) else ", ".join(told) or "nothing"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the figures: arrays stay read-only."""
        return partial(Uncertainty, **vars(self)), ()

    @property
    def is_of_load(self) -> bool:
        """Whether anything but friction and motors is uncertain."""
        pushed = self.center_of_mass.any() or self.force.any() or self.moment.any()
        return bool(self.mass > 0.0 or self.tilt > 0.0 or pushed)

    def scaled(self, share: float) -> Uncertainty:
        """Return the set with all its figures times a share, about the same middle."""
        figures: dict[str, Any] = {
            name: {key: share * one for key, one in value.items()}
            if isinstance(value, Mapping)
            else share * value
            for name, value in vars(self).items()
        }
        return Uncertainty(**figures)

    def check(self, joints: Sequence[str], fingers: Sequence[str], bodies: Sequence[str]) -> None:
        """Refuse figures of joints, fingers and bodies that are not there.

        Raises:
            ArgumentError: Naming the key.
        """
        motors = "joint or finger", (*joints, *fingers, DEFAULT_GAIN)
        surfaces = "body", ("hand", "supports", *bodies, DEFAULT_GAIN)
        for name in ("friction", "torque", "torque_offset", "effort"):
            what, known = surfaces if name == "friction" else motors
            given = getattr(self, name)
            for key in given if isinstance(given, Mapping) else ():
                if key not in known:
                    raise ArgumentError(
                        f"{name}['{key}']", f"is no {what}; {names_in_words(key, known)}"
                    )


@dataclass(frozen=True, eq=False, repr=False)
class Weight(Brief):
    """Which part of a problem's load and torques is whose weight.

    Attributes:
        force: (3,) N, the object's weight.
        steady: (3,) N, what else is proportional to its mass, and does not turn with gravity.
        lever: (3,) m, from the reference point to the centre of mass.
        axes: (3, 3) columns: the axes of `Uncertainty.center_of_mass` in the world's.
        other: (6, 3) times a unit vector along gravity: the wrench of what else weighs.
        links: (L, 3) times that vector: the torques that carry the links; None: not known.
    """

    force: FloatArray
    steady: FloatArray
    lever: FloatArray
    axes: FloatArray
    other: FloatArray
    links: FloatArray | None

    @cached_property
    def down(self) -> FloatArray:
        """(3,) unit vector along gravity; zero where the object has no weight."""
        size = np.linalg.norm(self.force)
        return self.force / size if size > 0.0 else np.zeros(3)

    def wrench(self, mass: float, off: FloatArray, down: FloatArray) -> FloatArray:
        """Return the (6,) wrench of all weight under gravity along another vector.

        Args:
            mass: Share by which the object's is larger.
            off: (3,) m, how far its centre of mass is off, in `axes`.
            down: (3,) gravity over its nominal size, world axes.
        """
        force = (1.0 + mass) * (np.linalg.norm(self.force) * down + self.steady)
        at = self.lever + self.axes @ off
        return wrench_map(at[None]) @ force + self.other @ down


_NO_WEIGHT = Weight(np.zeros(3), np.zeros(3), np.zeros(3), np.eye(3), np.zeros((6, 3)), None)


def weight_of_arrays(problem: QuasistaticProblem) -> Weight:
    """Return the weight where a problem's external wrench is all that is known: it counts as such.

    Raises:
        ArgumentError: If the problem is not one of one free object, or has no force.
    """
    if problem.passive_count != 6 or problem.wrench_matrix is not None:
        raise ArgumentError(
            "uncertainty", "is of one free object, and the problem has a wrench_matrix"
        )
    force, moment = problem.external_wrench[:3], problem.external_wrench[3:]
    lever = np.cross(force, moment) / max(float(force @ force), np.finfo(float).tiny)
    links = None if problem.gravity_torques.any() else np.zeros((problem.joint_count, 3))
    return Weight(force, np.zeros(3), lever, np.eye(3), np.zeros((6, 3)), links)


def known_weight(
    problem: QuasistaticProblem, uncertainty: Uncertainty, weight: Weight | None
) -> Weight:
    """Return the weight that is given, or all of the external wrench where one is needed."""
    if weight is not None:
        return weight
    return weight_of_arrays(problem) if uncertainty.is_of_load else _NO_WEIGHT


def members_of(
    problem: QuasistaticProblem, uncertainty: Uncertainty, weight: Weight | None = None
) -> tuple[Member, ...]:
    """Return the members of a set of which all others are means, once each.

    Wrench and torques are multi-affine in mass, centre of mass, gravity's vector and pushes, so
    that those of a product of polytopes lie in the hull of its corners' (a polygon stands around
    the circle of tilts). Of static friction the lower end counts: each cone contains it. Kinetic
    coefficients of several contacts are intervals each by itself, of which corners are enough: with
    the others fixed, those for which forces exist are an interval.

    Args:
        problem: The nominal one.
        uncertainty: What is not known of it.
        weight: Which part of its load is weight; None: all of its external wrench.

    Raises:
        ArgumentError: If the set has too many corners, or asks for what the problem does not tell.
    """
    count, joints = problem.contact_count, problem.joint_count
    of_load = uncertainty.is_of_load
    weight = known_weight(problem, uncertainty, weight)
    friction = each_of("friction", uncertainty.friction, count, "contacts")
    factors = each_of("torque", uncertainty.torque, joints, "joints")
    offsets = each_of("torque_offset", uncertainty.torque_offset, joints, "joints")
    effort = each_of("effort", uncertainty.effort, joints, "joints")
    idle = ~problem.jacobian.any(axis=0)  # errors of these joints move no contact force
    factors, offsets = np.where(idle, 0.0, factors), np.where(idle, 0.0, offsets)
    sliding = np.flatnonzero(problem.is_sliding & (friction > 0.0))
    _check_size(uncertainty, friction[sliding], factors, offsets)
    ends = {
        "mass": _ends(np.array([uncertainty.mass])),
        "center_of_mass": _ends(uncertainty.center_of_mass),
        "tilt": gravities(weight, uncertainty.tilt),
        "force": _ends(uncertainty.force),
        "moment": _ends(uncertainty.moment),
        "friction": _ends(friction[sliding]),
        "torque": _ends(factors),
        "torque_offset": _ends(offsets),
    }
    less = np.where(problem.is_sliding, problem.friction, (1.0 - friction) * problem.friction)
    limits = (
        np.where(problem.lower_torque < 0.0, 1.0 - effort, 1.0) * problem.lower_torque,
        np.where(problem.upper_torque > 0.0, 1.0 - effort, 1.0) * problem.upper_torque,
    )
    base = problem.with_changes(friction=less, torque_limits=limits)
    apart = problem.external_wrench
    if of_load:
        apart = apart - weight.wrench(0.0, np.zeros(3), weight.down)
    links = np.zeros((joints, 3)) if weight.links is None else weight.links
    found: list[Member] = []
    for kinetic, factor in product(ends["friction"], ends["torque"]):
        own = base
        if kinetic.any():
            coefficients = less.copy()
            coefficients[sliding] *= 1.0 + kinetic
            own = base.with_changes(friction=coefficients)
        along, loads = np.zeros(count), []
        along[sliding] = kinetic
        for mass, off, down, force, moment, offset in product(
            *(ends[name] for name in ("mass", "center_of_mass", "tilt", "force", "moment")),
            ends["torque_offset"],
        ):
            wrench = apart
            if of_load:
                push = np.concatenate([force, moment])
                wrench = apart + weight.wrench(float(mass[0]), off, down) + push
            carried = problem.gravity_torques + links @ (down - weight.down)
            corner = Corner(float(mass[0]), off, down, force, moment, along)
            loads.append((wrench, carried, offset, corner))
        kept = _hull(problem, np.array([np.concatenate([w, g - o]) for w, g, o, _ in loads]))
        for wrench, carried, offset, corner in (loads[number] for number in kept):
            words = _words(problem, corner, corner.down - weight.down, factor, offset)
            words = _with_effort(words, effort)
            load = {"external_wrench": read_only(wrench), "gravity_torques": read_only(carried)}
            loaded = changed(own, *_OF_LOAD, **load)
            found.append(Member(loaded, 1.0 + factor, offset, words, corner))
    return tuple(found)


def nominal_member(problem: QuasistaticProblem) -> Member:
    """Return a problem as it is, as a member."""
    ones = np.ones(problem.joint_count)
    return Member(problem, ones, np.zeros_like(ones), "nominal")


def _hull(problem: QuasistaticProblem, loads: FloatArray) -> list[int]:
    """Return which loads (K, P + L) are corners of the hull of all."""
    forces, moments, joints = problem.scales
    sizes = np.concatenate([np.where(problem.passive_turns, moments, forces), joints])
    idle = ~problem.jacobian.any(axis=0)
    scaled = np.where(
        np.concatenate([np.zeros(problem.passive_count, dtype=bool), idle]), 0.0, loads / sizes
    )
    scaled, kept = np.unique(scaled.round(12), axis=0, return_index=True)
    _, shares, directions = np.linalg.svd(scaled - scaled.mean(axis=0), full_matrices=False)
    rank = int((shares > _SAME * np.sqrt(len(scaled))).sum())
    points = scaled @ directions[:rank].T
    if rank == 1:
        kept = kept[[int(points.argmin()), int(points.argmax())]]
    elif 1 < rank <= _MOST_DIMENSIONS and len(points) > rank + 1:
        # Loaded here: scenes have an `Uncertainty`, and are loaded without.
        from scipy.spatial import ConvexHull, QhullError

        with suppress(QhullError):  # nearly flat: all of them serve as well
            kept = kept[ConvexHull(points).vertices]
    return sorted(kept.tolist())


def gravities(weight: Weight, tilt: float) -> FloatArray:
    """Return corners of a prism around gravity's unit vector tilted to all sides, (K, 3).

    Args:
        weight: What weighs.
        tilt: rad, to all sides.

    Raises:
        ArgumentError: If nothing weighs, or it is not known what the links' weight does.
    """
    down = weight.down
    if tilt == 0.0:
        return down[None]
    if not down.any():
        raise ArgumentError("tilt", "needs gravity, and the object has no weight")
    if weight.links is None:
        raise ArgumentError(
            "tilt", "turns the links' weight, which arrays do not tell; ask it of a scene"
        )
    across = np.linalg.svd(down[None])[2][1:]
    angles = 2.0 * pi * np.arange(_SIDES) / _SIDES
    ring = (sin(tilt) / cos(pi / _SIDES)) * np.array([np.cos(angles), np.sin(angles)]).T @ across
    return np.concatenate([ring + height * down for height in (cos(tilt), 1.0)])


def _ends(halves: FloatArray) -> FloatArray:
    """Return the corners of a box about zero, without the directions in which it is flat."""
    wide = np.flatnonzero(halves)
    corners = np.zeros((2 ** len(wide), len(halves)))
    corners[:, wide] = list(product((-1.0, 1.0), repeat=len(wide)))
    return corners * halves


def _check_size(
    uncertainty: Uncertainty, kinetic: FloatArray, factors: FloatArray, offsets: FloatArray
) -> None:
    """Refuse sets with too many corners, before any of them is made."""
    boxes = {
        "mass": np.array([uncertainty.mass]), "center_of_mass": uncertainty.center_of_mass,
        "force": uncertainty.force, "moment": uncertainty.moment, "friction": kinetic,
        "torque": factors, "torque_offset": offsets,
    }  # fmt: skip
    counts = {name: 2 ** int(np.count_nonzero(box)) for name, box in boxes.items()}
    counts["tilt"] = 2 * _SIDES if uncertainty.tilt > 0.0 else 1
    corners = prod(counts.values())
    if corners > MOST_MEMBERS:
        told = ", ".join(f"{name} {count}" for name, count in counts.items() if count > 1)
        raise ArgumentError(
            "uncertainty",
            f"has {corners} corners ({told}); at most {MOST_MEMBERS} are looked at: let fewer "
            "joints or axes be uncertain, each of which doubles them",
        )


def _with_effort(words: str, effort: FloatArray) -> str:
    if not effort.any():
        return words
    lack = f"effort limits {-100.0 * effort.max():.3g} %"
    return lack if words == "nominal" else f"{words}, {lack}"


def _words(
    problem: QuasistaticProblem,
    corner: Corner,
    tilted: FloatArray,
    factor: FloatArray,
    offset: FloatArray,
) -> str:
    told = [f"mass {100.0 * corner.mass:+.3g} %"] if corner.mass else []
    for name, value, unit in (
        ("centre of mass", corner.center_of_mass, "m"), ("gravity", tilted, "of its size"),
        ("push", corner.force, "N"), ("moment", corner.moment, "N m"),
        ("kinetic friction", corner.kinetic[problem.is_sliding], "of each"),
    ):  # fmt: skip
        if value.any():
            told.append(f"{name} [{', '.join(f'{x:+.3g}' for x in value.tolist())}] {unit}")
    for value, scale, unit in ((factor, 100.0, " %"), (offset, 1.0, "")):
        named = [
            f"{joint} {scale * x:+.3g}{unit or f' {kind}'}"
            for joint, kind, x in zip(
                problem.joint_names, problem.joint_units, value.tolist(), strict=True
            )
            if x
        ]
        told += [f"torques of {', '.join(named)}"] if named else []
    return ", ".join(told) or "nominal"


def _vector(name: str, value: ArrayLike) -> FloatArray:
    return _positive(name, np.broadcast_to(finite_array(name, *_shaped(value, 3)), (3,)))


def _amounts(name: str, value: ArrayLike | Mapping[str, float], *, shares: bool = False) -> Figures:
    if isinstance(value, Mapping):
        named = {str(key): (f"{name}['{key}']", one) for key, one in value.items()}
        found = {key: real_number(*one, 0.0) for key, one in named.items()}
        return {key: _share(named[key][0], one) if shares else one for key, one in found.items()}
    amounts = _positive(name, finite_array(name, *_shaped(value, None)))
    if shares:
        _share(name, float(np.max(amounts, initial=0.0)))
    return amounts


def _shaped(value: ArrayLike, length: int | None) -> tuple[ArrayLike, tuple[int | None, ...]]:
    return value, (() if np.ndim(value) == 0 else (length,))


def _positive(name: str, value: FloatArray) -> FloatArray:
    if (value < 0.0).any():
        raise ArgumentError(name, f"is {value.min():.4g}; it must not be negative")
    return read_only(np.array(value))


def _share(name: str, value: float) -> float:
    if value >= 1.0:
        raise ArgumentError(name, f"is {value:.4g}, a share; it must be below 1")
    return value


def each_of(name: str, value: Figures, count: int, of: str) -> FloatArray:
    """Return a figure for each joint or contact.

    Raises:
        ArgumentError: If there are some for another number of them, or by name.
    """
    if isinstance(value, Mapping):
        raise ArgumentError(name, f"is by name, which scenes take; give one, or {count}, of {of}")
    if value.ndim and len(value) != count:
        raise ArgumentError(name, f"has {len(value)} entries, and there are {count} {of}")
    return np.broadcast_to(value, (count,))
