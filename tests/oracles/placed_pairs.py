"""Do what a new user does, for hands and objects of packages: new, place, solve, report.

`make place` downloads the packages without their dependencies into out/hands; their files are read,
their code is not. Each pair goes through four commands in a folder of its own, and no file is
edited by hand. What comes out is held against figures of its own: the JSON's contacts and margin,
and the corners of the hand's shapes against the support's plane. Times that must be kept are of the
processors, which on a machine with nothing else to do are more than those of the clock.
"""

from __future__ import annotations

import json
import resource
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np

from graspless_pin import load_scene
from graspless_pin.findings import heard
from graspless_pin.geometry.bodies.triangles import geometry_triangles

ICUB = "share/iCub/robots/left_hand_mk3/model.urdf"
PR2 = "pybullet_data/pr2_gripper.urdf"
ROBOTIQ = "airo_models/grippers/robotiq_2f_85/urdf/robotiq_2f_85.urdf"
GRIPPERS = "robosuite/models/assets/grippers"
DUCK = "pybullet_data/duck_vhacd.obj --scale 0.03 --mass 0.15"
MUG = "pybullet_data/objects/mug_col.obj --mass 0.2"
BOX = "box:0.06,0.05,0.08 --mass 0.2"
PAIRS: dict[str, tuple[str, str]] = {
    "iCub, duck": (ICUB, f"{DUCK} --effort 0.5"),
    "iCub, mug on a slope": (ICUB, f"{MUG} --effort 0.5 --support slope:15deg"),
    "iCub, box": (ICUB, f"{BOX} --effort 0.5"),
    "PR2, duck on a slope": (PR2, f"{DUCK} --effort 4 --support slope:15deg"),
    "PR2, box": (PR2, f"{BOX} --effort 4"),
    "Robotiq 2F-85, mug": (ROBOTIQ, f"{MUG} --effort 2"),
    "Robotiq 2F-85, box on a slope": (ROBOTIQ, f"{BOX} --effort 2 --support slope:15deg"),
    "Shadow, mug": ("gymnasium_robotics/envs/assets/hand/reach.xml", f"{MUG} --effort 1"),
    "Inspire, box on a slope": (
        f"{GRIPPERS}/inspire_left_hand.xml",
        f"{BOX} --effort 1 --support slope:15deg",
    ),
    "Jaco, duck": (f"{GRIPPERS}/jaco_three_finger_gripper.xml", f"{DUCK} --effort 1"),
}
MORE_PAIRS: dict[str, tuple[str, str]] = {
    "PR2, mug": (PR2, f"{MUG} --effort 4"),
    "Robotiq 2F-85, duck": (ROBOTIQ, f"{DUCK} --effort 2"),
    "Allegro, duck": ("allegro_right_hand", f"{DUCK} --effort 0.7"),
    "Allegro, mug": ("allegro_right_hand", f"{MUG} --effort 0.7"),
    "Allegro, box on a slope": ("allegro_right_hand", f"{BOX} --effort 0.7 --support slope:15deg"),
    "PR2 of a whole robot, box": ("pr2", f"{BOX} --effort 4 --root-link r_gripper_palm_link"),
}
"""With these each of iCub's hand, PR2, 2F-85 and Allegro meets duck, mug and box."""
ENOUGH, MARGIN, SECONDS, PLACE_SECONDS = 0.8, 0.1, 180.0, 60.0
"""Share of the pairs that must succeed, their margin, N, and CPU time of all and of `place`, s."""


class Outcome(NamedTuple):
    """What one pair came to.

    Attributes:
        margin: Of `solve`, N; nan where a command failed.
        links: Of the hand that touch the object.
        clearance: Of the hand's lowest corner above the support, m.
        seconds: Of all four commands, s.
        cpu_seconds: Of their processes, s.
        place_cpu_seconds: Of those of `place` alone, s.
        said: What the command that failed said.
    """

    margin: float
    links: int
    clearance: float
    seconds: float
    cpu_seconds: float
    place_cpu_seconds: float
    said: str = ""

    @property
    def succeeded(self) -> bool:
        """Whether this is what a user wants."""
        sound = self.margin >= MARGIN and self.links >= 2 and self.clearance > 0.0
        return sound and self.cpu_seconds < SECONDS and self.place_cpu_seconds < PLACE_SECONDS


def place_pair(packages: Path, robot: str, more: str, folder: Path) -> Outcome:
    """Take one pair through the four commands."""
    words = more.split()
    if not words[0].startswith("box:"):
        words[0] = str(packages / words[0])
    if "/" in robot:  # else it is one that example-robot-data brings along
        robot = str(packages / robot)
        words += ["--package-dir", str(packages), "--package-dir", str(packages / "share")]
    commands = (
        ("new", robot, *words, "-o", "scene.yaml"),
        ("place", "scene.yaml", "-o", "placed.yaml"),
        ("solve", "placed.yaml", "--json", "solution.json"),
        ("report", "placed.yaml", "-o", "report.html"),
    )
    begin, said, cpu = time.monotonic(), "", dict[str, float]()
    for command in commands:
        before = _cpu_seconds()
        done = subprocess.run(  # noqa: S603 - our own command line
            [sys.executable, "-m", "graspless_pin.cli", *command],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        cpu[command[0]] = _cpu_seconds() - before
        if done.returncode:
            said = f"{command[0]}: {done.stdout[-400:]} {done.stderr[-400:]}"
            break
    times = time.monotonic() - begin, sum(cpu.values()), cpu.get("place", np.nan)
    if said:
        return Outcome(np.nan, 0, np.nan, *times, said)
    with heard():
        scene = load_scene(folder / "placed.yaml")
    assert scene.hand is not None and (folder / "report.html").stat().st_size > 10_000
    document = json.loads((folder / "solution.json").read_text())
    bodies = {one["bodies"][0] for one in document["contacts"]}
    (support,) = scene.supports
    up = np.asarray(support.T_world_support)[:3, 2]
    lowest = min(
        float((_corners(body) @ up).min()) for body in scene.hand.collision_bodies()
    ) - float(up @ support.T_world_support[:3, 3])
    margin = float(document["margin"])
    return Outcome(margin, len(bodies.intersection(scene.hand.link_names)), lowest, *times)


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _corners(body) -> np.ndarray:
    T = np.asarray(body.T_world_geometry)
    return geometry_triangles(body.geometry).vertices @ T[:3, :3].T + T[:3, 3]


def main() -> None:
    """Try all pairs with a folder of packages; exit code 1 where fewer than enough succeed."""
    packages, wanted = Path(sys.argv[1]).absolute(), " ".join(sys.argv[2:])
    good = tried = 0
    print("pair: margin, links that touch, the hand above the support; seconds, CPU, of place")
    for name, (robot, more) in {**PAIRS, **MORE_PAIRS}.items():
        if wanted not in name:
            continue
        with tempfile.TemporaryDirectory() as folder:
            seen = place_pair(packages, robot, more, Path(folder))
        tried += 1
        good += seen.succeeded
        print(
            f"{name}: {seen.margin:.2f} N, {seen.links}, {1e3 * seen.clearance:.1f} mm; "
            f"{seen.seconds:.0f} s, {seen.cpu_seconds:.0f} s, {seen.place_cpu_seconds:.0f} s "
            f"{seen.said}",
            flush=True,
        )
    print(f"{good} of {tried} pairs hold")
    sys.exit(good < ENOUGH * tried)


if __name__ == "__main__":
    main()
