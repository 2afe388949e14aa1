"""Load dense meshes as objects, find their contacts, and print time, memory and deviation.

``make dense`` runs it. Each mesh is loaded and touched in a process of its own; time is from its
start to the contacts, memory the most that it held.
"""

from __future__ import annotations

import subprocess
import sys
import tempfile
import time
from pathlib import Path

import trimesh

LOOK = """
import resource, sys, time
from graspless_pin import load_scene
from graspless_pin.findings import FindingCode
scene = load_scene(sys.argv[1])
assert scene.contacts.arrays.bodies == ("table",)
found = [one.message for one in scene.findings if one.code is FindingCode.SIMPLIFIED_HULL]
print(round(time.process_time(), 1), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
print(found[0].split(": the ")[1] if found else "all corners are kept")
"""
SCENE = """
friction: 0.5
object: {shape: {type: mesh, path: egg.stl}, density: 1000, pose: {position: [0, 0, 0.03]}}
supports: [{name: table, shape: {type: half_space}}]
"""


def egg(subdivisions: int) -> trimesh.Trimesh:
    """Return an ellipsoid with the half axes 50, 40 and 30 mm: 20 * 4**subdivisions triangles."""
    mesh = trimesh.creation.icosphere(subdivisions, radius=0.05)
    mesh.apply_scale([1.0, 0.8, 0.6])
    return mesh


def main() -> None:
    """Print a line a mesh."""
    print(f"{'triangles':>10} {'wall s':>7} {'CPU s':>6} {'MB':>5}  hull")
    with tempfile.TemporaryDirectory() as folder:
        (Path(folder) / "scene.yaml").write_text(SCENE)
        for subdivisions in map(int, sys.argv[1:] or ["5", "6", "7", "8"]):
            egg(subdivisions).export(Path(folder) / "egg.stl")
            begin = time.monotonic()
            done = subprocess.run(  # noqa: S603 - this Python
                [sys.executable, "-c", LOOK, str(Path(folder) / "scene.yaml")],
                capture_output=True, text=True, check=True,
            )  # fmt: skip
            taken, words = time.monotonic() - begin, done.stdout.splitlines()
            cpu, memory = words[0].split()
            print(f"{20 * 4**subdivisions:>10} {taken:>7.1f} {cpu:>6} {memory:>5}  {words[1]}")


if __name__ == "__main__":
    main()
