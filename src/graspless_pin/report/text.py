"""A scene's solution as text."""

from __future__ import annotations

from graspless_pin.findings import Severity
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution


def scene_solution_text(scene: Scene, solution: TorqueSolution, verdict: str = "") -> str:
    """Return the title and the tables of a scene's solution, contacts named by what they touch.

    Args:
        scene: The scene.
        solution: Its solution.
        verdict: What is said of whether the object stays: stands before the tables.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import scene_solution_text
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> print(scene_solution_text(scene, scene.solve()).splitlines()[0])
        Cuboid pinched on a slope, at rest: cuboid, 1 kg, 6 contacts, 2 joints
    """
    title = f"{scene.name}: {scene.object.name}, {scene.object.mass:g} kg"
    problem = solution.problem
    title += f", {_count(problem.contact_count, 'contact')}, {_count(problem.joint_count, 'joint')}"
    serious = [one for one in solution.findings if one.severity is Severity.SERIOUS]
    title = "\n".join([*(f"{one.severity}: {one.message}" for one in serious), title])
    if verdict:
        title += f"\n{verdict}"
    return f"{title}\n{solution.text(_touching(scene))}"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _touching(scene: Scene) -> list[str]:
    """Name what touches at each contact: the support, or the hand link with its finger."""
    names: list[str] = []
    for point in scene.contacts.points:
        finger = None
        if scene.hand is not None and point.kind is BodyKind.HAND:
            finger = scene.hand.finger_of(point.body)
        told = finger is None or finger in point.body
        names.append(point.body if told else f"{point.body} ({finger})")
    return names
