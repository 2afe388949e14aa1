"""Checks of the arguments of a `QuasistaticProblem`."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.bounds import (
    LARGEST_FRICTION,
    LARGEST_LOAD_OVER_LIMIT,
    MOST_CONE_EDGES,
    SMALLEST,
    SMALLEST_LOAD,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.intake.text import fault_of_name
from graspless_pin.problem.checks import (
    FREE_BODY,
    FloatArray,
    JointUnit,
    array_of_items,
    check_unit_rows,
    checked_inertia,
    checked_passive_units,
    checked_units,
    finite_array,
    read_only,
    refuse_first_bad,
    whole_number,
)
from graspless_pin.problem.cones import checked_cone, default_tangents

AT_REST = 1e-12
"""A contact with a sliding speed up to this does not slide, m/s."""
_LARGEST_COSINE = 1e-6
_ONE_MASS = 1e-9


def checked_arguments(
    positions: ArrayLike,
    normals: ArrayLike,
    external_wrench: ArrayLike,
    jacobian: ArrayLike | None,
    *,
    friction: ArrayLike,
    tangents: ArrayLike | None,
    sliding: ArrayLike | None,
    torque_limits: tuple[ArrayLike, ArrayLike],
    max_normal_force: ArrayLike,
    cone_edges: int,
    cone: str,
    joint_names: Sequence[str] | None,
    joint_units: Sequence[str] | None,
    gravity_torques: ArrayLike | None,
    object_inertia: ArrayLike | None,
    joint_inertia: ArrayLike | None,
    wrench_matrix: ArrayLike | None,
    passive_units: Sequence[str] | None,
) -> dict[str, Any]:
    """Return the attributes of a problem from the arguments of its constructor, checked.

    Raises:
        ArgumentError: Naming the argument, the index and the value that is wrong.
    """
    p = finite_array("positions", positions, (None, 3))
    m = len(p)
    if m == 0:
        raise ArgumentError("positions", "has no row; at least one contact is needed")
    n = finite_array("normals", normals, (m, 3))
    check_unit_rows("normals", n)
    matrix, kinds = _checked_coordinates(wrench_matrix, passive_units, m)
    wrench = _checked_wrench(external_wrench, len(kinds))
    rows = np.zeros((3 * m, 0)) if jacobian is None else jacobian
    jac = finite_array("jacobian", rows, (3 * m, None))
    count = jac.shape[1]
    mu = array_of_items("friction", friction, m)
    refuse_first_bad("friction", mu, ~(mu >= 0.0) | np.isinf(mu), "it must be finite and >= 0")
    refuse_first_bad(
        "friction", mu, mu > LARGEST_FRICTION, f"it must be from 0 to {LARGEST_FRICTION:g}"
    )
    t = _checked_tangents(tangents, n)
    v = _checked_sliding(sliding, n)
    lower, upper = _checked_limits(torque_limits, count)
    force = array_of_items("max_normal_force", max_normal_force, m)
    impossible = ~(force > 0.0) | np.isinf(force)
    refuse_first_bad("max_normal_force", force, impossible, "it must be finite and > 0")
    pull = wrench[[unit is JointUnit.FORCE for unit in kinds]]
    least = max(SMALLEST, float(np.abs(pull).max(initial=0.0)) / LARGEST_LOAD_OVER_LIMIT)
    too_small = f"it must be at least {least:g}: the external force is {pull.tolist()} N"
    refuse_first_bad("max_normal_force", force, force < least, too_small)
    weight = np.zeros(count) if gravity_torques is None else gravity_torques
    gravity = finite_array("gravity_torques", weight, (count,))
    return {
        "positions": p,
        "normals": n,
        "external_wrench": wrench,
        "jacobian": jac,
        "friction": mu,
        "tangents": t,
        "sliding": v,
        "lower_torque": lower,
        "upper_torque": upper,
        "max_normal_force": force,
        "cone_edges": whole_number("cone_edges", cone_edges, 3, MOST_CONE_EDGES),
        "cone": checked_cone(cone),
        "joint_names": _checked_names(joint_names, count),
        "joint_units": checked_units(joint_units, count),
        "gravity_torques": gravity,
        "wrench_matrix": matrix,
        "passive_units": kinds,
    } | _checked_inertias(object_inertia, joint_inertia, (len(kinds), count), free=matrix is None)


def _checked_coordinates(
    wrench_matrix: ArrayLike | None, passive_units: Sequence[str] | None, contacts: int
) -> tuple[FloatArray | None, tuple[JointUnit, ...]]:
    """Return the (P, 3M) matrix, or None, and the units of the P passive coordinates."""
    if wrench_matrix is None:
        kinds = checked_passive_units(passive_units, len(FREE_BODY))
        if kinds != FREE_BODY:
            raise ArgumentError(
                "passive_units",
                f"is {[str(unit) for unit in kinds]} without a wrench_matrix; there they are those "
                f"of one free object, {[str(unit) for unit in FREE_BODY]}",
            )
        return None, FREE_BODY
    matrix = finite_array("wrench_matrix", wrench_matrix, (None, 3 * contacts))
    if len(matrix) == 0:
        raise ArgumentError("wrench_matrix", "has no row; at least one coordinate is needed")
    return matrix, checked_passive_units(passive_units, len(matrix))


def _checked_inertias(
    of_object: ArrayLike | None,
    of_joints: ArrayLike | None,
    counts: tuple[int, int],
    *,
    free: bool,
) -> dict[str, Any]:
    """Return the given inertias by attribute; that of one free object must have a scalar mass."""
    checked, (passive, count) = {}, counts
    if of_object is not None:
        inertia = checked_inertia("object_inertia", of_object, passive, definite=True)
        mass = inertia[:3, :3]
        if free and np.abs(mass - mass[0, 0] * np.eye(3)).max() > _ONE_MASS * mass[0, 0]:
            raise ArgumentError(
                "object_inertia",
                f"has {mass.tolist()} for the mass; one free object has the same in all "
                "directions (others need a wrench_matrix)",
            )
        checked["object_inertia"] = inertia
    if of_joints is not None:
        checked["joint_inertia"] = checked_inertia("joint_inertia", of_joints, count)
    return checked


def _checked_wrench(external_wrench: ArrayLike, count: int) -> FloatArray:
    wrench = finite_array("external_wrench", external_wrench, (count,))
    if is_too_small(wrench):
        raise ArgumentError(
            "external_wrench",
            f"is {wrench.tolist()}; its largest entry must be 0 or at least {SMALLEST_LOAD:g}",
        )
    return wrench


def is_too_small(wrench: FloatArray) -> bool:
    """Return whether a wrench is not zero, but too small for double precision."""
    return bool(0.0 < np.abs(wrench).max() < SMALLEST_LOAD)


def _checked_tangents(tangents: ArrayLike | None, normals: FloatArray) -> FloatArray:
    """Return checked orthonormal (M, 3, 2) tangents; None: the default ones."""
    if tangents is None:
        return read_only(default_tangents(normals))
    t = finite_array("tangents", tangents, (len(normals), 3, 2))
    check_unit_rows("tangents", t.transpose(0, 2, 1))
    frames = np.concatenate([normals[:, :, None], t], axis=2)
    gram = np.abs(frames.transpose(0, 2, 1) @ frames - np.eye(3))
    cosine = np.maximum.reduce([gram[:, 0, 1], gram[:, 0, 2], gram[:, 1, 2]])
    if (cosine > _LARGEST_COSINE).any():
        index = int(np.argmax(cosine > _LARGEST_COSINE))
        raise ArgumentError(
            "tangents",
            f"at index {index} are {t[index].T.tolist()}: they must be orthogonal to each other "
            f"and to the normal {normals[index].tolist()} (largest cosine {cosine[index]:.3g})",
        )
    return t


def _checked_sliding(sliding: ArrayLike | None, normals: FloatArray) -> FloatArray:
    """Return checked (M, 3) tangential velocities, m/s; None: zeros."""
    v = finite_array("sliding", np.zeros_like(normals) if sliding is None else sliding,
                     (len(normals), 3))  # fmt: skip
    speed = np.linalg.norm(v, axis=1)
    normal = np.einsum("ij,ij->i", v, normals)
    bad = (speed > AT_REST) & (np.abs(normal) > _LARGEST_COSINE * speed)
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(
            "sliding",
            f"is {v[index].tolist()} at index {index} with normal component {normal[index]:.6g} "
            "m/s; a sliding velocity must be tangential",
        )
    return v


def _checked_limits(
    torque_limits: tuple[ArrayLike, ArrayLike], count: int
) -> tuple[FloatArray, FloatArray]:
    """Return (lower, upper), each (L,), from scalars or arrays."""
    try:
        lower_value, upper_value = torque_limits
    except (TypeError, ValueError):
        raise ArgumentError(
            "torque_limits", f"is {torque_limits!r}; it must be a pair (lower, upper)"
        ) from None
    lower = array_of_items("torque_limits lower", lower_value, count)
    upper = array_of_items("torque_limits upper", upper_value, count)
    bad = (lower > upper) | (lower == np.inf) | (upper == -np.inf)
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(
            "torque_limits",
            f"have lower {lower[index]} and upper {upper[index]} at index {index}; lower must not "
            "be above upper, and a torque between them must be finite",
        )
    return lower, upper


def _checked_names(names: Sequence[str] | None, count: int) -> tuple[str, ...]:
    """Return L checked distinct names; None: ``joint_1`` ... ``joint_L``."""
    if names is None:
        return tuple(f"joint_{i + 1}" for i in range(count))
    if isinstance(names, str) or not isinstance(names, Iterable):
        raise ArgumentError("joint_names", f"is {names!r}; it must be a sequence of names")
    checked = tuple(str(name) for name in names)
    for fault in filter(None, map(fault_of_name, checked)):
        raise ArgumentError("joint_names", fault)
    if len(checked) != count:
        raise ArgumentError(
            "joint_names", f"has {len(checked)} names; the jacobian has {count} columns"
        )
    if len(set(checked)) < count:
        repeated = {name for name in checked if checked.count(name) > 1}
        raise ArgumentError("joint_names", f"repeats {sorted(repeated)}; names must be distinct")
    return checked
