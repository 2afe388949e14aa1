"""Contacts that a scene states and its shapes contradict: points off them, normals the wrong way.

Shapes may be simpler than what they stand for, so the contacts are used all the same.
"""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Iterator
from itertools import chain

from graspless_pin.findings import Finding, FindingCode
from graspless_pin.geometry.bodies.collision import CollisionBody, PlacedBodies
from graspless_pin.geometry.contact.distances import distances_to_point
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.fields import SceneFields

_STEP = 3.0
"""Contact tolerances to either side, where it is looked on which one the object is."""


def stated_contact_findings(scene: SceneFields) -> Iterator[Finding]:
    """Find stated contacts off the surfaces of object or body, and normals out of the object.

    Both are measured by ``contact_tolerance``. Bodies without shapes are left out.
    """
    pieces: defaultdict[str, list[CollisionBody]] = defaultdict(list)
    placed = [support.placed_bodies for support in scene.supports]
    for body in chain(*placed, () if scene.hand is None else scene.hand.placed_bodies):
        pieces[body.name].append(body)
    made, tolerance = scene.object, scene.contact_tolerance
    off: list[tuple[float, int, str]] = []
    outward: list[int] = []
    for index, contact in enumerate(scene.given_contacts or ()):
        gaps = {
            name: abs(float(distances_to_point(bodies, contact.position).min()))
            for name, bodies in (
                (f"object '{made.name}'", made.placed_bodies),
                (f"'{contact.body}'", pieces[contact.body]),
            )
            if len(bodies)
        }
        far = [(gap, name) for name, gap in gaps.items() if gap > tolerance]
        if far:
            words = " and ".join(f"{_millimetres(gap)} from the surface of {on}" for gap, on in far)
            off.append((max(far)[0], index, words))
        elif _points_out(made.placed_bodies, contact.position, contact.normal, tolerance):
            outward.append(index)
    if outward:
        several = len(outward) > 1
        yield Finding(
            FindingCode.NORMAL_POINTS_OUT,
            made.name,
            f"the normal{'s' * several} of stated contact{'s' * several} "
            f"{', '.join(map(str, outward))} point{'s' * (not several)} out of object "
            f"'{made.name}'",
            "turn it round: normals point from the other body into the object",
            ("contacts", outward[0], "normal"),
        )
    if off:
        _, index, words = max(off)
        others = f" ({len(off) - 1} more are off)" if len(off) > 1 else ""
        yield Finding(
            FindingCode.CONTACT_OFF_SURFACE,
            made.name,
            f"stated contact {index} is {words}{others}",
            "give the point where they touch, in metres and world axes; if the shapes are simpler "
            f"than the bodies, raise contact_tolerance ({_millimetres(tolerance)})",
            ("contacts", index, "position"),
        )


def _points_out(
    bodies: PlacedBodies, point: FloatArray, normal: FloatArray, tolerance: float
) -> bool:
    """Return whether the object lies behind a point of its surface, as its normal sees it.

    Args:
        bodies: Its convex pieces; those at the point count, and one that lies ahead is enough.
        point: (3,) world, m.
        normal: (3,) unit, world axes.
        tolerance: m.
    """
    here = abs(distances_to_point(bodies, point)) <= tolerance
    touching = [body for body, counts in zip(bodies, here, strict=True) if counts]
    step = _STEP * tolerance * normal
    ahead, behind = (distances_to_point(touching, point + way) for way in (step, -step))
    return bool((ahead > behind + tolerance).all())


def _millimetres(metres: float) -> str:
    return f"{1e3 * metres:.3g} mm"
