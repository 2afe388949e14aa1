"""A scene: hand, object and supports at one moment, and the way to a `QuasistaticProblem`.

Check what a scene is changed to, where it is changed.
"""

from __future__ import annotations

import reprlib
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property, partial
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.named_objectives import objective_and_options, useless
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.caching import Latest
from graspless_pin.errors import (
    ArgumentError,
    GrasplessPinError,
    SceneError,
    SolverUnavailableError,
)
from graspless_pin.findings import Finding
from graspless_pin.geometry.bodies.materials import Materials
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import Shape
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.pickling import PickledByFields
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, real_number
from graspless_pin.problem.derived_inertias import with_derived_inertias
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.programs.objectives import Objective
from graspless_pin.records import changed
from graspless_pin.scene.contact_arrays import contacts_after_motion, label_of, touching_of
from graspless_pin.scene.joints import inertia_of_columns
from graspless_pin.scene.motion_and_contacts import GivenContact, Motion, SceneContacts
from graspless_pin.scene.problem_data import jointed_contacts, loads_of
from graspless_pin.scene.scene_findings import StatedFields, findings_of, unused_figures
from graspless_pin.scene.scene_schema import SceneEntry
from graspless_pin.scene.scene_stability import unknown_of, verdict_of
from graspless_pin.scene.validation_errors import checked_key
from graspless_pin.solution import TorqueSolution
from graspless_pin.suggestions import names_in_words

_Check = Callable[[str, Any], Any]

_OBJECT = "dataclasses.replace(scene.object, mass=2.0), scene.object.with_pose(T)"
_HAND = "scene.hand.with_configuration({...})"
_LEAST = {"object": {"shape": {"type": "sphere", "radius": 1.0}, "mass": 1.0}, "friction": 1.0}
_SUPPORTS = "(*scene.supports, Support(name, shape, T_world_support))"


def checked_changes(changes: Mapping[str, Any]) -> dict[str, Any]:
    """Return fields of a scene by name, each checked, figures as a scene file takes them.

    Raises:
        ArgumentError: If a name is none of the fields, or a value not one of its field.
    """
    checked = {}
    for name, value in changes.items():
        if name not in _CHECKS:
            raise ArgumentError(name, f"is no field of a scene; {names_in_words(name, _CHECKS)}")
        checked[name] = _CHECKS[name](name, value)
    return checked


def _one(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    def check(name: str, value: Any) -> Any:
        if isinstance(value, kind) or (optional and value is None):
            return value
        said = f", e.g. {example}" if example else ""
        none = " or None" if optional else ""
        raise ArgumentError(
            name, f"found {reprlib.repr(value)}; needs a {kind.__name__}{none}{said}"
        )

    return check


def _several(kind: type, example: str = "", *, optional: bool = False) -> _Check:
    one = _one(kind, example)

    def check(name: str, value: Any) -> Any:
        if optional and value is None:
            return None
        if isinstance(value, str | Mapping) or not hasattr(value, "__iter__"):
            value = (value,)
        return tuple([one(name, item) for item in value])

    return check


def _as_in_a_file(name: str, value: Any) -> Any:
    """Check a figure by the schema of scene files."""
    return checked_key(SceneEntry, _LEAST, name, value)


def _friction(name: str, value: Any) -> Mapping[str, float]:
    found = _as_in_a_file(name, dict(value) if isinstance(value, Mapping) else value)
    return found if isinstance(found, Mapping) else {"default": found}


def _array(name: str, value: Any) -> Any:
    return np.array(_as_in_a_file(name, np.asarray(value).tolist()), dtype=np.float64)


def _axes(name: str, value: Any) -> Any:
    axes = [np.asarray(axis).tolist() for axis in value]
    return tuple(np.array(axis) for axis in _as_in_a_file(name, axes))


def _options(_: str, value: Any) -> Any:
    return _as_in_a_file("solve", dict(value)).model_dump()


def _force(name: str, value: Any) -> float | None:
    return None if value is None else real_number(name, value, 0.0)


_CHECKS: dict[str, _Check] = {
    "name": _one(str),
    "object": _one(ManipulatedObject, _OBJECT),
    "friction": _friction,
    "hand": _one(Hand, _HAND, optional=True),
    "supports": _several(Support, _SUPPORTS),
    "path": _one(Path, optional=True),
    "gravity": _array,
    "materials": _one(Materials),
    "hand_material": _one(str, optional=True),
    "given_contacts": _several(GivenContact, optional=True),
    "motion": _one(Motion, "Motion([0.1, 0, 0, 0, 0, 0])", optional=True),
    "max_normal_force": _as_in_a_file,
    "cone_edges": _as_in_a_file,
    "cone": _as_in_a_file,
    "contact_tolerance": _as_in_a_file,
    "points_per_patch": _as_in_a_file,
    "tangent_axes": _axes,
    "count_own_weight": _one(bool),
    "hybrid_force_limit": _force,
    "max_penetration": _as_in_a_file,
    "solve_options": _options,
    "load_findings": _several(Finding),
}


@dataclass(frozen=True, eq=False, repr=False)
class Scene(PickledByFields):
    """Everything that `QuasistaticProblem` is made of. See the example of `load_scene`.

    Attributes:
        name: For titles.
        path: The file that it came from, for messages; None if made in Python.
        hand: The hand at its configuration; None: the object only leans on supports.
        object: The manipulated object.
        supports: What is fixed around it.
        gravity: (3,) m/s^2, world axes.
        friction: Coefficient by hand link or support, else by ``hand`` or ``supports``, else
            ``default``; a support's own coefficient comes first.
        materials: Coefficient per pair of materials; it comes before `friction` where both bodies
            have a material.
        hand_material: Material of all hand links; None: `friction` tells.
        given_contacts: Contacts to be used as they are; None: found from the shapes.
        motion: The declared motion; None: at rest.
        max_normal_force: f_n,max of every contact, N.
        cone_edges: Edges of each friction cone.
        cone: Name of the friction cone model: see `QuasistaticProblem`.
        contact_tolerance: Largest gap that counts as touching, m.
        points_per_patch: Most contacts that stand for one face on a face, at least 3.
        tangent_axes: t1 of a contact is the projection of the first of these axes that is not
            along its normal; without any, the rule of `QuasistaticProblem`.
        count_own_weight: Whether the links' weight g(q) counts against the limits.
        hybrid_force_limit: Largest commanded force of a hybrid finger, N; None: max_normal_force.
        max_penetration: Deepest overlap that passes for contact, m.
        solve_options: Options of `solve` by name.
        load_findings: What looked wrong when it was loaded.
    """

    name: str
    object: ManipulatedObject
    friction: Mapping[str, float]
    hand: Hand | None = None
    supports: tuple[Support, ...] = ()
    path: Path | None = None
    gravity: FloatArray = field(default_factory=lambda: np.array([0.0, 0.0, -9.81]))
    materials: Materials = field(default_factory=lambda: Materials({}))
    hand_material: str | None = None
    given_contacts: tuple[GivenContact, ...] | None = None
    motion: Motion | None = None
    max_normal_force: float = 50.0
    cone_edges: int = 32
    cone: str = "edges"
    contact_tolerance: float = 1e-3
    points_per_patch: int = 8
    tangent_axes: tuple[FloatArray, ...] = ()
    count_own_weight: bool = True
    hybrid_force_limit: float | None = None
    max_penetration: float = 5e-3
    solve_options: Mapping[str, Any] = field(default_factory=dict)
    load_findings: tuple[Finding, ...] = ()

    def with_changes(self, **changes: Any) -> Scene:
        """Return the same scene with some fields replaced; what they do not touch is not redone.

        Raises:
            ArgumentError: If a name is none of the fields, or a value not one of its field.
        """
        return self._changed(checked_changes(changes))

    def _changed(self, fields: Mapping[str, Any]) -> Scene:
        """Return the same scene with fields that need no check."""
        stated = None if self._stated is None else self._stated.without(fields)
        return changed(self, "contacts", "findings", _kept=self._kept, _stated=stated, **fields)

    def __reduce__(self) -> tuple[Any, ...]:
        """Pickle by the fields, with where the scene's file states them."""
        return (*super().__reduce__(), {"_stated": self._stated})

    def __repr__(self) -> str:
        """Return one line."""
        return scene_line(self)

    def __str__(self) -> str:
        """Return one screen: object, hand, supports, contacts, motion and findings."""
        return scene_screen(self)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with it, the gravest first, each with what to do, see `FindingCode`."""
        return findings_of(self)

    @cached_property
    def contacts(self) -> SceneContacts:
        """The contacts that carry force, found or given, after the declared motion.

        Raises:
            StateError: If nothing touches the object, bodies overlap too deeply, or the declared
                motion drives the object into something or away from everything.
            SceneError: If a shape cannot be used.
        """
        return contacts_after_motion(self, touching_of(self))

    def problem(self) -> QuasistaticProblem:
        """Return the problem: contacts, contact Jacobian, weight and limits as arrays.

        Positions and moments are about the object's centre of mass, in world axes.

        Raises:
            SceneError: See `contacts`.
        """
        state = jointed_contacts(self)
        contacts, joints, loads = state.contacts, state.joints, loads_of(self, state)
        # Contacts that are given may be anything; those found are right by themselves.
        made = problem_of_own_arrays
        problem = (made if self.given_contacts is None else QuasistaticProblem)(
            state.positions,
            contacts.arrays.normals,
            loads.wrench,
            joints.jacobian,
            friction=loads.friction,
            tangents=state.tangents,
            sliding=contacts.sliding,
            torque_limits=loads.limits,
            max_normal_force=loads.max_normal_force,
            cone_edges=self.cone_edges,
            cone=self.cone,
            joint_names=joints.names,
            joint_units=joints.units,
            gravity_torques=loads.gravity_torques,
        )
        joint_inertia = partial(inertia_of_columns, self.hand, len(joints.names))
        sources = {"object_inertia": self.object.spatial_inertia, "joint_inertia": joint_inertia}
        return with_derived_inertias(problem, sources)

    def solve(self, algorithm: str | None = None, **options: Any) -> TorqueSolution:
        """Solve the scene's problem with its own options, or with others.

        Args:
            algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's
                name; None: the scene's.
            options: Options of `maximize_margin`, `minimize_torque` or the other objective.

        Raises:
            ArgumentError: If an option is not known or not one of this algorithm.
            SceneError: See `contacts`; or if the scene's own solver is not installed.
        """
        mode = options.pop("mode", None)
        objective, how = self.asked(algorithm, **options)
        unknown = unknown_of(self) if how.strong else ""
        found = solve_problem(self.problem(), objective, how, mode=mode, unknown=unknown)
        unused = [] if algorithm else [*unused_figures(self.solve_options, self._stated)]
        if unused:
            return found.of_source(changed(self, findings=(*self.findings, *unused)))
        return found.of_source(self)

    def asked(self, algorithm: str | None = None, **options: Any) -> tuple[Objective, SolveOptions]:
        """Return what `solve` solves for, and how; the arguments are the same."""
        name = algorithm or self.solve_options.get("algorithm", "margin")

        def made() -> tuple[Objective, SolveOptions]:
            return objective_and_options(**{**self.solve_options, **options, "algorithm": name})

        sources = self.solve_options, algorithm, *options, *options.values()
        try:
            objective, how = self._kept.of("asked", sources, made)
        except SolverUnavailableError as error:
            if "solver" in options:
                raise
            raise SceneError(f"{label_of(self)}: solve.{error}") from error
        for key in options:
            if why := useless(key, name):
                raise ArgumentError(key, why)
        return objective, how

    def stability(self, torques: ArrayLike, **options: Any) -> StabilityVerdict:
        """Tell whether the object stays with motor torques (L,): see `graspless_pin.stability`.

        Where a link that torques move touches a support, nothing is decided: the problem does not
        have that force.
        """
        return verdict_of(self, torques, **options)

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a scene file that loads to the same problem, and return its path.

        What the file that the scene came from says stays, comments too, but for what has changed.
        Relative paths are written as they are from the new place, absolute ones as they are.

        Args:
            path: The file, ``.yaml``.
            overwrite: Whether a file of that name may be replaced.

        Raises:
            SceneError: If the file is there already or cannot be written, or no scene file can say
                what the scene is.
        """
        from graspless_pin.scene.saving import save_scene

        return save_scene(self, path, overwrite=overwrite)

    @cached_property
    def _stated(self) -> StatedFields | None:
        """Where its file states it; None: it came from none."""
        return None

    @cached_property
    def _kept(self) -> Latest:
        """What this scene and those changed from it, or made of the same parts, found last."""
        return Latest()


_MOST = 8


def scene_line(scene: Scene) -> str:
    """Return a scene in one line: its name and sizes; nothing is computed for it."""
    joints = "no hand"
    if scene.hand is not None:
        joints = f"a hand of {_count(len(scene.hand.joint_names), 'joint')}"
    return (
        f"<Scene {scene.name!r}: {scene.object.name}, {scene.object.mass:g} kg, {joints}, "
        f"{_count(len(scene.supports), 'support')}>"
    )


def scene_screen(scene: Scene) -> str:
    """Return a scene on one screen: what there is, what touches, what is wrong."""
    made = scene.object
    lines = [scene.name if scene.path is None else f"{scene.name} ({scene.path})"]
    lines.append(
        f"object    {made.name}: {_shape(made.shape)}, {made.mass:g} kg, at "
        f"{_point(made.T_world_object[:3, 3])} m"
    )
    if scene.hand is None:
        lines.append("hand      none")
    else:
        hand = scene.hand
        fingers = ", ".join(hand.fingers) or "no fingers"
        lines.append(
            f"hand      {_shortened(fingers)}: {_count(len(hand.joint_names), 'joint')}, "
            f"{len(hand.actuated_joint_names)} under force control"
        )
    for support in scene.supports[:_MOST]:
        moves = ", moves" if support.is_moving else ""
        lines.append(f"support   {support.name}: {_shape(support.shape)}{moves}")
    if len(scene.supports) > _MOST:
        lines.append(f"          and {len(scene.supports) - _MOST} more")
    lines.append(f"contacts  {_contacts(scene)}")
    if scene.motion is None:
        lines.append("motion    none: at rest")
    else:
        twist = scene.motion.object_twist
        lines.append(f"motion    {_point(twist[:3])} m/s, {_point(twist[3:])} rad/s")
    findings = scene.findings
    lines += [f"{one.severity!s:<9} {one}" for one in findings[:_MOST]]
    if len(findings) > _MOST:
        lines.append(f"          and {len(findings) - _MOST} more in scene.findings")
    return "\n".join(lines)


def _contacts(scene: Scene) -> str:
    try:
        touching = scene.contacts
    except GrasplessPinError as error:
        return f"none: {error}"
    bodies = Counter(touching.bodies)
    each = ", ".join(f"{name} {count}" for name, count in list(bodies.items())[:_MOST])
    more = f" and {len(bodies) - _MOST} bodies more" if len(bodies) > _MOST else ""
    sliding = int(touching.sliding.any(axis=1).sum())
    return f"{len(touching.bodies)}, {sliding} sliding: {each}{more}"


def _shape(shape: Shape) -> str:
    figures = [
        f"{value:g}" for key in shape.lengths() for value in np.atleast_1d(getattr(shape, key))
    ]
    files = [f" {value.name}" for value in vars(shape).values() if isinstance(value, Path)]
    words = "".join([shape.kind.replace("_", "-"), *files])
    return f"{words} {' x '.join(figures)} m" if figures else words


def _point(values: FloatArray) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in (np.round(values, 9) + 0.0).tolist())}]"


def _count(number: int, noun: str) -> str:
    return f"{number} {noun}" if number == 1 else f"{number} {noun}s"


def _shortened(text: str) -> str:
    return text if len(text) <= 60 else f"{text[:57]}..."
