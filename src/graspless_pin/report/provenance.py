"""The provenance of a result: versions, hashes and the command that reproduces it."""

from __future__ import annotations

import hashlib
import platform
import shlex
from pathlib import Path
from typing import Any

import numpy as np

from graspless_pin.algorithms.options import name_and_figures
from graspless_pin.errors import SceneError
from graspless_pin.intake.files import FileKind, read_bytes
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.derived_inertias import INERTIAS
from graspless_pin.report.verify.fields import IN_MODE
from graspless_pin.solution import TorqueSolution
from graspless_pin.versions import versions

_ARRAYS = (
    "positions", "normals", "external_wrench", "jacobian", "friction", "tangents", "sliding",
    "lower_torque", "upper_torque", "max_normal_force", "gravity_torques", "wrench_matrix",
)  # fmt: skip
_SCENE = FileKind("scene", 4, SceneError)
_SAME_ENTRY = 1e-9
"""Absolute tolerance of equal array entries, beside the relative one of `np.allclose`."""


def file_sha256(path: Path) -> str | None:
    """Return the hash of a file's bytes; None if it cannot be read."""
    try:
        return hashlib.sha256(read_bytes(path, _SCENE)).hexdigest()
    except SceneError:
        return None


def problem_sha256(problem: QuasistaticProblem) -> str:
    """Return the hash of a problem's known arrays, as little-endian doubles, and of its cones."""
    digest = hashlib.sha256(_problem_signature(problem).encode())
    for name in (*_ARRAYS, *INERTIAS):
        if getattr(problem, name) is None:
            continue
        array = np.ascontiguousarray(getattr(problem, name), dtype="<f8")
        digest.update(f"{name}{array.shape}".encode())
        digest.update((array + 0.0).tobytes())  # -0 and 0 are the same problem
    return digest.hexdigest()


def provenance(problem: QuasistaticProblem, scene_file: Path | None) -> dict[str, Any]:
    """Return the provenance of a solution, for its document.

    Args:
        problem: The problem that was solved.
        scene_file: The scene file of the problem; None: it was made from arrays or in Python.

    Returns:
        ``scene_file`` as it was given and ``scene_sha256`` (None without a file),
        ``problem_sha256`` and ``versions``, Python's among them.
    """
    return {
        "scene_file": None if scene_file is None else str(scene_file),
        "scene_sha256": None if scene_file is None else file_sha256(scene_file),
        "problem_sha256": problem_sha256(problem),
        "versions": {"python": platform.python_version(), **versions()},
    }


def _problem_signature(problem: QuasistaticProblem) -> str:
    """Return the signature of the cones, with the units of stated passive coordinates."""
    units = () if problem.wrench_matrix is None else problem.passive_units
    return problem.cone_model.signature(problem.cone_edges) + " ".join(units)


def same_problem(first: QuasistaticProblem, second: QuasistaticProblem) -> bool:
    """Return whether two problems agree up to rounding and inertias that only one of them has."""
    if (
        _problem_signature(first) != _problem_signature(second)
        or first.joint_names != second.joint_names
    ):
        return False
    pairs = [(getattr(first, name), getattr(second, name)) for name in (*_ARRAYS, *INERTIAS)]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    return all(a.shape == b.shape and np.allclose(a, b, atol=_SAME_ENTRY) for a, b in known)


def solve_command(solution: TorqueSolution, scene_file: Path) -> str | None:
    """Return the command line that solves a scene file again; None: no command does.

    All else is stated in the scene file. No command takes a given mode, or an objective without a
    name.
    """
    name, figures = name_and_figures(solution.objective) or (solution.algorithm, {})
    if solution.status.name.lower() in IN_MODE or name is None:
        return None
    words = ["graspless-pin", "solve", str(scene_file), "--algorithm", str(name)]
    if solution.algorithm is None:
        for key, value in figures.items():
            if isinstance(value, int | float | str):
                words += [f"--{key.replace('_', '-')}", str(value)]
    elif solution.algorithm == "torque":
        words += ["--margin", f"{solution.required_margin!r}"]
        if solution.found:
            words += ["--scale", "limits" if solution.objective.by_limits else "absolute"]
    if solution.algorithm is not None and solution.objective.regularization:
        words += ["--regularization", f"{solution.objective.regularization!r}"]
    for option, value in solution.rules.options().items():
        words += [f"--{option.replace('_', '-')}", str(value)]
    return shlex.join(words)
