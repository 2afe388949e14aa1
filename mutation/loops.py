"""Mistakes in the compiled loops, made by hand: ``python -m mutation.loops``.

Each is compiled in a copy of the project and tried with the tests that hold the loops against the
numpy beside their callers, and against the general search for contacts.
"""

from __future__ import annotations

import argparse
import os
import queue
import subprocess
import sys
import sysconfig
import tempfile
import time
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import NamedTuple

import numpy as np

from mutation.children import copy_of

ROOT = Path(__file__).parents[1]
LOOPS = Path("src", "graspless_pin", "compiled")
OF_CONTACTS = (
    "tests/compiled",
    "tests/geometry/test_body_pairs.py",
    "tests/planning/test_many_states.py",
)
OF_OPTIMA = (
    "tests/compiled",
    "tests/core/test_loaded_optima.py",
    "tests/holding/test_outcome_bounds.py",
    "tests/planning/test_attached.py",
    "tests/planning/test_batch_optimum.py",
    "tests/planning/test_many_states.py",
    "tests/planning/test_path.py",
)
_SUFFIX = str(sysconfig.get_config_var("EXT_SUFFIX"))
# As hatch_build.py does, but for the optimisation, which only costs time here.
_FLAGS = ("-shared", "-fPIC", "-O1", "-ffp-contract=off", "-w")
_SECONDS = 300.0


class Mistake(NamedTuple):
    """A text that stands once in a file of loops, or of Python that calls them; what replaces it.

    Attributes:
        loops: The file of loops without its suffix, or the path of the Python from there.
        text: What stands there.
        wrong: What takes its place.
    """

    loops: str
    text: str
    wrong: str

    def __str__(self) -> str:
        """Return it as a line."""
        return f"{self.file}: {self.text!r} -> {self.wrong!r}"

    @property
    def file(self) -> str:
        """The path of the file from the folder of the loops on."""
        return self.loops if self.loops.endswith(".py") else f"{self.loops}.pxi"

    @property
    def tests(self) -> tuple[str, ...]:
        """The tests that it is tried with."""
        return OF_CONTACTS if self.loops in (SEARCH, PAIRS) else OF_OPTIMA

    def source(self, folder: Path) -> str:
        """Return the file with the mistake in it.

        Raises:
            ValueError: If the text does not stand there once.
        """
        right = (folder / self.file).read_text(encoding="utf-8")
        if right.count(self.text) != 1:
            raise ValueError(f"{self}: the text stands there {right.count(self.text)} times")
        return right.replace(self.text, self.wrong)


FRAMES, MOTIONS, SHARED = "contact_frames", "virtual_motions", "shared"
SEARCH, PAIRS, CHAINS, STATES = "contact_search", "body_pairs", "kinematic_chains", "hand_states"
ASSEMBLY, STARTS, WARM = "paper_programs", "optimum_starts", "warm_optima"
COLD, LOADED, CALLER = "cold_optima", "loaded_states", "../algorithms/batch_optimum.py"
PROGRAMS = "../algorithms/batch_programs.py"
CARRIED, MODES = "../planning/attached_states.py", "mode_programs"
SIMPLEX, TABLES, OUTCOMES = "dense_simplex", "simplex_dictionary", "outcome_search"
MISTAKES = tuple(
    Mistake(*one)
    for one in (
        (FRAMES, "axes[6 + i] = t[6 * contact + 2 * i + 1]",
         "axes[6 + i] = t[6 * contact + 2 * i]"),
        (FRAMES, "share = mu[contact] / speed", "share = mu[contact]"),
        (MOTIONS, "(size[k] if k < 6 else -size[k])", "size[k]"),
        (MOTIONS, "motion[j] -= a[i] * normal[n * i + j]",
         "motion[j] += a[i] * normal[n * i + j]"),
        (MOTIONS, "slowest > 0.0 and slowest * slowest", "slowest * slowest"),
        (MOTIONS, "touching(N, G, s, n, H + n * i, small)", "pass"),
        (FRAMES, "along / sqrt(1.0 + slope[contact] ** 2)", "along"),
        (FRAMES, "arm[1] = f[4] - (center[2] * f[0] - center[0] * f[2])", "arm[1] = f[4]"),
        (FRAMES, "max(lever[k], least_lever * longest)", "lever[k]"),
        (PAIRS, "return min(_reach_along(sets, k, local), sets.reaches[k]) - height > depth",
         "return -height > depth"),
        (PAIRS, "if sets.kinds[k] == REVOLVED:", "if False:"),
        (PAIRS, "* half[0] + sizes[2] * half[2]", "* half[0]"),
        (PAIRS, "dot(offset, offset) >= reach * reach", "True"),
        (PAIRS, "_from_box_by(others.reaches[k] -", "_from_box_by(0.5 * others.reaches[k] -"),
        (PAIRS, "reach = half[i] + _reach_along(others, k, S + 3 * i)", "reach = half[i]"),
        (PAIRS, "return total > 0.0 and (", "return ("),
        (PAIRS, "if -gap <= depth * sqrt(sine):", "if -gap <= depth:"),
        (PAIRS, "_reach_along(ones, p, sizes) + _reach_along(others, k, other_sizes)",
         "_reach_along(ones, p, sizes)"),
        (STATES, "-(self.tolerance + _ON_FACE)", "-0.5 * self.tolerance"),
        (SEARCH, "if face[0] == NULL or over > height[0]:", "if face[0] == NULL:"),
        (SEARCH, "if dot(one, foot) - one[3] > _ON_FACE:", "if dot(one, foot) - one[3] > 1.0:"),
        (SEARCH, "if gap[0] < -max_penetration or not on_face:", "if not on_face:"),
        (OUTCOMES, "slack += wrong * fmax(slips[k], self.tolerance)",
         "slack += wrong * self.tolerance"),
        (OUTCOMES, "fmax(-nu, 0.0) * fmax(parts[k], self.tolerance)",
         "fmax(-nu, 0.0) * self.tolerance"),
        (OUTCOMES, "slack += fmax(-nu, 0.0) * fmax(parts[k], self.tolerance)", "pass"),
        (OUTCOMES, "for k in range(known - 1, -1, -1):", "for k in range(known - 1, 0, -1):"),
        (OUTCOMES, "rise += gain * self.own_spread[k]", "pass"),
        (OUTCOMES, "share = fmin(1.0, size * first / fmax(side, tiny))", "share = 1.0"),
        (SIMPLEX, "target = self.lower[v] if sign > 0.0 else self.upper[v]",
         "target = self.lower[v]"),
        (SIMPLEX, "step = self.upper[v] - self.lower[v]", "step = INFINITY"),
        (TABLES, "self._move(self.m - 1 - (i - first), k)", "self._move(self.m - 1, k)"),
        (SIMPLEX, "marginals[i] = 0.0 if k >= 0 else self.slopes[-1 - k]",
         "marginals[i] = 0.0 if k >= 0 else self.tilted[-1 - k]"),
        (TABLES, "out[-1 - at] += row[s]", "out[-1 - at] = row[s]"),
        (ASSEMBLY, "out[3 + k] /= self.length", "pass"),
        (ASSEMBLY, "if top else self.lower[j]) - self.gravity[j]",
         "if top else self.lower[j]) + self.gravity[j]"),
        (ASSEMBLY, "0.5 * least / self.force", "least / self.force"),
        (ASSEMBLY, "self.bounds[c] = margin", "self.bounds[c] = 0.0"),
        (ASSEMBLY, "self.torque_reach[k] += fabs(out[6 + k]) * self.box[n + 1 + c]",
         "self.torque_reach[k] += out[6 + k] * self.box[n + 1 + c]"),
        (CHAINS, "moment[4 * self.parents[j] + i] += moment[4 * j + i]", "pass"),
        (STATES, "self.lower[j] <= position[j]", "position[j]"),
        (STATES, "or self.times[links.bodies[k]] != 1", ""),
        (CHAINS, "step[1] -= s * axis[5]", "step[1] += s * axis[5]"),
        (WARM, "starts.insert(0, starts.pop(place))", "pass"),
        (WARM, "self.close and self.value <= self.cutoff", "self.close"),
        (WARM, "self.point[c] * sliding_sign", "-self.point[c] * sliding_sign"),
        (ASSEMBLY, "residual = max(residual, at if i >= 6 else fabs(at))",
         "residual = max(residual, at)"),
        (ASSEMBLY, "v[6 + self.peak_joint[i] % L] += self.peak_share[i] * weights[6 + i]", "pass"),
        (ASSEMBLY, "share, last = self.peak_share[i - 6], -self.peak_level[i - 6]",
         "share = self.peak_share[i - 6]"),
        (WARM, "self.bound * figures[5], (self", "self.bound * self.unit, (self"),
        (CHAINS, "+ J[4 * n + j] * (x[2] * g[0] - x[0] * g[2])",
         "+ J[4 * n + j] * (x[2] * g[0] + x[0] * g[2])"),
        (COLD, "-1.0 if self.point[c] > 0.0 else 1.0",
         "1.0 if self.point[c] > 0.0 else -1.0"),
        (COLD, "share = -_TO_BOUNDARY * values[k] / steps[k]", "pass"),
        (COLD, "self.dual_residual[n1 - 1] = self.cost()", "self.dual_residual[n1 - 1] = -1.0"),
        (ASSEMBLY, "weight * programs.row_value[e] * programs.row_value[f]",
         "weight * (programs.row_value[e] * programs.row_value[f] if e == f else 0.0)"),
        (LOADED, "if axis else -slope", "if axis else slope"),
        (LOADED, "friction[i] * cos(M_PI / self.edge_count)", "friction[i]"),
        (LOADED, "row + M, row + M + 6, row + M + 6 + L", "row + M, row + M + 6, row + M + 6"),
        (STARTS, "(i < first_fixed or first_torque <= i < count) != changes",
         "(i < first_fixed) != changes"),
        (STARTS, "self.upper[q] = flags_of(top)[k]", "self.upper[q] = True"),
        (STARTS, "if not 0 <= self.contacts[k] < M:", "if False:"),
        (CALLER, "objective.sign * unit", "unit"),
        (PROGRAMS, "or objective.regularization > 0.0", ""),
        (PROGRAMS, "or options.rules.by_direction", ""),
        (CALLER, "start.structure.has_rows_of(structure)", "start.structure is not structure"),
        (CALLER, "[*own, *self._pool]", "[*self._pool]"),
        (CHAINS, "column[5 * n + j] * p[0] - column[3 * n + j] * p[2]",
         "column[5 * n + j] * p[0] + column[3 * n + j] * p[2]"),
        (FRAMES, "t[i] = a[i] - along * n[i]", "t[i] = a[i]"),
        (SHARED, "C[4 * i + 3] += A[4 * i + 3]", "pass"),
        (CARRIED, "2, 3) @ R\n", "2, 3) @ np.swapaxes(R, -1, -2)\n"),
        (CARRIED, "torques - self.hand.tree.moves", "torques + self.hand.tree.moves"),
        (MODES, "self.bounds[c] = 0.0 if sign <= 0.0 else -INFINITY",
         "self.bounds[c] = -INFINITY"),
        (MODES, "lowest = min(lowest, self.bound)", "lowest = self.bound"),
        (SHARED, "other[j] = (other[j] - inner(other, row, j)) / row[j]",
         "other[j] = other[j] / row[j]"),
    )
)  # fmt: skip
"""Each is a mistake that a person could make; what a test does not notice is told."""


def compiled(copy: Path) -> None:
    """Compile the loops of a copy in place.

    Raises:
        subprocess.CalledProcessError: If it does not compile.
    """
    source, code = copy / LOOPS / "core.pyx", copy / "core.c"
    command = [sys.executable, "-m", "cython", "-3", str(source), "-o", str(code)]
    _run([*command, "-I", str(copy / "src")], copy)
    places = (sysconfig.get_path("include"), np.get_include())
    numpy = "-DNPY_NO_DEPRECATED_API=NPY_2_0_API_VERSION"
    library = copy / LOOPS / f"core{_SUFFIX}"
    library.unlink(missing_ok=True)
    _run(["cc", *_FLAGS, numpy, *(f"-I{one}" for one in places), str(code), "-o", str(library)],
         copy)  # fmt: skip


def noticed(copy: Path, tests: tuple[str, ...]) -> str:
    """Return the test of a copy that fails, "time" if they take too long, empty if none does."""
    command = [sys.executable, "-m", "pytest", "-q", "-x", "--tb=no", "-p", "no:cacheprovider"]
    environment = {**os.environ, "PYTHONPATH": str(copy / "src"), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        ended = subprocess.run(  # noqa: S603 - our own interpreter
            [*command, *tests], cwd=copy, env=environment, capture_output=True, text=True,
            timeout=_SECONDS, check=False,
        )  # fmt: skip
    except subprocess.TimeoutExpired:
        return "time"
    if ended.returncode == 0:
        return ""
    failed = [line for line in ended.stdout.splitlines() if line.startswith(("FAILED", "ERROR"))]
    return failed[0].split(" - ")[0] if failed else f"exit code {ended.returncode}"


def _run(command: list[str], folder: Path) -> None:
    subprocess.run(command, cwd=folder, check=True, capture_output=True)  # noqa: S603 - our own


def main() -> int:
    """Print a line for each mistake and the score; return 1 if one was not noticed."""
    parser = argparse.ArgumentParser(prog="python -m mutation.loops", description=__doc__)
    parser.add_argument("--jobs", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--only", default="", help="text that the mistakes have in their line")
    given = parser.parse_args()
    os.environ.update(OMP_NUM_THREADS="1", OPENBLAS_NUM_THREADS="1", CI="true")
    start = time.monotonic()
    mistakes = [one for one in MISTAKES if any(text in str(one) for text in given.only.split(","))]
    copies: queue.SimpleQueue[Path] = queue.SimpleQueue()
    with tempfile.TemporaryDirectory(prefix="loops-") as folder:
        for number in range(given.jobs):
            copies.put(copy_of(ROOT, Path(folder, str(number)), loops=True))

        def attempt(mistake: Mistake) -> str:
            copy = copies.get()
            source = copy / LOOPS / mistake.file
            right, library = source.read_text(encoding="utf-8"), copy / LOOPS / f"core{_SUFFIX}"
            kept = None if source.suffix == ".py" else library.read_bytes()
            try:
                source.write_text(mistake.source(copy / LOOPS), encoding="utf-8")
                if kept is not None:
                    compiled(copy)
                by = noticed(copy, mistake.tests)
            finally:
                source.write_text(right, encoding="utf-8")
                if kept is not None:
                    library.unlink(missing_ok=True)
                    library.write_bytes(kept)
                copies.put(copy)
            print(
                f"{time.monotonic() - start:6.0f} s {by or 'SURVIVED':70.70} {mistake}", flush=True
            )
            return by

        first = copies.get()
        if by := noticed(first, (*OF_CONTACTS, *OF_OPTIMA)):
            print(f"without any mistake: {by}")
            return 1
        copies.put(first)
        with ThreadPoolExecutor(given.jobs) as pool:
            found = list(pool.map(attempt, mistakes))
    left = found.count("")
    print(f"{len(found) - left} of {len(found)} mistakes in the loops were noticed")
    return 1 if left else 0


if __name__ == "__main__":
    sys.exit(main())
