"""Uncertain sets of problems: figures that are not known exactly, and their usual units."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from enum import StrEnum
from functools import partial
from math import pi
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import FloatArray, finite_array, read_only, real_number
from graspless_pin.problem.fingers import DEFAULT_GAIN
from graspless_pin.records import Brief
from graspless_pin.suggestions import names_in_words

RADII = ("center_of_mass_radius", "force_radius", "moment_radius")
"""The figures that are radii of balls, which have no vertices."""
_WORDS = {
    "mass": ("mass", 100.0, "%"), "mass_offset": ("mass", 1.0, "kg"),
    "center_of_mass": ("centre of mass", 100.0, "cm"),
    "tilt": ("gravity's direction", 180.0 / pi, "deg"), "force": ("push", 1.0, "N"),
    "moment": ("moment", 1.0, "N m"),
    "center_of_mass_radius": ("centre of mass in any direction", 100.0, "cm"),
    "force_radius": ("push in any direction", 1.0, "N"),
    "moment_radius": ("moment about any axis", 1.0, "N m"),
    "contact_position": ("contact positions", 1000.0, "mm"), "friction": ("friction", 100.0, "%"),
    "torque": ("torques", 100.0, "%"), "torque_offset": ("torques", 1.0, "N m"),
    "effort": ("effort limits", 100.0, "%"),
}  # fmt: skip
"""By figure: the quantity in words, the factor to the printed unit, and that unit."""
_SIGNS = {"effort": "-", **dict.fromkeys((*RADII, "contact_position"), "up to ")}

Figures = FloatArray | Mapping[str, float]
"""One figure, one for each contact or joint, or figures by name."""
PairFigures = Figures | Mapping[str, float | Mapping[str, float]]
"""The same, or figures by pair of names."""


@dataclass(frozen=True, eq=False, repr=False, init=False)
class Uncertainty(Brief):
    """Bounds on how much load, friction and motors may differ from a problem, independently.

    Attributes:
        mass: Share by which the object's mass may be smaller or larger.
        mass_offset: kg by which it may be so on top of that share; for scenes, which have a mass.
        center_of_mass: (3,) m, how far the centre of mass may be off along each axis, of the object
            in a scene and of the world for arrays.
        tilt: rad, how far gravity may be tilted, to all sides, links included.
        force: (3,) N that may push along each world axis, either way, on the nominal centre of
            mass.
        moment: (3,) N m about each world axis, either way.
        center_of_mass_radius: m, how far the centre of mass may be off in any direction, on top of
            `center_of_mass`.
        force_radius: N on the centre of mass in any direction, on top of `force`.
        moment_radius: N m about any axis, on top of `moment`.
        contact_position: m, how far contacts may be off within their tangent planes: one, or (M,),
            or in a scene by hand link, support, ``hand``, ``supports`` or ``default``. Such members
            are sampled.
        friction: Shares by which coefficients may be smaller or larger: one, or (M,), or in a scene
            by hand link, support, material, pair of materials (``{"rubber": {"steel": 0.1}}``),
            ``hand``, ``supports`` or ``default``; others are exact.
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
    mass_offset: float
    center_of_mass: FloatArray
    tilt: float
    force: FloatArray
    moment: FloatArray
    center_of_mass_radius: float
    force_radius: float
    moment_radius: float
    contact_position: Figures
    friction: PairFigures
    torque: Figures
    torque_offset: Figures
    effort: Figures

    def __init__(
        self,
        *,
        mass: float = 0.0,
        mass_offset: float = 0.0,
        center_of_mass: ArrayLike = 0.0,
        tilt: float = 0.0,
        force: ArrayLike = 0.0,
        moment: ArrayLike = 0.0,
        center_of_mass_radius: float = 0.0,
        force_radius: float = 0.0,
        moment_radius: float = 0.0,
        contact_position: ArrayLike | Mapping[str, float] = 0.0,
        friction: ArrayLike | Mapping[str, float | Mapping[str, float]] = 0.0,
        torque: ArrayLike | Mapping[str, float] = 0.0,
        torque_offset: ArrayLike | Mapping[str, float] = 0.0,
        effort: ArrayLike | Mapping[str, float] = 0.0,
    ) -> None:
        """Check and copy the figures: see the attributes; one number stands for all axes."""
        vars(self).update(
            mass=_checked_share("mass", real_number("mass", mass, 0.0)),
            mass_offset=real_number("mass_offset", mass_offset, 0.0),
            tilt=real_number("tilt", tilt, 0.0),
            friction=_checked_amounts("friction", friction, shares=True, pairs=True),
            torque_offset=_checked_amounts("torque_offset", torque_offset),
            contact_position=_checked_amounts("contact_position", contact_position),
            torque=_checked_amounts("torque", torque, shares=True),
            effort=_checked_amounts("effort", effort, shares=True),
            center_of_mass=_nonnegative_array("center_of_mass", center_of_mass, 3),
            force=_nonnegative_array("force", force, 3),
            moment=_nonnegative_array("moment", moment, 3),
            center_of_mass_radius=real_number("center_of_mass_radius", center_of_mass_radius, 0.0),
            force_radius=real_number("force_radius", force_radius, 0.0),
            moment_radius=real_number("moment_radius", moment_radius, 0.0),
        )
        if self.tilt >= pi / 4.0:
            raise ArgumentError("tilt", f"is {self.tilt:.4g} rad; it must be below 45 degrees")

    def __str__(self) -> str:
        """Return what may be off, in words: ``mass ±20 %, centre of mass ±1 cm``."""
        parts = []
        for name, (of, scale, unit) in _WORDS.items():
            value, sign = getattr(self, name), _SIGNS.get(name, "±")
            if isinstance(value, Mapping):
                flat = _flat_figures(value)
                each = [f"{key} {sign}{scale * one:.3g}" for key, one in flat.items() if one]
            else:
                same = np.unique(value)
                numbers = same if len(same) == 1 else np.ravel(value)
                each = [f"{sign}{scale * one:.3g}" for one in numbers if numbers.any()]
            parts += [f"{of} {', '.join(each)} {unit}"] if each else []
        return "; ".join(parts) if any(", " in p for p in parts) else ", ".join(parts) or "nothing"

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the figures: arrays stay read-only."""
        return partial(Uncertainty, **vars(self)), ()

    @property
    def is_of_load(self) -> bool:
        """Whether anything but friction and motors is uncertain."""
        pushed = self.center_of_mass.any() or self.force.any() or self.moment.any()
        heavier = self.mass > 0.0 or self.mass_offset > 0.0
        return bool(heavier or self.tilt > 0.0 or pushed or self.has_radii)

    @property
    def has_radii(self) -> bool:
        """Whether any figure is the radius of a ball, which has no vertices."""
        return any(getattr(self, name) > 0.0 for name in RADII)

    def scaled(self, share: float) -> Uncertainty:
        """Return the set with all its figures times a share, about the same middle."""
        return Uncertainty(**_scaled_figures(vars(self), share))

    def check(
        self,
        joints: Sequence[str],
        fingers: Sequence[str],
        bodies: Sequence[str],
        materials: Sequence[str] = (),
        made: str = "",
    ) -> None:
        """Refuse figures of unknown joints, fingers, bodies and materials.

        Args:
            joints: Names of joints.
            fingers: Names of fingers.
            bodies: Names of links and supports.
            materials: Names in the table of pairs.
            made: Name of the object.

        Raises:
            ArgumentError: Naming the key.
        """
        motors = (*joints, *fingers, DEFAULT_GAIN)
        for name in ("torque", "torque_offset", "effort"):
            _check_names(name, getattr(self, name), "joint or finger", motors)
        places = ("hand", "supports", *bodies, DEFAULT_GAIN)
        _check_names("contact_position", self.contact_position, "body", places)
        if not isinstance(self.friction, Mapping):
            return
        surfaces = ("hand", "supports", *bodies, *materials, DEFAULT_GAIN)
        if made in self.friction and made not in surfaces:
            raise ArgumentError(
                f"friction['{made}']",
                "is the object, which takes part in every contact; use 'default' for all contacts",
            )
        what = "body or material" if materials else "body"
        for key, figure in self.friction.items():
            if isinstance(figure, Mapping):
                _check_names("friction", [key], "material", materials)
                _check_names(f"friction['{key}']", figure, "material", materials)
                for other, one in figure.items():
                    back = self.friction.get(other)
                    if isinstance(back, Mapping) and back.get(key, one) != one:
                        raise ArgumentError(
                            f"friction['{key}']['{other}']",
                            f"is {one:g}, but the reversed pair has {back[key]:g}; give the same "
                            "figure for both",
                        )
            else:
                _check_names("friction", [key], what, surfaces)


def _check_names(name: str, given: object, what: str, known: Sequence[str]) -> None:
    for key in given if isinstance(given, Mapping | list) else ():
        if key not in known:
            advice = names_in_words(key, known) if known else "there is none"
            raise ArgumentError(f"{name}['{key}']", f"is not a {what}; {advice}")


def _scaled_figures(figures: Mapping[str, Any], share: float) -> dict[str, Any]:
    return {
        name: _scaled_figures(value, share) if isinstance(value, Mapping) else share * value
        for name, value in figures.items()
    }


def _flat_figures(figures: Mapping[str, Any]) -> dict[str, float]:
    """Return all figures by name, pairs by ``one on other``."""
    pairs = {name: one for name, one in figures.items() if isinstance(one, Mapping)}
    alone = {name: one for name, one in figures.items() if name not in pairs}
    of_pairs = {f"{a} on {b}": one for a, each in pairs.items() for b, one in each.items()}
    return alone | of_pairs


def _checked_amounts(name: str, value: Any, *, shares: bool = False, pairs: bool = False) -> Any:
    if isinstance(value, Mapping):
        found: dict[str, Any] = {}
        for key, one in value.items():
            where = f"{name}['{key}']"
            if pairs and isinstance(one, Mapping):
                found[str(key)] = _checked_amounts(where, one, shares=shares)
                continue
            found[str(key)] = real_number(where, one, 0.0)
            if shares:
                _checked_share(where, found[str(key)])
        return found
    amounts = _nonnegative_array(name, value, None)
    if shares:
        _checked_share(name, float(np.max(amounts, initial=0.0)))
    return amounts


def _nonnegative_array(name: str, value: ArrayLike, count: int | None) -> FloatArray:
    """Return an array of `count` nonnegative figures; a single one is repeated."""
    given = finite_array(name, value, () if np.ndim(value) == 0 else (count,))
    if (given < 0.0).any():
        raise ArgumentError(name, f"is {given.min():.4g}; it must not be negative")
    return read_only(np.array(given if count is None else np.broadcast_to(given, (count,))))


def _checked_share(name: str, value: float) -> float:
    if value >= 1.0:
        meant = f"; {value:g} % is {value / 100.0:g}" if value < 100.0 else ""
        raise ArgumentError(name, f"is {value:.4g}, a share; it must be below 1{meant}")
    return value


def figures_in(figures: Figures) -> list[float]:
    """Return all figures as a list, without their names."""
    named = isinstance(figures, Mapping)
    return list(figures.values()) if named else np.ravel(figures).tolist()


def each_of(name: str, value: PairFigures, count: int, of: str) -> FloatArray:
    """Return a figure for each joint or contact.

    Raises:
        ArgumentError: If there are some for another number of them, or by name.
    """
    if isinstance(value, Mapping):
        raise ArgumentError(
            name,
            f"is given by name, which requires a scene; give one figure, or {count} for the {of}",
        )
    if value.ndim and len(value) != count:
        raise ArgumentError(name, f"has {len(value)} entries, but there are {count} {of}")
    return np.broadcast_to(value, (count,))


MOST_TILT = 0.6  # rad
"""How far gravity may be turned: larger tilts are not looked at."""


class Quantity(StrEnum):
    """What may be off. See the example of `tolerances`."""

    MASS_MORE = "more mass"
    MASS_LESS = "less mass"
    CENTER = "centre of mass"
    TILT = "gravity's direction"
    FRICTION = "friction"
    """Of each contact by itself: less at those that stick, either at those that slide."""
    PUSH = "push"
    MOMENT = "moment"
    TORQUE_MORE = "all torques larger"
    TORQUE_LESS = "all torques smaller"
    JOINT = "one joint's torque"

    @property
    def unit(self) -> str:
        """The usual unit; that of `Tolerance` is SI, or a share."""
        return _UNITS[self][1]

    @property
    def scale(self) -> float:
        """Factor from the unit of `Tolerance` to the usual one."""
        return _UNITS[self][0]


_UNITS = {
    Quantity.MASS_MORE: (100.0, "%"), Quantity.MASS_LESS: (100.0, "%"),
    Quantity.CENTER: (100.0, "cm"), Quantity.TILT: (180.0 / np.pi, "deg"),
    Quantity.FRICTION: (100.0, "%"), Quantity.PUSH: (1.0, "N"), Quantity.MOMENT: (1.0, "N m"),
    Quantity.TORQUE_MORE: (100.0, "%"), Quantity.TORQUE_LESS: (100.0, "%"),
    Quantity.JOINT: (1.0, "N m"),
}  # fmt: skip
"""By quantity: the factor to the shown unit, and that unit."""


def polygon(count: int) -> FloatArray:
    """Return unit vectors (K, 2) to the vertices of a regular polygon."""
    angles = 2.0 * pi * np.arange(count) / count
    return np.array([np.cos(angles), np.sin(angles)]).T
