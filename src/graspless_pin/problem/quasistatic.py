"""The problem record: contacts, external wrench, joints and limits, and the paper's matrices."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import (
    FloatArray,
    finite_array,
    first_bad,
    per_item,
    read_only,
    real_array,
    unit_rows,
    whole_number,
)
from graspless_pin.problem.cones import cone_edges_local, cone_faces_local, default_tangents

_ORTHOGONAL = 1e-6
_AT_REST = 1e-12


@dataclass(frozen=True, eq=False, init=False, repr=False)
class QuasistaticProblem:
    """Point contacts on one object, the wrench they must balance and the joints behind them.

    All vectors are in one set of world axes; positions, moments and the columns of `W` are about
    one reference point, the object's centre of mass by convention. Arrays are read-only copies.
    The letters are those of Makita and Maeda, *Joint Torque Optimization for Quasi-static
    Graspless Manipulation*; equation numbers are theirs.

    Attributes:
        positions: (M, 3) contact points P_l relative to the reference point, m.
        normals: (M, 3) unit normals n_l, into the object.
        external_wrench: (6,) [force; moment] on the object, N and N m.
        jacobian: (3M, L) contact Jacobian with J^T f = tau, world axes; m/rad, m/m or 1.
        friction: (M,) Coulomb coefficients, static and kinetic.
        tangents: (M, 3, 2) unit tangents t_l1, t_l2.
        sliding: (M, 3) velocity of the object relative to the other body at each contact, m/s;
            a zero row is a contact that does not actually slide.
        lower_torque: (L,) smallest motor torque, N m (N for a linear or hybrid joint).
        upper_torque: (L,) largest motor torque.
        max_normal_force: (M,) f_n,max, N.
        cone_edges: Number r of edges of a friction cone.
        joint_names: L names, the columns of `jacobian`.
        gravity_torques: (L,) torque g(q) that the motors bear besides the contacts: the motor's
            torque is J^T f + g(q).
        scratch: What the algorithms assembled for this problem and reuse; no part of the data.
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
    joint_names: tuple[str, ...]
    gravity_torques: FloatArray
    scratch: dict[str, Any]

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
        joint_names: Sequence[str] | None = None,
        gravity_torques: ArrayLike | None = None,
    ) -> None:
        """Validate and freeze the arrays.

        Args:
            positions: (M, 3) m, about the reference point.
            normals: (M, 3) unit, into the object.
            external_wrench: (6,) [force; moment] about the reference point, N and N m.
            jacobian: (3M, L) with J^T f = tau; None: no joint (L = 0).
            friction: Scalar or (M,), >= 0.
            tangents: (M, 3, 2) orthonormal pairs, orthogonal to the normals; None:
                t1 = normalize(n x e_y) (n x e_x where n is along y), t2 = n x t1.
            sliding: (M, 3) m/s, velocity of the object relative to the other body, tangential;
                None: no contact slides.
            torque_limits: (lower, upper), each scalar or (L,), N m; infinite means unlimited.
            max_normal_force: Scalar or (M,), > 0 and finite, N.
            cone_edges: Edges of each friction cone, >= 3; the first edge is along t1.
            joint_names: L distinct names; None: ``joint_1`` ... ``joint_L``.
            gravity_torques: (L,) N m; None: zeros.

        Raises:
            ArgumentError: Naming the argument, the index and the value that is wrong.
        """
        p = finite_array("positions", positions, (None, 3))
        m = len(p)
        if m == 0:
            raise ArgumentError("positions", "has no row; at least one contact is needed")
        n = finite_array("normals", normals, (m, 3))
        unit_rows("normals", n)
        wrench = finite_array("external_wrench", external_wrench, (6,))
        jac = finite_array(
            "jacobian", np.zeros((3 * m, 0)) if jacobian is None else jacobian, (3 * m, None)
        )
        count = jac.shape[1]
        mu = per_item("friction", friction, m)
        first_bad("friction", mu, ~(mu >= 0.0) | np.isinf(mu), "it must be finite and >= 0")
        t = _checked_tangents(tangents, n)
        v = _checked_sliding(sliding, n)
        lower, upper = _checked_limits(torque_limits, count)
        force = per_item("max_normal_force", max_normal_force, m)
        first_bad(
            "max_normal_force", force, ~(force > 0.0) | np.isinf(force), "it must be finite and > 0"
        )
        gravity = finite_array(
            "gravity_torques",
            np.zeros(count) if gravity_torques is None else gravity_torques,
            (count,),
        )
        values = {
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
            "cone_edges": whole_number("cone_edges", cone_edges, 3),
            "joint_names": _checked_names(joint_names, count),
            "gravity_torques": gravity,
        }
        for name, value in values.items():
            object.__setattr__(self, name, value)
        object.__setattr__(self, "scratch", {})

    @classmethod
    def of_own_arrays(
        cls,
        positions: FloatArray,
        normals: FloatArray,
        external_wrench: FloatArray,
        jacobian: FloatArray,
        *,
        friction: FloatArray,
        tangents: FloatArray,
        sliding: FloatArray,
        torque_limits: tuple[FloatArray, FloatArray],
        max_normal_force: float,
        cone_edges: int,
        joint_names: tuple[str, ...],
        gravity_torques: FloatArray,
    ) -> QuasistaticProblem:
        """Take arrays that the caller has made itself, which costs a sixth of the constructor.

        They become read-only and are not copied. Shapes, orthonormal frames, tangential sliding and
        distinct names are the caller's affair; whether all numbers are possible ones is checked.

        Args:
            positions: (M, 3) m.
            normals: (M, 3) unit.
            external_wrench: (6,) N and N m.
            jacobian: (3M, L).
            friction: (M,).
            tangents: (M, 3, 2).
            sliding: (M, 3) m/s.
            torque_limits: (lower, upper), each (L,).
            max_normal_force: One for all contacts, N.
            cone_edges: As in the constructor.
            joint_names: L distinct names.
            gravity_torques: (L,).

        Raises:
            ArgumentError: See the constructor.
        """
        lower, upper = torque_limits
        numbers = (positions, normals, external_wrench, jacobian, friction, tangents, sliding,
                   gravity_torques)  # fmt: skip
        total = np.concatenate([array.ravel() for array in numbers])
        if not (
            len(positions) > 0
            and np.isfinite(total).all()
            and min(friction.tolist()) >= 0.0
            and 0.0 < max_normal_force < np.inf
            and isinstance(cone_edges, int)
            and cone_edges >= 3
            and ((lower <= upper) & (lower < np.inf) & (upper > -np.inf)).all()
        ):
            # The constructor finds what is wrong and names it.
            return cls(positions, normals, external_wrench, jacobian, friction=friction,
                       tangents=tangents, sliding=sliding, torque_limits=torque_limits,
                       max_normal_force=max_normal_force, cone_edges=cone_edges,
                       joint_names=joint_names, gravity_torques=gravity_torques)  # fmt: skip
        for array in (*numbers, lower, upper):
            array.setflags(write=False)
        made = object.__new__(cls)
        made.__dict__.update(
            positions=positions,
            normals=normals,
            external_wrench=external_wrench,
            jacobian=jacobian,
            friction=friction,
            tangents=tangents,
            sliding=sliding,
            lower_torque=lower,
            upper_torque=upper,
            max_normal_force=read_only(np.full(len(positions), float(max_normal_force))),
            cone_edges=cone_edges,
            joint_names=joint_names,
            gravity_torques=gravity_torques,
            scratch={},
        )
        return made

    def __getstate__(self) -> dict[str, Any]:
        """Return the data alone: what was derived from it is derived again after unpickling."""
        return {item.name: getattr(self, item.name) for item in fields(self)} | {"scratch": {}}

    def __repr__(self) -> str:
        """Return the sizes, not the arrays."""
        return (
            f"QuasistaticProblem({self.contact_count} contacts, {int(self.is_sliding.sum())} "
            f"sliding, {self.joint_count} joints, {self.cone_edges} cone edges)"
        )

    def with_changes(self, **changes: Any) -> QuasistaticProblem:
        """Return the problem with some arguments replaced, validated anew.

        Args:
            changes: Arguments of the constructor by name.

        Raises:
            ArgumentError: See the constructor.
        """
        values: dict[str, Any] = {
            "positions": self.positions,
            "normals": self.normals,
            "external_wrench": self.external_wrench,
            "jacobian": self.jacobian,
            "friction": self.friction,
            "tangents": self.tangents,
            "sliding": self.sliding,
            "torque_limits": (self.lower_torque, self.upper_torque),
            "max_normal_force": self.max_normal_force,
            "cone_edges": self.cone_edges,
            "joint_names": self.joint_names,
            "gravity_torques": self.gravity_torques,
        }
        unknown = sorted(set(changes) - set(values))
        if unknown:
            raise ArgumentError(unknown[0], f"is no argument; known: {', '.join(values)}")
        return QuasistaticProblem(**{**values, **changes})

    @property
    def contact_count(self) -> int:
        """M, the number of contacts."""
        return len(self.positions)

    @property
    def joint_count(self) -> int:
        """L, the number of columns of `J`."""
        return self.jacobian.shape[1]

    @cached_property
    def is_sliding(self) -> NDArray[np.bool_]:
        """(M,) d_l of eq. (2): contacts in actual sliding."""
        return np.linalg.norm(self.sliding, axis=1) > _AT_REST

    @cached_property
    def has_cone(self) -> NDArray[np.bool_]:
        """(M,) contacts with a friction cone: not sliding and not frictionless."""
        return ~self.is_sliding & (self.friction > 0.0)

    @cached_property
    def kinetic_directions(self) -> FloatArray:
        """(M, 3) force per newton of normal force where there is no cone, n - mu v/|v|; else 0."""
        directions = np.zeros_like(self.normals)
        bare = ~self.has_cone
        if bare.any():
            directions[bare] = self.normals[bare]
            slide = self.is_sliding
            unit = self.sliding[slide] / np.linalg.norm(self.sliding[slide], axis=1, keepdims=True)
            directions[slide] -= self.friction[slide, None] * unit
        return read_only(directions)

    @cached_property
    def frames(self) -> FloatArray:
        """(M, 3, 3) columns n, t1, t2 of each contact."""
        return read_only(np.concatenate([self.normals[:, :, None], self.tangents], axis=2))

    @cached_property
    def W(self) -> FloatArray:
        """(6, 3M) map from contact forces to the wrench on the object, eq. (7): [1; m]."""
        p = self.positions
        w = np.zeros((6, self.contact_count, 3))
        w[:3] = np.eye(3)[:, None, :]
        w[3, :, 1], w[3, :, 2] = -p[:, 2], p[:, 1]
        w[4, :, 0], w[4, :, 2] = p[:, 2], -p[:, 0]
        w[5, :, 0], w[5, :, 1] = -p[:, 1], p[:, 0]
        return read_only(w.reshape(6, -1))

    @cached_property
    def N(self) -> FloatArray:
        """(3M, M) block diagonal of the normals n_l, eq. (40)."""
        return _block_diagonal([n[:, None] for n in self.normals])

    @cached_property
    def T(self) -> FloatArray:
        """(3M, 2M) block diagonal of the tangents [t_l1 t_l2], eqs. (10) and (11)."""
        return _block_diagonal(list(self.tangents))

    @cached_property
    def C(self) -> FloatArray:
        """(3M, sum r_l) block diagonal of the unit cone edges, eqs. (4) and (8); f = C k, k >= 0.

        A sliding or frictionless contact has one edge: the kinetic friction's direction
        n - mu v/|v| normalised, or n.
        """
        blocks = []
        for contact in range(self.contact_count):
            if self.has_cone[contact]:
                local = cone_edges_local(float(self.friction[contact]), self.cone_edges)
                blocks.append(self.frames[contact] @ local)
            else:
                edge = self.kinetic_directions[contact]
                blocks.append((edge / np.linalg.norm(edge))[:, None])
        return _block_diagonal(blocks)

    @cached_property
    def H(self) -> FloatArray:
        """(3M, sum r_l) block diagonal of the unit outward side-face normals, eqs. (38), (39).

        The normals point outward as the paper defines them, so a force with margin e satisfies
        e 1 + H^T f <= 0; the minus sign printed in (35), (37) and (42) belongs to inward normals.
        A sliding or frictionless contact has no side face: its one column is zero and `D_star`
        strikes its row.
        """
        blocks = []
        for contact in range(self.contact_count):
            if self.has_cone[contact]:
                local = cone_faces_local(float(self.friction[contact]), self.cone_edges)
                blocks.append(self.frames[contact] @ local)
            else:
                blocks.append(np.zeros((3, 1)))
        return _block_diagonal(blocks)

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
        edges = np.where(self.has_cone, self.cone_edges, 1)
        return read_only(np.diag(np.repeat((~self.has_cone).astype(np.float64), edges)))

    def margin_of(self, forces: ArrayLike) -> float:
        """Return the margin e of given contact forces, eqs. (36) and (42), in newton.

        The smallest of n^T f, f_n,max - n^T f and, where there is a cone, -h^T f over its faces.

        Args:
            forces: (M, 3) contact forces on the object, N.
        """
        f = real_array("forces", forces, (self.contact_count, 3))
        normal = np.einsum("ij,ij->i", self.normals, f)
        margin = min(normal.min(), (self.max_normal_force - normal).min())
        faces = self.H.T @ f.ravel()
        kept = np.diag(self.D_star) == 0.0
        return float(min(margin, -faces[kept].max(initial=-np.inf)))


def _block_diagonal(blocks: list[FloatArray]) -> FloatArray:
    """Return the read-only block-diagonal matrix of (3, c) blocks."""
    matrix = np.zeros((3 * len(blocks), sum(block.shape[1] for block in blocks)))
    column = 0
    for row, block in enumerate(blocks):
        matrix[3 * row : 3 * row + 3, column : column + block.shape[1]] = block
        column += block.shape[1]
    return read_only(matrix)


def _checked_tangents(tangents: ArrayLike | None, normals: FloatArray) -> FloatArray:
    if tangents is None:
        return read_only(default_tangents(normals))
    t = finite_array("tangents", tangents, (len(normals), 3, 2))
    unit_rows("tangents", t.transpose(0, 2, 1))
    frames = np.concatenate([normals[:, :, None], t], axis=2)
    gram = np.abs(frames.transpose(0, 2, 1) @ frames - np.eye(3))
    off = np.maximum.reduce([gram[:, 0, 1], gram[:, 0, 2], gram[:, 1, 2]])
    if (off > _ORTHOGONAL).any():
        index = int(np.argmax(off > _ORTHOGONAL))
        raise ArgumentError(
            "tangents",
            f"at index {index} are {t[index].T.tolist()}: they must be orthogonal to each other "
            f"and to the normal {normals[index].tolist()} (largest cosine {off[index]:.3g})",
        )
    return t


def _checked_sliding(sliding: ArrayLike | None, normals: FloatArray) -> FloatArray:
    v = finite_array("sliding", np.zeros_like(normals) if sliding is None else sliding,
                     (len(normals), 3))  # fmt: skip
    speed = np.linalg.norm(v, axis=1)
    along = np.einsum("ij,ij->i", v, normals)
    bad = (speed > _AT_REST) & (np.abs(along) > _ORTHOGONAL * speed)
    if bad.any():
        index = int(np.argmax(bad))
        raise ArgumentError(
            "sliding",
            f"is {v[index].tolist()} at index {index} with normal component {along[index]:.6g} "
            "m/s; a sliding velocity must be tangential",
        )
    return v


def _checked_limits(
    torque_limits: tuple[ArrayLike, ArrayLike], count: int
) -> tuple[FloatArray, FloatArray]:
    try:
        lower_value, upper_value = torque_limits
    except (TypeError, ValueError):
        raise ArgumentError(
            "torque_limits", f"is {torque_limits!r}; it must be a pair (lower, upper)"
        ) from None
    lower = per_item("torque_limits lower", lower_value, count)
    upper = per_item("torque_limits upper", upper_value, count)
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
    if names is None:
        return tuple(f"joint_{i + 1}" for i in range(count))
    if isinstance(names, str):
        raise ArgumentError("joint_names", f"is {names!r}; it must be a sequence of names")
    checked = tuple(str(name) for name in names)
    if len(checked) != count:
        raise ArgumentError(
            "joint_names", f"has {len(checked)} names; the jacobian has {count} columns"
        )
    if len(set(checked)) < count:
        repeated = {name for name in checked if checked.count(name) > 1}
        raise ArgumentError("joint_names", f"repeats {sorted(repeated)}; names must be distinct")
    return checked
