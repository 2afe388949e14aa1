"""A scene's solution as text."""

from __future__ import annotations

from collections import Counter
from math import hypot, inf
from textwrap import fill
from typing import TYPE_CHECKING

from graspless_pin.algorithms.force_bounds import ContactForceBounds
from graspless_pin.findings import Severity
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.holding.controller import TORQUES_OF_HELD_JOINTS
from graspless_pin.scene import Scene
from graspless_pin.scene.contact_arrays import touching_of
from graspless_pin.scene.load_wrenches import object_motion
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.solution.active_limits import joint_limit_words, margin_limit_words
from graspless_pin.solution.tables import COLUMNS, figure, headed_text, with_noun

if TYPE_CHECKING:
    from graspless_pin.scene.robust_answer import RobustAnswer

_SAME_MARGIN = 1e-6
"""Of the load: margins closer than this count as one."""


def scene_solution_text(
    scene: Scene,
    solution: TorqueSolution,
    verdict: str = "",
    bounds: ContactForceBounds | None = None,
    answer: RobustAnswer | None = None,
) -> str:
    """Return title and tables of a scene's solution, with contacts named by their bodies.

    Args:
        scene: The scene.
        solution: Its solution.
        verdict: The verdict on whether the object stays, which comes before the tables.
        bounds: The contact force ranges of its torques, for their smallest margin; or None.
        answer: The robust answer over the scene's uncertainty; None: the scene is nominal. The
            solution is the one under the robust torques where these were found.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.report import scene_solution_text
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> print(scene_solution_text(scene, scene.solve()).splitlines()[0])
        Cuboid pinched on a slope, at rest: cuboid, 1 kg, 6 contacts, 2 joints
    """
    problem = (solution if answer is None else answer.nominal).problem
    facts = (
        f"{scene.object.name}, {scene.object.mass:g} kg, "
        f"{with_noun(problem.contact_count, 'contact')}, {with_noun(problem.joint_count, 'joint')}"
    )
    parted = len(touching_of(scene)) - len(scene.contacts.arrays)
    if parted:
        facts += f", {with_noun(parted, 'contact')} opened by the motion"
    if scene.loads:
        facts += f", {with_noun(len(scene.loads), 'load')}"
    if scene.acceleration is not None:
        a = object_motion(scene).acceleration_of(scene.object.center_of_mass_world)
        facts += f", accelerating by {hypot(*a):.3g} m/s^2"
    title = headed_text(scene.name, facts)
    title = f"{_serious_findings_line(solution)}{title}"
    if answer is not None:
        # Imported here: a scene without uncertainty does not need it.
        from graspless_pin.report.robust import robust_text

        title += f"\n{robust_text(answer)}"
        if not answer.found:
            return title
        title += "\nThe nominal scene under these torques:"
    if verdict:
        title += f"\n{fill(verdict, COLUMNS, break_on_hyphens=False)}"
    remarks = _limit_remarks(scene, solution, bounds) if solution.found else []
    return f"{title}\n{solution.text(_touching_bodies(scene), remarks)}"


def _serious_findings_line(solution: TorqueSolution) -> str:
    """Return a line that warns of serious findings; empty where there are none."""
    counts = Counter(one.code for one in solution.findings if one.severity is Severity.SERIOUS)
    if not counts:
        return ""
    codes = ", ".join(code if count == 1 else f"{code} ({count})" for code, count in counts.items())
    warning = f"serious: {codes}: this may be the answer to another problem than you meant"
    return f"{fill(warning, COLUMNS, break_on_hyphens=False)}\n"


def _limit_remarks(
    scene: Scene, solution: TorqueSolution, bounds: ContactForceBounds | None
) -> list[str]:
    """Return sentences on the enforced margin, and on what limits margin and torques."""
    held = scene.controller.holds_joints
    words = [
        TORQUES_OF_HELD_JOINTS if held and solution.problem.joint_count else "",
        "" if bounds is None else _smallest_margin_sentence(bounds, solution, held=held),
        margin_limit_words(solution, scene.contacts.bodies),
        joint_limit_words(solution),
    ]
    return [fill(sentence, COLUMNS, break_on_hyphens=False) for sentence in words if sentence]


def _smallest_margin_sentence(
    bounds: ContactForceBounds, solution: TorqueSolution, *, held: bool
) -> str:
    who = "Held joints" if held else "These torques"
    if not bounds.found:
        return f"Whether {who.lower()} enforce that margin was not decided in time."
    if bounds.smallest_margin == -inf:
        return (
            f"{who} do not enforce any margin: contact forces are unbounded (jamming is possible)."
        )
    load, is_proven = solution.problem.scales.force, bounds.status is Status.OPTIMAL
    if is_proven and bounds.smallest_margin >= solution.margin - _SAME_MARGIN * load:
        return f"{who} enforce that margin, {bounds.covers}."
    least = figure(bounds.smallest_margin, load)
    unproven = "" if is_proven else " (less is not ruled out)"
    overload = (
        ": a normal force may exceed max_normal_force by that much" if least.startswith("-") else ""
    )
    return (
        f"{who} do not enforce that margin: it may be as small as {least} N{unproven}, "
        f"{bounds.covers}{overload}."
    )


def _touching_bodies(scene: Scene) -> list[str]:
    """Return the body at each contact: the support, or the hand link with its finger."""
    names: list[str] = []
    for point in scene.contacts.points:
        finger = None
        if scene.hand is not None and point.kind is BodyKind.HAND:
            finger = scene.hand.finger_of(point.body)
        is_shown = finger is None or finger in point.body
        names.append(point.body if is_shown else f"{point.body} ({finger})")
    return names
