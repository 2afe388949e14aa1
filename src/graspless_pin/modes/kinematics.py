"""Kinematic feasibility of virtual sliding: is there a virtual motion behind (B, S)? Eq. (22)."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import nnls

from graspless_pin.modes.rules import SignRule
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray

# Rows are scaled to unit size, so this is the largest relative velocity that counts as zero: it
# lets four corner contacts whose normals differ by rounding share a motion.
_RANK_TOLERANCE = 1e-8
# A witness with |x| = 1 / sqrt(this) for unit requirements is as good as none.
_NO_WITNESS = 1e-12
_IN_CONFLICT = 1e-9


@dataclass(frozen=True)
class Requirement:
    """What is asked of the virtual sliding at one selected contact.

    Attributes:
        contact: Index of the contact.
        signs: s_l1, s_l2 in {-1, 0, 1}; what 0 asks depends on the sign rule: under ``exact`` the
            component is zero; under ``strict`` and ``nonzero`` it is not looked at, and neither
            is, under ``nonzero``, whether the contact moves at all.
    """

    contact: int
    signs: tuple[int, int]


@dataclass(frozen=True)
class Conflict:
    """A proof that requirements exclude each other: a positive combination of them is zero.

    Attributes:
        signs: (contact, component, sign) items that take part with a positive weight.
        contacts: Contacts that take part only by being selected (normal velocity zero, or
            tangential velocity zero under ``exact``).
    """

    signs: tuple[tuple[int, int, int], ...]
    contacts: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Witness:
    """A virtual motion that meets the requirements.

    Attributes:
        velocities: (M, 3) relative velocity of the object against the other body at each contact,
            components along n, t1, t2, up to one positive scale.
    """

    velocities: FloatArray


class VirtualKinematics:
    """Relative contact velocities of all virtual motions [V; theta_dot] of one problem.

    Attributes:
        rows: (M, 3, 6 + L) maps from the scaled motion to the velocity of the object relative to
            the other body along n, t1, t2: [W^T, J] [V; -theta_dot] of eq. (22), columns scaled to
            a common size.
    """

    def __init__(self, problem: QuasistaticProblem) -> None:
        """Assemble the scaled map."""
        frames = np.concatenate([problem.normals[:, :, None], problem.tangents], axis=2)
        count = problem.contact_count
        world = np.hstack([problem.W.T, -problem.jacobian]).reshape(count, 3, -1)
        local = frames.transpose(0, 2, 1) @ world
        size = np.linalg.norm(local.reshape(3 * count, -1), axis=0)
        self.rows: FloatArray = local / np.where(size > 0.0, size, 1.0)
        self._spaces: dict[bytes, FloatArray] = {}

    def solve(self, requirements: Sequence[Requirement], rule: SignRule) -> Witness | Conflict:
        """Find a virtual motion that meets all requirements, or prove that there is none.

        Feasible exactly when no nonzero, nonnegative combination of the sign requirements
        vanishes on the motions that leave the selected contacts touching (Gordan's theorem);
        the nearest such combination is one nonnegative least-squares problem, whose residual is
        the motion sought.

        Args:
            requirements: At most one per contact.
            rule: How a zero sign is read, and whether both components must move.
        """
        if not requirements:
            return Witness(np.zeros(self.rows.shape[:2]))
        still, moving, items, strictness = self._stack(requirements, rule)
        if not items:
            return Witness(np.zeros(self.rows.shape[:2]))
        basis = self._null_space(still)
        projected = moving @ basis
        # A row that vanishes there must vanish exactly, or rounding would pass for a direction.
        projected[np.linalg.norm(projected, axis=1) < _RANK_TOLERANCE] = 0.0
        system = np.vstack([projected.T, strictness])
        target = np.zeros(len(system))
        target[-1] = 1.0
        weights, residual = nnls(system, target)
        if residual * residual > _NO_WITNESS:
            motion = basis @ (projected.T @ weights)
            return Witness(self.rows @ motion)
        return self._conflict(requirements, rule, still, moving, items, weights)

    def _stack(
        self, requirements: Sequence[Requirement], rule: SignRule
    ) -> tuple[FloatArray, FloatArray, list[tuple[int, ...]], FloatArray]:
        """Rows that must vanish, rows that must be positive, their items and strictness.

        Under ``nonzero`` the two components of a contact need only be nonnegative each and
        positive together, so a third, strict row is their sum.
        """
        still, moving, items, strict = [], [], [], []
        for requirement in requirements:
            normal, *tangents = self.rows[requirement.contact]
            still.append(normal)
            signed = [(component, sign) for component, sign in enumerate(requirement.signs) if sign]
            for component, sign in signed:
                moving.append(sign * tangents[component])
                items.append((requirement.contact, component, sign))
                strict.append(0.0 if rule is SignRule.NONZERO else 1.0)
            if rule is SignRule.NONZERO and len(signed) == 2:
                moving.append(sum(sign * tangents[component] for component, sign in signed))
                items.append((requirement.contact,))
                strict.append(1.0)
            elif rule is SignRule.EXACT:
                still.extend(tangents[c] for c in range(2) if requirement.signs[c] == 0)
        return np.array(still), np.array(moving), items, np.array(strict)

    def _null_space(self, still: FloatArray) -> FloatArray:
        """(6 + L, d) orthonormal motions on which the rows vanish, to the rank tolerance."""
        key = still.tobytes()
        basis = self._spaces.get(key)
        if basis is None:
            _, values, right = np.linalg.svd(still)
            rank = int((values > _RANK_TOLERANCE * max(1.0, values[0])).sum())
            basis = self._spaces[key] = right[rank:].T
        return basis

    def _conflict(
        self,
        requirements: Sequence[Requirement],
        rule: SignRule,
        still: FloatArray,
        moving: FloatArray,
        items: list[tuple[int, ...]],
        weights: FloatArray,
    ) -> Conflict:
        """Name the requirements whose combination vanishes."""
        threshold = _IN_CONFLICT * weights.max()
        taking_part = list(np.flatnonzero(weights > threshold))
        signs: dict[tuple[int, int, int], None] = {}
        given = {requirement.contact: requirement.signs for requirement in requirements}
        for i in taking_part:
            item = items[i]
            if len(item) == 3:
                signs[(item[0], item[1], item[2])] = None
            else:
                for component in range(2):
                    signs[(item[0], component, given[item[0]][component])] = None
        # The rest of the combination is carried by rows that vanish: a basic solution names few.
        pull = moving.T @ weights
        reactions, _ = nnls(np.hstack([still.T, -still.T]), -pull)
        reactions = np.abs(reactions[: len(still)] - reactions[len(still) :])
        owners = []
        for requirement in requirements:
            zero = sum(sign == 0 for sign in requirement.signs) if rule is SignRule.EXACT else 0
            owners.extend([requirement.contact] * (1 + zero))
        signed = {contact for contact, _, _ in signs}
        largest = reactions.max(initial=0.0)
        contacts = {
            owner
            for owner, reaction in zip(owners, reactions, strict=True)
            if largest > 0.0 and reaction > _IN_CONFLICT * max(1.0, largest)
        }
        return Conflict(tuple(signs), tuple(sorted(contacts - signed)))
