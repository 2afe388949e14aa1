"""Several problems under the same commanded torques, combined into one problem."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag, null_space

from graspless_pin.problem.checks import FloatArray, JointUnit, torque_mask
from graspless_pin.problem.quasistatic import QuasistaticProblem, contact_map
from graspless_pin.problem.scales import bears_contacts
from graspless_pin.records import Brief, Record, unchecked

_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Corner(Record, Brief):
    """Deviations of a member's load and sliding friction from the nominal problem's.

    Attributes:
        mass: Relative increase of the mass.
        center_of_mass: (3,) m, see `Uncertainty`.
        down: (3,) gravity over its nominal size, world axes.
        force: (3,) N.
        moment: (3,) N m.
        kinetic: (M,) relative increases of the coefficients of contacts that slide.
    """

    mass: float
    center_of_mass: FloatArray
    down: FloatArray
    force: FloatArray
    moment: FloatArray
    kinetic: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Member(Record, Brief):
    """One of the possible actual problems of an uncertain one.

    Attributes:
        problem: Contacts, wrench and joints.
        factors: (L,) ratios of the actual to the commanded torques, offsets aside; nominally 1.
        offsets: (L,) torques added to these, N m (N).
        words: Description of how it differs from the nominal problem.
        corner: The corner of an uncertainty set that it is; None: it is none.
        moved: (M, 3) m, displacements of contacts from their nominal positions, world axes; None:
            zero.
        directions: (L, d) torques that joint stiffness adds, see `feedback_torques`, with these
            contacts; None: the same as for the nominal problem.
    """

    problem: QuasistaticProblem
    factors: FloatArray
    offsets: FloatArray
    words: str = ""
    corner: Corner | None = None
    moved: FloatArray | None = None
    directions: FloatArray | None = None

    def commanded(self, contact_torques: FloatArray) -> FloatArray:
        """Return (L,) the commands c with factors * c + offsets = J^T f + g."""
        return (contact_torques + self.problem.gravity_torques - self.offsets) / self.factors


def feedback_torques(
    problem: QuasistaticProblem, stiffness: FloatArray | None
) -> FloatArray | None:
    """Return the (L, d) torques that joint stiffness adds in motions that no contact resists.

    A motion n with [W^T, J] n = 0 has zero relative velocity at all contacts; contacts that slide
    or have no friction only have to keep touching. Equilibrium determines how far the object and
    the joints move along each, and the joints' deflections times the stiffness are torques that
    friction need not provide.

    Args:
        problem: Contacts and joints.
        stiffness: (L,) N m/rad (N/m) of each joint; None: there is none, and None is returned.
    """
    if stiffness is None:
        return None
    return stiffness[:, None] * motions_keeping_contact(problem)[problem.passive_count :]


def motions_keeping_contact(problem: QuasistaticProblem) -> FloatArray:
    """Return a (P + L, d) basis of the motions [V; -theta_dot] that maintain all contacts.

    Their relative velocity is zero at contacts with a friction cone, and its normal component at
    the others.

    Args:
        problem: Contacts and joints.
    """
    is_constrained = np.ones((problem.contact_count, 3), dtype=bool)
    is_constrained[~problem.has_cone, 1:] = False
    rows = contact_map(problem)[is_constrained]
    length = problem.scales.length
    sizes = np.ones(rows.shape[1])
    sizes[: problem.passive_count] = np.where(problem.passive_turns, 1.0, length)
    return sizes[:, None] * null_space(rows * sizes, rcond=_RANK_TOLERANCE)


def join_members(
    members: Sequence[Member], feedback: FloatArray | None = None
) -> QuasistaticProblem:
    """Return the problem of common torques for all members, each with its own contact forces.

    With P passive coordinates each, K members have K P of them. The commanded torques of all
    members are equal, J_k^T f_k - J_0^T f_0 = g_0 - g_k if motors are exact. So each joint of each
    further member is a passive coordinate, too, balanced by contact forces and held by no motor. A
    virtual motion of the combined problem consists of independent motions of the members.

    Args:
        members: At least one, with the same joints and numbers of contacts.
        feedback: (L, d) torques by which the commands of members may differ, see
            `feedback_torques`; None: they are equal. If given, each member's joints are driven.

    Returns:
        A problem of K M contacts, member by member. Its joints are those of the first member, or
        with feedback those of all.
    """
    problems = [member.problem for member in members]
    first, count = problems[0], len(members)
    maps = [one.problem.jacobian / one.factors for one in members]  # J_k of commands
    carried = [one.commanded(np.zeros(first.joint_count)) for one in members]
    names, units = first.joint_names, first.joint_units
    coupled = couplings(members, feedback)
    driven, drives = (maps[:1], 1) if feedback is None else (maps, count)
    rows = sum(len(shared) for shared, _ in coupled)
    coupling = np.zeros((rows, 3 * sum(one.contact_count for one in problems)))
    loads, row, start = [], 0, 3 * first.contact_count
    for number, (shared, _) in enumerate(coupled, 1):
        block = slice(row, row + len(shared))
        stop = start + 3 * problems[number].contact_count
        coupling[block, : 3 * first.contact_count] = -shared @ maps[0].T
        coupling[block, start:stop] = shared @ maps[number].T
        loads.append(shared @ (carried[number] - carried[0]))
        row, start = block.stop, stop
    jacobian = np.zeros((coupling.shape[1], drives * len(names)))
    jacobian[: 3 * sum(one.contact_count for one in problems[:drives])] = _block_diagonal(driven)
    if drives > 1:
        names = tuple(f"{name} of member {k}" for k in range(count) for name in names)
    return _problem_of_contacts(
        problems,
        external_wrench=np.concatenate([*(one.external_wrench for one in problems), *loads]),
        jacobian=jacobian,
        lower_torque=np.concatenate([one.lower_torque for one in problems[:drives]]),
        upper_torque=np.concatenate([one.upper_torque for one in problems[:drives]]),
        joint_names=names,
        joint_units=units * drives,
        gravity_torques=np.concatenate(carried[:drives]),
        wrench_matrix=np.concatenate([_block_diagonal([one.W for one in problems]), coupling]),
        passive_units=(
            *first.passive_units * count,
            *(unit for _, units in coupled for unit in units),
        ),
    )


def under_commands(
    member: Member, commanded: FloatArray, feedback: FloatArray | None = None
) -> QuasistaticProblem:
    """Return the problem of a member under commanded torques, with joints as passive coordinates.

    Args:
        member: The member.
        commanded: (L,) N m (N).
        feedback: See `join_members`.

    Returns:
        A problem without driven joints; with feedback its joints are those of the member.
    """
    problem = member.problem
    torque_map = problem.jacobian / member.factors
    shared, coupled = shared_commands([member], feedback)
    count = 0 if feedback is None else problem.joint_count
    return _problem_of_contacts(
        [problem],
        external_wrench=loads_under_commands([member], commanded, feedback)[0],
        jacobian=torque_map[:, :count],
        lower_torque=problem.lower_torque[:count],
        upper_torque=problem.upper_torque[:count],
        joint_names=problem.joint_names[:count],
        joint_units=problem.joint_units[:count],
        gravity_torques=member.commanded(np.zeros(problem.joint_count))[:count],
        wrench_matrix=np.vstack([problem.W, shared @ torque_map.T]),
        passive_units=(*problem.passive_units, *coupled),
    )


def loads_under_commands(
    members: Sequence[Member], commanded: FloatArray, feedback: FloatArray | None = None
) -> FloatArray:
    """Return the (K, Q) external loads of the problems of `under_commands`.

    Args:
        members: K that differ only in loads: in `external_wrench`, `gravity_torques`, `offsets`.
        commanded: (L,) N m (N).
        feedback: See `join_members`.
    """
    first = members[0].problem
    shared, _ = shared_commands(members[:1], feedback)
    carried = np.array([one.commanded(np.zeros(first.joint_count)) for one in members])
    wrenches = np.array([one.problem.external_wrench for one in members])
    return np.hstack([wrenches, (carried - commanded) @ shared.T])


def couplings(
    members: Sequence[Member], feedback: FloatArray | None
) -> list[tuple[FloatArray, list[JointUnit]]]:
    """Return the combinations of commands that each further member shares with the first.

    Args:
        members: K members; if one is moved and there is feedback, the first is the nominal one.
        feedback: See `join_members`.

    Returns:
        The result of `shared_commands` for each of the K - 1 further members.
    """
    common = shared_commands(members, feedback)
    return [
        common if one.directions is None else shared_commands([one], feedback)
        for one in members[1:]
    ]


def shared_commands(
    members: Sequence[Member], feedback: FloatArray | None
) -> tuple[FloatArray, list[JointUnit]]:
    """Return the combinations of commands common to all members, as (s, L) rows, and their units.

    Args:
        members: All members.
        feedback: See `join_members`.
    """
    units = members[0].problem.joint_units
    if feedback is None:
        maps = [one.problem.jacobian / one.factors for one in members]
        # Joints without contact forces only carry their links: their torques are not shared.
        loaded = np.flatnonzero(bears_contacts(np.vstack(maps)))
        return np.eye(len(units))[loaded], [units[joint] for joint in loaded.tolist()]
    if members[0].directions is not None:
        feedback = members[0].directions
    shared = (
        null_space(feedback.T, rcond=_RANK_TOLERANCE).T if feedback.size else np.eye(len(units))
    )
    turns = (shared[:, torque_mask(units)] ** 2).sum(axis=1) >= 0.5
    return shared, [JointUnit.TORQUE if turn else JointUnit.FORCE for turn in turns]


def _block_diagonal(matrices: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(block_diag(*matrices), dtype=float)


def _problem_of_contacts(
    problems: Sequence[QuasistaticProblem], **others: Any
) -> QuasistaticProblem:
    """Return a problem with the contacts of several checked problems; it is not checked again."""
    contacts = {
        name: np.concatenate([getattr(one, name) for one in problems]) for name in _CONTACT_ARRAYS
    }
    values = contacts | others
    for value in values.values():
        if isinstance(value, np.ndarray):
            value.setflags(write=False)
    first = problems[0]
    return unchecked(QuasistaticProblem, cone_edges=first.cone_edges, cone=first.cone, **values)


_CONTACT_ARRAYS = ("positions", "normals", "friction", "tangents", "sliding", "max_normal_force")
