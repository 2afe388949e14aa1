"""Files to spoil: small ones of every kind, and the commands that read them."""

from __future__ import annotations

import io
import subprocess
import sys
from collections.abc import Callable
from dataclasses import dataclass
from functools import cache, partial
from pathlib import Path

import trimesh

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"

LEVER = """\
name: lever
gravity: [0, 0, -9.8]
friction: {default: 0.3, floor: 0.4}
max_normal_force: 40
cone_edges: 8
hand:
  robot: lever_100mm
  base_pose: {position: [-0.1, -0.1, 0.0], rpy: [3.141592653589793, 0, 0]}
  q: {hinge: 0.0}
  effort_limits: {hinge: [-3, 3]}
object:
  name: box
  shape: {type: box, size: [0.2, 0.2, 0.2]}
  mass: 1.0
  center_of_mass: [0, 0, -0.01]
supports:
  - name: floor
    shape: {type: half_space}
    pose: {position: [0, 0, -0.1]}
solve: {algorithm: torque, margin: 0.05, regularization: 0.0}
"""

PUSHED = """\
gravity: [0, 0, -9.81]
materials: {rubber: {steel: 0.6}, wood: {steel: 0.3, rubber: 0.5}}
friction: 0.5
hand: {urdf: hand.urdf, base_pose: {position: [0, -0.11, 0]}, material: rubber}
object:
  shape: {type: mesh, path: mesh.stl, scale: [1, 1, 1]}
  density: 500
  material: wood
  pose: {position: [0, 0, 0], quaternion: [0, 0, 0, 1]}
supports:
  - {name: table, shape: {type: box, size: [1, 1, 0.1]}, pose: {position: [0, 0, -0.15]},
     material: steel}
motion: {object_twist: {linear: [0, 0.1, 0]}}
"""

GIVEN = """\
friction: 0.4
object: {shape: {type: sphere, radius: 0.1}, mass: 0.5}
supports:
  - {name: left, shape: {type: half_space}, pose: {position: [-0.1, 0, 0], rpy: [0, 0.7, 0]}}
  - {name: right, shape: {type: half_space}, pose: {position: [0.1, 0, 0], rpy: [0, -0.7, 0]}}
contacts:
  - {body: left, position: [-0.064, 0, -0.076], normal: [0.64, 0, 0.76]}
  - {body: right, position: [0.064, 0, -0.076], normal: [-0.64, 0, 0.76]}
tangent_axes: [[0, 1, 0]]
"""

HAND = """\
<?xml version="1.0"?>
<robot name="hand">
  <link name="palm"/>
  <link name="pad">
    <inertial><mass value="0.1"/><origin xyz="0 0 0"/>
      <inertia ixx="1e-4" ixy="0" ixz="0" iyy="1e-4" iyz="0" izz="1e-4"/></inertial>
    <visual><geometry><mesh filename="link.obj" scale="0.1 0.1 0.1"/></geometry></visual>
    <collision><origin xyz="0 0 0" rpy="0 0 0"/><geometry><sphere radius="0.01"/></geometry>
    </collision>
  </link>
  <link name="tip"><collision><geometry><mesh filename="link.stl"
    scale="0.01 0.01 0.01"/></geometry></collision></link>
  <joint name="slide" type="prismatic"><parent link="palm"/><child link="pad"/>
    <axis xyz="0 1 0"/><limit lower="-1" upper="1" effort="20" velocity="1"/></joint>
  <joint name="turn" type="revolute"><parent link="pad"/><child link="tip"/>
    <origin xyz="0 0 -0.3"/><axis xyz="1 0 0"/>
    <limit lower="-1" upper="1" effort="2" velocity="1"/></joint>
  <joint name="follow" type="continuous"><parent link="tip"/><child link="end"/>
    <axis xyz="1 0 0"/><mimic joint="turn" multiplier="0.5" offset="0"/></joint>
  <link name="end"/>
</robot>
"""

ROBOT = """\
name: slider
urdf: hand.urdf
palm: palm
root_link: palm
fingers:
  finger: {joints: [slide, turn], links: [pad, tip], tip: tip}
couplings:
  follow: {follows: {turn: 0.5}, offset: 0.0}
effort_limits:
  slide: {limit: 20, source: data sheet}
  turn: {unknown: not measured}
convex: {tip: hull}
concavity: 0.05
"""

SOLVE = """\
import sys
from graspless_pin.cli.commands import app
for scene in sys.argv[1:]:
    app(["solve", scene, "--json", f"{scene}.json"], standalone_mode=False)
"""

STUDY = """\
name: few
scene: scene.yaml
vary:
  object.mass: {values: [0.5, 1.0]}
  height: {from: 0, to: 1, steps: 2, unit: mm, move: {what: object, along: [0, 0, 1]}}
sampling: {method: grid, seed: 1}
compute: {algorithm: margin, regularization: 0.0}
"""


@dataclass(frozen=True)
class Seed:
    """A file to spoil.

    Attributes:
        name: Of the file.
        commands: Command lines that read it.
        others: All files of the folder by name, this one among them unless it is `made`.
        made: Computes this one when it is asked for.
    """

    name: str
    commands: tuple[tuple[str, ...], ...]
    others: dict[str, bytes]
    made: Callable[[], bytes] | None = None

    @property
    def files(self) -> dict[str, bytes]:
        """All files of the folder by name."""
        return self.others if self.made is None else self.others | {self.name: self.made()}


def meshes() -> dict[str, bytes]:
    """A box of 0.2 m in every format, and a small one for a link."""
    made: dict[str, bytes] = {}
    box = trimesh.creation.box((0.2, 0.2, 0.2))
    for name, kind in (
        ("mesh.stl", "stl"),
        ("text.stl", "stl_ascii"),
        ("mesh.obj", "obj"),
        ("mesh.ply", "ply"),
        ("mesh.off", "off"),
        ("mesh.glb", "glb"),
        ("mesh.dae", "dae"),
    ):
        buffer = io.BytesIO()
        box.export(buffer, file_type=kind)
        made[name] = buffer.getvalue()
    text = io.BytesIO()
    box.export(text, file_type="ply", encoding="ascii")
    made["text.ply"] = text.getvalue()
    made["mesh.obj"] = b"mtllib mesh.mtl\nusemtl red\n" + made["mesh.obj"]
    made["mesh.mtl"] = b"newmtl red\nKd 1 0 0\nmap_Kd red.png\n"
    parts = box.scene().export(file_type="gltf")
    assert isinstance(parts, dict)
    for name, content in parts.items():
        made["mesh.gltf" if name == "model.gltf" else name] = content
    small = trimesh.creation.icosahedron()
    for name in ("link.stl", "link.obj"):
        buffer = io.BytesIO()
        small.export(buffer, file_type=name[-3:])
        made[name] = buffer.getvalue()
    return made


def seeds(folder: Path) -> list[Seed]:
    """Return all files to spoil; documents are computed in a folder of one's own."""
    base = {
        **meshes(),
        "hand.urdf": HAND.encode(),
        "robot.yaml": ROBOT.encode(),
        "study.yaml": STUDY.encode(),
        "scene.yaml": LEVER.encode(),
        "pushed.yaml": PUSHED.encode(),
        "given.yaml": GIVEN.encode(),
        "sliding.yaml": (EXAMPLES / "paper" / "cuboid_sliding_up.yaml").read_bytes(),
    }
    found: list[Seed] = []
    for name in ("scene.yaml", "pushed.yaml", "given.yaml", "sliding.yaml"):
        commands = [("solve", name), ("solve", name, "--json", "-"), ("solve", name)]
        if name != "sliding.yaml":
            commands.append(("report", name, "-o", "out.html", "--no-ranges"))
        found += [Seed(name, tuple(commands), base)] * 2
    study = ("study", "study.yaml", "-o", "out.csv", "--workers", "1", "--no-progress")
    found.append(Seed("study.yaml", (study,), base))
    robot = base | {"pushed.yaml": PUSHED.replace("urdf: hand.urdf", "robot: robot.yaml").encode()}
    found.append(Seed("robot.yaml", (("inspect", "robot.yaml"), ("solve", "pushed.yaml")), robot))
    found += [Seed("hand.urdf", (("inspect", "hand.urdf"), ("solve", "pushed.yaml")), base)] * 2
    for name in base:
        if name.startswith(("mesh.", "text.", "gltf_buffer")) and name.endswith(
            ("stl", "obj", "ply", "off", "glb", "dae", "gltf", "bin", "mtl")
        ):
            mesh = {"mtl": "mesh.obj", "bin": "mesh.gltf"}.get(name[-3:], name)
            used = base | {
                "pushed.yaml": PUSHED.replace("mesh.stl", mesh).encode(),
                "hand.urdf": HAND.replace("link.stl", mesh).encode(),
            }
            commands = (("solve", "pushed.yaml"), ("inspect", "hand.urdf"))
            found.append(Seed(name, commands, used))
    for name, content in base.items():
        (folder / name).write_bytes(content)
    scenes = ("scene.yaml", "given.yaml", "sliding.yaml")

    @cache
    def documents() -> dict[str, bytes]:
        # Not in this process: solvers start threads, which no fork takes along.
        words = [sys.executable, "-c", SOLVE, *scenes]
        subprocess.run(words, cwd=folder, check=True, stdout=subprocess.DEVNULL)  # noqa: S603
        return {scene: (folder / f"{scene}.json").read_bytes() for scene in scenes}

    for scene in scenes:
        commands = (
            ("verify", "solution.json"),
            ("report", "solution.json", "-o", "out.html", "--no-ranges"),
        )
        made = partial(lambda scene: documents()[scene], scene)
        found += [Seed("solution.json", commands, base, made)] * 2
    return found
