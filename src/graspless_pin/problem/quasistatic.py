"""The problem record: contacts, external wrench, joints and limits, and the paper's matrices.

Also `contact_map`, the Jacobian in contact frames, used by virtual motions and force programs.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.caching import Derived
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.arguments import AT_REST, checked_arguments
from graspless_pin.problem.checks import (
    FREE_BODY,
    FloatArray,
    JointUnit,
    read_only,
    real_array,
    squared_lengths,
    torque_mask,
)
from graspless_pin.problem.cone_model import ConeModel, Section
from graspless_pin.problem.cones import CONE_MODELS
from graspless_pin.problem.derived_inertias import INERTIAS, derived, keep_inertias
from graspless_pin.problem.matrices import block_diagonal, cone_blocks, wrench_map
from graspless_pin.problem.scales import (
    LIMIT_TOLERANCE,
    Scales,
    Strictness,
    scales_of,
    scales_of_matrix,
    strictness_of,
)
from graspless_pin.suggestions import what_to_pass


@dataclass(frozen=True, eq=False, init=False, repr=False)
class QuasistaticProblem:
    """Point contacts on one object, the wrench they must balance and the joints behind them.

    All vectors are in one set of world axes; positions, moments and the columns of `W` are about
    one reference point, the object's centre of mass by convention. Arrays are read-only copies.
    With a `wrench_matrix` any P passive coordinates replace the object's six: those of several
    objects (`body_wrench_matrix`), or of one on a rail. "The object" then means whatever these
    coordinates move.
    The letters are those of Makita and Maeda, *Joint Torque Optimization for Quasi-static
    Graspless Manipulation*; equation numbers are theirs.

    Attributes:
        positions: (M, 3) contact points P_l relative to the reference point, m.
        normals: (M, 3) unit normals n_l, into the object.
        external_wrench: (P,) load on the passive coordinates; [force; moment] on one free object,
            N and N m.
        jacobian: (3M, L) contact Jacobian with J^T f = tau, world axes; m/rad, m/m or 1.
        friction: (M,) Coulomb coefficients, static and kinetic.
        tangents: (M, 3, 2) unit tangents t_l1, t_l2.
        sliding: (M, 3) velocity of the object relative to the other body at each contact, m/s;
            a zero row is a contact that does not actually slide.
        lower_torque: (L,) smallest motor torque, N m (N for a linear or hybrid joint).
        upper_torque: (L,) largest motor torque.
        max_normal_force: (M,) f_n,max, N.
        cone_edges: Number r of edges of a friction cone.
        cone: Name of the model of friction cones: ``edges`` for these pyramids, ``round`` for the
            circumscribed round cones, or another of `problem.cones.CONE_MODELS`.
        joint_names: L names, the columns of `jacobian`.
        joint_units: L units of their torques.
        gravity_torques: (L,) torque g(q) that the motors bear besides the contacts: the motor's
            torque is J^T f + g(q).
        wrench_matrix: (P, 3M) the given map; None: `W` follows from the positions.
        passive_units: P units of the passive coordinates' loads.
        object_inertia: (P, P) the passive coordinates' inertia; the object's about the reference
            point, for [linear; angular] accelerations in world axes, kg, kg m and kg m^2; None: not
            known.
        joint_inertia: (L, L) joint-space inertia, kg m^2 (kg m, kg for prismatic joints); zero in a
            hybrid finger's row and column; None: not known.

    Examples:
        >>> from graspless_pin import QuasistaticProblem
        >>> feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]  # m
        >>> weight = [0.0, 0.0, -4.9, 0.0, 0.0, 0.0]  # N, N m
        >>> QuasistaticProblem(feet, [[0.0, 0.0, 1.0]] * 3, weight, friction=0.5)
        QuasistaticProblem(3 contacts, 0 sliding, 0 joints, 32 cone edges)
    """

    positions: FloatArray
    normals: FloatArray
    external_wrench: FloatArray
    jacobian: FloatArray
    friction: FloatArray
    tangents: FloatArray
    sliding: FloatArray
    lower_torque: FloatArray
    upper_torque: FloatArray
    max_normal_force: FloatArray
    cone_edges: int
    cone: str
    joint_names: tuple[str, ...]
    joint_units: tuple[JointUnit, ...]
    gravity_torques: FloatArray
    wrench_matrix: FloatArray | None = None
    passive_units: tuple[JointUnit, ...] = FREE_BODY
    object_inertia: FloatArray | None = derived("object_inertia")  # noqa: RUF009 - a descriptor
    joint_inertia: FloatArray | None = derived("joint_inertia")  # noqa: RUF009

    def __init__(
        self,
        positions: ArrayLike,
        normals: ArrayLike,
        external_wrench: ArrayLike,
        jacobian: ArrayLike | None = None,
        *,
        friction: ArrayLike,
        tangents: ArrayLike | None = None,
        sliding: ArrayLike | None = None,
        torque_limits: tuple[ArrayLike, ArrayLike] = (-10.0, 10.0),
        max_normal_force: ArrayLike = 50.0,
        cone_edges: int = 32,
        cone: str = "edges",
        joint_names: Sequence[str] | None = None,
        joint_units: Sequence[str] | None = None,
        gravity_torques: ArrayLike | None = None,
        object_inertia: ArrayLike | None = None,
        joint_inertia: ArrayLike | None = None,
        wrench_matrix: ArrayLike | None = None,
        passive_units: Sequence[str] | None = None,
    ) -> None:
        """Validate and freeze the arrays.

        Args:
            positions: (M, 3) m, about the reference point; beside a `wrench_matrix` they only tell
                where contacts are.
            normals: (M, 3) unit, into the object.
            external_wrench: (P,) load on the passive coordinates; without a `wrench_matrix` (6,)
                [force; moment] about the reference point, N and N m.
            jacobian: (3M, L) with J^T f = tau; None: no joint (L = 0).
            friction: Scalar or (M,), >= 0.
            tangents: (M, 3, 2) orthonormal pairs, orthogonal to the normals; None:
                t1 = normalize(n x e_y) (n x e_x where n is along y), t2 = n x t1.
            sliding: (M, 3) m/s, velocity of the object relative to the other body, tangential;
                None: no contact slides.
            torque_limits: (lower, upper), each scalar or (L,), N m; infinite means unlimited.
            max_normal_force: Scalar or (M,), > 0 and finite, N.
            cone_edges: Edges of each friction cone, >= 3; the first edge is along t1.
            cone: ``edges``, or ``round`` for Coulomb's cone itself, for which `cone_edges` counts
                in `C`, `H` and pictures only; or the name of another model.
            joint_names: L distinct names; None: ``joint_1`` ... ``joint_L``.
            joint_units: L units, ``N m`` or ``N``, of the torques; None: N m.
            gravity_torques: (L,) N m; None: zeros.
            object_inertia: (P, P) symmetric and positive definite, that of one free object about
                the reference point; only verdicts on what really happens need it.
            joint_inertia: (L, L) symmetric and positive semidefinite; likewise.
            wrench_matrix: (P, 3M) from contact forces to the generalised forces that they make on
                P passive coordinates, which no motor holds; None: W of eq. (7), of one free object.
                The transpose maps these coordinates' velocities to those at contacts.
            passive_units: P units, ``N`` or ``N m``, of the generalised forces; None: three of each
                for every free body, and P is a multiple of 6.

        Raises:
            ArgumentError: Naming the argument, the index and the value that is wrong.
        """
        values = checked_arguments(
            positions, normals, external_wrench, jacobian, friction=friction, tangents=tangents,
            sliding=sliding, torque_limits=torque_limits, max_normal_force=max_normal_force,
            cone_edges=cone_edges, cone=cone, joint_names=joint_names, joint_units=joint_units,
            gravity_torques=gravity_torques, object_inertia=object_inertia,
            joint_inertia=joint_inertia, wrench_matrix=wrench_matrix, passive_units=passive_units,
        )  # fmt: skip
        self.__dict__.update(values)

    def __getstate__(self) -> dict[str, Any]:
        """Return the fields only: cached properties are computed again after unpickling."""
        return {item.name: getattr(self, item.name) for item in fields(self)}

    def __repr__(self) -> str:
        """Return the numbers of contacts and joints, not the arrays."""
        given = self.wrench_matrix is not None
        passive = f"{self.passive_count} passive coordinates, " if given else ""
        return (
            f"QuasistaticProblem({self.contact_count} contacts, {int(self.is_sliding.sum())} "
            f"sliding, {passive}{self.joint_count} joints, "
            f"{self.cone_model.words(self.cone_edges)})"
        )

    def with_changes(self, **changes: Any) -> QuasistaticProblem:
        """Return the problem with some arguments replaced, validated anew.

        Args:
            changes: Arguments of the constructor by name. If the number of joints changes, missing
                `joint_units` mean N m for all torques, and a missing `joint_inertia` is unknown;
                likewise `passive_units` and `object_inertia` with the number of passive
                coordinates.

        Raises:
            ArgumentError: See the constructor. Other positions need another `wrench_matrix` where
                one was given.
        """
        names = [item.name for item in fields(self) if item.name not in INERTIAS]
        arguments = {name: getattr(self, name) for name in names}
        limits = arguments.pop("lower_torque"), arguments.pop("upper_torque")
        values: dict[str, Any] = {**arguments, "torque_limits": limits}
        known = [*values, *INERTIAS]
        unknown = sorted(set(changes) - set(known))
        if unknown:
            raise ArgumentError(unknown[0], f"is not an argument; known: {', '.join(known)}")
        columns: tuple[int, ...] = ()
        with suppress(ValueError):  # the constructor says that it is no matrix
            columns = np.shape(changes.get("jacobian", self.jacobian))[1:]
        if columns != (self.joint_count,):
            values["joint_units"] = None
        if "wrench_matrix" in changes:
            rows = 0
            with suppress(TypeError):  # the constructor says that it is no matrix
                rows = len(changes["wrench_matrix"])
            if rows != self.passive_count:
                values["passive_units"] = None
        elif "positions" in changes and self.wrench_matrix is not None:
            raise ArgumentError(
                "wrench_matrix",
                "was given for the old positions; give the matrix of the new positions, too, or "
                "None for that of one free object",
            )
        return keep_inertias(self, QuasistaticProblem(**{**values, **changes}), changes)

    @property
    def contact_count(self) -> int:
        """M, the number of contacts."""
        return len(self.positions)

    @property
    def joint_count(self) -> int:
        """L, the number of columns of `J`."""
        return self.jacobian.shape[1]

    @property
    def passive_count(self) -> int:
        """P, the number of passive coordinates: 6 for one free object."""
        return len(self.passive_units)

    @cached_property
    def passive_turns(self) -> NDArray[np.bool_]:
        """(P,) mask of the passive coordinates whose loads are in N m."""
        return torque_mask(self.passive_units)

    @property
    def cone_model(self) -> ConeModel:
        """The model of the friction cones."""
        return CONE_MODELS[self.cone]

    @property
    def cone_section(self) -> Section:
        """Cross-section of all cones where mu f_n is 1; for round cones an inscribed polygon."""
        return self.cone_model.section(self.cone_edges)

    @cached_property
    def scales(self) -> Scales:
        """Reference values of forces, lengths and torques of this problem, from its load."""
        load, given = self.external_wrench, self.wrench_matrix
        if given is None:
            return scales_of(self.positions, load, self.jacobian, self.max_normal_force)
        return scales_of_matrix(
            given, self.passive_units, load, self.jacobian, self.max_normal_force
        )

    @cached_property
    def limit_tolerances(self) -> tuple[FloatArray, FloatArray]:
        """Tolerances of the limits of each torque, (L,) N m (N), and normal force, (M,) N.

        A tolerance is 1e-6 of the limit, or of the load's effect there if that is smaller; see
        `docs/limits.md`.
        """
        strict, (force, _, joints) = self.strictness, self.scales
        if strict is None:
            torque, normal = joints, np.full(self.contact_count, force)
        else:
            torque, normal = joints / strict.torque, force / strict.normal
        return read_only(LIMIT_TOLERANCE * torque), read_only(LIMIT_TOLERANCE * normal)

    @cached_property
    def strictness(self) -> Strictness | None:
        """Factors by which tolerances of limits are smaller than the balance's; None: none is."""
        return self.strictness_in(self.scales)

    def strictness_in(self, scales: Scales) -> Strictness | None:
        """Return the `strictness` in other scales than the problem's."""
        return strictness_of(
            scales, self.lower_torque, self.upper_torque, self.joint_units, self.max_normal_force
        )

    @cached_property
    def is_sliding(self) -> NDArray[np.bool_]:
        """(M,) d_l of eq. (2): contacts in actual sliding."""
        return squared_lengths(self.sliding) > AT_REST**2

    @cached_property
    def has_cone(self) -> NDArray[np.bool_]:
        """(M,) contacts with a friction cone: not sliding and not frictionless."""
        return ~self.is_sliding & (self.friction > 0.0)

    @cached_property
    def kinetic_directions(self) -> FloatArray:
        """(M, 3) force per newton of normal force where there is no cone; else 0.

        It is n - mu v/|v| for Coulomb's law.

        Raises:
            ArgumentError: If contacts slide and the cone model does not define their friction.
        """
        return self.cone_model.kinetic_directions(
            self.normals, self.tangents, self.friction, self.sliding, ~self.has_cone
        )

    @cached_property
    def frames(self) -> FloatArray:
        """(M, 3, 3) columns n, t1, t2 of each contact."""
        return read_only(np.concatenate([self.normals[:, :, None], self.tangents], axis=2))

    @cached_property
    def W(self) -> FloatArray:
        """(P, 3M) map from contact forces to loads on passive coordinates: [1; m].

        Without a `wrench_matrix`, the map to the wrench on the object, eq. (7).
        """
        given = self.wrench_matrix
        return wrench_map(self.positions) if given is None else given

    @cached_property
    def N(self) -> FloatArray:
        """(3M, M) block diagonal of the normals n_l, eq. (40)."""
        return block_diagonal(list(self.normals[:, :, None]))

    @cached_property
    def T(self) -> FloatArray:
        """(3M, 2M) block diagonal of the tangents [t_l1 t_l2], eqs. (10) and (11)."""
        return block_diagonal(list(self.tangents))

    @cached_property
    def C(self) -> FloatArray:
        """(3M, sum r_l) block diagonal of the unit cone edges, eqs. (4) and (8); f = C k, k >= 0.

        A sliding or frictionless contact has one edge: the kinetic friction's direction
        n - mu v/|v| normalised, or n.
        """
        directions = self.kinetic_directions
        lengths = np.where(self.has_cone, 1.0, np.linalg.norm(directions, axis=1))
        directions = directions / lengths[:, None]
        return cone_blocks(
            self.frames, self.friction, self.has_cone, self.cone_section.edges, directions
        )

    @cached_property
    def H(self) -> FloatArray:
        """(3M, sum r_l) block diagonal of the unit outward side-face normals, eqs. (38), (39).

        The normals point outward as the paper defines them, so a force with margin e satisfies
        e 1 + H^T f <= 0; the minus sign printed in (35), (37) and (42) belongs to inward normals.
        A sliding or frictionless contact has no side face: its one column is zero and `D_star`
        strikes its row.
        """
        none = np.zeros_like(self.normals)
        return cone_blocks(self.frames, self.friction, self.has_cone, self.cone_section.faces, none)

    @property
    def J(self) -> FloatArray:
        """(3M, L) contact Jacobian, eqs. (12) and (18): J^T f = tau."""
        return self.jacobian

    @cached_property
    def D(self) -> FloatArray:
        """(3M, 3M) diag(d_l I_3), eqs. (1) and (2): 1 where a contact actually slides."""
        return read_only(np.diag(np.repeat(self.is_sliding.astype(np.float64), 3)))

    @cached_property
    def D_star(self) -> FloatArray:
        """(sum r_l, sum r_l) diag(d_l I_r), eq. (43): 1 on the faces that bound no margin.

        A frictionless contact has no cone to keep a margin in and is struck like a sliding one.
        """
        edges = np.where(self.has_cone, len(self.cone_section.corners), 1)
        return read_only(np.diag(np.repeat((~self.has_cone).astype(np.float64), edges)))

    def cone_distances(self, forces: FloatArray) -> FloatArray:
        """Return the distance of contact forces to the surface of their friction cones, N.

        Args:
            forces: (M, 3) contact forces on the object, N.

        Returns:
            (M,), negative outside; inf where there is no cone.
        """
        local = (forces[:, None, :] @ self.frames)[:, 0]
        distances = self.cone_model.surface_distances(local, self.friction, self.cone_edges)
        return np.where(self.has_cone, distances, np.inf)

    def margin_of(self, forces: ArrayLike) -> float:
        """Return the margin e of given contact forces, eqs. (36) and (42), in newton.

        The smallest of n^T f, f_n,max - n^T f and, where there is a cone, -h^T f over its faces, or
        the distance to the round cone's surface.

        Args:
            forces: (M, 3) contact forces on the object, N.
        """
        f = real_array("forces", forces, (self.contact_count, 3))
        normal = np.einsum("ij,ij->i", self.normals, f)
        sides = self.cone_distances(f)
        return float(np.minimum.reduce((normal, self.max_normal_force - normal, sides), axis=None))


def checked_problem(problem: object) -> QuasistaticProblem:
    """Return the argument if it is a problem.

    Raises:
        ArgumentError: If it is not.
    """
    if not isinstance(problem, QuasistaticProblem):
        words = what_to_pass("problem", problem, "QuasistaticProblem")
        raise ArgumentError("problem", words)
    return problem


@Derived
def contact_map(problem: QuasistaticProblem) -> FloatArray:
    """Return [W^T, J] of eq. (22) in contact frames, cached for the problems in use.

    Multiplied by [V; -theta_dot] it gives the velocity of the object relative to the other body
    along n, t1, t2; its rows, transposed, are the wrench and joint torques of unit forces along
    these axes.

    Returns:
        (M, 3, P + L) read-only.
    """
    count, passive, joints = problem.contact_count, problem.passive_count, problem.joint_count
    in_world = np.empty((count, 3, passive + joints))
    in_world[:, :, :passive] = problem.W.T.reshape(count, 3, passive)
    in_world[:, :, passive:] = problem.jacobian.reshape(count, 3, joints)
    return read_only(problem.frames.transpose(0, 2, 1) @ in_world)
