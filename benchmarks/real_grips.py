"""Placed grips of real hands: what is said of them, beside what MuJoCo does with them.

Grips are placed once and kept as scene files, and so is what came out for each:
``python -m benchmarks.real_grips`` goes on where it stopped.
"""

from __future__ import annotations

import argparse
import json
import sys
import time
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass
from itertools import chain, islice, product
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

import numpy as np
import trimesh
from tabulate import tabulate

from benchmarks.grip_runs import FINGER_MOVED, MARGIN, NODES, outcome_table, run_of
from benchmarks.grip_softness import SoftCase, soft_cases, soft_summary
from benchmarks.grip_windows import EndCase, StableCase, end_cases, stable_cases, window_summary
from graspless_pin import Controller, Holding, Scene, load_scene, place_hand
from graspless_pin.findings import capture
from graspless_pin.geometry import Box, Capsule, Cone, Cylinder, MeshShape, Sphere
from graspless_pin.geometry.bodies.shapes import Shape
from graspless_pin.problem.checks import FloatArray
from graspless_pin.scene.new_scene import new_scene_text
from graspless_pin.scene.saving import scene_text
from graspless_pin.simulation.model import SOFT, STIFF, ContactModel

ROOT = Path(__file__).parents[1]
KEPT = ROOT / "out" / "real_grips"
HANDS = (
    "allegro_right", "trihand", "dex3_left", "psyonic_right", "panda_hand",
    "allegro_left", "tiago_pro_gripper", "dex3_right", "psyonic_left", "talos_gripper",
)  # fmt: skip
EFFORT = 1.0
"""N m (N) of actuators whose limit the robot's files do not tell."""
MASS = 0.3  # kg
SEED, CANDIDATES, RANKS = 11, 60, 6
BELOW, ABOVE = 0.67, 1.5
"""Times the feedback that is said to be needed."""
WITHIN, WITHIN_ON_MESH = 1.2, 2.0
"""Factors by which growth rates may be off, on smooth shapes and on meshes."""


def objects(folder: Path) -> dict[str, Callable[[], Shape]]:
    """Return the objects by name; meshes are written to a folder."""

    def egg() -> Shape:
        mesh = trimesh.creation.icosphere(subdivisions=3, radius=1.0)
        mesh.apply_scale((0.028, 0.028, 0.038))
        mesh.export(folder / "egg.stl")
        return MeshShape(folder / "egg.stl")

    return {
        "box": lambda: Box((0.06, 0.05, 0.08)),
        "ball": lambda: Sphere(0.03),
        "cylinder": lambda: Cylinder(0.025, 0.1),
        "egg": egg,
        "flat": lambda: Box((0.08, 0.06, 0.03)),
        "capsule": lambda: Capsule(0.022, 0.06),
        "mug": lambda: MeshShape(ROOT / "examples" / "meshes" / "mug.stl"),
        "cone": lambda: Cone(0.03, 0.09),
    }


@dataclass(frozen=True)
class Case:
    """One run of one grip.

    Attributes:
        grip: Hand, object and rank.
        contacts: How many.
        algorithm: Whose torques.
        holding: What is said of these torques without feedback.
        controller: ``constant``, ``below`` or ``above`` the feedback that is needed.
        bodies: ``stiff`` or ``soft``.
        stiffness: Feedback that is said to be needed, N m/rad (N/m).
        growth: Rate of the small motion that is said to grow under the controller, 1/s.
        is_mesh: Whether a mesh touches.
        outcome: What the object does.
        fingers: Largest way of a joint, rad.
        measured: Rate of growth in the simulation, 1/s; None: nothing grew far enough.
        displacement: m.
        rotation: rad.
        seconds: Of the verdict.
        said: Its sentence.
    """

    grip: str
    contacts: int
    algorithm: str
    holding: str
    controller: str
    bodies: str
    stiffness: float
    growth: float
    is_mesh: bool
    outcome: str
    fingers: float
    measured: float | None
    displacement: float
    rotation: float
    seconds: float
    said: str

    @property
    def stays(self) -> bool:
        """Whether object and fingers stay."""
        return self.outcome == "held" and self.fingers < FINGER_MOVED

    @property
    def is_odd(self) -> bool:
        """Whether with stiff bodies it is not as it is said to be."""
        expected = {"constant": self.holding == Holding.HOLDS, "below": False, "above": True}
        said = self.controller != "constant" or self.holding in (
            Holding.HOLDS, Holding.NEEDS_FEEDBACK)  # fmt: skip
        return said and self.bodies == "stiff" and self.stays is not expected[self.controller]

    @property
    def growth_is_near(self) -> bool:
        """Whether the measured growth is what it is said to be."""
        factor = WITHIN_ON_MESH if self.is_mesh else WITHIN
        return self.measured is not None and 1.0 / factor <= self.measured / self.growth <= factor

    def __str__(self) -> str:
        """Return it in one line."""
        measured = "-" if self.measured is None else f"{self.measured:.3g}"
        return (
            f"{self.grip}, {self.algorithm}, {self.controller}, {self.bodies}: {self.holding}, "
            f"growth {self.growth:.3g} (measured {measured}), needs {self.stiffness:.3g}; "
            f"{self.outcome}, {1e3 * self.displacement:.2f} mm, "
            f"{np.degrees(self.rotation):.2f} deg, joints {np.degrees(self.fingers):.2f} deg"
        )


def place(name: tuple[str, str]) -> list[Path]:
    """Place a hand at an object, and return the files of the best grips."""
    hand, target = name
    KEPT.mkdir(parents=True, exist_ok=True)
    done = KEPT / f"{hand}_{target}.done"
    if not done.exists():
        start = KEPT / f"{hand}_{target}.yaml"
        with capture():
            shape = objects(KEPT)[target]()
            new = new_scene_text(start, hand, target, shape, mass=MASS, effort=EFFORT)
            start.write_text(new.text)
            scene = load_scene(start)
            found = place_hand(
                scene, seed=SEED, candidates=CANDIDATES, time_limit=None, verdict_nodes=0, workers=1
            )
            for rank, one in enumerate(found.places[:RANKS]):
                path = KEPT / f"{hand}_{target}_{rank}.yaml"
                path.write_text(scene_text(one.scene, path))
        start.unlink()
        done.touch()
    return sorted(KEPT.glob(f"{hand}_{target}_[0-9].yaml"))


_Kind = TypeVar("_Kind")


class GripCases(NamedTuple):
    """All that is known of a grip."""

    said: list[Case]
    stable: list[StableCase]
    ends: list[EndCase]
    soft: list[SoftCase]


def kept_cases(path: Path) -> GripCases:
    """Return what is said of a grip and what becomes of it; from files where it is known."""
    grip = path.stem

    def stable() -> Iterator[StableCase]:
        return stable_cases(load_scene(path), grip)

    def ends() -> Iterator[EndCase]:
        return end_cases(load_scene(path), grip)

    def soft() -> Iterator[SoftCase]:
        failed = [one for one in said if one.controller == "above" and one.bodies == "soft"]
        asked = [(one.algorithm, one.stiffness) for one in failed if not one.stays]
        return soft_cases(load_scene(path), grip, asked)

    said = kept(path.with_suffix(".json"), Case, lambda: cases(path))
    return GripCases(
        said,
        kept(path.with_suffix(".stable.json"), StableCase, stable),
        kept(path.with_suffix(".ends.json"), EndCase, ends),
        kept(path.with_suffix(".soft.json"), SoftCase, soft),
    )


def kept(path: Path, kind: type[_Kind], made: Callable[[], Iterable[_Kind]]) -> list[_Kind]:
    """Return cases, which are made where their file is not there yet."""
    if path.exists():
        return [kind(**one) for one in json.loads(path.read_text())]
    with capture():
        found = [*made()]
    path.write_text(json.dumps([vars(one) for one in found], indent=1))
    return found


def cases(
    path: Path, algorithms: Sequence[str] = ("margin", "torque"), *, soft: bool = True
) -> list[Case]:
    """Return what is said of the grip of a scene file, and what becomes of it.

    Args:
        path: The file.
        algorithms: Whose torques.
        soft: Whether soft bodies are tried, too.
    """
    found = list[Case]()
    with capture():
        scene = load_scene(path)
        for algorithm in algorithms:
            more: dict[str, Any] = {"margin": MARGIN} if algorithm == "torque" else {}
            solution = scene.solve(algorithm, **more)
            if solution.found:
                found += _of_torques(scene, path.stem, algorithm, solution.torques, soft=soft)
    return found


def _of_torques(
    scene: Scene, name: str, algorithm: str, torques: FloatArray, *, soft: bool = True
) -> Iterator[Case]:
    begin = time.process_time()
    said = scene.with_changes(controller=Controller()).stability(torques, node_limit=NODES)
    seconds, small = time.process_time() - begin, said.small_motions
    motion = None if small is None else small.motion

    def run(controller: str, stiffness: float, model: ContactModel) -> Case:
        held = scene.with_changes(controller=Controller(stiffness))
        own, growth = motion, said.growth_rate
        if stiffness and said.holding is Holding.NEEDS_FEEDBACK:
            now = held.stability(torques, node_limit=NODES)
            growth = now.growth_rate
            if now.small_motions is not None and now.small_motions.motion is not None:
                own = now.small_motions.motion
        mesh = small is not None and bool(small.growth_by_surface)
        done = run_of(held, torques, own, growth, model)
        return Case(
            name, scene.problem().contact_count, algorithm, str(said.holding), controller,
            model.name, said.stiffness_needed, growth, mesh, *done, seconds, said.message,
        )  # fmt: skip

    needed = said.stiffness_needed
    needs = said.holding is Holding.NEEDS_FEEDBACK and np.isfinite(needed)
    yield run("constant", 0.0, STIFF)
    if needs:
        yield run("below", BELOW * needed, STIFF)
        yield run("above", ABOVE * needed, STIFF)
    if soft:
        yield run("constant", 0.0, SOFT)
    if soft and needs:
        yield run("above", 2.0 * needed, SOFT)


def summary(found: Sequence[Case]) -> str:
    """Return the tables of all cases, and each that is not as it is said to be."""
    by = {"bodies": "bodies", "controller": "feedback", "holding": "said", "algorithm": "torques"}
    lines = [outcome_table(found, by, "cases"), "", *_shares(found), "", _softly(found), ""]
    lines += ["Not as said, stiff bodies:", *(f"- {one}" for one in found if one.is_odd)]
    return "\n".join(lines)


def _softly(found: Sequence[Case]) -> str:
    """Return how many rests that hold with stiff bodies are not held with soft ones, and where."""
    kind = "soft", "constant", Holding.HOLDS
    own = [one for one in found if (one.bodies, one.controller, one.holding) == kind]
    targets = [*objects(KEPT)]
    rows = []
    for hand in HANDS:
        row = [hand]
        for target in targets:
            here = [one.stays for one in own if one.grip.startswith(f"{hand}_{target}_")]
            row.append(f"{here.count(False)} of {len(here)}" if here else "")
        rows.append(row)
    return tabulate(rows, ["not held, soft", *targets], "github")


def _shares(found: Sequence[Case]) -> list[str]:
    stiff = [one for one in found if one.bodies == "stiff"]
    constant = [one for one in stiff if one.controller == "constant"]
    needing = [one for one in stiff if one.holding == Holding.NEEDS_FEEDBACK]
    grown = [one for one in needing if one.measured]
    decided = [one for one in constant if one.holding != Holding.UNDECIDED and one.stays]
    groups: Mapping[str, tuple[list[bool], float]] = {
        "of answers with `holds`, held": (
            [one.stays for one in constant if one.holding == Holding.HOLDS], 0.99),
        "of decided grips that hold with constant torques, called so": (
            [one.holding == Holding.HOLDS for one in decided], 0.8),
        "of `needs_feedback`, with 1.5 times the stiffness, held": (
            [one.stays for one in stiff if one.controller == "above"], 0.98),
        "with 0.67 times, moved": (
            [not one.stays for one in stiff if one.controller == "below"], 0.9),
        "of growth rates on smooth shapes within 20 %": (
            [one.growth_is_near for one in grown if not one.is_mesh], 1.0),
        "on meshes within a factor 2": (
            [one.growth_is_near for one in grown if one.is_mesh], 1.0),
        "of verdicts undecided": (
            [one.holding == Holding.UNDECIDED for one in constant], 0.2),
    }  # fmt: skip
    return [
        f"- {sum(hits)} of {len(hits)} {name} ({100.0 * np.mean(hits):.0f} %; wanted {wanted:.0%})"
        for name, (hits, wanted) in groups.items()
        if hits
    ]


def main() -> None:
    """Place, simulate, and print the tables."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.real_grips", description=__doc__)
    parser.add_argument("--count", type=int, help="grips; default: all")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--place", action="store_true", help="place only")
    given = parser.parse_args()
    with ProcessPoolExecutor(given.jobs) as pool:
        pairs = [(hand, target) for target, hand in product(objects(KEPT), HANDS)]
        grips: list[Path] = []
        for found in pool.map(place, pairs):
            grips += found
            print(f"{len(grips)} grips", file=sys.stderr, flush=True)
            if given.count is not None and len(grips) >= given.count:
                break
        results = GripCases([], [], [], [])
        if not given.place:
            for own in pool.map(kept_cases, islice(grips, given.count)):
                results.said.extend(own.said)
                results.stable.extend(own.stable)
                results.ends.extend(own.ends)
                results.soft.extend(own.soft)
                print(*chain(*own), sep="\n", file=sys.stderr, flush=True)
    print(summary(results.said))
    print(f"\n{window_summary(results.stable, results.ends)}\n\n{soft_summary(results.soft)}")


if __name__ == "__main__":
    main()
