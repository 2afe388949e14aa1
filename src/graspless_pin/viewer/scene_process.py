"""The evaluation of one setting of the page's controls, without browser or server."""

from __future__ import annotations

import warnings
from collections import Counter
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

from graspless_pin.algorithms.options import why_without_effect
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import (
    ArgumentError,
    CrashError,
    GrasplessPinError,
    GrasplessPinWarning,
    SceneError,
    StateError,
    StateFault,
    internal_error,
)
from graspless_pin.holding.controller import TORQUES_OF_HELD_JOINTS
from graspless_pin.holding.verdict import (
    BRIEF_NODE_LIMIT,
    Holding,
    Stability,
    StabilityKeywords,
)
from graspless_pin.modes.rules import StaticFriction
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Scene
from graspless_pin.scene.robust_answer import solution_for_all
from graspless_pin.scene.scene_stability import solution_verdict
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.active_limits import joint_limit_words, margin_limit_words
from graspless_pin.viewer.controls import changed_scene
from graspless_pin.visualization import Picture, draw_scene
from graspless_pin.visualization.drawing import draw_bodies
from graspless_pin.visualization.motion import (
    MovingPicture,
    draw_motion,
    draw_small_motion,
    draw_virtual_sliding,
)

_DEFAULT_MARGIN = 0.1
_MOST_FILES = 1000
_VERDICT_LIMITS: StabilityKeywords = {"node_limit": BRIEF_NODE_LIMIT, "time_limit": 3.0}


@dataclass(frozen=True)
class Settings:
    """The settings of the page's controls. See the example of `answer_settings`.

    Attributes:
        algorithm: ``margin``, ``torque`` or another objective's name.
        required_margin: e_0 of Algorithm 2, N.
        values: Value by the key of a `Control`; those that are not named are the scene's own.
    """

    algorithm: str
    required_margin: float
    values: Mapping[str, float] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class SettingsAnswer:
    """Scene, solution, picture and verdict of one setting. See the example of `answer_settings`.

    Attributes:
        settings: The setting.
        scene: The scene as changed; as loaded if the change is not possible.
        solution: The solution, found or not; None if there is no problem to solve. Of a scene with
            uncertainty, the one under the robust torques.
        picture: The picture; without contacts if there are none.
        reason: Why there are no torques; empty if there are.
        verdict: The verdict on whether the object stays; None: it is not known yet.
        stability: Its status, if there is one.
        holds: Whether the object provably stays under the scene's controller.
        motion: The motion that the verdict states; None: it states none.
        sliding: The picture along the mode's virtual motion; None: there is none.
        bodies: The body at each contact; None: contacts cannot be found.
        limits: What limits margin and torques, a sentence each.
    """

    settings: Settings
    scene: Scene
    solution: TorqueSolution | None
    picture: Picture
    reason: str
    verdict: str | None = None
    stability: Stability | None = None
    holds: bool = False
    motion: MovingPicture | None = None
    sliding: MovingPicture | None = None
    bodies: tuple[str, ...] | None = None
    limits: tuple[str, ...] = ()


def initial_settings(scene: Scene) -> Settings:
    """Return the scene's own algorithm and margin.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.viewer import answer_settings, initial_settings
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> answer = answer_settings(scene, initial_settings(scene))
        >>> print(f"{answer.solution.margin:.4f} N")
        1.6504 N
    """
    options: Mapping[str, Any] = scene.solve_options
    return Settings(
        options.get("algorithm", Algorithm.MARGIN),
        float(options.get("margin", _DEFAULT_MARGIN)),
    )


def answer_settings(scene: Scene, settings: Settings) -> SettingsAnswer:
    """Change a scene, solve it and draw it; an impossible scene gives a reason, and no error.

    So does an exception from outside this package.

    Args:
        scene: The scene as loaded.
        settings: The changes, and the algorithm.

    Raises:
        MeshError: A mesh file is missing or unreadable.

    Examples:
        >>> from graspless_pin import load_scene
        >>> from graspless_pin.viewer import answer_settings, initial_settings
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> answer = answer_settings(scene, initial_settings(scene))
        >>> print(f"{answer.solution.margin:.4f} N")
        1.6504 N
    """
    try:
        return _solve_and_draw(scene, settings)
    except GrasplessPinError:
        raise
    except Exception as error:  # is shown in place of this state of the page
        return SettingsAnswer(settings, scene, None, draw_bodies(scene), error_text(error))


def error_text(error: Exception) -> str:
    """Return the message of an error; an internal one asks for a report."""
    is_known = isinstance(error, GrasplessPinError)
    return str(error) if is_known else f"{internal_error(error)}; please report it"


def _solve_and_draw(scene: Scene, settings: Settings) -> SettingsAnswer:
    """Return what `answer_settings` returns, but let unexpected exceptions pass."""
    changed, bodies, robust = scene, None, None
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", GrasplessPinWarning)  # they were shown at loading
        try:
            changed = changed_scene(scene, settings.values)
            takes_margin = not why_without_effect("margin", settings.algorithm)
            options: dict[str, Any] = {"margin": settings.required_margin} if takes_margin else {}
            if changed.uncertainty is None:
                solution = changed.solve(settings.algorithm, **options)
            else:
                solution, robust = solution_for_all(changed, settings.algorithm, **options)
        except GrasplessPinError as error:
            if isinstance(error, StateError) and error.kind is StateFault.NO_CONTACT:
                bodies = ()
            else:
                with suppress(GrasplessPinError):
                    bodies = changed.contacts.bodies
            picture = draw_bodies(changed)
            return SettingsAnswer(settings, changed, None, picture, str(error), bodies=bodies)
        picture, bodies = draw_scene(changed, solution), changed.contacts.bodies
        if not solution.found:
            reason = f"{solution.status.message}\n\n{solution.explanation}".strip()
            return SettingsAnswer(settings, changed, solution, picture, reason, bodies=bodies)
        origin = changed.object.center_of_mass_world
        return SettingsAnswer(
            settings,
            changed,
            solution,
            picture,
            "",
            sliding=draw_virtual_sliding(picture, solution, changed.hand, origin),
            bodies=bodies,
            limits=(
                "" if robust is None else _served_set_text(robust),
                TORQUES_OF_HELD_JOINTS if changed.controller.holds_joints else "",
                margin_limit_words(solution, bodies),
                joint_limit_words(solution),
            ),
        )


def _served_set_text(robust: RobustSolution) -> str:
    """Return what the robust torques are proven for, and the member with the smallest margin."""
    sampled = "" if robust.samples is None else f"; sampled: {robust.samples}"
    return (
        f"torques for {robust.uncertainty}, proven for {robust.proven_for}{sampled}; smallest "
        f"margin at: {robust.members[robust.worst].words}"
    )


def contact_changes_text(before: Sequence[str], after: Sequence[str]) -> str:
    """Return in words which contacts are gone or new after a change; empty: none.

    Contacts are told apart by the body that touches, not by their positions, which change with
    every shift.

    Args:
        before: The body at each contact before the change.
        after: The same after it.
    """
    counts, now = Counter(before), Counter(after)
    changes = []
    for verb, change in (("gone", counts - now), ("new", now - counts)):
        if change:
            total = change.total()
            names = ", ".join(f"{name} ({count})" for name, count in change.items())
            changes.append(f"{total} contact{'s' * (total > 1)} {verb}: {names}")
    return "; ".join(changes)


def with_region(answer: SettingsAnswer) -> SettingsAnswer:
    """Return an answer with the region of the centre of mass under its torques, where known."""
    scene, solution = answer.scene, answer.solution
    if solution is None or not solution.found:
        return answer
    try:
        tolerances = scene.tolerances(
            solution.torques,
            quantities=(Quantity.CENTER,),
            static_friction=StaticFriction.COULOMB,
        )
    except GrasplessPinError:  # such as of a scene with an angular acceleration
        return answer
    picture = draw_scene(scene, solution, tolerances=tolerances)
    origin = scene.object.center_of_mass_world
    sliding = draw_virtual_sliding(picture, solution, scene.hand, origin)
    return replace(answer, picture=picture, sliding=sliding)


def with_verdict(answer: SettingsAnswer) -> SettingsAnswer:
    """Return an answer with the verdict on its torques; unchanged without torques."""
    if answer.solution is None or not answer.solution.found:
        return answer
    try:
        verdict = solution_verdict(answer.scene, answer.solution, **_VERDICT_LIMITS)
    except ArgumentError as error:
        return replace(answer, verdict=f"no verdict: {error}")
    except GrasplessPinError:
        raise
    except Exception as error:
        return replace(answer, verdict=f"no verdict: {error_text(error)}")
    motion, small = None, verdict.small_motions
    if verdict.motion is not None:
        motion = draw_motion(verdict.problem, verdict.motion, scene=answer.scene)
    elif small is not None and small.motion is not None:
        motion = draw_small_motion(
            answer.picture,
            verdict.problem,
            small.motion,
            small.growth,
            answer.scene.hand,
            answer.scene.object.center_of_mass_world,
        )
    words = verdict.full_message("graspless-pin solve --verdict-nodes {}")
    return replace(
        answer,
        verdict=words,
        stability=verdict.status,
        holds=verdict.holding is Holding.HOLDS,
        motion=motion,
    )


def free_name(scene: Scene) -> Path:
    """Return an unused path for a changed scene: beside the scene's own file, or here.

    Raises:
        SceneError: There are too many already.
    """
    own = scene.path or Path("scene.yaml")
    names = (own.with_name(f"{own.stem}_{number}.yaml") for number in range(1, _MOST_FILES + 1))
    free = next((name for name in names if not name.exists()), None)
    if free is None:
        raise SceneError(f"{own.parent}: contains {_MOST_FILES} saved scenes already; delete some")
    return free


class SceneProcess:
    """Evaluates settings of one scene in a child process, whose crash does no harm.

    Not to be shared between threads, except for `kill`.
    """

    def __init__(self, scene: Scene) -> None:
        """Start the process."""
        self._scene = scene
        self._child, self._knows_scene = ChildProcess(), False

    def evaluate(self, settings: Settings) -> SettingsAnswer:
        """Return what `answer_settings` returns; a process that has died is replaced first.

        Raises:
            CrashError: The process died of these settings.
            MeshError: See `answer_settings`.
        """
        if not self._child.is_running:
            self._child.close()
            self._child, self._knows_scene = ChildProcess(), False
        if not self._knows_scene:
            self._child.call(_keep_scene, self._scene)
            self._knows_scene = True
        return self._child.call(_evaluate_kept, settings)

    def judge(self) -> SettingsAnswer:
        """Return the last answer of `evaluate` with its verdict.

        Raises:
            CrashError: The process died of it.
        """
        return self._child.call(_judge_kept)

    def evaluate_first(self, settings: Settings) -> SettingsAnswer:
        """Return what `evaluate` returns; after a crash the bodies, with the crash as reason."""
        try:
            return self.evaluate(settings)
        except CrashError as error:
            return SettingsAnswer(settings, self._scene, None, draw_bodies(self._scene), str(error))

    def kill(self) -> None:
        """End the process; an evaluation under way raises a `CrashError`."""
        self._child.kill()

    def close(self) -> None:
        """End the process and wait for it."""
        self._child.close()


_kept: list[Scene] = []
_answered: list[SettingsAnswer] = []


def _keep_scene(scene: Scene) -> None:
    _kept[:] = [scene]


def _evaluate_kept(settings: Settings) -> SettingsAnswer:
    _answered[:] = [answer_settings(_kept[0], settings)]
    return _answered[0]


def _judge_kept() -> SettingsAnswer:
    return with_verdict(with_region(_answered[0]))
