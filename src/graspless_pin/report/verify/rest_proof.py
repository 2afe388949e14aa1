"""What a proof of rest in a document proves: smallest loads, then a certificate or a tree."""

from __future__ import annotations

from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.outcome import Check, holds, within
from graspless_pin.report.verify.rest_bounds import KnownStates, RestDynamics, largest_goal
from graspless_pin.report.verify.rest_load import RestLoad
from graspless_pin.report.verify.rest_tree import RestWalk, read_rest_multipliers, read_rest_tree
from graspless_pin.report.verify.values import MOST, entry, items, number, whole


def force_limit(proof: object, wanted: float) -> tuple[float, Check]:
    """Return the normal forces up to which a proof holds, N, and whether they are enough.

    None is stated where the proof leans on no limit: it has neither loads nor a tree.
    """
    stated, name = entry(proof, "force_limit", "proof of rest"), "force limit of the proof"
    if stated is None:
        leans = entry(proof, "loads", "proof") or entry(proof, "nodes", "proof of rest")
        detail = "none is stated, but the proof leans on one" if leans else "it leans on none"
        return wanted, holds(name, not leans, detail)
    limit = number(stated, "force_limit")
    detail = f"{limit:.6g} N, wanted {wanted:.6g} N"
    return limit, holds(name, limit >= (1.0 - tolerances.SAME) * wanted, detail)


def stated_loads(
    proof: Any, bodies: RestLoad, dynamics: RestDynamics | None, limit: float
) -> tuple[np.ndarray, list[Check]]:
    """Return the (M,) normal forces that every outcome has, N, and the checks of their proofs.

    Args:
        proof: As it stands in the document.
        bodies: With the load.
        dynamics: The equations of motion that the multipliers are of.
        limit: Normal forces that the proofs have to hold for, N.
    """
    loads, checks, count = bodies.commanded, list[Check](), bodies.problem.count
    for index, one in enumerate(items(entry(proof, "loads", "proof"), "loads", 0, MOST)):
        where = f"load {index} of the proof"
        if dynamics is None:
            raise ValueError(f"{where} needs inertias")
        contact = whole(entry(one, "contact", where), where, 0, count - 1)
        force, unit = number(entry(one, "force", where), where), dynamics.force_unit
        q = np.zeros((count, 3))
        q[contact, 0] = -1.0
        multipliers = read_rest_multipliers(entry(one, "multipliers", where), dynamics, where)
        states, goal = KnownStates.unknown(count), (np.zeros(len(dynamics.load)), q)
        found = -unit * largest_goal(
            dynamics, states, loads / unit, multipliers, goal, limit / unit
        )
        good = force <= found + tolerances.ARITHMETIC * bodies.undisturbed.force
        detail = f"stated {force:.9g}, proven {found:.9g} N"
        checks.append(holds(f"least normal force of contact {contact}", good, detail))
        if good:
            loads[contact] = max(loads[contact], min(force, found))
    return loads, checks


def certificate(
    name: str, bodies: RestLoad, forces: np.ndarray, loads: np.ndarray, limit: float
) -> Check:
    """Check that forces balance with no more friction than the loads of all outcomes bear.

    Args:
        name: Of the check.
        bodies: With the load.
        forces: (M, 3) in contact frames, N.
        loads: (M,) N.
        limit: Accelerations of points up to this count as rest, m/s^2.
    """
    unborne = np.linalg.norm(forces[:, 1:], axis=1) - bodies.problem.mu * loads
    unborne, pulling = np.maximum(unborne, 0.0), np.maximum(-forces[:, 0], 0.0)
    dynamics, size = bodies.dynamics, bodies.undisturbed.force
    if dynamics is None:
        worst = max(bodies.unbalanced(forces), unborne.max() / size, pulling.max() / size)
        return within(name, worst, tolerances.EXACT, "loads")
    rows, unit = dynamics.rows.astype(np.longdouble), dynamics.force_unit
    left = np.einsum("lin,li->n", rows, forces / unit) + dynamics.load
    sizes = np.einsum("lin,li->n", np.abs(rows), np.abs(forces) / unit) + np.abs(dynamics.load)
    y = float(np.linalg.norm(left) + tolerances.lost(sizes.sum()))
    y += float(unborne @ np.linalg.norm(dynamics.rows[:, 1:], ord=2, axis=(1, 2))) / unit
    y += float(pulling @ np.linalg.norm(rows[:, 0], axis=1)) / unit
    return within(name, y * dynamics.reach, limit, "m/s^2 at most")


def tree(
    name: str, proof: object, dynamics: RestDynamics, loads: np.ndarray, limits: tuple[float, float]
) -> Check:
    """Check a tree of contact states.

    Args:
        name: Of the check.
        proof: As it stands in the document.
        dynamics: The equations of motion.
        loads: (M,) normal forces that every outcome has, N.
        limits: Of accelerations, m/s^2, and of normal forces, N.
    """
    unit, (still, most_force) = dynamics.force_unit, limits
    walk = RestWalk(dynamics, loads / unit, most_force / unit)
    walk.walk(read_rest_tree(entry(proof, "nodes", "proof of rest"), dynamics))
    most = (still / dynamics.reach) ** 2
    proven = not walk.failure and walk.bound <= (1.0 + tolerances.SHARE) * most
    shown = f"{walk.leaves} leaves, power {walk.bound:.3g} of {most:.3g} (scaled)"
    return holds(name, proven, walk.failure or shown)
