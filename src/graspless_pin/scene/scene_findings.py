"""What is wrong with a scene at this moment, from its data: near misses, overlaps, odd figures.

`state_findings` tells whether its hand stands where torques mean nothing: off the object, or in
something. Evaluators, studies and paths ask there, too.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.torque import users_of
from graspless_pin.errors import GrasplessPinError, StateError, StateFault
from graspless_pin.findings import Finding, FindingCode, capture, gravest_first
from graspless_pin.geometry.bodies.collision import PARALLEL_ANGLE, CollisionBody
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.geometry.contact.curvature import normal_jumps
from graspless_pin.geometry.contact.distances import near_pairs, nearest_separation, separation
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.overlaps import Overlap, unwanted_overlaps
from graspless_pin.problem.checks import FloatArray, JointUnit
from graspless_pin.scene.contact_arrays import contacts_of
from graspless_pin.scene.entry_findings import MOST_ANGLE, box_around, meant_lengths, unit_findings
from graspless_pin.scene.fields import SceneFields, StatedFields
from graspless_pin.scene.problem_data import problem_of
from graspless_pin.scene.scene_schema import SolveEntry
from graspless_pin.scene.stated_contact_findings import stated_contact_findings
from graspless_pin.scene.uncertain_figures import unused_surfaces

STEEPEST_FRICTION = 3.0
"""A larger coefficient is hardly one of dry bodies."""
_NEAR = 5.0  # contact tolerances
_STRONGEST_GRAVITY = 30.0  # m/s^2; Jupiter has 25
_UPWARD = np.cos(np.radians(45.0))
_LEAST_GRAVITY = 9.81  # m/s^2, where loads are held against the object's weight
_HEAVIEST_LOAD = 50.0
"""Of the object's mass or weight."""
_UNLIMITED_EFFORT = {JointUnit.TORQUE: 1e3, JointUnit.FORCE: 1e5}
_UNLIMITED_FORCE = 1e6  # N
_OVER_WEIGHT = 1e4
_SLACK = 1e-6
_JUMP = np.radians(20.0)
_UNEVEN = 0.1
"""Contact tolerances: gaps of one rigid body that differ by less are the same."""


class StateChecks(NamedTuple):
    """What is looked for in a state.

    Attributes:
        collisions: Whether links may not be deeper than ``max_penetration`` in a support or in each
            other, see `unwanted_overlaps`.
        need_hand: Whether the hand has to touch the object.
    """

    collisions: bool = True
    need_hand: bool = True


ALL_CHECKS = StateChecks()


def state_findings(scene: SceneFields, checks: StateChecks = ALL_CHECKS) -> tuple[Finding, ...]:
    """Return the serious findings that depend on where bodies are, the gravest first.

    Args:
        scene: The scene.
        checks: What is looked for.

    Raises:
        SceneError: If the hand has to touch, and the contacts cannot be found for another reason
            than that nothing touches.
    """
    if scene.hand is None:
        return ()
    found = [_of_overlap(one) for one in hand_overlaps(scene)] if checks.collisions else []
    if checks.need_hand and not _hand_touches(scene):
        found.append(
            Finding(
                FindingCode.HAND_TOUCHES_NOTHING,
                scene.object.name,
                f"no link of the hand touches object '{scene.object.name}'",
                "move the hand (base_pose, in metres and radians), have it placed (graspless-pin "
                "place), or close its fingers (graspless-pin close)",
                ("hand", "base_pose"),
            )
        )
    return gravest_first(found) if len(found) > 1 else tuple(found)


def hand_overlaps(scene: SceneFields) -> tuple[Overlap, ...]:
    """Return where the hand is in itself or in a support deeper than ``max_penetration``."""
    hand, deepest = scene.hand, scene.max_penetration
    if hand is None:
        return ()
    supports = [support.placed_bodies for support in scene.supports]
    sources = hand.positions, hand.tree, *supports, deepest
    overlaps = scene._kept.get("overlaps", sources)
    if overlaps is None:
        overlaps = unwanted_overlaps(hand, scene.supports, tolerance=deepest)
        scene._kept.put("overlaps", sources, overlaps)
    return overlaps


def _hand_touches(scene: SceneFields) -> bool:
    try:
        return contacts_of(scene).arrays.hand_count > 0
    except StateError as error:
        if error.kind is StateFault.NO_CONTACT:
            return False
        raise


def _of_overlap(one: Overlap) -> Finding:
    on_support = one.kind is BodyKind.SUPPORT
    return Finding(
        FindingCode.HAND_THROUGH_SUPPORT if on_support else FindingCode.HAND_THROUGH_ITSELF,
        one.link,
        str(one),
        "move the hand (base_pose, q): it cannot stand there"
        if on_support
        else "change q; if only the collision shapes are too wide, disable the pair in an SRDF",
        ("hand",),
    )


def findings_of(scene: SceneFields) -> tuple[Finding, ...]:
    """Return what is wrong with a scene, the gravest first.

    Where the scene has no problem in this state, what would need one is left out: asking for the
    problem says why.
    """
    with capture() as emitted:
        found = [*_figures(scene)]
        if scene.hand is not None:
            found += [*_joints(scene.hand), *_shallow_overlaps(scene)]
            found += state_findings(scene, StateChecks(need_hand=False))
        found += [*_touching(scene), *stated_contact_findings(scene)]
    of_hand = () if scene.hand is None else scene.hand.findings
    return gravest_first([*scene.load_findings, *of_hand, *_placed(scene, found), *emitted])


def _placed(scene: SceneFields, found: Iterable[Finding]) -> Iterable[Finding]:
    """Return findings with their places in the scene's file."""
    return found if scene._stated is None else map(scene._stated.placed, found)


def figure_findings(scene: SceneFields) -> tuple[Finding, ...]:
    """Return what is found of the scene's figures alone, wherever its bodies are."""
    return tuple(_placed(scene, _figures(scene)))


def unused_figures(options: Mapping[str, Any], stated: StatedFields | None) -> Iterator[Finding]:
    """Find what a scene asks for that its own algorithm has no use for.

    What is as it would be if it were left out is none.

    Args:
        options: Of the scene.
        stated: Where they stand.
    """
    algorithm = options.get("algorithm", "margin")
    for key, value in options.items():
        others = users_of(key, algorithm)
        if others and value is not None and value != SolveEntry.model_fields[key].default:
            also = "; graspless-pin place and planning use it as it is" if key == "margin" else ""
            found = Finding(
                FindingCode.UNUSED_OPTION,
                key,
                f"{key} is {value}, and the scene's algorithm, {algorithm!r}, does not use it",
                f"write algorithm: {' or '.join(others)} to have it used, or leave it out{also}",
                ("solve", key),
            )
            yield found if stated is None else stated.placed(found)


def _figures(scene: SceneFields) -> Iterator[Finding]:
    """Find figures that look like another unit or a placeholder."""
    made, gravity = scene.object, float(np.linalg.norm(scene.gravity))
    yield from unit_findings(made, beside_hand=scene.hand is not None)
    lowest, highest = box_around(made)
    slack = 1e-6 * (highest - lowest)
    center = made.center_of_mass
    if (center < lowest - slack).any() or (center > highest + slack).any():
        yield Finding(
            FindingCode.CENTER_OUTSIDE,
            made.name,
            f"the centre of mass {np.round(center, 6).tolist()} m of object '{made.name}' lies "
            "outside the box around its shape",
            "give center_of_mass in the object's own frame, in metres"
            + meant_lengths(center, np.maximum(-lowest, highest)),
            ("object", "center_of_mass"),
        )
    yield from _loads(scene, max(gravity, _LEAST_GRAVITY) * made.mass, (lowest, highest))
    if gravity > _STRONGEST_GRAVITY:
        yield Finding(
            FindingCode.UNLIKELY_GRAVITY,
            "gravity",
            f"gravity is {gravity:g} m/s^2",
            "give it in metres per second squared: 9.81 on Earth",
            ("gravity",),
        )
    if scene.gravity[2] > _UPWARD * gravity:
        yield Finding(
            FindingCode.UNLIKELY_GRAVITY,
            "gravity",
            f"gravity points up: {scene.gravity.tolist()} m/s^2",
            f"where z of the world points up, it is [0, 0, {-gravity:g}]",
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
    if scene.max_normal_force >= max(_UNLIMITED_FORCE, _OVER_WEIGHT * made.mass * gravity):
        yield Finding(
            FindingCode.PLACEHOLDER_FORCE,
            made.name,
            f"the largest normal force, {scene.max_normal_force:g} N, looks like a placeholder",
            "give the force that the bodies bear: the margin counts the room up to it",
            ("max_normal_force",),
        )


def _loads(
    scene: SceneFields, weight: float, box: tuple[FloatArray, FloatArray]
) -> Iterator[Finding]:
    """Find loads that are many times the object's weight, or act far from it.

    Args:
        scene: The scene.
        weight: Of its object, N.
        box: The lowest and the highest corner of the box around it, its own axes, m.
    """
    made = scene.object
    for index, load in enumerate(scene.loads):
        force = float(np.linalg.norm(load.force))
        for name, figure, unit, of, most in (
            ("mass", load.mass, "kg", "mass", _HEAVIEST_LOAD * made.mass),
            ("force", force, "N", "weight", _HEAVIEST_LOAD * weight),
        ):
            if figure > most:
                yield Finding(
                    FindingCode.UNLIKELY_LOAD,
                    load.name,
                    f"the {name} of load '{load.name}', {figure:g} {unit}, is "
                    f"{_HEAVIEST_LOAD * figure / most:.3g} times the {of} of object '{made.name}'",
                    f"give it in {unit}",
                    ("loads", index, name),
                )
        lowest, highest = box
        at = made.center_of_mass if load.at is None else load.at
        away = float(np.maximum(lowest - at, at - highest).max())
        if away > float((highest - lowest).max()):
            yield Finding(
                FindingCode.UNLIKELY_LOAD,
                load.name,
                f"load '{load.name}' acts {away:.3g} m outside the box around object '{made.name}'",
                "give 'at' in the object's own frame, in metres",
                ("loads", index, "at"),
            )


def _joints(hand: Hand) -> Iterator[Finding]:
    """Find joint angles in degrees, and stated limits that are none."""
    turning = np.array([kind != "prismatic" for kind in hand.tree.joint_kinds], dtype=bool)
    for index in np.flatnonzero((np.abs(hand.positions) > MOST_ANGLE) & turning):
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
        for one in hand.findings
        if one.code in (FindingCode.PLACEHOLDER_EFFORT, FindingCode.UNKNOWN_EFFORT)
        for name in one.subject.split(", ")
    }
    endless = {
        name: f"'{name}' ({upper:g})"
        for name, unit, lower, upper in zip(
            hand.actuation.names, hand.effort_units, *hand.effort_limits, strict=True
        )
        if max(-lower, upper) >= _UNLIMITED_EFFORT[unit] and name not in declared
    }
    if endless:
        yield Finding(
            FindingCode.PLACEHOLDER_EFFORT,
            ", ".join(endless),
            f"effort limits that look like placeholders: {', '.join(endless.values())}",
            "give the motors' real limits in effort_limits (N m, or N for a prismatic joint)",
            ("hand", "effort_limits"),
        )


def _shallow_overlaps(scene: SceneFields) -> Iterator[Finding]:
    """Find where the hand is in itself or in a support, but not so deep that it is serious."""
    if scene.hand is None:
        return
    for one in unwanted_overlaps(scene.hand, scene.supports, tolerance=scene.contact_tolerance):
        if one.depth <= scene.max_penetration:
            yield Finding(
                FindingCode.DEEP_OVERLAP,
                one.link,
                str(one),
                "move them apart (base_pose, q); nothing pushes back between them, and more than "
                f"max_penetration ({_length(scene.max_penetration)}) is serious",
                ("max_penetration",),
            )


def _touching(scene: SceneFields) -> Iterator[Finding]:
    """Find what should touch and does not, and what touches in a doubtful way."""
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
    names = set(() if touching is None else touching.bodies)
    if scene.given_contacts is None:
        yield from _missed(scene, names)
        if touching is not None:
            yield from _doubtful(scene, touching)
            yield from _uneven(scene, touching)
    if scene.hand is None:
        return
    off = state_findings(scene, StateChecks(collisions=False))
    yield from (_with_nearest(scene, one) for one in off)
    if not off and not problem_of(scene).jacobian.any():
        yield Finding(
            FindingCode.NO_TORQUE_COUNTS,
            scene.object.name,
            "the hand touches the object with links that no force-controlled joint moves",
            "touch it with the fingers, or set hand.control of their joints to force",
            ("hand", "control"),
        )


def _with_nearest(scene: SceneFields, found: Finding) -> Finding:
    """Return the finding for a hand without contacts, with the link that is nearest."""
    hand, pieces = scene.hand, scene.object.placed_bodies
    if hand is None or scene.given_contacts is not None or not len(hand.placed_bodies):
        return found
    gap, link = min(
        (nearest_separation([body], pieces).distance, body.name) for body in hand.placed_bodies
    )
    nearest = f"{found.message}; the nearest one, '{link}', is {_length(gap)} away"
    return replace(found, message=nearest)


def _missed(scene: SceneFields, touching: set[str]) -> Iterator[Finding]:
    """Find supports and fingers that miss the object by a few tolerances."""
    tolerance, pieces = scene.contact_tolerance, scene.object.placed_bodies
    reach = _NEAR * tolerance

    for index, support in enumerate(scene.supports):
        if support.name in touching:
            continue
        bodies = support.placed_bodies
        gaps = [
            separation(pieces[i], bodies[k]).distance for i, k in near_pairs(pieces, bodies, reach)
        ]
        gap = min(gaps, default=np.inf)
        if (1.0 + _SLACK) * tolerance < gap <= reach:
            yield Finding(
                FindingCode.SUPPORT_MISSED,
                support.name,
                f"support '{support.name}' is {_length(gap)} from object '{scene.object.name}', so "
                f"it is not a contact (contact_tolerance: {_length(tolerance)})",
                "settle the object (graspless-pin settle), correct the pose, or raise "
                "contact_tolerance",
                ("supports", index, "pose"),
            )
    if scene.hand is None:
        return
    hand = scene.hand
    nearest: dict[str, tuple[float, str]] = {}
    bodies = hand.placed_bodies
    fingers = {name: hand.finger_of(name) or name for name in {one.name for one in bodies}}
    busy = {fingers[name] for name in touching if name in fingers}
    for i, k in near_pairs(pieces, bodies, reach):
        finger = fingers[bodies[k].name]
        if finger not in busy:
            gap = separation(pieces[i], bodies[k]).distance
            nearest[finger] = min(nearest.get(finger, (np.inf, "")), (gap, bodies[k].name))
    for finger, (gap, link) in nearest.items():
        if (1.0 + _SLACK) * tolerance < gap <= reach:
            way, key = "close the finger (graspless-pin close), correct q", "q"
            if hand.finger_of(link) is None:
                way, key = "move the hand closer (base_pose) if it should touch", "base_pose"
            yield Finding(
                FindingCode.FINGER_MISSED,
                finger,
                f"'{link}' is {_length(gap)} from object '{scene.object.name}', so it is not a "
                f"contact (contact_tolerance: {_length(tolerance)})",
                f"{way}, or raise contact_tolerance",
                ("hand", key),
            )
    if len(hand.mounts) > 1:
        missed = {link for gap, link in nearest.values() if gap <= reach}
        yield from _idle_mounts(scene, hand, touching, missed)


def _idle_mounts(
    scene: SceneFields, hand: Hand, touching: set[str], missed: set[str]
) -> Iterator[Finding]:
    """Find robots of a hand that touch nothing while others do, nor nearly so."""
    index = {mount.prefix: place for place, mount in enumerate(hand.mounts)}
    prefixes = sorted(index, key=len, reverse=True)
    bodies: dict[str, list[CollisionBody]] = {prefix: [] for prefix in index}
    for body in hand.placed_bodies:
        bodies[next(prefix for prefix in prefixes if body.name.startswith(prefix))].append(body)
    named = {prefix: {body.name for body in own} for prefix, own in bodies.items()}
    if not any(names & touching for names in named.values()):
        return
    for prefix, own in bodies.items():
        if own and not named[prefix] & (touching | missed):
            gap = nearest_separation(own, scene.object.placed_bodies).distance
            yield Finding(
                FindingCode.IDLE_MOUNT,
                prefix,
                f"robot '{prefix}' touches nothing: it is {_length(gap)} from object "
                f"'{scene.object.name}'",
                "correct its base_pose (m, rad) or q, or leave it out, if it should touch",
                ("hand", "mounts", index[prefix], "base_pose"),
            )


def _doubtful(scene: SceneFields, touching: ContactArrays) -> Iterator[Finding]:
    """Find deep overlaps, and normals that a small shift would turn."""
    deepest: dict[str, float] = {}
    for body, gap in zip(touching.bodies, touching.distances, strict=True):
        deepest[body] = min(deepest.get(body, 0.0), gap)
    for body, gap in deepest.items():
        if gap < -(1.0 + _SLACK) * scene.contact_tolerance:
            yield Finding(
                FindingCode.DEEP_OVERLAP,
                body,
                f"'{body}' and object '{scene.object.name}' overlap by {_length(-gap)}",
                "move them apart (settle, close_fingers); max_penetration is the overlap that "
                "passes for contact",
                ("max_penetration",),
            )
    others = [*(() if scene.hand is None else scene.hand.placed_bodies)]
    others += [piece for support in scene.supports for piece in support.placed_bodies]
    jumps = normal_jumps(scene.object.placed_bodies, others, touching, scene.contact_tolerance)
    for body in dict.fromkeys(touching.bodies):
        worst = max(jump for jump, name in zip(jumps, touching.bodies, strict=True) if name == body)
        if worst > _JUMP:
            yield Finding(
                FindingCode.AMBIGUOUS_NORMAL,
                body,
                f"'{body}' touches object '{scene.object.name}' edge on edge: a small shift turns "
                f"the normal there by {np.degrees(worst):.0f} degrees",
                "shift one of them so that a face touches, or compare the answers beside it",
            )


def _uneven(scene: SceneFields, touching: ContactArrays) -> Iterator[Finding]:
    """Find contacts whose gaps a rigid body cannot close beside a nearer one of its own.

    `contact_tolerance` says how far bodies may be from where they touch. Once the nearer contact
    touches, a body may so slide along it by the tolerance, and turn by what faces count as parallel
    within. That closes the other gap by no more than the sum of both, seen along its normal.
    """
    names, tolerance = touching.bodies, scene.contact_tolerance
    gaps, normals = np.array(touching.distances), touching.normals
    cosines = np.clip(normals @ normals.T, -1.0, 1.0)
    sines = np.sqrt(1.0 - cosines**2)
    levers = np.linalg.norm(touching.positions[:, None] - touching.positions, axis=2)
    behind = gaps[:, None] - gaps * cosines
    left = behind - tolerance * sines - PARALLEL_ANGLE * levers
    # Links that no joint parts are one rigid body, and so are all supports.
    links = {} if scene.hand is None else scene.hand.tree.link_joints
    count = touching.hand_count
    rigid = np.array([links[name] if k < count else -1 for k, name in enumerate(names)])
    ranks = np.argsort(np.argsort(gaps, kind="stable"))
    left[(rigid[:, None] != rigid) | (ranks[:, None] <= ranks)] = 0.0
    most = left.max(axis=1, initial=0.0)
    for name in dict.fromkeys(names):
        far = max((k for k, one in enumerate(names) if one == name), key=lambda k: most[k])
        if most[far] <= _UNEVEN * tolerance:
            continue
        near = int(np.argmax(left[far]))
        gap, made = _length(gaps[far]), scene.object.name
        beside = f"'{names[near]}', rigid with it,"
        if names[near] == name:
            beside = "another of its contacts"
        angle = np.degrees(np.arctan2(behind[far, near], levers[far, near]))
        yield Finding(
            FindingCode.UNEVEN_GAPS,
            name,
            f"'{name}' is {gap} from object '{made}' at one contact, where {beside} is "
            f"{_length(gaps[near])} from it: both count as contacts that bear, and they only touch "
            f"at once if the bodies turn by {angle:.2g} degrees",
            "correct their poses (q, base_pose, settle), or leave this contact out: "
            f"contact_tolerance below {gap}",
            ("contact_tolerance",),
        )


def _length(metres: float) -> str:
    """Return a length in the unit that reads best."""
    return f"{1e3 * metres:.4g} mm" if abs(metres) < 1.0 else f"{metres:.4g} m"
