"""Evaluation of samples: from the values of the variables to a row of results."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from enum import StrEnum
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.batch_optimum import LoadSweep
from graspless_pin.algorithms.batch_programs import loops_cover
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
    updated_load_row,
)
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.scene_findings import StateChecks, state_findings
from graspless_pin.scene.scene_stability import rest_model_of, solution_verdict
from graspless_pin.solution import Status, TorqueSolution
from graspless_pin.studies.keys import Sample
from graspless_pin.studies.study import Row, SampleParts, Study

LARGEST_TORQUE = "max_torque_"
"""Beginning of the names of columns of the largest |torque| of joints with the same unit."""
_SUFFIXES = {unit: unit.replace(" ", "") for unit in JointUnit}
"""End of a column's name, by unit."""


OBJECTIVE_VALUE = "objective_value"
"""Column of the optimal value of an objective other than Algorithms 1 and 2."""
ROBUST_COLUMNS = (
    "robust_status", "robust_found", "robust_coverage", "robust_margin_N",
    f"robust_{LARGEST_TORQUE}Nm", f"robust_{LARGEST_TORQUE}N", "robust_sampled_share",
)  # fmt: skip
"""Columns of torques that serve the whole set of a scene's uncertainty."""
FINDINGS = "findings"
"""Column of the codes of serious findings; empty without any."""


class _LoopKind(NamedTuple):
    """What samples have in common that one compiled loop solves.

    Attributes:
        state: Contacts and joints.
        rubbing: (M,) whether each contact has friction, as bytes.
        cone: See `Scene`.
        cone_edges: Likewise.
        objective: The objective.
        options: Options of the search.
    """

    state: JointedContacts
    rubbing: bytes
    cone: str
    cone_edges: int
    objective: Objective
    options: SolveOptions


class StatedSample(NamedTuple):
    """A sample's problem in the form for compiled loops.

    Attributes:
        scene: Its scene.
        kind: What it has in common with others.
        loads: See `Loads.row`.
        findings: See `state_findings`.
    """

    scene: Scene
    kind: _LoopKind
    loads: FloatArray
    findings: tuple[Finding, ...]


def stated_sample(scene: Scene, checks: StateChecks, before: StatedSample | None) -> StatedSample:
    """Return the problem of a sample.

    Args:
        scene: Its scene.
        checks: Which findings to look for.
        before: Another sample, whose data are reused where they are the same; None: no other.

    Raises:
        SceneError: If the scene has no problem.
    """
    if before is not None:
        row = updated_load_row(scene, before.kind.state, before.scene, before.loads)
        if row is not None:
            rubbing = (row[: len(before.kind.state.positions)] > 0.0).tobytes()
            is_same = rubbing == before.kind.rubbing
            kind = before.kind if is_same else before.kind._replace(rubbing=rubbing)
            return StatedSample(scene, kind, row, before.findings)
    state = jointed_contacts(scene)
    loads = loads_of(scene, state)
    rubbing = (loads.friction > 0.0).tobytes()
    kind = _LoopKind(state, rubbing, scene.cone, scene.cone_edges, *scene.objective_and_options())
    return StatedSample(scene, kind, loads.row(), state_findings(scene, checks))


class SampleBlock:
    """A block of samples; each search starts warm from earlier samples of the block.

    Whether a sample runs in a loop, and its row, depend on earlier samples of the block only.
    """

    def __init__(self, study: Study) -> None:
        """Begin without warm starts."""
        self._study = study
        self._starts = StartsByContacts()
        self._kind: _LoopKind | None = None
        self._run: list[tuple[int, StatedSample]] = []
        self._optima: dict[tuple[Any, ...], LoadSweep] = {}

    def rows(self, number: int, stated: StatedSample) -> Iterator[Row]:
        """Add the next sample, and yield the rows that are ready by then.

        Args:
            number: Its number.
            stated: What `stated_sample` returns for its scene.
        """
        kind, current = stated.kind, self._kind
        if kind is not current and (
            current is None or kind.state is not current.state or kind[1:] != current[1:]
        ):
            yield from self.finish()
        if kind is current or loops_cover(CONE_MODELS[kind.cone], kind.objective, kind.options):
            self._kind = kind
            self._run.append((number, stated))
        else:
            yield self._row_by_search(number, stated)

    def _row_by_search(self, number: int, stated: StatedSample) -> Row:
        return _row(self._study, number, stated.scene, stated.findings, self._starts)

    def finish(self) -> Iterator[Row]:
        """Yield the rows of the pending samples."""
        pending, kind = self._run, self._kind
        if not pending or kind is None:
            return
        self._run = []
        try:
            rows = [*self._rows_by_loop(pending, kind)]
        except Exception as error:  # runs of one sample each tell which one it was
            if len(pending) == 1 or isinstance(error, StudyError):
                rows = [_failed_row(self._study, pending[0][0], error)]
            else:
                rows = []
                for item in pending:
                    self._run = [item]
                    rows += self.finish()
        yield from rows

    def _rows_by_loop(
        self, run: Sequence[tuple[int, StatedSample]], kind: _LoopKind
    ) -> Iterator[Row]:
        """Yield the rows of samples of one kind: by the loop, and by a search where it stops."""
        problem = problem_at(run[0][1].scene, kind.state)
        joints = kind.state.joints
        bodies = kind.options.rules, *kind.state.contacts.bodies
        optima, columns = self._sweep_of(kind, problem), torque_columns(joints.names, joints.units)
        loads, count = np.array([stated.loads for _, stated in run]), len(run)
        figures, torques = np.empty((count, 6)), np.empty((count, problem.joint_count))
        start = 0
        starts = self._starts.for_contacts(bodies, problem, kind.objective)
        while start < count:
            optima.learn(problem, starts.best)
            end = optima.advance(problem, loads, start, figures, torques)
            margins, optimal_torques = figures[start:end, 0].tolist(), torques[start:end].tolist()
            solved = zip(run[start:end], margins, optimal_torques, strict=True)
            for (number, stated), margin, own_torques in solved:
                yield {
                    "sample": number,
                    "status": Status.OPTIMAL.name.lower(),
                    "found": True,
                    **columns.values(margin, own_torques),
                    "contacts": problem.contact_count,
                    "nodes": 1,
                    **finding_columns(stated.scene, stated.findings),
                }
            if end < count:
                yield self._row_by_search(*run[end])
            start = end + 1

    def _sweep_of(self, kind: _LoopKind, problem: QuasistaticProblem) -> LoadSweep:
        """Return the optima that loops learned for these bodies in contact, cached."""
        shape = problem.is_sliding.tobytes(), problem.joint_count
        key = *kind[1:], kind.state.contacts.bodies, *shape
        if key not in self._optima:
            self._optima[key] = LoadSweep(problem, kind.objective, kind.options)
        return self._optima[key]


class Failure(StrEnum):
    """Why a sample has no result: values of the column ``status`` in addition to `Status`."""

    FAILED = "failed"
    """Its scene is invalid, or the evaluation raised an error."""
    CRASHED = "crashed"
    """The process that computed it crashed, and so did a second one."""
    OUT_OF_TIME = "out_of_time"
    """It took longer than the study's ``sample_time_limit``."""


def evaluate_each(
    study: Study, samples: Sequence[tuple[int, Sample]], *, one_by_one: bool = False
) -> Iterator[Row]:
    """Evaluate samples in this process; robots are cached from call to call.

    Samples of a block start warm from earlier ones of it.

    Args:
        study: The study.
        samples: Number and values of each sample; of each block all from its beginning on.
        one_by_one: Whether each row is yielded before the next sample begins. Rows stay the same.

    Yields:
        The row of each.

    Raises:
        StudyError: If the study's record cannot store a solution.
    """
    hand_columns: dict[int, Row] = {}
    for row in _evaluate_in_blocks(study, samples, hand_columns, one_by_one=one_by_one):
        own_columns = hand_columns.pop(row["sample"], None)
        yield row | own_columns if own_columns else row


def _evaluate_in_blocks(
    study: Study,
    samples: Sequence[tuple[int, Sample]],
    hand_columns: dict[int, Row],
    *,
    one_by_one: bool,
) -> Iterator[Row]:
    """Yield the rows of `evaluate_each` without those on the hand's place, put in hand_columns."""
    parts, compute = _shared_parts(study.fingerprint), study.entry.compute
    analysed = compute.verdict or compute.mode or compute.force_bounds or compute.disturbance_margin
    single = study.block == 1 or study.record is not None or analysed or compute.minimum_friction
    current, block, starts = None, SampleBlock(study), None
    checks = StateChecks(compute.collisions, compute.need_hand)
    stated: StatedSample | None = None
    for number, sample in samples:
        if study.block > 1 and number // study.block != current:
            yield from block.finish()
            current, block, starts = number // study.block, SampleBlock(study), StartsByContacts()
        try:
            scene, hand_columns[number] = study.posed_at(sample, parts)
            is_separate = single or (scene is not None and scene.uncertainty is not None)
            findings = state_findings(scene, checks) if is_separate and scene is not None else ()
            if scene is not None:
                stated = None if is_separate else stated_sample(scene, checks, stated)
        except Exception as error:
            yield from block.finish()
            yield _failed_row(study, number, error)
            continue
        if scene is None:
            yield from block.finish()
            yield {"sample": number}
        elif stated is None:
            yield from block.finish()
            yield _row(study, number, scene, findings, starts)
        else:
            yield from block.rows(number, stated)
        if one_by_one:
            yield from block.finish()
    yield from block.finish()


@lru_cache(maxsize=4)
def _shared_parts(_fingerprint: str) -> SampleParts:
    """Return the cache that the scenes of a study share in this process."""
    return SampleParts()


def _row(
    study: Study,
    number: int,
    scene: Scene,
    findings: tuple[Finding, ...],
    starts: StartsByContacts | None,
) -> Row:
    """Return the row of one sample, solved by a search; an error gives a row of a failure.

    Args:
        study: The study.
        number: Number of the sample.
        scene: Its scene.
        findings: See `state_findings`.
        starts: Warm starts from earlier samples; None: none.

    Raises:
        StudyError: If the study's record cannot store the solution.
    """
    try:
        row = {"sample": number, **_solved_cells(study, number, scene, starts)}
        return row | finding_columns(scene, findings)
    except Exception as error:
        return _failed_row(study, number, error)


def _failed_row(study: Study, number: int, error: Exception) -> Row:
    """Return the row of a sample whose evaluation raised an error.

    Raises:
        StudyError: If the error is one, which ends the study.
    """
    if isinstance(error, StudyError):
        raise error
    # Any other error is the result of this sample. Folders are cut from the message: they differ
    # between machines.
    is_known = isinstance(error, GrasplessPinError)
    text = f"{type(error).__name__}: {error}" if is_known else internal_error(error)
    text = text.replace(str(study.scene.path), study.scene.path.name)
    return failure_row(number, Failure.FAILED, text)


def failure_row(number: int, failure: Failure, error: str) -> Row:
    """Return the row of a sample without a result."""
    return {"sample": number, "status": failure.value, "found": False, "error": error}


def _solved_cells(study: Study, number: int, scene: Scene, starts: StartsByContacts | None) -> Row:
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
        # The solution's own verdict where its torques are guaranteed.
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
    row |= _analysis_columns(study, scene, solution)
    if scene.uncertainty is not None:
        row |= robust_values(scene.solve(uncertainty=True))
    if not solution.found:
        explanation = solution.explanation if compute.explain else ""
        row["reason"] = explanation or solution.status.message
    return row


def _solution(scene: Scene, starts: StartsByContacts | None) -> TorqueSolution:
    if starts is None:
        return scene.solve()
    objective, options = scene.objective_and_options()
    problem, rest_model = scene.problem(), rest_model_of(scene) if options.strong else None
    warm_search = starts.for_contacts((options.rules, *scene.contacts.bodies), problem, objective)
    return warm_search.solve(problem, objective, options, rest_model).with_source(scene)


def _analysis_columns(study: Study, scene: Scene, solution: TorqueSolution) -> Row:
    """Return the columns of further analyses; those that are not proven are empty."""
    compute, problem, rules = study.entry.compute, solution.problem, solution.rules.options()
    limits = {name: scene.solve_options[name] for name in ("node_limit", "time_limit")}
    row: Row = {}
    if compute.force_bounds and solution.found:
        bounds = contact_force_bounds(problem, solution.torques, ranges=False, **limits, **rules)
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


def finding_columns(scene: Scene, findings: Sequence[Finding]) -> Row:
    """Return the column of the codes of serious findings, the gravest first; empty without any.

    Args:
        scene: The scene of the sample, whose findings from loading count, too.
        findings: See `state_findings`.
    """
    load_findings = (*scene.load_findings, *(() if scene.hand is None else scene.hand.findings))
    if not (load_findings or findings):
        return {}
    serious = [
        one for one in causes_first([*load_findings, *findings]) if one.severity is Severity.SERIOUS
    ]
    return {FINDINGS: "; ".join(dict.fromkeys(one.code for one in serious))} if serious else {}


class TorqueColumns(NamedTuple):
    """The columns of the torques of some joints.

    Attributes:
        largest: For each unit in use the column of the largest |torque|, and indices of its joints.
        each: Columns of the L joints.
    """

    largest: tuple[tuple[str, tuple[int, ...]], ...]
    each: tuple[str, ...]

    def values(self, margin: float, torques: Sequence[float]) -> Row:
        """Return the cells of a margin (N) and L torques (N m or N) by column."""
        row: Row = {name: max([abs(torques[k]) for k in own], default=0.0)
                    for name, own in self.largest}  # fmt: skip
        row["margin_N"] = margin
        row.update(zip(self.each, torques, strict=True))
        return row


@lru_cache(maxsize=64)
def torque_columns(names: tuple[str, ...], units: tuple[JointUnit, ...]) -> TorqueColumns:
    """Return the columns of joints with given names and units of torques."""
    present = [unit for unit in JointUnit if unit in units] or [JointUnit.TORQUE]
    largest = tuple([
        (LARGEST_TORQUE + _SUFFIXES[one], tuple([k for k, unit in enumerate(units) if unit is one]))
        for one in present
    ])  # fmt: skip
    each = [f"torque_{name}_{_SUFFIXES[unit]}" for name, unit in zip(names, units, strict=True)]
    return TorqueColumns(largest, tuple(each))


def robust_values(robust: RobustSolution) -> Row:
    """Return the cells of a robust solution, see `ROBUST_COLUMNS`."""
    row: Row = {
        "robust_status": robust.status.name.lower(),
        "robust_found": robust.found,
        "robust_coverage": robust.coverage.name.lower(),
    }
    if not robust.found:
        return row
    row["robust_margin_N"] = robust.margin
    if robust.samples is not None:
        row["robust_sampled_share"] = robust.samples.served / robust.samples.count
    units, largest = robust.members[0].problem.joint_units, robust.largest_commands
    columns = torque_columns(robust.joint_names, units)
    for name, joints in columns.largest:
        row[f"robust_{name}"] = float(largest[list(joints)].max(initial=0.0))
    return row
