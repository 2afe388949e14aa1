"""One load with the torques of a document: the equations of motion, and forces of rest."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.fields import Part, stacked
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.reading import stated_mass
from graspless_pin.report.verify.rest_bounds import (
    RestDynamics,
    commanded_contacts,
    contact_motion,
    force_motion,
    rest_dynamics,
)

LARGEST_FORCE = 1e6
"""Of the load: proofs have to hold for normal forces up to this."""


class RestLoad:
    """A load and torques on bodies whose inertias may be known.

    Attributes:
        problem: Contacts, joints and external wrench.
        load: (P + L,) external wrench, and torques less those that bear the links' weight.
        unit: (P + L,) unit of each entry of the load.
        undisturbed: The problem whose load all tolerances are relative to.
        inertia: (P + L, P + L) of object and joints; None where it is not known.
        hybrid: (L,) contact whose normal force a column commands; -1: a joint.
        joints_held: Whether joints keep their positions, whatever torques that takes.
        dynamics: The equations of motion; None without inertia, or where nothing accelerates.
    """

    def __init__(
        self,
        problem: Problem,
        load: np.ndarray,
        inertia: np.ndarray | None,
        hybrid: np.ndarray,
        undisturbed: Problem | None = None,
        *,
        joints_held: bool = False,
    ) -> None:
        """Set up the equations of motion."""
        self.joints_held = joints_held
        self.problem, self.load, self.inertia, self.hybrid = problem, load, inertia, hybrid
        self.undisturbed = problem if undisturbed is None else undisturbed
        self.unit = _load_units(problem)
        self.dynamics: RestDynamics | None = None
        if inertia is not None:
            self.dynamics = rest_dynamics(problem, load, inertia, hybrid)

    def with_joints_held(self) -> RestLoad:
        """Return the same bodies with joints that move no contact and bear no load."""
        load = np.concatenate([self.problem.w, np.zeros(len(self.problem.units))])
        problem = replace(self.problem, J=np.zeros_like(self.problem.J))
        hybrid = np.full_like(self.hybrid, -1)
        return RestLoad(problem, load, self.inertia, hybrid, joints_held=True)

    def changed(self, wrench: np.ndarray) -> RestLoad:
        """Return the same bodies with an additional external wrench (P,)."""
        more = np.concatenate([wrench, np.zeros(len(self.load) - len(wrench))])
        problem = replace(self.problem, w=self.problem.w + wrench)
        return RestLoad(problem, self.load + more, self.inertia, self.hybrid, self.undisturbed)

    def acceleration_limit(self, resolution: float) -> float:
        """Return the acceleration up to which points of the object count as at rest, m/s^2."""
        return resolution * self.load_over_mass(self.problem)

    def load_over_mass(self, problem: Problem) -> float:
        """Return a problem's load over the object's mass, m/s^2; NaN without inertia."""
        return float(np.nan) if self.inertia is None else problem.force / problem.mass(self.inertia)

    @property
    def commanded(self) -> np.ndarray:
        """(M,) normal forces that hybrid fingers command, N; zero elsewhere."""
        forces, columns = np.zeros(self.problem.count), np.flatnonzero(self.hybrid >= 0)
        forces[self.hybrid[columns]] = self.load[len(self.problem.w) + columns]
        return forces

    def local(self, forces: np.ndarray) -> np.ndarray:
        """(M, 3) forces of world axes in contact frames, N."""
        return np.einsum("lij,lj->li", self.problem.frames, forces)

    def unbalanced_load(self, local: np.ndarray) -> float:
        """Return the largest entry of G^T f + g, in loads; forces (M, 3) in contact frames."""
        no_error = np.zeros(len(self.load))
        off = self._residual_sizes(
            contact_motion(self.problem), local.astype(np.longdouble), no_error, no_error
        )
        return float((off / _load_units(self.undisturbed)).max())

    def _residual_sizes(
        self, motion: np.ndarray, local: np.ndarray, inertial: np.ndarray, size: np.ndarray
    ) -> np.ndarray:
        """(P + L,) bounds on the sizes of M a - G^T f - g, with the rounding error.

        Args:
            motion: (M, 3, P + L) G.
            local: (M, 3) forces in contact frames, N.
            inertial: (P + L,) M a.
            size: (P + L,) sum of the sizes of its terms.
        """
        motion = motion.astype(np.longdouble)
        residual = inertial - np.einsum("lik,li->k", motion, local) - self.load
        sizes = np.einsum("lik,li->k", np.abs(motion), np.abs(local)) + np.abs(self.load) + size
        return np.abs(residual) + tolerances.rounding_error(sizes)

    def motion_residual(self, local: np.ndarray, acceleration: np.ndarray) -> float:
        """Return the largest entry of M a - G^T f - g, in loads.

        Args:
            local: (M, 3) forces in contact frames, N.
            acceleration: (P + L,) of object and joints; hybrid fingers' own are ignored.
        """
        if self.inertia is None:
            return float(np.inf)
        passive = len(self.problem.w)
        kept = np.concatenate([np.ones(passive, dtype=bool), self.hybrid < 0])
        acceleration = np.where(kept, acceleration, 0.0).astype(np.longdouble)
        inertial, size = self.inertia @ acceleration, np.abs(self.inertia) @ np.abs(acceleration)
        residual = self._residual_sizes(force_motion(self.problem), local, inertial, size)
        units = _load_units(self.undisturbed)
        # A joint that reaches no contact moves by its weight.
        units[passive:] = np.maximum(units[passive:], np.abs(self.undisturbed.gravity))
        return float((residual / units)[kept].max())

    def kinetic_friction_error(self, local: np.ndarray) -> float:
        """Return the largest distance of friction from opposing the declared sliding, N."""
        along = np.einsum("lij,lj->li", self.problem.frames, self.problem.kinetic_directions)
        off = np.linalg.norm(local - local[:, :1] * along, axis=1)
        return float(off[self.problem.slides].max(initial=0.0))

    def rest_violation(self, local: np.ndarray) -> float:
        """Return the largest violation of rest by forces (M, 3) in contact frames, in loads."""
        size = self.undisturbed.force
        slip = np.linalg.norm(local[:, 1:], axis=1) - self.problem.mu * local[:, 0]
        outside = max(
            float(-local[:, 0].min()), float(slip.max()), self.kinetic_friction_error(local)
        )
        return max(self.unbalanced_load(local), outside / size)

    def least_unbalanced_load(self, z: np.ndarray, more: np.ndarray | float = 0.0) -> float:
        """Return a lower bound on the load that every choice of contact forces leaves, in loads.

        Args:
            z: (P + L,) scaled motion along which they all do work of one sign.
            more: (P + L,) addition to the load.
        """
        z = z / max(1.0, float(np.abs(z).sum()))
        motion, mu = z.astype(np.longdouble) * self.problem.force / self.unit, self.problem.mu
        acting = force_motion(self.problem).astype(np.longdouble)
        c, sizes = acting @ motion, np.abs(acting) @ np.abs(motion)
        gain = mu * np.linalg.norm(c[:, 1:], axis=1) - c[:, 0]
        gain = gain + tolerances.rounding_error(sizes[:, 0] + mu * sizes[:, 1:].sum(axis=1))
        load = z.astype(np.longdouble) * (self.load + more) / self.unit
        load_power = float(load.sum() - tolerances.rounding_error(np.abs(load).sum()))
        return load_power - LARGEST_FORCE * float(np.maximum(gain, 0.0).sum())


def _load_units(problem: Problem) -> np.ndarray:
    """(P + L,) unit of a problem's load in the balance and at each joint, N and N m.

    At a joint with next to no lever it is a small share of the largest load or weight at any joint.
    """
    joints = problem.joint_scale
    most = np.maximum(joints, np.abs(problem.gravity)).max(initial=0.0)
    least = tolerances.LEAST_TORQUE * most
    return np.concatenate([problem.passive_scale, np.maximum(joints, least)])


def read_load(document: object, problem: Problem) -> RestLoad:
    """Return the load of a document with its torques and inertias.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    stated, passive = problem.part(document), len(problem.w)
    motors, own = stacked(stated["joints"], "torque"), stated.get("object_inertia")
    load, joints = np.concatenate([problem.w, motors - problem.gravity]), len(motors)
    inertia, hybrid = np.zeros((len(load), len(load))), np.full(joints, -1)
    of_joints = stated.get("joint_inertia")
    if of_joints is not None:
        inertia[passive:, passive:] = of_joints
        hybrid = commanded_contacts(problem, of_joints)
    if own is None or (of_joints is None and joints):
        return RestLoad(problem, load, None, hybrid)
    inertia[:passive, :passive] = own
    size = np.sqrt(np.abs(np.outer(inertia.diagonal(), inertia.diagonal())))
    if (np.abs(inertia - inertia.T) > tolerances.SAME * size).any():
        raise ValueError("object_inertia and joint_inertia must be symmetric")
    if problem.stated_map is None:
        _check_mass(stated, own)
    return RestLoad(problem, load, inertia, hybrid)


def _check_mass(stated: Part, inertia: np.ndarray) -> None:
    """Refuse an object inertia whose mass depends on the direction, or is not the stated one.

    Raises:
        ValueError: Saying what it is instead.
    """
    mass, most = inertia[0, 0], tolerances.SAME * inertia[0, 0]
    if not mass > 0.0 or (np.abs(inertia[:3, :3] - mass * np.eye(3)) > most).any():
        raise ValueError("object_inertia must have the same positive mass in all directions")
    total = stated_mass(stated)
    if total is not None:
        total += sum(load["mass"] for load in stated.get("loads") or [])
        if abs(total - mass) > most:
            raise ValueError(
                f"object_inertia has the mass {mass:.6g} kg; object and loads have {total:.6g} kg"
            )
