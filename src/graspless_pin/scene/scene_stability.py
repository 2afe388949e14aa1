"""Verdicts on scenes, and where moving links touch supports: forces that no problem has."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Unpack

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.geometry.contact.distances import near_pairs, separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.holding.verdict import MovingPart, Stability, StabilityKeywords, StabilityVerdict
from graspless_pin.problem.checks import FloatArray, finite_array
from graspless_pin.problem.cones import CONE_MODELS, checked_cone
from graspless_pin.scene.fields import SceneFields
from graspless_pin.scene.problem_data import fingers_of_motors, problem_of, rest_problem
from graspless_pin.solution import TorqueSolution

if TYPE_CHECKING:
    from graspless_pin.holding.small_motions import RestModel


def hand_support_contacts(scene: SceneFields) -> tuple[tuple[str, str], ...]:
    """Return which links that torques or commanded forces can move touch which supports.

    A problem has the contacts of the object alone. What a support does to a link counts against the
    joints' torques all the same: verdicts on what really happens cannot be had then. Links that
    stand still, as on joints under position control, may touch what they like.

    Args:
        scene: The scene.

    Returns:
        (link, support) of each pair that is no farther apart than the scene's `contact_tolerance`,
        links in model order.
    """
    if scene.hand is None:
        return ()
    bodies, moving = scene.hand.placed_bodies, _moving_links(scene.hand)
    touching = {}
    for support in scene.supports:
        pieces = support.placed_bodies
        for i, k in near_pairs(bodies, pieces, scene.contact_tolerance):
            if bodies[i].name in moving:
                gap = separation(bodies[i], pieces[k]).distance
                if gap <= scene.contact_tolerance:
                    touching[bodies[i].name, support.name] = i
    return tuple(sorted(touching, key=lambda pair: touching[pair]))


def verdict_of(
    scene: SceneFields,
    torques: ArrayLike,
    *,
    friction: FloatArray | None = None,
    **options: Unpack[StabilityKeywords],
) -> StabilityVerdict:
    """Tell whether a scene's object stays at rest with these torques.

    Args:
        scene: The scene.
        torques: (L,) the motors' torques, as solutions give them, N m (N).
        friction: (M,) coefficients where those of one body's contacts differ; None: the scene's.
        options: Of `stability`.

    Raises:
        SceneError: See `Scene.contacts`.
        ArgumentError: If a link of the fingers has no mass and its motor no inertia.
    """
    # Loaded here: whoever solves without a verdict goes without the search and its solver.
    from graspless_pin.holding.stability import stability, undecided_verdict

    problem, why = problem_of(scene), unknown_of(scene)
    if friction is not None:
        problem = problem.with_changes(friction=friction)
    given = finite_array("torques", torques, (problem.joint_count,))
    if why:
        return known_of_scene(scene, undecided_verdict(problem, given, why, **options))
    problem = rest_problem(scene, problem, given)
    return known_of_scene(scene, stability(problem, given, **options))


def solution_verdict(
    scene: SceneFields, solution: TorqueSolution, **options: Unpack[StabilityKeywords]
) -> StabilityVerdict:
    """Return the verdict on a solution's torques: its own where they are guaranteed.

    Args:
        scene: The scene.
        solution: A solution of it that was found.
        options: Of `stability`, where it has to be asked.

    Raises:
        SceneError: See `verdict_of`.
        ArgumentError: See `verdict_of`.
    """
    known = None if solution.guarantee is None else solution.guarantee.verdict
    if known is not None:
        return known_of_scene(scene, known)
    return verdict_of(scene, solution.torques, **options)


def known_of_scene(scene: SceneFields, verdict: StabilityVerdict) -> StabilityVerdict:
    """Return a verdict on a scene's problem with what the scene tells beside it.

    Whether rest lasts hangs on how contacts roll, and a joint belongs to a finger.
    """
    from graspless_pin.holding.verdict_words import NO_FINGERS, finger_words, strong_words

    # Loaded here: scenes that are solved without a verdict go without.
    from graspless_pin.scene.minimum_stiffness import controller_words, small_motions

    verdict = replace(
        verdict, controller=controller_words(scene), joints_held=scene.controller.holds_joints
    )
    small = verdict.small_motions
    if verdict.joints_held and verdict.status is Stability.WEAK:
        said = verdict.message.replace("may fail", f"may fail with {verdict.controller}", 1)
        return replace(verdict, message=said)
    fingers = NO_FINGERS if scene.hand is None else fingers_of_motors(scene.hand)
    if verdict.moves is MovingPart.FINGER:
        return replace(verdict, message=finger_words(verdict, fingers))
    if small is None or verdict.problem.is_sliding.any():
        return verdict
    if small.unknown:
        verdict = replace(verdict, small_motions=small_motions(scene, verdict.torques))
    return replace(verdict, message=strong_words(verdict, fingers))


def rest_model_of(scene: SceneFields) -> RestModel:
    """Return what a scene tells of rest beside its problem, for torques to be guaranteed.

    Where its controller is stated, rest has to last under it; of a declared motion that is not
    asked, as nobody knows it.
    """
    from graspless_pin.holding.small_motions import RestModel
    from graspless_pin.holding.stability import stability
    from graspless_pin.scene.minimum_stiffness import linearized_motions

    if not scene.controller.is_stated or problem_of(scene).is_sliding.any():
        return RestModel(unknown_of(scene))
    return RestModel(
        unknown_of(scene),
        lambda: linearized_motions(scene),
        lambda problem, torques, **limits: known_of_scene(
            scene, stability(rest_problem(scene, problem, torques), torques, **limits)
        ),
        lasts=True,
    )


def unknown_of(scene: SceneFields) -> str:
    """Return why no verdict on torques of a scene can be had; empty: one can."""
    if why := CONE_MODELS[checked_cone(scene.cone)].no_verdict:
        return why
    if scene.controller.holds_joints:
        hybrid = () if scene.hand is None else scene.hand.control.hybrid_fingers
        told = ", ".join(hybrid)
        return f"undecided: joints hold their positions, but {told} follows" if hybrid else ""
    touching = hand_support_contacts(scene)
    if not touching:
        return ""
    pairs = ", ".join(f"{link} on {support}" for link, support in touching)
    return f"undecided: the hand touches supports ({pairs}); what they do to its torques is unknown"


def _moving_links(hand: Hand) -> set[str]:
    """Return the links that force-controlled joints move, and those of hybrid fingers."""
    rows = np.flatnonzero(hand.actuation.from_joints.any(axis=1))
    links = {
        link
        for link, carrier in hand.tree.link_joints.items()
        if hand.tree.supports[carrier, rows].any()
    }
    return links.union(*(hand.fingers[name].links for name in hand.control.hybrid_fingers))
