"""Findings on a scene in its present state: near misses, overlaps, implausible figures.

`state_findings` are those that make torques meaningless: the hand does not touch the object, or
overlaps something. Evaluators, studies and paths use them, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.options import other_algorithms_with
from graspless_pin.errors import GrasplessPinError, StateError, StateFault
from graspless_pin.findings import Finding, FindingCode, capture, causes_first
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.contact.distances import nearest_separation
from graspless_pin.geometry.hand.actuation import limit_words
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.overlaps import Overlap, unwanted_overlaps
from graspless_pin.problem.checks import FloatArray, JointUnit
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.contact_findings import (
    contact_findings,
    in_mm,
    stated_contact_findings,
)
from graspless_pin.scene.entry_findings import (
    LARGEST_OBJECT,
    MOST_ANGLE,
    box_around,
    likely_lengths,
    tolerance_findings,
    unit_findings,
)
from graspless_pin.scene.fields import SceneFields, StatedFields
from graspless_pin.scene.problem_data import problem_of
from graspless_pin.scene.scene_schema import SolveEntry
from graspless_pin.scene.uncertain_figures import unused_surfaces
from graspless_pin.suggestions import first_of

STEEPEST_FRICTION = 3.0
"""Largest plausible friction coefficient of dry bodies."""
_STRONGEST_GRAVITY = 30.0  # m/s^2; Jupiter has 25
_COSINE_UPWARD = np.cos(np.radians(45.0))
_LEAST_GRAVITY = 9.81  # m/s^2, where loads are compared with the object's weight
_HEAVIEST_LOAD = 50.0
"""Relative to the object's mass or weight."""
_UNLIMITED_EFFORT = {JointUnit.TORQUE: 1e3, JointUnit.FORCE: 1e5}
_UNLIMITED_FORCE = 1e6  # N
_FORCE_OVER_WEIGHT = 1e4


class StateChecks(NamedTuple):
    """Which checks are made of a state.

    Attributes:
        collisions: Whether links must not overlap supports or each other by more than
            ``max_penetration``, see `unwanted_overlaps`.
        need_hand: Whether the hand has to touch the object.
    """

    collisions: bool = True
    need_hand: bool = True


ALL_CHECKS = StateChecks()


def state_findings(scene: SceneFields, checks: StateChecks = ALL_CHECKS) -> tuple[Finding, ...]:
    """Return the serious findings that depend on where bodies are, the gravest first.

    Args:
        scene: The scene.
        checks: Which checks are made.

    Raises:
        SceneError: If the hand has to touch, and the contacts cannot be found for another reason
            than that there are none.
    """
    if scene.hand is None:
        return ()
    findings = [*_serious_overlap_findings(hand_overlaps(scene))] if checks.collisions else []
    if checks.need_hand and not _hand_touches(scene):
        findings.append(
            Finding(
                FindingCode.HAND_TOUCHES_NOTHING,
                scene.object.name,
                f"no link of the hand touches object '{scene.object.name}'",
                "move the hand (base_pose, in metres and radians), have it placed (graspless-pin "
                "place), or close its fingers (graspless-pin close)",
                ("hand", "base_pose"),
            )
        )
    return causes_first(findings) if len(findings) > 1 else tuple(findings)


def hand_overlaps(scene: SceneFields) -> tuple[Overlap, ...]:
    """Return overlaps of the hand with itself or supports deeper than ``max_penetration``."""
    hand, deepest = scene.hand, scene.max_penetration
    if hand is None:
        return ()
    supports = [support.placed_bodies for support in scene.supports]
    sources = hand.positions, hand.tree, *supports, deepest
    return scene._cache.value(
        "overlaps", sources, lambda: unwanted_overlaps(hand, scene.supports, tolerance=deepest)
    )


def _hand_touches(scene: SceneFields) -> bool:
    try:
        return contacts_of(scene).arrays.hand_count > 0
    except StateError as error:
        if error.kind is StateFault.NO_CONTACT:
            return False
        raise


def _serious_overlap_findings(overlaps: Iterable[Overlap]) -> Iterator[Finding]:
    """Find overlaps of the hand with supports and with itself: one serious finding for each."""
    for kind, (deepest, words) in _deepest_by_kind(overlaps).items():
        on_support = kind is BodyKind.SUPPORT
        yield Finding(
            FindingCode.HAND_THROUGH_SUPPORT if on_support else FindingCode.HAND_THROUGH_ITSELF,
            deepest.link,
            words,
            "move the hand (base_pose, q): this position is impossible"
            if on_support
            else "change q; if collision shapes are too large, disable their pairs in an SRDF",
            ("hand",),
        )


def _deepest_by_kind(overlaps: Iterable[Overlap]) -> dict[BodyKind, tuple[Overlap, str]]:
    """Return the deepest overlap with supports and the one of links, with a text on all of them."""
    by_kind: dict[BodyKind, list[Overlap]] = {}
    for overlap in overlaps:
        by_kind.setdefault(overlap.kind, []).append(overlap)
    summaries = {}
    for kind, same_kind in by_kind.items():
        deepest = max(same_kind, key=lambda overlap: overlap.depth)
        pairs = "pair" if len(same_kind) == 2 else "pairs"
        others = f", and {len(same_kind) - 1} more {pairs} less deep" if len(same_kind) > 1 else ""
        summaries[kind] = deepest, f"{deepest}{others}"
    return summaries


_UNUSED_LIMIT = Finding(
    FindingCode.UNUSED_OPTION,
    "hybrid_force_limit",
    "hybrid_force_limit is given, and no finger is under hybrid control",
    "write control: {FINGER: hybrid} for the fingers that it is for, or leave it out",
    ("hand", "hybrid_force_limit"),
)


def findings_of(scene: SceneFields) -> tuple[Finding, ...]:
    """Return all findings on a scene, the gravest first.

    Where the scene has no problem in this state, findings that need it are left out: the error of
    `Scene.problem` says why.
    """
    with capture() as emitted:
        own = [*_all_figure_findings(scene)]
        if scene.hand is not None:
            own += [*_joint_findings(scene.hand), *_overlap_findings(scene, scene.hand)]
            if scene.hybrid_force_limit is not None and not scene.hand.control.hybrid_fingers:
                own.append(_UNUSED_LIMIT)
            own += _gravcomp_findings(scene.hand) if scene.count_own_weight else ()
        own += [*_touch_findings(scene), *stated_contact_findings(scene)]
    hand_findings = () if scene.hand is None else scene.hand.findings
    return causes_first([*scene.load_findings, *hand_findings, *_with_places(scene, own), *emitted])


def _with_places(scene: SceneFields, findings: Iterable[Finding]) -> Iterable[Finding]:
    """Return findings with their places in the scene's file filled in."""
    return findings if scene._source is None else map(scene._source.with_place, findings)


def figure_findings(scene: SceneFields) -> tuple[Finding, ...]:
    """Return the findings on the scene's figures, which do not depend on poses."""
    return tuple(_with_places(scene, _all_figure_findings(scene)))


def unused_figures(options: Mapping[str, Any], stated: StatedFields | None) -> Iterator[Finding]:
    """Find options of a scene that its own algorithm does not use; defaults are accepted.

    Args:
        options: The scene's options.
        stated: The scene's file; None: it came from none.
    """
    algorithm = options.get("algorithm", "margin")
    for key, value in options.items():
        users = other_algorithms_with(key, algorithm)
        if users and value is not None and value != SolveEntry.model_fields[key].default:
            note = (
                "; graspless-pin place and planning use it with every algorithm"
                if key == "margin"
                else ""
            )
            finding = Finding(
                FindingCode.UNUSED_OPTION,
                key,
                f"{key} is {value}, which has no effect with the scene's algorithm, {algorithm!r}",
                f"write algorithm: {' or '.join(users)}, or leave {key} out{note}",
                ("solve", key),
            )
            yield finding if stated is None else stated.with_place(finding)


def _all_figure_findings(scene: SceneFields) -> Iterator[Finding]:
    """Find figures that are probably in another unit, or placeholders."""
    target, gravity = scene.object, float(np.linalg.norm(scene.gravity))
    yield from unit_findings(target, beside_hand=scene.hand is not None)
    lengths = {key: getattr(scene, key) for key in ("contact_tolerance", "max_penetration")}
    yield from tolerance_findings(target, lengths)
    lowest, highest = box_around(target)
    slack = 1e-6 * (highest - lowest)
    center = target.center_of_mass
    if (center < lowest - slack).any() or (center > highest + slack).any():
        yield Finding(
            FindingCode.CENTER_OUTSIDE,
            target.name,
            f"the centre of mass {np.round(center, 6).tolist()} m of object '{target.name}' lies "
            "outside the box around its shape",
            "give center_of_mass in the object's own frame, in metres"
            + likely_lengths(center, np.maximum(-lowest, highest)),
            ("object", "center_of_mass"),
        )
    yield from _load_findings(scene, max(gravity, _LEAST_GRAVITY) * target.mass, (lowest, highest))
    if gravity > _STRONGEST_GRAVITY:
        yield Finding(
            FindingCode.UNLIKELY_GRAVITY,
            "gravity",
            f"gravity is {gravity:g} m/s^2",
            "give it in metres per second squared: 9.81 on Earth",
            ("gravity",),
        )
    if scene.gravity[2] > _COSINE_UPWARD * gravity:
        yield Finding(
            FindingCode.UNLIKELY_GRAVITY,
            "gravity",
            f"gravity points up: {scene.gravity.tolist()} m/s^2",
            f"if z of the world points up, write [0, 0, {-gravity:g}]",
            ("gravity",),
        )
    stated = [(("friction", name), name, value) for name, value in scene.friction.items()]
    stated += [
        (("supports", index, "friction"), support.name, support.friction)
        for index, support in enumerate(scene.supports)
        if support.friction is not None
    ]
    stated += [
        (("materials",), " on ".join(sorted(pair)), value)
        for pair, value in scene.materials.coefficients.items()
    ]
    for key, name, value in stated:
        if value > STEEPEST_FRICTION:
            yield Finding(
                FindingCode.STEEP_FRICTION,
                name,
                f"the coefficient of friction {value:g} ({name}) is above {STEEPEST_FRICTION:g}",
                "give the ratio of friction to normal force, not a percentage or an angle: 0.3 "
                "for steel, 0.8 for rubber",
                key,
            )
    if scene.max_normal_force >= max(_UNLIMITED_FORCE, _FORCE_OVER_WEIGHT * target.mass * gravity):
        yield Finding(
            FindingCode.PLACEHOLDER_FORCE,
            target.name,
            f"the largest normal force, {scene.max_normal_force:g} N, looks like a placeholder",
            "give the largest admissible normal force: the margin includes the distance to it",
            ("max_normal_force",),
        )


def _load_findings(
    scene: SceneFields, weight: float, box: tuple[FloatArray, FloatArray]
) -> Iterator[Finding]:
    """Find loads that are many times the object's weight, or act far from it.

    Args:
        scene: The scene.
        weight: Weight of its object, N.
        box: Lowest and highest corner of the box around the object, in its axes, m.
    """
    target = scene.object
    for index, load in enumerate(scene.loads):
        force = float(np.linalg.norm(load.force))
        for name, figure, unit, reference, largest in (
            ("mass", load.mass, "kg", "mass", _HEAVIEST_LOAD * target.mass),
            ("force", force, "N", "weight", _HEAVIEST_LOAD * weight),
        ):
            if figure > largest:
                yield Finding(
                    FindingCode.UNLIKELY_LOAD,
                    load.name,
                    f"the {name} of load '{load.name}', {figure:g} {unit}, is "
                    f"{_HEAVIEST_LOAD * figure / largest:.3g} times the {reference} of object "
                    f"'{target.name}'",
                    f"give it in {unit}",
                    ("loads", index, name),
                )
        lowest, highest = box
        point = target.center_of_mass if load.at is None else load.at
        distance = float(np.maximum(lowest - point, point - highest).max())
        if distance > float((highest - lowest).max()):
            yield Finding(
                FindingCode.UNLIKELY_LOAD,
                load.name,
                f"load '{load.name}' acts {distance:.3g} m outside the box around object "
                f"'{target.name}'",
                "give 'at' in the object's own frame, in metres",
                ("loads", index, "at"),
            )


def _joint_findings(hand: Hand) -> Iterator[Finding]:
    """Find joint angles in degrees, and effort limits that are placeholders."""
    is_revolute = np.array([kind != "prismatic" for kind in hand.tree.joint_kinds], dtype=bool)
    for index in np.flatnonzero((np.abs(hand.positions) > MOST_ANGLE) & is_revolute):
        name, angle = hand.joint_names[index], float(hand.positions[index])
        yield Finding(
            FindingCode.ANGLE_IN_DEGREES,
            name,
            f"joint '{name}' stands at {angle:g} rad, more than a turn",
            f"give angles in radians, or under q_deg: {angle:g} degrees are "
            f"{np.radians(angle):.4g} rad",
            ("hand", "q", name),
        )
    declared = {
        name
        for finding in hand.findings
        if finding.code in (FindingCode.PLACEHOLDER_EFFORT, FindingCode.UNKNOWN_EFFORT)
        for name in finding.subject.split(", ")
    }
    placeholders = {
        name: limit_words(name, upper)
        for name, unit, lower, upper in zip(
            hand.actuation.names, hand.effort_units, *hand.effort_limits, strict=True
        )
        if max(-lower, upper) >= _UNLIMITED_EFFORT[unit] and name not in declared
    }
    if placeholders:
        yield Finding(
            FindingCode.PLACEHOLDER_EFFORT,
            ", ".join(placeholders),
            f"effort limits that look like placeholders: {', '.join(placeholders.values())}",
            "give the motors' real limits in effort_limits (N m, or N for a prismatic joint)",
            ("hand", "effort_limits"),
        )


def _gravcomp_findings(hand: Hand) -> Iterator[Finding]:
    """Find links whose weight an MJCF compensates (gravcomp), where the links' weight counts."""
    if names := hand.tree.compensated_links:
        yield Finding(
            FindingCode.LEFT_OUT_OF_MJCF,
            ", ".join(names),
            f"the MJCF has gravcomp for {first_of([*map(repr, names)], 3)}, but here joints carry "
            "the weight of all links",
            "if the robot's controller compensates the weight by itself, write "
            "count_own_weight: false, which leaves out the weight of all links",
            ("hand", "count_own_weight"),
        )


def _overlap_findings(scene: SceneFields, hand: Hand) -> Iterator[Finding]:
    """Find overlaps of the hand with itself or supports, serious if beyond max_penetration."""
    min_depth, max_depth = scene.contact_tolerance, scene.max_penetration
    found = unwanted_overlaps(hand, scene.supports, tolerance=min(min_depth, max_depth))
    yield from _serious_overlap_findings(one for one in found if one.depth > max_depth)
    shallow = _deepest_by_kind(one for one in found if min_depth < one.depth <= max_depth)
    for deepest, words in shallow.values():
        yield Finding(
            FindingCode.DEEP_OVERLAP,
            deepest.link,
            words,
            "move them apart (base_pose, q): no contact force acts between them; overlaps of more "
            f"than max_penetration ({in_mm(max_depth)}) are a serious finding",
            ("hand",),
        )


def _touch_findings(scene: SceneFields) -> Iterator[Finding]:
    """Find missing and doubtful contacts, and contacts that no force-controlled joint moves."""
    try:
        touching = contacts_of(scene).arrays
    except StateError as error:
        if error.kind is not StateFault.NO_CONTACT or scene.given_contacts is not None:
            return
        touching = None
    except GrasplessPinError:
        return
    if touching is not None and scene.uncertainty is not None:
        yield from unused_surfaces(scene)
    if scene.given_contacts is None:
        yield from contact_findings(scene, touching)
    if scene.hand is None:
        return
    hand_findings = state_findings(scene, StateChecks(collisions=False))
    yield from (_with_nearest_link(scene, finding) for finding in hand_findings)
    if not hand_findings and not problem_of(scene).jacobian.any():
        yield Finding(
            FindingCode.NO_TORQUE_COUNTS,
            scene.object.name,
            "the hand touches the object with links that no force-controlled joint moves",
            "touch it with the fingers, or set hand.control of their joints to force",
            ("hand", "control"),
        )


def _with_nearest_link(scene: SceneFields, finding: Finding) -> Finding:
    """Return the finding for a hand without contacts, with the nearest link and its distance."""
    hand, pieces = scene.hand, scene.object.placed_bodies
    if hand is None or scene.given_contacts is not None or not len(hand.placed_bodies):
        return finding
    gap, link = min(
        (nearest_separation([body], pieces).distance, body.name) for body in hand.placed_bodies
    )
    away = in_mm(gap) if gap < LARGEST_OBJECT else f"{gap:.3g} m"
    nearest = replace(
        finding, message=f"{finding.message}; the nearest one, '{link}', is {away} away"
    )
    if gap < LARGEST_OBJECT:
        return nearest
    origins = {
        ("object", "pose"): (f"object '{scene.object.name}'", scene.object.T_world_object[:3, 3]),
        ("hand", "base_pose"): ("the hand's base", hand.T_world_base[:3, 3]),
    }
    key, (what, at) = max(origins.items(), key=lambda item: float(np.linalg.norm(item[1][1])))
    stands = f"{what} is at {np.round(at, 6).tolist()} m"
    longest = np.full(3, LARGEST_OBJECT)
    return replace(
        nearest, advice=f"give lengths in metres; {stands}{likely_lengths(at, longest)}", key=key
    )
