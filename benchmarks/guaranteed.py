"""Guaranteed torques in seeded slots, beside MuJoCo's word: ``python -m benchmarks.guaranteed``."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor
from itertools import count, islice

from tabulate import tabulate
from tests.simulation.holding_scenes import holding_scenes

from graspless_pin import Scene, Stability, stability
from graspless_pin.simulation import simulate

SLOTS = 20


def weak_slots() -> Iterator[tuple[int, Scene]]:
    """Yield the slots of which Algorithm 1's torques are weak, with their numbers."""
    for number, scene in zip(count(), holding_scenes("slot", 10**6), strict=False):
        verdict = stability(scene.problem(), scene.solve("margin").torques)
        if verdict.status is Stability.WEAK:
            yield number, scene


def row(slot: tuple[int, Scene]) -> list[object]:
    """Ask for guaranteed torques in one slot and simulate them."""
    number, scene = slot
    found = scene.solve("margin", stability="strong")
    problem, guarantee = found.problem, found.guarantee
    if guarantee is None or guarantee.verdict is None:
        raise RuntimeError(f"slot {number}: not even a best case ({found.status.message})")
    known = [number, problem.contact_count, problem.joint_count, f"{guarantee.best_case:.2f}"]
    if not found.found:
        proven = "proven" if found.status.name == "INFEASIBLE_STRONG" else "not proven"
        return [*known, f"none, {proven}", guarantee.tried, "", ""]
    runs = ", ".join(run.outcome for run in simulate(scene, found.torques).runs)
    margin, programs = f"{found.margin:.2f}", guarantee.verdict.programs
    return [*known, margin, guarantee.tried, programs, runs]


def guaranteed(slots: int = SLOTS, jobs: int = 2) -> str:
    """A row for each slot, and how many have guaranteed torques."""
    with ProcessPoolExecutor(jobs) as pool:
        rows = list(pool.map(row, islice(weak_slots(), slots)))
    headers = [
        "slot", "contacts", "joints", "best case [N]", "guaranteed [N]", "tried", "LPs of the last",
        "stiff, soft",
    ]  # fmt: skip
    found = [one for one in rows if one[-1]]
    held = sum(str(one[-1]).startswith("held") for one in found)
    said = f"{len(found)} of {len(rows)} have guaranteed torques; {held} hold with stiff bodies."
    return f"{tabulate(rows, headers, tablefmt='github', disable_numparse=True)}\n\n{said}"


def main() -> None:
    parser = argparse.ArgumentParser(prog="python -m benchmarks.guaranteed", description=__doc__)
    parser.add_argument("--count", type=int, default=SLOTS, help="slots in which it may fail")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    given = parser.parse_args()
    print(guaranteed(given.count, given.jobs))


if __name__ == "__main__":
    main()
