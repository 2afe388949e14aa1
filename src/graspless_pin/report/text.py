"""A scene's solution as text."""

from __future__ import annotations

from graspless_pin.geometry.contact.finding import BodyKind
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.table import solution_text


def scene_solution_text(scene: Scene, solution: TorqueSolution) -> str:
    """Return the title and the tables of a scene's solution, contacts named by what they touch."""
    title = f"{scene.name}: {scene.object.name}, {scene.object.mass:g} kg"
    problem = solution.problem
    title += f", {problem.contact_count} contacts, {problem.joint_count} joints"
    kinds = {point.kind for point in scene.contacts.points}
    if scene.hand is not None and BodyKind.HAND not in kinds:
        title += "\nno link of the hand touches the object; move or close the hand"
    return f"{title}\n{solution_text(solution, scene.contacts.bodies)}"
