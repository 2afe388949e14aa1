"""Findings on a scene's contacts: near misses, deep overlaps, uneven gaps, stated contacts.

Stated contacts may contradict the shapes: points off the surface, normals in the wrong direction.
Shapes may be simplified, so such contacts are used all the same.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.bodies.convex_sets import PARALLEL_ANGLE
from graspless_pin.geometry.contact.contact_points import ContactArrays
from graspless_pin.geometry.contact.curvature import normal_jumps
from graspless_pin.geometry.contact.distances import (
    distances_to_point,
    near_pairs,
    nearest_separation,
    separation,
)
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.contact_arrays import pieces_by_body
from graspless_pin.scene.fields import SceneFields

_NEAR_MISS = 5.0  # contact tolerances
_TURNED_NORMAL = np.radians(20.0)
_UNEVEN_GAPS = 0.1
"""In contact tolerances: gaps of one rigid body that differ by less count as equal."""
_GAP_ROUNDING = 1e-6
_STEP_INTO_BODIES = 3.0
"""In contact tolerances: distance to either side at which the object is looked for."""


def stated_contact_findings(scene: SceneFields) -> Iterator[Finding]:
    """Find stated contacts off the surface of object or body, and normals out of the object.

    Distances are compared with ``contact_tolerance``. Bodies without shapes are not checked.
    """
    pieces = pieces_by_body(scene)
    target, tolerance = scene.object, scene.contact_tolerance
    off_surface: list[tuple[float, int, str]] = []
    outward: list[int] = []
    for index, contact in enumerate(scene.given_contacts or ()):
        gaps = {
            name: abs(float(distances_to_point(bodies, contact.position).min()))
            for name, bodies in (
                (f"object '{target.name}'", target.placed_bodies),
                (f"'{contact.body}'", pieces[contact.body]),
            )
            if len(bodies)
        }
        gapped = [(gap, name) for name, gap in gaps.items() if gap > tolerance]
        if gapped:
            words = " and ".join(f"{in_mm(gap)} from the surface of {on}" for gap, on in gapped)
            off_surface.append((max(gapped)[0], index, words))
        elif _normal_points_out(target.placed_bodies, contact.position, contact.normal, tolerance):
            outward.append(index)
    if outward:
        several = len(outward) > 1
        yield Finding(
            FindingCode.NORMAL_POINTS_OUT,
            target.name,
            f"the normal{'s' * several} of stated contact{'s' * several} "
            f"{', '.join(map(str, outward))} point{'s' * (not several)} out of object "
            f"'{target.name}'",
            "reverse it: normals point from the other body into the object",
            ("contacts", outward[0], "normal"),
        )
    if off_surface:
        _, index, words = max(off_surface)
        others = f" ({len(off_surface) - 1} more are off)" if len(off_surface) > 1 else ""
        yield Finding(
            FindingCode.CONTACT_OFF_SURFACE,
            target.name,
            f"stated contact {index} is {words}{others}",
            "give the point where they touch, in metres and world axes; if shapes are simpler than "
            f"the real bodies, raise contact_tolerance ({in_mm(tolerance)})",
            ("contacts", index, "position"),
        )


def _normal_points_out(
    bodies: PlacedBodies, point: FloatArray, normal: FloatArray, tolerance: float
) -> bool:
    """Return whether a normal points out of the object: the object lies behind the point.

    Args:
        bodies: Convex pieces of the object. Only those at the point count, and all have to lie
            behind it.
        point: (3,) world, m.
        normal: (3,) unit, world axes.
        tolerance: m.
    """
    is_near = abs(distances_to_point(bodies, point)) <= tolerance
    touching = [body for body, near in zip(bodies, is_near, strict=True) if near]
    step = _STEP_INTO_BODIES * tolerance * normal
    ahead, behind = (distances_to_point(touching, point + offset) for offset in (step, -step))
    return bool((ahead > behind + tolerance).all())


def contact_findings(scene: SceneFields, touching: ContactArrays | None) -> Iterator[Finding]:
    """Find near misses, deep overlaps, ambiguous normals and uneven gaps.

    Args:
        scene: The scene, without stated contacts.
        touching: Its contacts; None: there are none.
    """
    yield from _near_miss_findings(scene, set(() if touching is None else touching.bodies))
    if touching is not None:
        yield from _overlap_and_normal_findings(scene, touching)
        yield from _uneven_gap_findings(scene, touching)


def _near_miss_findings(scene: SceneFields, touching: set[str]) -> Iterator[Finding]:
    """Find supports and fingers that miss the object by a few tolerances."""
    tolerance, pieces = scene.contact_tolerance, scene.object.placed_bodies
    reach = _NEAR_MISS * tolerance

    if touching and not touching & {one.name for one in scene.supports}:
        yield from _no_support_findings(scene, reach)
    for index, support in enumerate(scene.supports):
        if support.name in touching:
            continue
        bodies = support.placed_bodies
        pairs = near_pairs(pieces, bodies, reach)
        gap = min((separation(pieces[i], bodies[k]).distance for i, k in pairs), default=np.inf)
        if (1.0 + _GAP_ROUNDING) * tolerance < gap <= reach:
            yield Finding(
                FindingCode.SUPPORT_MISSED,
                support.name,
                f"support '{support.name}' is {in_mm(gap)} from object '{scene.object.name}', so "
                f"it is not a contact (contact_tolerance: {in_mm(tolerance)})",
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
    touching_fingers = {fingers[name] for name in touching if name in fingers}
    for i, k in near_pairs(pieces, bodies, reach):
        finger = fingers[bodies[k].name]
        if finger not in touching_fingers:
            gap = separation(pieces[i], bodies[k]).distance
            nearest[finger] = min(nearest.get(finger, (np.inf, "")), (gap, bodies[k].name))
    for finger, (gap, link) in nearest.items():
        if (1.0 + _GAP_ROUNDING) * tolerance < gap <= reach:
            advice, key = (
                "close the finger (graspless-pin close), correct its joint positions (q)",
                "q",
            )
            if hand.finger_of(link) is None:
                advice, key = "move the hand closer (base_pose) if it should touch", "base_pose"
            yield Finding(
                FindingCode.FINGER_MISSED,
                finger,
                f"'{link}' is {in_mm(gap)} from object '{scene.object.name}', so it is not a "
                f"contact (contact_tolerance: {in_mm(tolerance)})",
                f"{advice}, or raise contact_tolerance",
                ("hand", key),
            )
    if len(hand.mounts) > 1:
        missed = {link for gap, link in nearest.values() if gap <= reach}
        yield from _idle_mount_findings(scene, hand, touching, missed)


def _no_support_findings(scene: SceneFields, reach: float) -> Iterator[Finding]:
    """Find that no support touches the object or is within reach (m) of it."""
    pieces = scene.object.placed_bodies
    gaps = {
        support.name: nearest_separation(pieces, support.placed_bodies).distance
        for support in scene.supports
        if len(support.placed_bodies)
    }
    nearest = min(gaps, key=gaps.__getitem__, default=None)
    if nearest is not None and gaps[nearest] > reach:
        yield Finding(
            FindingCode.NO_SUPPORT_TOUCHES,
            scene.object.name,
            f"no support touches object '{scene.object.name}': the nearest, '{nearest}', is "
            f"{in_mm(gaps[nearest])} away",
            "if the object should lie on it, settle it (graspless-pin settle) or correct its pose; "
            "otherwise the hand carries the whole weight",
            ("object", "pose"),
        )


def _idle_mount_findings(
    scene: SceneFields, hand: Hand, touching: set[str], missed: set[str]
) -> Iterator[Finding]:
    """Find robots of a hand that neither touch nor nearly touch the object while others do."""
    index = {mount.prefix: number for number, mount in enumerate(hand.mounts)}
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
                f"robot '{prefix}' touches nothing: it is {in_mm(gap)} from object "
                f"'{scene.object.name}'",
                "if it should touch, correct its base_pose (m, rad) or q; otherwise leave it out",
                ("hand", "mounts", index[prefix], "base_pose"),
            )


def _overlap_and_normal_findings(scene: SceneFields, touching: ContactArrays) -> Iterator[Finding]:
    """Find deep overlaps, and normals that a small shift would turn by a large angle."""
    deepest: dict[str, float] = {}
    for body, gap in zip(touching.bodies, touching.distances, strict=True):
        deepest[body] = min(deepest.get(body, 0.0), gap)
    supports = [support.name for support in scene.supports]
    for body, gap in deepest.items():
        if gap < -(1.0 + _GAP_ROUNDING) * scene.contact_tolerance:
            if body in supports:
                advice = "settle the object (graspless-pin settle) or correct the pose"
                key = ("supports", supports.index(body), "pose")
            elif scene.hand is not None and scene.hand.finger_of(body) is not None:
                advice = "open the finger (q), then close it (graspless-pin close)"
                key = ("hand", "q")
            else:
                advice, key = "move the hand away (base_pose)", ("hand", "base_pose")
            yield Finding(
                FindingCode.DEEP_OVERLAP,
                body,
                f"'{body}' and object '{scene.object.name}' overlap by {in_mm(-gap)}",
                f"{advice}; overlaps up to max_penetration ({in_mm(scene.max_penetration)}) "
                "count as contact",
                key,
            )
    others = [*(() if scene.hand is None else scene.hand.placed_bodies)]
    others += [piece for support in scene.supports for piece in support.placed_bodies]
    jumps = normal_jumps(scene.object.placed_bodies, others, touching, scene.contact_tolerance)
    for body in dict.fromkeys(touching.bodies):
        worst = max(jump for jump, name in zip(jumps, touching.bodies, strict=True) if name == body)
        if worst > _TURNED_NORMAL:
            yield Finding(
                FindingCode.AMBIGUOUS_NORMAL,
                body,
                f"'{body}' touches object '{scene.object.name}' edge on edge: a small shift turns "
                f"the normal there by {np.degrees(worst):.0f} degrees",
                "shift one of them so that a face touches, or compare the results of nearby poses",
            )


def _uneven_gap_findings(scene: SceneFields, touching: ContactArrays) -> Iterator[Finding]:
    """Find contacts whose gap a rigid body cannot close together with a smaller gap of its own.

    `contact_tolerance` bounds how far bodies are from touching. Once the contact with the smaller
    gap touches, the body may slide along it by the tolerance, and turn by the angle within which
    faces count as parallel. Along its normal, the other gap closes by at most the sum of both.
    """
    names, tolerance = touching.bodies, scene.contact_tolerance
    gaps, normals = np.array(touching.distances), touching.normals
    cosines = np.clip(normals @ normals.T, -1.0, 1.0)
    sines = np.sqrt(1.0 - cosines**2)
    levers = np.linalg.norm(touching.positions[:, None] - touching.positions, axis=2)
    gap_difference = gaps[:, None] - gaps * cosines
    excess = gap_difference - tolerance * sines - PARALLEL_ANGLE * levers
    # Links without a joint between them are one rigid body, and so are all supports.
    links = {} if scene.hand is None else scene.hand.tree.link_joints
    count = touching.hand_count
    rigid_body = np.array([links[name] if k < count else -1 for k, name in enumerate(names)])
    ranks = np.argsort(np.argsort(gaps, kind="stable"))
    excess[(rigid_body[:, None] != rigid_body) | (ranks[:, None] <= ranks)] = 0.0
    peak = excess.max(axis=1, initial=0.0)
    for name in dict.fromkeys(names):
        far = max((k for k, one in enumerate(names) if one == name), key=lambda k: peak[k])
        if peak[far] <= _UNEVEN_GAPS * tolerance:
            continue
        near = int(np.argmax(excess[far]))
        gap, object_name = in_mm(gaps[far]), scene.object.name
        near_words = f"'{names[near]}', which is rigidly connected to it,"
        if names[near] == name:
            near_words = "another of its contacts"
        angle = np.degrees(np.arctan2(gap_difference[far, near], levers[far, near]))
        yield Finding(
            FindingCode.UNEVEN_GAPS,
            name,
            f"'{name}' is {gap} from object '{object_name}' at one contact, where {near_words} is "
            f"{in_mm(gaps[near])} from it: both count as contacts with force, but they only touch "
            f"at the same time if the bodies turn by {angle:.2g} degrees",
            "correct their poses (q, base_pose, settle), or leave this contact out with a "
            f"contact_tolerance below {gap}",
            ("contact_tolerance",),
        )


def in_mm(metres: float) -> str:
    """Return a length (m) as text, in mm if it is below one metre."""
    return f"{1e3 * metres:.4g} mm" if abs(metres) < 1.0 else f"{metres:.4g} m"
