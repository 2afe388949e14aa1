"""The samples of a block: those that follow each other with the same contacts, in one loop."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from graspless_pin.algorithms.carried import are_for
from graspless_pin.algorithms.loaded import LoadedOptima
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.errors import StudyError
from graspless_pin.findings import Finding
from graspless_pin.planning.warm_starts import WarmStarts
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray
from graspless_pin.problem.cones import CONE_MODELS
from graspless_pin.programs.objectives import Objective
from graspless_pin.scene.problem_data import (
    JointedContacts,
    jointed_contacts,
    loads_of,
    renewed_row,
)
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.state_findings import StateChecks, state_findings
from graspless_pin.solution import Status
from graspless_pin.studies.rows import Row, of_findings, torque_columns

_Loaded = tuple[int, Scene, tuple[Finding, ...], FloatArray]
"""Number, scene, findings and `Loads.row` of a sample."""


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


def stated_sample(
    scene: Scene, limits: Mapping[str, Any], checks: StateChecks, before: StatedSample | None
) -> StatedSample:
    """Return the problem of a sample.

    Args:
        scene: Its scene.
        limits: What ends its search, see `SolveOptions`.
        checks: Which findings are looked for.
        before: Another sample with these limits; what it has and this one shares is not made again.

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
    asked = scene.asked(**limits)
    kind = _Kind(state, rubbing, scene.cone, scene.cone_edges, *asked)
    return StatedSample(scene, kind, loads.row(), state_findings(scene, checks))


class SampleBlock:
    """Samples that begin with what was learned of those before them in their block.

    Whether a sample runs in a loop depends on those before it alone, and so does its row.
    """

    def __init__(
        self,
        alone: Callable[[int, Scene, tuple[Finding, ...], WarmStarts], Row],
        failed: Callable[[int, Exception], Row],
    ) -> None:
        """Begin with nothing learned.

        Args:
            alone: Returns the row of a sample that is solved by itself, whatever goes wrong.
            failed: Returns the row of a sample over which something was raised.
        """
        self._alone, self._failed = alone, failed
        self._starts = WarmStarts()
        self._kind: _Kind | None = None
        self._run: list[_Loaded] = []
        self._optima: dict[tuple[Any, ...], LoadedOptima] = {}

    def rows(self, number: int, stated: StatedSample) -> Iterator[Row]:
        """Take the next sample, and yield the rows that are ready then.

        Args:
            number: Its number.
            stated: What `stated_sample` returns of its scene.
        """
        (scene, kind, loads, found), last = stated, self._kind
        if kind is not last and (
            last is None or kind.state is not last.state or kind[1:] != last[1:]
        ):
            yield from self.rest()
        if are_for(CONE_MODELS[kind.cone], kind.objective, kind.options):
            self._kind = kind
            self._run.append((number, scene, found, loads))
        else:
            yield self._alone(number, scene, found, self._starts)

    def rest(self) -> Iterator[Row]:
        """Yield the rows of the samples that have none yet."""
        run, kind = self._run, self._kind
        if not run or kind is None:
            return
        self._run = []
        try:
            rows = [*self._looped(run, kind)]
        except StudyError:
            raise
        except Exception:  # which sample it was, each in a run of its own tells
            rows = []
            for one in run:
                try:
                    rows += self._looped([one], kind)
                except StudyError:
                    raise
                except Exception as error:
                    rows.append(self._failed(one[0], error))
        yield from rows

    def _looped(self, run: Sequence[_Loaded], kind: _Kind) -> Iterator[Row]:
        """Yield the rows of samples of one kind."""
        problem = run[0][1].problem()
        joints = kind.state.joints
        bodies = kind.options.rules, *kind.state.contacts.bodies
        optima, columns = self._optima_of(kind, problem), torque_columns(joints.names, joints.units)
        loads, count = np.array([row for *_, row in run]), len(run)
        figures, torques = np.empty((count, 6)), np.empty((count, problem.joint_count))
        begin = 0
        while begin < count:
            start = self._starts.best(bodies, problem, kind.objective)
            optima.learn(problem, start)
            end = optima.carry_on(problem, loads, begin, figures, torques)
            margins, found = figures[begin:end, 0].tolist(), torques[begin:end].tolist()
            of_run = zip(run[begin:end], margins, found, strict=True)
            for (number, scene, wrong, _), margin, each in of_run:
                yield {
                    "sample": number,
                    "status": Status.OPTIMAL.name.lower(),
                    "found": True,
                    **columns.values(margin, each),
                    "contacts": problem.contact_count,
                    "nodes": 1,
                    **of_findings(scene, wrong),
                }
            if end < count:
                yield self._alone(*run[end][:3], self._starts)
            begin = end + 1

    def _optima_of(self, kind: _Kind, problem: QuasistaticProblem) -> LoadedOptima:
        """Return what was learned in loops of these contacts, wherever they are."""
        shape = problem.is_sliding.tobytes(), problem.joint_count
        key = *kind[1:], kind.state.contacts.bodies, *shape
        if key not in self._optima:
            self._optima[key] = LoadedOptima(problem, kind.objective, kind.options)
        return self._optima[key]
