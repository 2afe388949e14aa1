"""What a worker does: from the values of a sample to a row of results, and what stands in one."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.batch_optimum import LoadSweep
from graspless_pin.algorithms.batch_programs import are_for
from graspless_pin.algorithms.comparison import minimum_friction
from graspless_pin.algorithms.disturbances import disturbance_margin
from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.algorithms.warm_search import StartsByContacts
from graspless_pin.errors import GrasplessPinError, StudyError, internal_error
from graspless_pin.findings import Finding, Severity, causes_first
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, JointUnit
from graspless_pin.problem.cones import CONE_MODELS
from graspless_pin.programs.objectives import Objective
from graspless_pin.scene.problem_data import (
    JointedContacts,
    jointed_contacts,
    loads_of,
    problem_at,
    renewed_row,
)
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_findings import StateChecks, state_findings
from graspless_pin.scene.scene_stability import rest_model_of, solution_verdict
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.studies.keys import Sample
from graspless_pin.studies.study import Row, SampleParts, Study

LARGEST_TORQUE = "max_torque_"
"""Begin of the names of columns with the largest |torque| of the joints of one unit."""
_SUFFIXES = {unit: unit.replace(" ", "") for unit in JointUnit}
"""What ends the name of a column, by unit."""


OBJECTIVE_VALUE = "objective_value"
"""Name of the column of the optimum of an objective that is none of Algorithms 1 and 2."""
ROBUST_COLUMNS = (
    "robust_status", "robust_found", "robust_coverage", "robust_margin_N",
    f"robust_{LARGEST_TORQUE}Nm", f"robust_{LARGEST_TORQUE}N", "robust_sampled_share",
)  # fmt: skip
"""Names of the columns of torques for all that is not known of a scene."""
FINDINGS = "findings"
"""Name of the column of serious findings; empty without any."""


class _Kind(NamedTuple):
    """What samples share that one loop solves.

    Attributes:
        state: Contacts and joints.
        rubbing: Bytes of which contacts have friction.
        cone: See `Scene`.
        cone_edges: Likewise.
        objective: What is optimised.
        options: How.
    """

    state: JointedContacts
    rubbing: bytes
    cone: str
    cone_edges: int
    objective: Objective
    options: SolveOptions


class StatedSample(NamedTuple):
    """A sample's problem, as loops take it.

    Attributes:
        scene: Its scene.
        kind: What it shares with others.
        loads: See `Loads.row`.
        findings: See `state_findings`.
    """

    scene: Scene
    kind: _Kind
    loads: FloatArray
    findings: tuple[Finding, ...]


def stated_sample(scene: Scene, checks: StateChecks, before: StatedSample | None) -> StatedSample:
    """Return the problem of a sample.

    Args:
        scene: Its scene.
        checks: Which findings are looked for.
        before: Another sample; what it has and this one shares is not made again.

    Raises:
        SceneError: If the scene has no problem.
    """
    if before is not None:
        row = renewed_row(scene, before.kind.state, before.scene, before.loads)
        if row is not None:
            rubbing = (row[: len(before.kind.state.positions)] > 0.0).tobytes()
            same = rubbing == before.kind.rubbing
            kind = before.kind if same else before.kind._replace(rubbing=rubbing)
            return StatedSample(scene, kind, row, before.findings)
    state = jointed_contacts(scene)
    loads = loads_of(scene, state)
    rubbing = (loads.friction > 0.0).tobytes()
    kind = _Kind(state, rubbing, scene.cone, scene.cone_edges, *scene.asked())
    return StatedSample(scene, kind, loads.row(), state_findings(scene, checks))


class SampleBlock:
    """Samples that begin with what was learned of those before them in their block.

    Whether a sample runs in a loop depends on those before it alone, and so does its row.
    """

    def __init__(self, study: Study) -> None:
        """Begin with nothing learned of a study's samples."""
        self._study = study
        self._starts = StartsByContacts()
        self._kind: _Kind | None = None
        self._run: list[tuple[int, StatedSample]] = []
        self._optima: dict[tuple[Any, ...], LoadSweep] = {}

    def rows(self, number: int, stated: StatedSample) -> Iterator[Row]:
        """Take the next sample, and yield the rows that are ready then.

        Args:
            number: Its number.
            stated: What `stated_sample` returns of its scene.
        """
        kind, last = stated.kind, self._kind
        if kind is not last and (
            last is None or kind.state is not last.state or kind[1:] != last[1:]
        ):
            yield from self.rest()
        if kind is last or are_for(CONE_MODELS[kind.cone], kind.objective, kind.options):
            self._kind = kind
            self._run.append((number, stated))
        else:
            yield self._alone(number, stated)

    def _alone(self, number: int, stated: StatedSample) -> Row:
        return _row(self._study, number, stated.scene, stated.findings, self._starts)

    def rest(self) -> Iterator[Row]:
        """Yield the rows of the samples that have none yet."""
        run, kind = self._run, self._kind
        if not run or kind is None:
            return
        self._run = []
        try:
            rows = [*self._looped(run, kind)]
        except Exception as error:  # which sample it was, each in a run of its own tells
            if len(run) == 1 or isinstance(error, StudyError):
                rows = [_failed(self._study, run[0][0], error)]
            else:
                rows = []
                for one in run:
                    self._run = [one]
                    rows += self.rest()
        yield from rows

    def _looped(self, run: Sequence[tuple[int, StatedSample]], kind: _Kind) -> Iterator[Row]:
        """Yield the rows of samples of one kind."""
        problem = problem_at(run[0][1].scene, kind.state)
        joints = kind.state.joints
        bodies = kind.options.rules, *kind.state.contacts.bodies
        optima, columns = self._optima_of(kind, problem), torque_columns(joints.names, joints.units)
        loads, count = np.array([stated.loads for _, stated in run]), len(run)
        figures, torques = np.empty((count, 6)), np.empty((count, problem.joint_count))
        begin = 0
        starts = self._starts.for_contacts(bodies, problem, kind.objective)
        while begin < count:
            optima.learn(problem, starts.best)
            end = optima.advance(problem, loads, begin, figures, torques)
            margins, found = figures[begin:end, 0].tolist(), torques[begin:end].tolist()
            of_run = zip(run[begin:end], margins, found, strict=True)
            for (number, stated), margin, each in of_run:
                yield {
                    "sample": number,
                    "status": Status.OPTIMAL.name.lower(),
                    "found": True,
                    **columns.values(margin, each),
                    "contacts": problem.contact_count,
                    "nodes": 1,
                    **of_findings(stated.scene, stated.findings),
                }
            if end < count:
                yield self._alone(*run[end])
            begin = end + 1

    def _optima_of(self, kind: _Kind, problem: QuasistaticProblem) -> LoadSweep:
        """Return what was learned in loops of these contacts, wherever they are."""
        shape = problem.is_sliding.tobytes(), problem.joint_count
        key = *kind[1:], kind.state.contacts.bodies, *shape
        if key not in self._optima:
            self._optima[key] = LoadSweep(problem, kind.objective, kind.options)
        return self._optima[key]


class Failure(StrEnum):
    """Why a sample has no result: beside `Status`, what its column ``status`` may hold."""

    FAILED = "failed"
    """Its scene cannot be used, or something raised an error."""
    CRASHED = "crashed"
    """The process that computed it died, and so did a second one."""
    OUT_OF_TIME = "out_of_time"
    """It took longer than the study's ``sample_time_limit``."""


def evaluate_each(
    study: Study, samples: Sequence[tuple[int, Sample]], *, one_by_one: bool = False
) -> Iterator[Row]:
    """Evaluate samples in this process; robots that an earlier call has read are kept.

    What was learned of a sample serves in those after it in its block.

    Args:
        study: The study.
        samples: Number and values of each sample; of each block all from its beginning.
        one_by_one: Whether each row comes before the next sample is begun. It changes no row.

    Yields:
        The row of each.

    Raises:
        StudyError: If the study's record cannot keep a solution.
    """
    of_hands: dict[int, Row] = {}
    for row in _evaluated(study, samples, of_hands, one_by_one=one_by_one):
        of_hand = of_hands.pop(row["sample"], None)
        yield row | of_hand if of_hand else row


def _evaluated(
    study: Study,
    samples: Sequence[tuple[int, Sample]],
    of_hands: dict[int, Row],
    *,
    one_by_one: bool,
) -> Iterator[Row]:
    """Yield the rows of `evaluate_each`; what they tell of where hands went is put beside them."""
    parts, compute = _parts_of(study.fingerprint), study.entry.compute
    asked = compute.verdict or compute.mode or compute.force_bounds or compute.disturbance_margin
    alone = study.block == 1 or study.record is not None or asked or compute.minimum_friction
    at, block, starts = None, SampleBlock(study), None
    checks = StateChecks(compute.collisions, compute.need_hand)
    stated: StatedSample | None = None
    for number, sample in samples:
        if study.block > 1 and number // study.block != at:
            yield from block.rest()
            at, block, starts = number // study.block, SampleBlock(study), StartsByContacts()
        try:
            scene, of_hands[number] = study.posed_at(sample, parts)
            apart = alone or (scene is not None and scene.uncertainty is not None)
            found = state_findings(scene, checks) if apart and scene is not None else ()
            if scene is not None:
                stated = None if apart else stated_sample(scene, checks, stated)
        except Exception as error:
            yield from block.rest()
            yield _failed(study, number, error)
            continue
        if scene is None:
            yield from block.rest()
            yield {"sample": number}
        elif stated is None:
            yield from block.rest()
            yield _row(study, number, scene, found, starts)
        else:
            yield from block.rows(number, stated)
        if one_by_one:
            yield from block.rest()
    yield from block.rest()


@lru_cache(maxsize=4)
def _parts_of(_fingerprint: str) -> SampleParts:
    """Return what the scenes of a study share in this process."""
    return SampleParts()


def _row(
    study: Study,
    number: int,
    scene: Scene,
    found: tuple[Finding, ...],
    starts: StartsByContacts | None,
) -> Row:
    """Return the row of one sample, which begins with what was learned; a failure is one, too.

    Args:
        study: The study.
        number: Of the sample.
        scene: Its scene.
        found: See `state_findings`.
        starts: What was learned.

    Raises:
        StudyError: If the study's record cannot keep the solution.
    """
    try:
        row = {"sample": number, **_results(study, number, scene, starts)}
        return row | of_findings(scene, found)
    except Exception as error:
        return _failed(study, number, error)


def _failed(study: Study, number: int, error: Exception) -> Row:
    """Return the row of a sample over which something was raised.

    Raises:
        StudyError: It is one: the study ends.
    """
    if isinstance(error, StudyError):
        raise error
    # Whatever else goes wrong is this sample's result. The path as it was given is no part of it:
    # another machine has another one.
    is_known = isinstance(error, GrasplessPinError)
    text = f"{type(error).__name__}: {error}" if is_known else internal_error(error)
    text = text.replace(str(study.scene.path), study.scene.path.name)
    return failure_row(number, Failure.FAILED, text)


def failure_row(number: int, why: Failure, error: str) -> Row:
    """Return the row of a sample that has no result."""
    return {"sample": number, "status": why.value, "found": False, "error": error}


def _results(study: Study, number: int, scene: Scene, starts: StartsByContacts | None) -> Row:
    compute = study.entry.compute
    solution = _solution(scene, starts)
    if study.record is not None:
        try:
            study.record(number, scene, solution)
        except GrasplessPinError as error:
            raise StudyError(f"sample {number}: {error}") from error
    problem = solution.problem
    columns = torque_columns(problem.joint_names, problem.joint_units)
    row: Row = {"status": solution.status.name.lower(), "found": solution.found}
    if solution.found:
        row |= columns.values(solution.margin, solution.torques.tolist())
        if solution.algorithm is None:
            row[OBJECTIVE_VALUE] = solution.value
    else:
        row |= dict.fromkeys(name for name, _ in columns.largest)
    row["contacts"] = problem.contact_count
    row["nodes"] = solution.certificate.nodes
    if compute.verdict and solution.found:
        # Its own where the torques are guaranteed.
        options = scene.solve_options
        verdict = solution_verdict(
            scene, solution, node_limit=options["verdict_nodes"], time_limit=options["time_limit"]
        )
        row |= {
            "verdict": str(verdict.status),
            "holding": str(verdict.holding),
            "stiffness_needed": verdict.stiffness_needed,
            "growth_rate": verdict.growth_rate,
        }
    if compute.mode and solution.found:
        row["mode"] = str(solution.mode)
    row |= _analyses(study, scene, solution)
    if scene.uncertainty is not None:
        row |= robust_values(scene.solve(uncertainty=True))
    if not solution.found:
        why = solution.explanation if compute.explain else ""
        row["reason"] = why or solution.status.message
    return row


def _solution(scene: Scene, starts: StartsByContacts | None) -> TorqueSolution:
    if starts is None:
        return scene.solve()
    objective, how = scene.asked()
    problem, rest = scene.problem(), rest_model_of(scene) if how.strong else None
    known = starts.for_contacts((how.rules, *scene.contacts.bodies), problem, objective)
    return known.solve(problem, objective, how, rest).of_source(scene)


def _analyses(study: Study, scene: Scene, solution: TorqueSolution) -> Row:
    """Return what is computed beside the torques; a column has no room for what is not proven."""
    compute, problem, rules = study.entry.compute, solution.problem, solution.rules.options()
    limits = {name: scene.solve_options[name] for name in ("node_limit", "time_limit")}
    row: Row = {}
    if compute.force_bounds and solution.found:
        bounds = contact_force_bounds(problem, solution.torques, **limits, **rules)
        if bounds.status is Status.OPTIMAL:
            row |= {
                "smallest_margin_N": float(bounds.smallest_margin),
                "largest_margin_N": float(bounds.largest_margin),
            }
    if compute.disturbance_margin and solution.found:
        margin = disturbance_margin(problem, solution.torques, **limits, **rules)
        if margin.found:
            row["disturbance_N"] = float(margin.magnitudes[margin.worst])
    if compute.minimum_friction:
        least = minimum_friction(problem, **limits, **rules)
        row["minimum_friction_factor"] = float(least.factor) if least.proven else None
    return row


def of_findings(scene: Scene, found: Sequence[Finding]) -> Row:
    """Return the codes of serious findings as they stand in a row: in the order of their gravity.

    Args:
        scene: The scene of the sample; what its files told counts, too.
        found: See `state_findings`.
    """
    loaded = (*scene.load_findings, *(() if scene.hand is None else scene.hand.findings))
    if not (loaded or found):
        return {}
    serious = [one for one in causes_first([*loaded, *found]) if one.severity is Severity.SERIOUS]
    return {FINDINGS: "; ".join(dict.fromkeys(one.code for one in serious))} if serious else {}


class TorqueColumns(NamedTuple):
    """The columns of the torques of some joints.

    Attributes:
        largest: Of each unit that there is the column of its largest |torque|, and the joints.
        each: L columns.
    """

    largest: tuple[tuple[str, tuple[int, ...]], ...]
    each: tuple[str, ...]

    def values(self, margin: float, torques: Sequence[float]) -> Row:
        """Return margin (N) and L torques (N m or N) by column."""
        row: Row = {name: max([abs(torques[k]) for k in own], default=0.0)
                    for name, own in self.largest}  # fmt: skip
        row["margin_N"] = margin
        row.update(zip(self.each, torques, strict=True))
        return row


@lru_cache(maxsize=64)
def torque_columns(names: tuple[str, ...], units: tuple[JointUnit, ...]) -> TorqueColumns:
    """Return the columns of joints by their names and the units of their torques."""
    there = [unit for unit in JointUnit if unit in units] or [JointUnit.TORQUE]
    largest = tuple([
        (LARGEST_TORQUE + _SUFFIXES[one], tuple([k for k, unit in enumerate(units) if unit is one]))
        for one in there
    ])  # fmt: skip
    each = [f"torque_{name}_{_SUFFIXES[unit]}" for name, unit in zip(names, units, strict=True)]
    return TorqueColumns(largest, tuple(each))


def robust_values(found: RobustSolution) -> Row:
    """Return what stands in a row of torques for all that is not known of a scene."""
    row: Row = {
        "robust_status": found.status.name.lower(),
        "robust_found": found.found,
        "robust_coverage": found.coverage.name.lower(),
    }
    if not found.found:
        return row
    row["robust_margin_N"] = found.margin
    if found.samples is not None:
        row["robust_sampled_share"] = found.samples.served / found.samples.count
    units, largest = found.members[0].problem.joint_units, found.largest_commands
    columns = torque_columns(found.joint_names, units)
    for name, joints in columns.largest:
        row[f"robust_{name}"] = float(largest[list(joints)].max(initial=0.0))
    return row
