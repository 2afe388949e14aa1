"""A scene: hand, object and supports at one moment, and the way to a `QuasistaticProblem`."""

from __future__ import annotations

import reprlib
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from os import PathLike
from pathlib import Path
from textwrap import shorten
from typing import TYPE_CHECKING, Any, Literal, Self, overload

import numpy as np
from numpy.typing import ArrayLike

from graspless_pin.algorithms.options import (
    SolveOptions,
    objective_and_options,
    refuse_feedback_alone,
    refuse_useless,
)
from graspless_pin.algorithms.solve import solve_problem
from graspless_pin.errors import (
    ArgumentError,
    GrasplessPinError,
    SceneError,
    SolverUnavailableError,
)
from graspless_pin.findings import Finding
from graspless_pin.geometry.bodies.shapes import Shape
from graspless_pin.holding.verdict import StabilityVerdict
from graspless_pin.intake.yaml_source import YamlSource
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.programs.objectives import Objective
from graspless_pin.records import changed
from graspless_pin.scene.contact_arrays import SceneContacts, contacts_of
from graspless_pin.scene.fields import SceneFields, label_of
from graspless_pin.scene.load import build_scene
from graspless_pin.scene.problem_data import problem_of
from graspless_pin.scene.scene_findings import findings_of, unused_figures
from graspless_pin.scene.scene_schema import SCENE
from graspless_pin.scene.scene_stability import (
    MemberVerdicts,
    rest_model_of,
    verdict_of,
    verdicts_of_members,
)
from graspless_pin.solution import TorqueSolution
from graspless_pin.solution.tables import with_noun
from graspless_pin.suggestions import first_of, what_to_pass

if TYPE_CHECKING:
    from graspless_pin.algorithms.robust_solution import RobustSolution
    from graspless_pin.algorithms.tolerance_tables import Tolerances
    from graspless_pin.algorithms.uncertainty import Uncertainty


_MOST_LINES = 8  # of each kind, in the text of a scene
_WIDEST_LIST = 60  # characters


@dataclass(frozen=True, eq=False, repr=False)
class Scene(SceneFields):
    """Everything that `QuasistaticProblem` is made of. See the example of `load_scene`.

    Attributes:
        name: For titles.
        path: Its file, for messages; None if made in Python.
        hand: The hand at its configuration; None: the object has support contacts only.
        object: The manipulated object.
        supports: What is fixed around it.
        gravity: (3,) m/s^2, world axes.
        friction: Coefficient by hand link or support, else by ``hand`` or ``supports``, else
            ``default``; a support's own coefficient comes first.
        materials: Coefficient per pair of materials; it comes before `friction` where both bodies
            have a material.
        hand_material: Material of all hand links; None: `friction` applies.
        given_contacts: Stated contacts, used as they are; None: found from the shapes.
        motion: The declared motion; None: at rest.
        loads: Forces, payloads and fields on the object in addition to gravity; names differ.
        acceleration: Acceleration of object and hand; None: none.
        max_normal_force: f_n,max of every contact, N.
        cone_edges: Edges of each friction cone.
        cone: Name of the friction cone model: see `QuasistaticProblem`.
        contact_tolerance: Largest gap that counts as touching, m.
        points_per_patch: Most contact points that represent one face on a face, at least 3.
        tangent_axes: t1 of a contact is the projection of the first of these axes that is not
            along its normal; without any, the rule of `QuasistaticProblem`.
        count_own_weight: Whether the links' weight g(q) counts against the limits.
        hybrid_force_limit: Largest commanded force of a hybrid finger, N; None: max_normal_force.
        max_penetration: Deepest overlap that counts as contact, m.
        controller: Joint feedback that acts in addition to the torques, for verdicts; its stiffness
            counts in robust torques, too.
        uncertainty: What is not known exactly; None: nothing, the scene is nominal.
        solve_options: Options of `solve` by name.
        load_findings: Findings from loading.
    """

    _DERIVED = ("contacts", "findings")

    def __repr__(self) -> str:
        """Return name and sizes in one line, without computing anything."""
        joints = "no hand"
        if self.hand is not None:
            joints = f"a hand of {with_noun(len(self.hand.joint_names), 'joint')}"
        return (
            f"<Scene {self.name!r}: {self.object.name}, {self.object.mass:g} kg, {joints}, "
            f"{with_noun(len(self.supports), 'support')}>"
        )

    def __str__(self) -> str:
        """Return one screen: object, hand, supports, contacts, motion and findings."""
        target = self.object
        lines = [self.name if self.path is None else f"{self.name} ({self.path})"]
        lines.append(
            f"object    {target.name}: {_shape_text(target.shape)}, {target.mass:g} kg, at "
            f"{_numbers(target.T_world_object[:3, 3])} m"
        )
        if self.hand is None:
            lines.append("hand      none")
        else:
            hand = self.hand
            fingers = shorten(
                ", ".join(hand.fingers) or "no fingers", _WIDEST_LIST, placeholder=" ..."
            )
            lines.append(
                f"hand      {fingers}: {with_noun(len(hand.joint_names), 'joint')}, "
                f"{len(hand.actuated_joint_names)} under force control"
            )
        lines += _first_lines_of_kind(
            [
                f"support   {one.name}: {_shape_text(one.shape)}"
                + (", moves" if one.is_moving else "")
                for one in self.supports
            ]
        )
        lines += _first_lines_of_kind([f"load      {load}" for load in self.loads])
        if self.acceleration is not None:
            lines.append(f"moves     {self.acceleration}")
        if self.uncertainty is not None:
            lines.append(f"unknown   {self.uncertainty}")
        lines.append(f"contacts  {_contacts_text(self)}")
        if self.motion is None:
            lines.append("motion    none: at rest")
        else:
            twist = self.motion.object_twist
            lines.append(f"motion    {_numbers(twist[:3])} m/s, {_numbers(twist[3:])} rad/s")
        finding_lines = [f"{one.severity!s:<9} {one}" for one in self.findings]
        lines += _first_lines_of_kind(finding_lines, " in scene.findings")
        return "\n".join(lines)

    @cached_property
    def findings(self) -> tuple[Finding, ...]:
        """What is wrong with it, the gravest first, each with advice: see `FindingCode`."""
        return findings_of(self)

    @cached_property
    def contacts(self) -> SceneContacts:
        """The contacts that carry force, found or given, after the declared motion.

        Raises:
            StateError: If nothing touches the object, bodies overlap too deeply, or the declared
                motion drives the object into something or away from everything.
            SceneError: If a shape cannot be used.
        """
        return contacts_of(self)

    def with_changes(self, values: Mapping[str, Any] | None = None, /, **changes: Any) -> Self:
        """Return the scene with some values replaced; data that do not depend on them stay cached.

        Args:
            values: By key of a scene file, dotted as in a study (``object.mass``), in the form of
                the file: numbers in SI units, angles in rad. The scene's file is read again for
                that: fields are quicker.
            changes: By name of a field; also the file's keys ``solve`` and ``contacts``, whose
                fields have other names, in the form of the file. Fields are replaced first.

        Raises:
            ArgumentError: If a name is no field or key, or a value is invalid for its field.
            SceneError: If the scene file would be invalid.

        Examples:
            >>> from graspless_pin import load_scene
            >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
            >>> heavy = scene.with_changes({"object.mass": 2.0, "supports.slope.friction": 0.5})
            >>> print(f"{heavy.object.mass} kg, {heavy.solve().margin:.3f} N")
            2.0 kg, 2.709 N
        """
        renamed = {"solve", "contacts"} & changes.keys()
        is_keyed = isinstance(values, Mapping) and all(isinstance(key, str) for key in values)
        if values is not None and not is_keyed:
            example = "{'object.mass': 2.0}"
            found = reprlib.repr(values)
            raise ArgumentError("values", f"found {found}; needs keys and values, e.g. {example}")
        keys = dict(values or {}) | {key: changes.pop(key) for key in renamed}
        scene = super().with_changes(**changes) if changes or not keys else self
        if not keys:
            return scene
        from graspless_pin.scene.keys import scene_with_keys

        return scene_with_keys(scene, keys)

    def problem(self) -> QuasistaticProblem:
        """Return the problem: contacts, contact Jacobian, weight and limits as arrays.

        Positions and moments are about the object's centre of mass, in world axes.

        Raises:
            SceneError: See `contacts`.
        """
        return problem_of(self)

    @overload
    def solve(
        self,
        algorithm: str | None = None,
        *,
        uncertainty: Literal[False] | None = None,
        **options: Any,
    ) -> TorqueSolution: ...

    @overload
    def solve(
        self,
        algorithm: str | None = None,
        *,
        uncertainty: Uncertainty | Literal[True],
        **options: Any,
    ) -> RobustSolution: ...

    def solve(
        self,
        algorithm: str | None = None,
        *,
        uncertainty: Uncertainty | bool | None = None,
        **options: Any,
    ) -> TorqueSolution | RobustSolution:
        """Solve the scene's problem with its own options, or with others.

        Args:
            algorithm: ``margin`` (Algorithm 1), ``torque`` (Algorithm 2) or another objective's
                name; None: the scene's.
            uncertainty: What is not known exactly: then one vector of torques serves its whole set.
                True: the scene's own uncertainty. Without it the nominal scene is solved, even if
                the scene has an uncertainty.
            options: Options of `maximize_margin`, `minimize_torque` or the other objective. With an
                uncertainty ``stability="strong"`` is proven at its corners, and `feedback` is an
                option; its default is the stiffness of the scene's controller.

        Raises:
            ArgumentError: If an option is unknown or not one of this algorithm, or the scene has no
                uncertainty.
            SceneError: See `contacts`; or if the scene's own solver is not installed.
        """
        mode, feedback = options.pop("mode", None), options.pop("feedback", None)
        objective, how = self.objective_and_options(algorithm, **options)
        if uncertainty is not None and uncertainty is not False:
            # Imported here: scenes without uncertainty do not need it.
            from graspless_pin.scene.uncertain import required_uncertainty, solve_uncertain

            unknown = required_uncertainty(self) if uncertainty is True else uncertainty
            return solve_uncertain(self, objective, how, unknown, feedback=feedback, mode=mode)
        refuse_feedback_alone(feedback)
        rest_model = rest_model_of(self) if how.strong else None
        solution = solve_problem(self.problem(), objective, how, mode=mode, rest=rest_model)
        unused = unused_figures(self.solve_options, self._source) if algorithm is None else ()
        if findings := tuple(unused):
            return solution.with_source(changed(self, findings=(*self.findings, *findings)))
        return solution.with_source(self)

    def objective_and_options(
        self, algorithm: str | None = None, **options: Any
    ) -> tuple[Objective, SolveOptions]:
        """Return the objective and options of `solve`, which has the same arguments."""
        own = self.solve_options.get("algorithm", "margin")
        name = own if algorithm is None else algorithm
        sources = self.solve_options, algorithm, *options, *options.values()
        chosen = self._cache.get("options", sources)
        if chosen is None:
            merged = {**self.solve_options, **options, "algorithm": name}
            try:
                chosen = self._cache.put("options", sources, objective_and_options(**merged))
            except SolverUnavailableError as error:
                if "solver" in options:
                    raise
                raise SceneError(f"{label_of(self)}: solve.{error}") from error
        refuse_useless([key for key, value in options.items() if value is not None], name)
        return chosen

    def stability(
        self, torques: ArrayLike | Mapping[str, float], **options: Any
    ) -> StabilityVerdict:
        """Tell whether the object stays with motor torques (L,), or by joint: see `stability`.

        It is undecided where a link that torques move touches a support: the problem does not
        have that force.
        """
        return verdict_of(self, torques, **options)

    def stability_of_members(self, robust: RobustSolution, **options: Any) -> MemberVerdicts:
        """Tell whether the object stays at each corner of a set that torques serve.

        Args:
            robust: What `solve` returns with an uncertainty.
            options: Those of `graspless_pin.stability`; `time_limit` is that of all corners.
        """
        return verdicts_of_members(self, robust, **options)

    def tolerances(self, torques: ArrayLike | Mapping[str, float], **options: Any) -> Tolerances:
        """Tell how far mass, pushes, friction and the like may be off with motor torques (L,).

        Args:
            torques: N m (N), or by joint.
            options: Those of `graspless_pin.tolerances`; rules, solver and feedback are as in
                `solve` unless they are given.
        """
        from graspless_pin.scene.uncertain import tolerances_of

        _, how = self.objective_and_options(
            **{name: options[name] for name in options.keys() & {"solver"}}
        )
        return tolerances_of(self, torques, **{**how.for_analyses(), **options})

    def save(self, path: str | Path, *, overwrite: bool = False) -> Path:
        """Write a scene file that loads to the same problem, and return its path.

        The content of the scene's file stays, with comments, except what has changed. Relative
        paths are rewritten for the new folder, absolute ones stay.

        Args:
            path: The file, ``.yaml``; folders that are missing are made.
            overwrite: Whether a file of that name may be replaced.

        Raises:
            SceneError: If the file exists already or cannot be written, or the scene cannot be
                expressed by a scene file.
            ArgumentError: If ``path`` is no path, or ``overwrite`` is neither True nor False.
        """
        if not isinstance(path, str | PathLike):
            raise ArgumentError("path", what_to_pass("path", path, "path of a scene file"))
        from graspless_pin.scene.saving import scene_text, write_scene_file

        return write_scene_file(
            Path(path), lambda target: scene_text(self, target), overwrite=overwrite
        )


def load_scene(path: str | Path) -> Scene:
    """Load a YAML scene.

    Paths in the file are relative to the file. The file is data: YAML tags are refused, and so are
    XML entities in the URDFs that it names.

    Args:
        path: The scene file.

    Returns:
        The scene, with hand and shapes loaded.

    Raises:
        SceneError: Naming file, line and key, the value found and the values allowed.

    Examples:
        >>> from graspless_pin import load_scene
        >>> scene = load_scene("examples/paper/cuboid_at_rest.yaml")
        >>> scene.name
        'Cuboid pinched on a slope, at rest'
        >>> print(f"{scene.solve().margin:.4f} N")
        1.6504 N
    """
    return build_scene(Scene, YamlSource.read(path, SCENE))


def _first_lines_of_kind(lines: list[str], suffix: str = "") -> list[str]:
    """Return the first lines of one kind, and a line with the number of hidden ones."""
    hidden = len(lines) - _MOST_LINES
    return [*lines[:_MOST_LINES], f"          and {hidden} more{suffix}"] if hidden > 0 else lines


def _contacts_text(scene: Scene) -> str:
    try:
        touching = scene.contacts
    except GrasplessPinError as error:
        return f"none: {error}"
    bodies = Counter(touching.bodies)
    each = first_of([f"{name} {count}" for name, count in bodies.items()], _MOST_LINES)
    sliding = int(touching.sliding.any(axis=1).sum())
    return f"{len(touching.bodies)}, {sliding} sliding: {each}"


def _shape_text(shape: Shape) -> str:
    figures = [
        f"{value:g}" for key in shape.lengths() for value in np.atleast_1d(getattr(shape, key))
    ]
    files = [f" {value.name}" for value in vars(shape).values() if isinstance(value, Path)]
    words = "".join([shape.kind.replace("_", "-"), *files])
    return f"{words} {' x '.join(figures)} m" if figures else words


def _numbers(values: FloatArray) -> str:
    return f"[{', '.join(f'{value:.4g}' for value in (np.round(values, 9) + 0.0).tolist())}]"
