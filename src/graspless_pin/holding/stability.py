"""Does the object stay at rest with these torques? Certificate, search and proof.

Motions of outcomes are described in words, too.
"""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import islice
from math import inf

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.errors import ArgumentError
from graspless_pin.holding.branching import branch
from graspless_pin.holding.certificate import (
    balance,
    balance_and_certificate,
    bearing_forces,
    force_limit,
    proven_loads,
    residual_lower_bound,
    scaled_balance,
    with_proven_loads,
)
from graspless_pin.holding.declared_motion import search_other_motion
from graspless_pin.holding.dynamics import (
    Dynamics,
    free_friction,
    free_motions,
    scaled_dynamics,
    slides_with_friction,
    small_motions_without_scene,
    without_free_joints,
    world_forces,
)
from graspless_pin.holding.equilibrium import BALANCE_TOLERANCE, least_residual
from graspless_pin.holding.relaxation import Relaxation
from graspless_pin.holding.unstable_motion import (
    find_motion,
    is_outcome,
    outcome_record,
    polish,
    search_motions,
)
from graspless_pin.holding.verdict import (
    BRIEF_NODE_LIMIT,
    COARSEST_RESOLUTION,
    FINEST_RESOLUTION,
    NODE_LIMIT,
    ContactState,
    DynamicOutcome,
    LoadProof,
    MovingPart,
    RestProof,
    Stability,
    StabilityVerdict,
)
from graspless_pin.holding.verdict_words import NO_FINGERS, finger_words, strong_words
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import (
    FloatArray,
    motor_torques,
    read_only,
    real_number,
    whole_number,
)
from graspless_pin.problem.inertias import (
    commanded_forces,
    hybrid_contacts,
    largest_mass,
    whole_inertia,
)
from graspless_pin.problem.quasistatic import checked_problem
from graspless_pin.tree_search import Limits

_SAME_WAY = float(np.cos(np.radians(20.0)))
"""Cosine of the angle up to which directions are called the same."""
_SIDEWAYS = float(np.sin(np.radians(20.0)))
_NAMED_MOTION = 0.2
"""Share of the largest acceleration below which a part of the motion is not named."""
_MOVING = {ContactState.OPEN: "open", ContactState.SLIPPING: "slip"}
_STATES = _MOVING | {ContactState.CLOSED: "stay closed", ContactState.STICKING: "stick"}


def motion_words(problem: QuasistaticProblem, motion: DynamicOutcome) -> str:
    """Return the object's motion in words, its acceleration, and which contacts open or slip.

    Down is where the load's force pulls; other directions are in world axes. For other passive
    coordinates than those of one free object no direction is told.

    Args:
        problem: The problem.
        motion: An outcome of it.

    Returns:
        Words that follow "the object can", such as "slip down, 3.1 m/s^2 (contacts 4, 5 open)".
    """
    states = state_words(motion.states, _MOVING)
    fast = f", {motion.point_acceleration:.3g} m/s^2" + (f" ({states})" if states else "")
    if problem.wrench_matrix is not None:
        return f"{'slip' if ContactState.SLIPPING in motion.states else 'move'}{fast}"
    linear, angular = motion.object_acceleration[:3], motion.object_acceleration[3:]
    turning = float(np.linalg.norm(np.cross(angular, problem.positions), axis=1).max(initial=0.0))
    least, load = _NAMED_MOTION * motion.point_acceleration, problem.external_wrench[:3]
    parts = []
    if np.linalg.norm(linear) > least or turning <= least:
        parts.append(_translation_words(_unit_vector(linear), _unit_vector(load), motion.states))
    if turning > least:
        axis = _unit_vector(angular)
        word = "tilt" if abs(float(axis @ _unit_vector(load))) < _SAME_WAY else "turn"
        parts.append(f"{word} about {_direction_words(axis)}")
    return f"{' and '.join(parts)}{fast}"


def _translation_words(
    direction: FloatArray, load: FloatArray, states: tuple[ContactState, ...]
) -> str:
    """Return a verb and a direction, such as "move sideways along +x"."""
    down = float(direction @ load)
    if down > _SAME_WAY and set(states) == {ContactState.OPEN}:
        return "fall"
    verb = "slip" if ContactState.SLIPPING in states else "move"
    if abs(down) > _SAME_WAY:
        return f"{verb} {'down' if down > 0.0 else 'up'}"
    where = "sideways " if abs(down) < _SIDEWAYS else "down " if down > 0.0 else "up "
    return f"{verb} {where if load.any() else ''}along {_direction_words(direction)}"


def _direction_words(direction: FloatArray) -> str:
    """Return a direction in words: a world axis, or its components."""
    largest = int(np.argmax(np.abs(direction)))
    if abs(direction[largest]) > _SAME_WAY:
        return f"{'+' if direction[largest] > 0.0 else '-'}{'xyz'[largest]}"
    return f"({', '.join(f'{part + 0.0:.2f}' for part in np.round(direction, 2))})"


def state_words(states: Sequence[ContactState], words: Mapping[ContactState, str] = _STATES) -> str:
    """Return in words which contacts are in which states."""
    parts = []
    for state, word in words.items():
        which = [str(index) for index, own in enumerate(states) if own is state]
        if len(which) == len(states):
            parts.append(f"all contacts {word}")
        elif which[1:]:
            parts.append(f"contacts {', '.join(which)} {word}")
        elif which:
            verb, *after = word.split()
            parts.append(" ".join([f"contact {which[0]} {verb}s", *after]))
    return "; ".join(parts)


def _unit_vector(vector: FloatArray) -> FloatArray:
    length = float(np.linalg.norm(vector))
    return vector / length if length > 0.0 else vector


_MORE = 10
"""Factor on the node limit that is suggested where it ended a search."""


def stability(
    problem: QuasistaticProblem,
    torques: ArrayLike | Mapping[str, float],
    *,
    acceleration_resolution: float = 1e-3,
    node_limit: int = NODE_LIMIT,
    time_limit: float | None = None,
) -> StabilityVerdict:
    """Decide whether rest is the only outcome with these torques, and prove it.

    Where contacts slide by a declared motion, decide whether that motion is kept: accelerations are
    then deviations from those of the motion, which are neglected.

    Args:
        problem: Contacts, load and joints, with `object_inertia` and `joint_inertia`; without them
            only proofs that hold for every inertia are used.
        torques: (L,) the motors' torques, as solutions give them, or by joint, N m (N).
        acceleration_resolution: Points of the object that accelerate by less than this share of
            load over mass count as at rest; 1e-6 to 0.01.
        node_limit: Most sets of outcomes that are searched, not counting those that multipliers
            found before prove.
        time_limit: Seconds; None: any time. With it a slower machine may decide less.

    Raises:
        ArgumentError: If an argument is wrong.

    Examples:
        >>> from graspless_pin import load_scene, maximize_margin, stability
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> print(stability(problem, maximize_margin(problem).torques))
        holds: the object provably stays at rest (75 LPs); no small motion grows
    """
    return _decided_verdict(
        *_blank_verdict(problem, torques, acceleration_resolution, node_limit, time_limit)
    )


def counterexamples(verdict: StabilityVerdict, most: int) -> list[DynamicOutcome]:
    """Return the motion of a verdict, and further moving outcomes that a search finds.

    Args:
        verdict: The verdict; the result is empty if it has no motion.
        most: Largest number of further outcomes.
    """
    dynamics = None if verdict.motion is None else _scaled_dynamics(verdict)[0]
    if verdict.motion is None or dynamics is None:
        return []
    others = islice(search_motions(dynamics), most)
    return [verdict.motion] + [outcome_record(verdict.problem, dynamics, f) for f in others]


def undecided_verdict(
    problem: QuasistaticProblem,
    torques: ArrayLike | Mapping[str, float],
    message: str,
    *,
    acceleration_resolution: float = 1e-3,
    node_limit: int = NODE_LIMIT,
    time_limit: float | None = None,
) -> StabilityVerdict:
    """Return an undecided verdict with a sentence why. Other arguments as of `stability`.

    Raises:
        ArgumentError: If an argument is wrong.
    """
    blank, _ = _blank_verdict(problem, torques, acceleration_resolution, node_limit, time_limit)
    return replace(blank, message=message)


def _blank_verdict(
    problem: QuasistaticProblem,
    torques: ArrayLike | Mapping[str, float],
    acceleration_resolution: float,
    node_limit: int,
    time_limit: float | None,
) -> tuple[StabilityVerdict, Limits]:
    """Check the arguments of `stability`; return an undecided verdict and the search's limits."""
    checked_problem(problem)
    tau = motor_torques(problem.joint_names, torques)
    resolution = real_number("acceleration_resolution", acceleration_resolution, FINEST_RESOLUTION)
    if resolution > COARSEST_RESOLUTION:
        raise ArgumentError(
            "acceleration_resolution",
            f"is {resolution}; it must be at most {COARSEST_RESOLUTION}: an object that "
            "accelerates by a larger share of load over mass is not at rest",
        )
    if time_limit is not None:
        time_limit = real_number("time_limit", time_limit, 0.0)
    limits = Limits.from_now(whole_number("node_limit", node_limit, 0), time_limit)
    limit = np.nan
    if (mass := largest_mass(problem)) is not None:
        limit = resolution * problem.scales.force / mass
    blank = StabilityVerdict(
        Stability.UNDECIDED, problem, tau, resolution, limit, rest_forces=None, motion=None,
        proof=None, no_rest=None, programs=0, nodes=0, free_motions=len(free_motions(problem)),
        small_motions=None, seconds=0.0, next_nodes=0, message="",
    )  # fmt: skip
    return blank, limits


def _decided_verdict(blank: StabilityVerdict, limits: Limits) -> StabilityVerdict:
    """Decide a verdict: by a certificate, by the balance of forces, then by search."""
    problem, torques = blank.problem, blank.torques
    if why := problem.cone_model.no_verdict:
        return replace(blank, message=why)
    try:
        dynamics, nothing_moves = _scaled_dynamics(blank)
    except np.linalg.LinAlgError:
        why = "undecided: the inertias differ by more than double precision resolves"
        return replace(blank, message=why)
    commanded = commanded_forces(problem, torques)
    # The power of kinetic friction has no sign: then certificates are not valid.
    draft, proof = (blank, None) if slides_with_friction(problem).any() else (
        _try_certificate(blank, (), commanded, dynamics)
    )  # fmt: skip
    if draft.rest_forces is not None and proof is not None:
        return _strong_verdict(draft, proof)
    rest = balance(problem, torques)
    if rest is None:
        return replace(draft, message="undecided: no solver could balance the forces")
    draft = replace(draft, programs=draft.programs + rest.programs)
    if not rest.is_rest:
        return _no_rest_verdict(draft, rest.proof, dynamics, limits)
    draft = replace(draft, rest_forces=world_forces(problem, rest.forces * problem.scales.force))
    if nothing_moves:
        proof = RestProof((), draft.rest_forces, None, np.inf)
    if proof is not None:
        return _strong_verdict(draft, proof)
    if dynamics is None:
        why = f"undecided: {_rest_words(problem)}; state object_inertia and joint_inertia, too"
        return replace(draft, message=why)
    return _searched_verdict(draft, dynamics, commanded, limits)


def _rest_words(problem: QuasistaticProblem) -> str:
    """Return in words that rest, or the declared motion, is an outcome."""
    return f"the object can {'keep its motion' if problem.is_sliding.any() else 'stay'}"


def _strong_verdict(draft: StabilityVerdict, proof: RestProof) -> StabilityVerdict:
    problem, torques, forces = draft.problem, draft.torques, draft.rest_forces

    def supporting_forces() -> FloatArray:
        if forces is None:
            return np.zeros((problem.contact_count, 3))
        local = np.einsum("lij,li->lj", problem.frames, forces) / problem.scales.force
        bearing = bearing_forces(problem, torques, local)
        return world_forces(problem, bearing * problem.scales.force)

    small = small_motions_without_scene(problem, supporting_forces)
    draft = replace(draft, status=Stability.STRONG, proof=proof, small_motions=small)
    return replace(draft, message=strong_words(draft))


def _scaled_dynamics(blank: StabilityVerdict) -> tuple[Dynamics | None, bool]:
    """Return the scaled dynamics, or None, and whether it is None because there is no load."""
    problem = blank.problem
    inertia = whole_inertia(problem)
    if inertia is None:
        return None, False
    dynamics = scaled_dynamics(
        problem, blank.torques, inertia, hybrid_contacts(problem), blank.acceleration_limit
    )
    return dynamics, dynamics is None


def _try_certificate(
    draft: StabilityVerdict,
    loads: tuple[LoadProof, ...],
    commanded: FloatArray,
    dynamics: Dynamics | None,
) -> tuple[StabilityVerdict, RestProof | None]:
    """Try a certificate by one linear program; return the updated verdict, and the proof or None.

    A certificate's forces may balance the load only nearly, and with proven loads they may be
    outside their cones: then they are no forces of rest.
    """
    normal_forces = with_proven_loads(commanded, loads)
    rest, proof = balance_and_certificate(
        draft.problem, draft.torques, normal_forces, loads, dynamics
    )
    if rest is not None:
        draft = replace(draft, programs=draft.programs + rest.programs)
        if proof is not None and not loads and rest.is_rest:
            draft = replace(draft, rest_forces=proof.forces)
    return draft, proof


def _searched_verdict(
    draft: StabilityVerdict, dynamics: Dynamics, commanded: FloatArray, limits: Limits
) -> StabilityVerdict:
    """Prove smallest normal forces, search for a motion, then branch over all outcomes.

    Under a declared motion with friction: search for another motion, then branch over the rest.
    """
    most, unit = force_limit(draft.problem, dynamics), dynamics.force_unit
    sliding_friction, loads = bool(slides_with_friction(draft.problem).any()), ()
    if not sliding_friction:
        loads, programs = proven_loads(dynamics, commanded / unit, most)
        draft = replace(draft, programs=draft.programs + programs)
    if loads:
        draft, proof = _try_certificate(draft, loads, commanded, dynamics)
        if proof is not None:
            return _strong_verdict(draft, proof)
    forces = find_motion(dynamics)
    if forces is None:
        begun = time.thread_time()
        if sliding_friction:
            result = search_other_motion(dynamics, most, limits.is_over)
        else:
            least = with_proven_loads(commanded, loads) / unit
            result = branch(dynamics, Relaxation(dynamics, least, most), limits.is_over)
        programs, seconds = draft.programs + result.programs, time.thread_time() - begun
        draft = replace(draft, programs=programs, nodes=result.nodes, seconds=seconds)
        forces = result.motion
        if result.tree is not None:
            leaving = () if sliding_friction else _leaving_joints(draft, dynamics, most)
            proof = RestProof(loads, None, result.tree, most * unit)
            return _strong_verdict(replace(draft, leaving=leaving), proof)
        if forces is None:
            resists = state_words(result.resisting) or "no contact's state is known"
            what = f"; what resists: {resists}" if sliding_friction else ""
            return _unproven_verdict(draft, limits, f"{result.remaining} left{what}")
    return _weak_verdict(draft, outcome_record(draft.problem, dynamics, forces))


def _leaving_joints(draft: StabilityVerdict, dynamics: Dynamics, most: float) -> tuple[str, ...]:
    """Return names of joints that may leave the object by themselves while the others keep it.

    Proofs by branching do not bound the motion of joints by themselves. Rest is an outcome for
    these joints, as friction keeps them. That they leave is another one if it opens their contacts,
    or slides along them, and all other forces balance without them.

    Args:
        draft: A verdict with a proof that the object stays at rest.
        dynamics: The scaled dynamics.
        most: The largest normal force, scaled.
    """
    problem = draft.problem
    moved = problem.jacobian.reshape(problem.contact_count, 3, -1) != 0.0
    acts: NDArray[np.bool_] = np.any(moved, axis=1)
    leaving = np.zeros(problem.joint_count, dtype=bool)
    for opened in np.unique(acts.T, axis=0):
        own = np.any(acts, axis=0) & ~np.any(acts[~opened], axis=0)
        aside = without_free_joints(dynamics, opened, most).free_motion
        if not aside.any() or (dynamics.rows[opened, 0] @ aside < -dynamics.resolution).any():
            continue
        if _partial_rest_forces(draft, ~own, opened) is not None:
            leaving |= own
    return tuple(problem.joint_names[joint] for joint in np.flatnonzero(leaving))


def _partial_rest_forces(
    draft: StabilityVerdict, joints: NDArray[np.bool_], opened: NDArray[np.bool_] | None = None
) -> FloatArray | None:
    """Return forces that balance the object and some joints, whatever the other joints do.

    Args:
        draft: A verdict, for its problem and torques.
        joints: (L,) mask of the joints that are balanced.
        opened: (M,) contacts without force; None: all may bear.

    Returns:
        (M, 3) in contact frames, in loads; None where there are none.
    """
    problem = draft.problem
    jacobian, load = scaled_balance(problem, draft.torques)
    kept = np.concatenate([np.ones(problem.passive_count, dtype=bool), joints])
    if opened is not None:
        jacobian = np.where(opened[:, None, None], 0.0, jacobian)
    friction = free_friction(problem)
    rest = least_residual(jacobian[:, :, kept], load[kept], friction, BALANCE_TOLERANCE)
    return None if rest is None or not rest.is_rest else rest.forces


def _unproven_verdict(draft: StabilityVerdict, limits: Limits, open_sets: str) -> StabilityVerdict:
    motion = "other motion" if draft.problem.is_sliding.any() else "motion"
    why = f"undecided: {_rest_words(draft.problem)}, but {motion} was not ruled out "
    why += f"({draft.nodes} sets of outcomes examined, {open_sets})"
    most = limits.node_limit or 0
    more = max(_MORE * most, BRIEF_NODE_LIMIT) if draft.nodes >= most else 0
    return replace(draft, next_nodes=more, message=why)


def _weak_verdict(draft: StabilityVerdict, motion: DynamicOutcome) -> StabilityVerdict:
    message = "may lose its motion" if draft.problem.is_sliding.any() else "may fail"
    message += f": the object can {motion_words(draft.problem, motion)}"
    return replace(draft, status=Stability.WEAK, motion=motion, message=message)


def _no_rest_verdict(
    draft: StabilityVerdict, proof: FloatArray, dynamics: Dynamics | None, limits: Limits
) -> StabilityVerdict:
    problem, torques = draft.problem, draft.torques
    # Written so that NaN is no proof.
    if not residual_lower_bound(problem, torques, proof) > BALANCE_TOLERANCE:
        return replace(
            draft, message="undecided: no forces of rest found, but not proven that none exist"
        )
    forces = None if dynamics is None else find_motion(dynamics)
    motion, message = None, "loses its motion" if problem.is_sliding.any() else "fails"
    message += f": {'keeping the motion' if problem.is_sliding.any() else 'rest'} is no outcome"
    if dynamics is not None and forces is None and slides_with_friction(problem).any():
        result = search_other_motion(dynamics, force_limit(problem, dynamics), limits.is_over)
        draft = replace(draft, programs=draft.programs + result.programs, nodes=result.nodes)
        forces = result.motion
        if result.tree is not None and result.tree.is_empty:
            message += ", and nothing else is one: sliding contacts jam"
    may_bend = problem.joint_count > 0 and not problem.is_sliding.any()
    if dynamics is not None and forces is None and may_bend:
        forces = _joint_motion_forces(draft, dynamics)
    if dynamics is not None and forces is not None:
        motion = outcome_record(problem, dynamics, forces)
        message += f"; the object can {motion_words(problem, motion)}"
    draft = replace(
        draft, status=Stability.NONE, motion=motion, no_rest=read_only(proof), message=message
    )
    if draft.moves is MovingPart.FINGER:
        return replace(draft, message=finger_words(draft, NO_FINGERS))
    return draft


def _joint_motion_forces(draft: StabilityVerdict, dynamics: Dynamics) -> FloatArray | None:
    """Return scaled forces of an outcome in which only joints move; None: none was found."""
    problem = draft.problem
    anything = replace(dynamics, limit=-inf)
    acting: NDArray[np.bool_] = np.any(problem.jacobian, axis=0)
    if not acting.all():
        # Without joints that act on no contact, object and other joints may balance.
        partial = _partial_rest_forces(draft, acting)
        if partial is not None:
            forces = partial * problem.scales.force / dynamics.force_unit
            start = forces if is_outcome(anything, forces) else polish(anything, forces)
            if start is not None:
                return start
    return find_motion(anything)
