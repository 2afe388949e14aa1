"""Load dense meshes as objects, find their contacts, and print time, memory and deviation.

``make dense`` runs it: eggs, whose hulls stand for them, and rings, which are cut into convex
pieces. Each mesh is loaded and touched in a process of its own; time is from its start to the
contacts, memory the most that it held, that of cutting not included.
"""

from __future__ import annotations

import os
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
assert set(scene.contacts.arrays.bodies) == {"table"}
found = [one.message for one in scene.findings if one.code is FindingCode.SIMPLIFIED_HULL]
print(round(time.process_time(), 1), resource.getrusage(resource.RUSAGE_SELF).ru_maxrss // 1024)
print(found[-1].partition(": ")[2] if found else "all corners are kept")
"""
SCENE = """
friction: 0.5
object:
  shape: {{type: mesh, path: body.stl, convex: {convex}, decompose_time_limit: 600}}
  density: 1000
  pose: {{position: [0, 0, {z}]}}
supports: [{{name: table, shape: {{type: half_space}}}}]
"""


def egg(subdivisions: int) -> trimesh.Trimesh:
    """Return an ellipsoid with the half axes 50, 40 and 30 mm: 20 * 4**subdivisions triangles."""
    mesh = trimesh.creation.icosphere(subdivisions, radius=0.05)
    mesh.apply_scale([1.0, 0.8, 0.6])
    return mesh


def ring(sections: int) -> trimesh.Trimesh:
    """Return a torus of the radii 40 and 15 mm: 2 * sections**2 triangles."""
    return trimesh.creation.torus(0.04, 0.015, major_sections=sections, minor_sections=sections)


def main() -> None:
    """Print a line a mesh."""
    print(f"{'triangles':>10} {'wall s':>7} {'CPU s':>6} {'MB':>5}  what stands for it")
    with tempfile.TemporaryDirectory() as folder:
        os.environ["XDG_CACHE_HOME"] = folder
        for name in sys.argv[1:] or [
            "egg5",
            "egg6",
            "egg7",
            "egg8",
            "ring64",
            "ring256",
            "ring800",
        ]:
            is_egg, size = name.startswith("egg"), int(name.lstrip("eginr"))
            mesh = egg(size) if is_egg else ring(size)
            mesh.export(Path(folder) / "body.stl")
            convex, z = ("hull", 0.03) if is_egg else ("decompose", 0.015)
            (Path(folder) / "scene.yaml").write_text(SCENE.format(convex=convex, z=z))
            begin = time.monotonic()
            done = subprocess.run(  # noqa: S603 - this Python
                [sys.executable, "-c", LOOK, str(Path(folder) / "scene.yaml")],
                stdout=subprocess.PIPE, text=True, check=True,
            )  # fmt: skip
            taken, words = time.monotonic() - begin, done.stdout.splitlines()
            cpu, memory = words[0].split()
            print(f"{len(mesh.faces):>10} {taken:>7.1f} {cpu:>6} {memory:>5}  {words[1]}")


if __name__ == "__main__":
    main()
