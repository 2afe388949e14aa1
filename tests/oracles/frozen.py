"""Hold the answers of this version against those of an older one: ``make frozen BASE=COMMIT``.

Each version answers the same seeded problems and examples in a process of its own, through the
public names alone. Values and bounds have to agree to 1e-7, decided verdicts and infeasible
answers stay as they are; an answer that the older version leaves undecided may be decided, and a
scene that it refuses be read. Force ranges and verdicts are those of the older version's torques,
since optima need not be unique, and of ranges the ends count that both versions have proven. What
commands print is listed where it differs, for somebody to read.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import tempfile
from collections import Counter
from collections.abc import Callable, Iterator, Mapping
from functools import partial
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np
from benchmarks.against import ONE_THREAD, ROOT, checked_commit, installed, run
from tests.core.random_scenes import general_scene, infeasible_scene, slope_scene

SAME = 1e-7
"""Relative, of the larger of two values, or of 1 N or 1 N m."""
COUNT = 3000
NODES = 1000
"""Of a search: some over directions take a quarter of an hour."""
RULES = tuple(product(("strict", "exact", "nonzero"), ("exempt", "constrained")))
REFUSED = 2
"""Exit code of a scene that cannot be read."""
OPEN = {"undecided", "limit_reached", "unverified", "unbounded", None}

Answer = dict[str, Any]


def problems(count: int) -> Iterator[tuple[str, Callable[[], Any]]]:
    """Yield a name and a maker for each seeded problem; every fifth has round cones."""
    families = {
        "general": general_scene,
        "weak fingers": partial(general_scene, joints=(1, 2)),
        "slope": slope_scene,
        "infeasible": infeasible_scene,
    }
    for seed in range(count):
        family = tuple(families)[seed % 4]
        contacts = 3 + (seed // 4) % (22 if seed % 10 == 0 else 6)
        yield f"{family} {seed}, {contacts} contacts", partial(families[family], seed, contacts)


def answers(count: int, older: Mapping[str, Answer]) -> Iterator[tuple[str, Answer]]:
    """Yield the answers of the version that is imported, a name each.

    Args:
        count: How many seeded problems there are.
        older: The answers whose torques are asked about; of those that it lacks, one's own.
    """
    for seed, (name, make) in enumerate(problems(count)):
        problem = make()
        if seed % 5 == 4:
            problem = problem.with_changes(cone="round")
        sign, sliding = RULES[(seed // 4) % len(RULES)]
        if seed % 15 == 7 and problem.contact_count <= 6:
            sign = "direction"
        rules = {"sign_rule": sign, "sliding_rule": sliding, "node_limit": NODES}
        yield from of_problem(name, problem, seed, rules, older)
    for scene in sorted((ROOT / "examples").rglob("*.yaml")):
        if "studies" not in scene.parts:
            yield from of_scene(scene)


def of_problem(
    name: str, problem: Any, seed: int, rules: Mapping[str, Any], older: Mapping[str, Answer]
) -> Iterator[tuple[str, Answer]]:
    """Yield both optima of a problem, and ranges and a verdict for some."""
    from graspless_pin import contact_force_bounds, maximize_margin, minimize_torque, stability

    best = maximize_margin(problem, **rules)
    yield f"{name}: margin", optimum(best, "margin")
    least = minimize_torque(problem, margin=0.1, **rules)
    yield f"{name}: torque", optimum(least, "torque")
    if not best.found or rules["sign_rule"] == "direction" or problem.contact_count > 8:
        return
    torques = older.get(f"{name}: margin", {}).get("torques", best.torques)
    if seed % 6 == 0:
        few: dict[str, Any] = {**rules, "node_limit": 200}
        ranges = contact_force_bounds(problem, torques, **few)
        known = [ranges.status.name == "OPTIMAL", *2 * ranges.proven.ravel().tolist()]
        values = [ranges.smallest_margin, *ranges.lower.ravel(), *ranges.upper.ravel()]
        ends = zip(values, known, strict=True)
        worst, *told = [number(one) if proven else None for one, proven in ends]
        # Versions find it among other forces, which balance to a share of the load.
        of_load = SAME * max(1.0, problem.scales.force)
        yield f"{name}: margin at worst", {"values": [worst], "loose": of_load}
        yield f"{name}: force ranges", {"values": told}
    if seed % 6 == 2 and not problem.is_sliding.any():
        moving = problem.with_changes(
            object_inertia=np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]),
            joint_inertia=1e-3 * np.eye(problem.joint_count),
        )
        verdict = stability(moving, torques)
        yield f"{name}: verdict", {"status": verdict.status.name.lower()}


def optimum(solution: Any, algorithm: str) -> Answer:
    """Return what is promised of an optimum: how the search ended, the value and its bound."""
    answer: Answer = {"status": solution.status.name.lower()}
    if solution.found:
        value = solution.margin if algorithm == "margin" else solution.max_torque
        answer["values"] = [number(value), number(solution.certificate.bound)]
        answer["loose"] = number(solution.certificate.gap)
        answer["torques"] = solution.torques.tolist()
    return answer


def of_scene(path: Path) -> Iterator[tuple[str, Answer]]:
    """Yield what the command line prints of a scene, without verdicts and with them."""
    for algorithm in ("margin", "torque"):
        command = ["solve", str(path.relative_to(ROOT)), "--algorithm", algorithm]
        command += ["--margin", "0.1"] if algorithm == "torque" else []
        printed = subprocess.run(  # noqa: S603 - our own interpreter
            [sys.executable, "-c", "from graspless_pin.cli import main; main()", *command],
            cwd=ROOT, capture_output=True, text=True, check=False,
        )  # fmt: skip
        yield (
            " ".join(command),
            {"exit": printed.returncode, "text": printed.stdout + printed.stderr},
        )


def number(value: float) -> float | str:
    """Return a float that JSON can hold."""
    return float(value) if np.isfinite(value) else str(float(value))


def differences(new: Mapping[str, Answer], base: Mapping[str, Answer]) -> Iterator[tuple[str, str]]:
    """Yield what kind of difference there is, and where and how."""
    for name in sorted(new.keys() | base.keys()):
        if name not in new or name not in base:
            yield "lost" if name in base else "added", name
            continue
        here, there = new[name], base[name]
        one, other = here.get("status"), there.get("status")
        if one != other:
            kind = "decided" if other in OPEN else "status"
            yield kind, f"{name}: {other} became {one}"
            continue
        if here.get("exit") != there.get("exit"):
            kind = "read" if there.get("exit") == REFUSED else "exit code"
            yield kind, f"{name}: {there['exit']} became {here['exit']}"
        if here.get("text") != there.get("text"):
            yield "text", name
        allowed = max(SAME, *(float(each.get("loose", 0.0)) for each in (here, there)))
        pairs = zip(here.get("values", ()), there.get("values", ()), strict=True)
        for place, (mine, theirs) in enumerate(pairs):
            if None not in (mine, theirs) and not near(float(mine), float(theirs), allowed):
                yield "value", f"{name}, value {place}: {theirs} became {mine}"


def near(one: float, other: float, allowed: float) -> bool:
    """Whether two values agree; infinite ones if they are the same."""
    if not (np.isfinite(one) and np.isfinite(other)):
        return one == other or (np.isnan(one) and np.isnan(other))
    return abs(one - other) <= allowed * max(1.0, abs(one), abs(other))


def written(python: Path, count: int, folder: Path, *names: str) -> dict[str, Answer]:
    """Return the answers of the version that a Python imports; the second name is the older's."""
    file, *older = [folder / f"{name}.json" for name in names]
    words = [python, "-m", "tests.oracles.frozen", "--write", file, "--count", str(count)]
    run([*words, *(["--older", *older] if older else [])], ROOT, **ONE_THREAD)
    return json.loads(file.read_text(encoding="utf-8"))


def main() -> int:
    """Compare two versions, or write the answers of this one; 1 where they differ but in text."""
    parser = argparse.ArgumentParser(prog="python -m tests.oracles.frozen", description=__doc__)
    parser.add_argument("base", metavar="COMMIT", nargs="?", help="the version to compare with")
    parser.add_argument("--count", type=int, default=COUNT, help="of seeded problems")
    parser.add_argument("--write", type=Path, help="write the answers of this version, no more")
    parser.add_argument("--older", type=Path, help="whose torques to ask about, with --write")
    given = parser.parse_args()
    if given.write is not None:
        older = {} if given.older is None else json.loads(given.older.read_text(encoding="utf-8"))
        found = dict(answers(given.count, older))
        given.write.write_text(json.dumps(found, indent=0), encoding="utf-8")
        return 0
    if given.base is None:
        parser.error("name the version to compare with, or --write FILE")
    commit = checked_commit(parser, given.base)
    with tempfile.TemporaryDirectory(prefix="frozen-") as place:
        folder = Path(place)
        base = written(installed(commit, folder), given.count, folder, "base")
        new = written(Path(sys.executable), given.count, folder, "new", "base")
    kinds: Counter[str] = Counter()
    for kind, said in differences(new, base):
        kinds[kind] += 1
        print(f"{kind}: {said}")
    print(
        f"{len(new)} answers; " + (", ".join(f"{n} {k}" for k, n in kinds.items()) or "all agree")
    )
    return int(any(kinds[kind] for kind in ("lost", "status", "exit code", "value")))


if __name__ == "__main__":
    sys.exit(main())
