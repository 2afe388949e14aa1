"""Many states at once: in this process or in several, with the same answers in any order."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from itertools import chain, repeat
from time import thread_time
from typing import Any, NamedTuple
from uuid import uuid4

import numpy as np
from numpy.typing import NDArray

from graspless_pin.caching import Derived
from graspless_pin.child_process import kept_processes, usable_cores
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.poses import RIGIDITY_TOLERANCE, as_pose
from graspless_pin.planning.state_solver import StateSolver
from graspless_pin.problem.checks import FloatArray, all_within, finite_array, whole_number
from graspless_pin.scene.motion_and_contacts import Motion

Progress = Callable[[int, int], object]
"""Called with the number of states that are done, and with that of all."""
Arrays = tuple[NDArray[Any], ...]
"""Arrays with an entry for each of some states."""

_CHUNK = 1000
"""States that are computed in one go: tens of milliseconds, long beside the way to a process."""
_FIRST = 100, 400
"""States that are computed here before processes are asked for: the first ones learn, too."""
_WORTH_A_PROCESS = 2.0
"""Processor time (s) of work for which a process is used: it takes a second of it to start."""
_MOST_SOLVERS = 4
_BLOCK = 4096
_DIMENSIONS = {"q": 2, "T_world_object": 3, "twist": 2}
"""Of what has an entry for each state."""


class StateArrays(NamedTuple):
    """Some states.

    Attributes:
        total: K.
        each: What differs from state to state, by the arguments of `Evaluator.evaluate`: (K, a),
            (K, 4, 4) or (K, 6).
        common: What all of them share, likewise.
    """

    total: int
    each: Mapping[str, FloatArray]
    common: Mapping[str, Any]

    @property
    def configurations(self) -> FloatArray | None:
        """(K, a), if nothing else is given."""
        others = [*self.each, *(name for name, value in self.common.items() if value is not None)]
        return self.each["q"] if others == ["q"] else None

    def part(self, numbers: slice) -> StateArrays:
        """Return a part of the states."""
        each = {name: values[numbers] for name, values in self.each.items()}
        return StateArrays(len(range(self.total)[numbers]), each, self.common)

    def one(self, number: int) -> tuple[Any, Any, Any]:
        """Return the arguments of `Evaluator.evaluate` for one of the states."""
        q, T, twist = (
            self.each[name][number] if name in self.each else self.common[name]
            for name in _DIMENSIONS
        )
        return q, T, twist


def checked_states(joint_count: int, q: Any, T_world_object: Any, twist: Any) -> StateArrays:
    """Return states as they are given to `Evaluator.evaluate_many`.

    Args:
        joint_count: a.
        q: See there.
        T_world_object: See there.
        twist: See there.

    Raises:
        ArgumentError: If nothing has an entry for each state, or not as many as another; if a shape
            is wrong, a number not finite or a pose not rigid.
    """
    given = {"q": q, "T_world_object": T_world_object, "twist": twist}
    shapes = {"q": (joint_count,), "T_world_object": (4, 4), "twist": (6,)}
    each: dict[str, FloatArray] = {}
    common: dict[str, Any] = {}
    for name, value in given.items():
        if isinstance(value, Motion | Mapping) or np.ndim(value) < _DIMENSIONS[name]:
            common[name] = value
        else:
            each[name] = _numbers(name, value, (None, *shapes[name]))
    if not each:
        raise ArgumentError(
            "q", f"give q (K, {joint_count}), T_world_object (K, 4, 4) or twist (K, 6) for K states"
        )
    first, count = next((name, len(values)) for name, values in each.items())
    for name, values in each.items():
        if len(values) != count:
            raise ArgumentError(
                name, f"has {len(values)} states and {first} has {count}; give as many of each"
            )
    _check_rigid(each.get("T_world_object", np.empty((0, 4, 4))))
    return StateArrays(count, each, common)


def _numbers(name: str, value: Any, shape: tuple[int | None, ...]) -> FloatArray:
    """Return finite numbers of a shape, without a copy where they are an array of them."""
    if (
        isinstance(value, np.ndarray)
        and value.dtype == np.float64
        and value.shape[1:] == shape[1:]
        and value.flags.c_contiguous
        and all_within((value,))
    ):
        return value
    return finite_array(name, value, shape)


def _check_rigid(poses: FloatArray) -> None:
    for start in range(0, len(poses), _BLOCK):
        block = poses[start : start + _BLOCK]
        R = block[:, :3, :3]
        off = np.abs(R.transpose(0, 2, 1) @ R - np.eye(3)).max(axis=(1, 2))
        doubtful = (off > 0.5 * RIGIDITY_TOLERANCE) | (np.linalg.det(R) < 0.0)
        doubtful |= (block[:, 3] != [0.0, 0.0, 0.0, 1.0]).any(axis=1)
        for k in np.flatnonzero(doubtful).tolist():
            as_pose(f"T_world_object[{start + k}]", block[k])


def gathered(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    workers: int | None,
    progress: Progress | None,
) -> Arrays:
    """Return what is found of states, whichever process finds it.

    Args:
        compute: Finds it for some of them.
        solver: Solves them.
        states: K states.
        workers: Processes; 1: this one; None: as many as there are cores, as far as the processor
            time of the states done by then tells that each saves more than its start takes.
        progress: Is told how far it is; None: nobody is.

    Raises:
        ArgumentError: If ``workers`` is not a whole number from 1 on.
        CrashError: If a process dies.
    """
    if workers is not None:
        workers = whole_number("workers", workers, 1)
    whole: Arrays = ()
    for chunk, found in _found(compute, solver, states, workers):
        if not whole:
            whole = tuple([np.empty((states.total, *a.shape[1:]), a.dtype) for a in found])
        for array, part in zip(whole, found, strict=True):
            array[chunk] = part
        if progress is not None:
            progress(min(chunk.stop, states.total), states.total)
    return whole


def _found(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    workers: int | None,
) -> Iterator[tuple[slice, Arrays]]:
    """Yield chunks and what is found of them, in order."""
    done = 0
    if workers is None or workers == 1:
        for size in chain(_FIRST if workers is None else (), repeat(_CHUNK)):
            chunk, begin = slice(done, min(done + size, states.total)), thread_time()
            found = compute(solver, states.part(chunk))
            pace = (thread_time() - begin) / size
            yield chunk, found
            learned, done = done > 0, chunk.stop
            left = states.total - done
            if not left:
                return
            worth = int(min(usable_cores(), left * pace / _WORTH_A_PROCESS))
            if workers is None and learned and worth > 1:
                workers = worth
                break
    yield from _found_by_processes(compute, solver, states, done, workers or 1)


def _found_by_processes(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    solver: StateSolver,
    states: StateArrays,
    begin: int,
    workers: int,
) -> Iterator[tuple[slice, Arrays]]:
    """Yield chunks from a state on and what processes find of them, in order."""
    size = min(_CHUNK, max(1, -(-(states.total - begin) // (4 * workers))))
    ends = [*range(begin, states.total, size), states.total]
    chunks = [slice(*ends[k : k + 2]) for k in range(len(ends) - 1)] or [slice(0, 0)]
    processes, token = kept_processes(), _TOKENS.of(solver)

    def found(chunk: slice) -> Arrays:
        child = processes.taken(_found_there)
        part = states.part(chunk)
        try:
            there = child.call(_found_there, compute, token, None, part)
            if there is None:
                there = child.call(_found_there, compute, token, solver, part)
            return there
        finally:
            processes.give_back(child)

    with ThreadPoolExecutor(workers, thread_name_prefix="graspless-states") as threads:
        try:
            yield from zip(chunks, threads.map(found, chunks), strict=True)
        finally:
            threads.shutdown(wait=True, cancel_futures=True)


_TOKENS: Derived[StateSolver, str] = Derived(lambda _: uuid4().hex, most=math.inf)
"""What tells a solver from all others, in any process."""
_SOLVERS: dict[str, StateSolver] = {}
"""Those that this process was sent, by token: what they have learned serves the next chunk."""


def _found_there(
    compute: Callable[[StateSolver, StateArrays], Arrays],
    token: str,
    solver: StateSolver | None,
    states: StateArrays,
) -> Arrays | None:
    """Return what is found of states in another process; None: the solver is not there yet."""
    if solver is not None:
        if len(_SOLVERS) >= _MOST_SOLVERS:
            del _SOLVERS[next(iter(_SOLVERS))]
        _SOLVERS[token] = solver
    known = _SOLVERS.get(token)
    return None if known is None else compute(known, states)
