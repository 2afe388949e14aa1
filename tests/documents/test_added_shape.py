"""CONTRIBUTING's walk-through "Add a shape", done to a copy of the package."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from package_copy import command, followed, shown
from page_blocks import ROOT
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.shapes import SHAPES

BODIES = Path("src") / "graspless_pin" / "geometry" / "bodies"
RADIUS, HEIGHT = 0.1 * np.sqrt(2.0), 0.2
SHOWN = """
import json, sys
import numpy as np
from graspless_pin import load_scene, maximize_margin, minimize_torque
from graspless_pin.geometry.bodies.shapes import SHAPES
from graspless_pin.scene.units import kinds_of
from graspless_pin.simulation import simulation_model
from graspless_pin.visualization.drawing import draw_bodies

scene = load_scene(sys.argv[1])
saved = scene.save(sys.argv[1].replace(".yaml", "_saved.yaml"))
again = load_scene(saved)
problem = scene.problem()
solution = maximize_margin(problem)
model = simulation_model(scene, solution.torques)
print(json.dumps({
    "kinds": list(SHAPES),
    "shape": repr(scene.object.shape),
    "summary": str(scene).splitlines()[1],
    "same": scene.object.shape == again.object.shape,
    "saved": saved.read_text(),
    "mass": scene.object.mass,
    "center": scene.object.center_of_mass.tolist(),
    "inertia": scene.object.own_inertia.tolist(),
    "contacts": np.hstack([problem.positions, problem.normals]).tolist(),
    "margin": solution.margin,
    "margin_again": maximize_margin(again.problem()).margin,
    "torque": minimize_torque(problem, 0.1).max_torque,
    "xml": model.xml,
    "drawn": len(draw_bodies(scene).meshes),
    "unit": kinds_of(("object", "shape", "height")),
}))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the repository in which the walk-through was followed."""
    folder = tmp_path_factory.mktemp("package")
    beside = "from graspless_pin.geometry.bodies.shape import"
    return followed(folder, "Prism", BODIES / "prism.py", BODIES / "shapes.py", beside)


def scene_of(folder: Path, name: str, shape: dict[str, Any], turn: float) -> Path:
    """The paper's cuboid pinched on a slope, at rest and as another shape turned about its z."""
    scene = yaml.safe_load((ROOT / "examples/paper/cuboid_sliding_up.yaml").read_text())
    del scene["motion"]
    R = Rotation.from_euler("y", 45.0, degrees=True) * Rotation.from_euler("z", turn, degrees=True)
    scene["object"] = {
        "name": "body",
        "shape": shape,
        "density": 100.0,
        "pose": {"matrix": R.as_matrix().tolist()},
    }
    file = folder / f"{name}.yaml"
    file.write_text(yaml.safe_dump(scene))
    return file


def on_a_block(file: Path, shape: dict[str, Any], turn: float) -> Path:
    """The same scene on a block of 0.6 x 0.6 x 0.1 m, the top of which is the slope."""
    scene = yaml.safe_load(file.read_text())
    R = Rotation.from_euler("y", 45.0, degrees=True) * Rotation.from_euler("z", turn, degrees=True)
    (slope,) = scene["supports"]
    middle = np.array(slope["pose"]["position"]) - 0.05 * R.as_matrix()[:, 2]
    pose = {"position": middle.tolist(), "matrix": R.as_matrix().tolist()}
    scene["supports"] = [{"name": "slope", "shape": shape, "pose": pose}]
    file.write_text(yaml.safe_dump(scene))
    return file


def in_order(rows: Any) -> np.ndarray:
    """Rows in an order that rounding does not change."""
    found = np.array(rows)
    return found[np.lexsort(np.round(found, 6).T)]


def vertices(xml: str) -> np.ndarray:
    """Corners of the one mesh of an MJCF document."""
    (mesh,) = [part for part in xml.split("<") if part.startswith("mesh name")]
    numbers = mesh.split('vertex="')[1].split('"')[0].split()
    return np.array(numbers, dtype=float).reshape(-1, 3)


@pytest.fixture(scope="module")
def squares(package, tmp_path_factory):
    """What a scene says of a prism of four corners, the same as a box, and as a mesh file."""
    folder = tmp_path_factory.mktemp("scenes")
    trimesh.creation.box(extents=[0.2, 0.2, HEIGHT]).export(folder / "box.off")
    prism = {"type": "prism", "corners": 4, "radius": float(RADIUS), "height": HEIGHT}
    box = {"type": "box", "size": [0.2, 0.2, HEIGHT]}
    mesh = {"type": "mesh", "path": "box.off"}
    return (
        shown(package, SHOWN, scene_of(folder, "prism", prism, 45.0)),
        shown(package, SHOWN, scene_of(folder, "box", box, 0.0)),
        shown(package, SHOWN, scene_of(folder, "mesh", mesh, 0.0)),
    )


def test_the_new_shape_is_one_module_and_one_line(squares):
    prism, *_ = squares
    assert prism["kinds"] == ["prism", *SHAPES]
    assert prism["shape"].startswith("Prism(corners=4, radius=0.14142")
    assert prism["summary"].startswith("object    body: prism 0.141421 x 0.2 m, 0.8 kg")
    assert prism["unit"] == ["length"]
    assert prism["same"]
    shape = yaml.safe_load(prism["saved"])["object"]["shape"]
    assert shape == {"type": "prism", "corners": 4, "radius": RADIUS, "height": HEIGHT}
    assert prism["margin_again"] == pytest.approx(prism["margin"], rel=1e-9)


def test_a_square_prism_touches_weighs_and_holds_like_a_box(squares):
    prism, *others = squares
    turn = Rotation.from_euler("z", 45.0, degrees=True).as_matrix()
    for other in others:
        assert prism["mass"] == pytest.approx(other["mass"], rel=1e-9)
        assert prism["center"] == pytest.approx(other["center"], abs=1e-12)
        turned = turn @ np.array(prism["inertia"]) @ turn.T
        assert turned == pytest.approx(np.array(other["inertia"]), rel=1e-9, abs=1e-12)
        assert in_order(prism["contacts"]) == pytest.approx(in_order(other["contacts"]), abs=1e-7)
        assert prism["margin"] == pytest.approx(other["margin"], rel=1e-6)
        assert prism["torque"] == pytest.approx(other["torque"], rel=1e-6)
        assert prism["drawn"] == other["drawn"]
    assert len(prism["contacts"]) == 6
    assert prism["margin"] > 0.1


def test_it_may_be_a_support(package, squares, tmp_path):
    shape = {"type": "prism", "corners": 4, "radius": 0.3 * 2.0**0.5, "height": 0.1}
    cube = {"type": "box", "size": [0.2, 0.2, HEIGHT]}
    found = shown(package, SHOWN, on_a_block(scene_of(tmp_path, "block", cube, 0.0), shape, 45.0))
    _, box, _ = squares
    assert in_order(found["contacts"]) == pytest.approx(in_order(box["contacts"]), abs=1e-7)
    assert found["margin"] == pytest.approx(box["margin"], rel=1e-6)


def test_its_mjcf_is_a_mesh_of_its_corners(squares):
    prism, _, mesh = squares
    turn = Rotation.from_euler("z", 45.0, degrees=True).as_matrix()
    found, expected = vertices(prism["xml"]) @ turn.T, vertices(mesh["xml"])
    assert in_order(found) == pytest.approx(in_order(expected), abs=1e-9)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"corners": 2}, "object.shape.corners: found 2; needs"),
        ({"radius": "3 cm"}, "object.shape.radius: found '3 cm'; needs"),
        (
            {"hieght": 1.0},
            "did you mean 'height'?",
        ),
    ],
)
def test_a_wrong_prism_is_told_with_file_line_and_key(package, tmp_path, change, message):
    shape = {"type": "prism", "corners": 4, "radius": 0.1, "height": 0.2} | change
    file = scene_of(tmp_path, "wrong", shape, 0.0)
    result = command(package, "solve", str(file))
    assert f"{file}:" in result.stderr
    assert message in result.stderr


def test_the_command_line_and_the_schema_know_it(package, tmp_path):
    target = tmp_path / "scene.yaml"
    made = command(package, "new", "allegro_left", "prism:6,0.03,0.1", "-o", str(target))
    assert made.returncode == 0, made.stderr
    assert "corners: 6," in target.read_text() or "corners: 6\n" in target.read_text()
    schema = json.loads((tmp_path / "scene.schema.json").read_text())
    entry = schema["$defs"]["PrismEntry"]
    assert entry["required"] == ["type", "corners", "radius", "height"]
    assert entry["properties"]["corners"]["minimum"] == 3
    assert schema["$defs"]["SupportEntry"]["properties"]["shape"]["discriminator"]["mapping"][
        "prism"
    ].endswith("PrismEntry")
    refused = command(package, "new", "allegro_left", "prism:2,0.03,0.1")
    assert "corners: is 2; it must be a whole number >= 3" in refused.stderr
    refused = command(package, "new", "allegro_left", "prism:6.5,0.03,0.1")
    assert "corners: is 6.5; it must be a whole number" in refused.stderr
