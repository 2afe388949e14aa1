"""Problems that share one vector of torques, as one problem of more coordinates."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.linalg import block_diag, null_space

from graspless_pin.problem.checks import FloatArray, JointUnit, turning
from graspless_pin.problem.quasistatic import QuasistaticProblem, contact_map
from graspless_pin.problem.scales import bears_contacts
from graspless_pin.records import Brief, Record, unchecked

_RANK_TOLERANCE = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class Corner(Record, Brief):
    """By how much the load and sliding contacts of a member differ from the nominal problem's.

    Attributes:
        mass: Share by which it is larger.
        center_of_mass: (3,) m, see `Uncertainty`.
        down: (3,) gravity over its nominal size, world axes.
        force: (3,) N.
        moment: (3,) N m.
        kinetic: (M,) shares by which coefficients are larger where contacts slide.
    """

    mass: float
    center_of_mass: FloatArray
    down: FloatArray
    force: FloatArray
    moment: FloatArray
    kinetic: FloatArray


@dataclass(frozen=True, eq=False, repr=False)
class Member(Record, Brief):
    """One of the problems that may turn out to be the true one.

    Attributes:
        problem: Contacts, wrench and joints.
        factors: (L,) what the joints really make of a commanded torque, beside 1.
        offsets: (L,) what is added to it, N m (N).
        words: What is different from the nominal problem.
        corner: The corner of a set that it is; None: it is no corner.
        moved: (M, 3) m, how far contacts are from their nominal positions, world axes; None:
            they are there.
        directions: (L, d) what joint stiffness adds with contacts there, see `feedback_torques`;
            None: the same as for the nominal problem.
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
    """Return (L, d) what joint stiffness adds to torques in motions that no contact resists.

    A motion n with [W^T, J] n = 0 leaves all contacts as they are; those that slide anyway or have
    no friction only have to keep touching. Equilibrium picks how far the object and the joints go
    along each, and the joints' deflections times the stiffness are torques that no friction has to
    give.

    Args:
        problem: Contacts and joints.
        stiffness: (L,) N m/rad (N/m) of each joint; None: nothing is added, None is
            returned.
    """
    if stiffness is None:
        return None
    return stiffness[:, None] * motions_keeping_contact(problem)[problem.passive_count :]


def motions_keeping_contact(problem: QuasistaticProblem) -> FloatArray:
    """Return a (P + L, d) basis of the motions [V; -theta_dot] that keep all contacts.

    Their relative velocity is zero at contacts with a friction cone, and its normal component at
    the others.

    Args:
        problem: Contacts and joints.
    """
    along = np.ones((problem.contact_count, 3), dtype=bool)
    along[~problem.has_cone, 1:] = False
    rows = contact_map(problem)[along]
    length = problem.scales.length
    sizes = np.ones(rows.shape[1])
    sizes[: problem.passive_count] = np.where(problem.passive_turns, 1.0, length)
    return sizes[:, None] * null_space(rows * sizes, rcond=_RANK_TOLERANCE)


def joined(members: Sequence[Member], feedback: FloatArray | None = None) -> QuasistaticProblem:
    """Return the problem of torques that serve all members: each has contact forces of its own.

    With P passive coordinates each, K members have K P of them. Commanded torques of two members
    are the same, J_k^T f_k - J_0^T f_0 = g_0 - g_k where motors are exact, so that each joint of
    each further member is a passive coordinate, too: one that forces balance and that no motor
    holds. A virtual motion of all of them is one of each member by itself.

    Args:
        members: At least one, with the same joints and numbers of contacts.
        feedback: (L, d) torques by which the commands of members may differ, see
            `feedback_torques`; None: by none. With some, each member's joints are driven ones.

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
        own = slice(row, row + len(shared))
        stop = start + 3 * problems[number].contact_count
        coupling[own, : 3 * first.contact_count] = -shared @ maps[0].T
        coupling[own, start:stop] = shared @ maps[number].T
        loads.append(shared @ (carried[number] - carried[0]))
        row, start = own.stop, stop
    jacobian = np.zeros((coupling.shape[1], drives * len(names)))
    jacobian[: 3 * sum(one.contact_count for one in problems[:drives])] = _blocks(driven)
    if drives > 1:
        names = tuple(f"{name} of member {k}" for k in range(count) for name in names)
    return _with_contacts(
        problems,
        external_wrench=np.concatenate([*(one.external_wrench for one in problems), *loads]),
        jacobian=jacobian,
        lower_torque=np.concatenate([one.lower_torque for one in problems[:drives]]),
        upper_torque=np.concatenate([one.upper_torque for one in problems[:drives]]),
        joint_names=names,
        joint_units=units * drives,
        gravity_torques=np.concatenate(carried[:drives]),
        wrench_matrix=np.concatenate([_blocks([one.W for one in problems]), coupling]),
        passive_units=(
            *first.passive_units * count,
            *(unit for _, units in coupled for unit in units),
        ),
    )


def under_commands(
    member: Member, commanded: FloatArray, feedback: FloatArray | None = None
) -> QuasistaticProblem:
    """Return the problem of a member under commanded torques: those of joints balance, too.

    Args:
        member: The member.
        commanded: (L,) N m (N).
        feedback: See `joined`.

    Returns:
        A problem without joints, or with feedback with those of the member.
    """
    problem = member.problem
    made = problem.jacobian / member.factors
    shared, coupled = shared_commands([member], feedback)
    count = 0 if feedback is None else problem.joint_count
    return _with_contacts(
        [problem],
        external_wrench=loads_under_commands([member], commanded, feedback)[0],
        jacobian=made[:, :count],
        lower_torque=problem.lower_torque[:count],
        upper_torque=problem.upper_torque[:count],
        joint_names=problem.joint_names[:count],
        joint_units=problem.joint_units[:count],
        gravity_torques=member.commanded(np.zeros(problem.joint_count))[:count],
        wrench_matrix=np.vstack([problem.W, shared @ made.T]),
        passive_units=(*problem.passive_units, *coupled),
    )


def loads_under_commands(
    members: Sequence[Member], commanded: FloatArray, feedback: FloatArray | None = None
) -> FloatArray:
    """Return (K, Q) loads of the problems of `under_commands`.

    Args:
        members: K that differ in loads alone: in `external_wrench`, `gravity_torques`, `offsets`.
        commanded: (L,) N m (N).
        feedback: See `joined`.
    """
    first = members[0].problem
    shared, _ = shared_commands(members[:1], feedback)
    carried = np.array([one.commanded(np.zeros(first.joint_count)) for one in members])
    wrenches = np.array([one.problem.external_wrench for one in members])
    return np.hstack([wrenches, (carried - commanded) @ shared.T])


def couplings(
    members: Sequence[Member], feedback: FloatArray | None
) -> list[tuple[FloatArray, list[JointUnit]]]:
    """Return which sums of commands each member but the first has in common with it.

    Args:
        members: K of them; where one is moved and there is feedback, the first is the nominal one.
        feedback: See `joined`.

    Returns:
        K - 1 times what `shared_commands` returns.
    """
    common = shared_commands(members, feedback)
    return [
        common if one.directions is None else shared_commands([one], feedback)
        for one in members[1:]
    ]


def shared_commands(
    members: Sequence[Member], feedback: FloatArray | None
) -> tuple[FloatArray, list[JointUnit]]:
    """Return which sums of commands are the same for all members, as (s, L) rows, and their units.

    Args:
        members: All of them.
        feedback: See `joined`.
    """
    units = members[0].problem.joint_units
    if feedback is None:
        maps = [one.problem.jacobian / one.factors for one in members]
        # What carries the links of joints that bear no contact force is their own.
        loaded = np.flatnonzero(bears_contacts(np.vstack(maps)))
        return np.eye(len(units))[loaded], [units[joint] for joint in loaded.tolist()]
    if members[0].directions is not None:
        feedback = members[0].directions
    shared = (
        null_space(feedback.T, rcond=_RANK_TOLERANCE).T if feedback.size else np.eye(len(units))
    )
    turns = (shared[:, turning(units)] ** 2).sum(axis=1) >= 0.5
    return shared, [JointUnit.TORQUE if turn else JointUnit.FORCE for turn in turns]


def _blocks(matrices: Sequence[FloatArray]) -> FloatArray:
    return np.asarray(block_diag(*matrices), dtype=float)


def _with_contacts(problems: Sequence[QuasistaticProblem], **others: Any) -> QuasistaticProblem:
    """Return a problem with the contacts of several, whose data were checked with theirs."""
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
