"""CONTRIBUTING's new kind of surface, an ellipsoid, done to a copy of the package."""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from package_copy import followed, run
from page_blocks import ROOT
from scipy.spatial.transform import Rotation

from graspless_pin.geometry.bodies.convex_sets import BoundedSet

BODIES = Path("src") / "graspless_pin" / "geometry" / "bodies"
ELLIPSOID = ROOT / "tests" / "geometry" / "ellipsoid.py"
SHOWN = """
import json, sys
import numpy as np
from graspless_pin import Evaluator, load_scene, maximize_margin
from graspless_pin.simulation import simulate
from graspless_pin.visualization.drawing import draw_bodies

scene = load_scene(sys.argv[1])
again = load_scene(scene.save(sys.argv[1].replace(".yaml", "_saved.yaml")))
problem = scene.problem()
evaluator = Evaluator(scene)
q = evaluator.configuration() + 1e-4 * np.arange(3)[:, None]
many = evaluator.evaluate_many(q, workers=1)
torques = maximize_margin(problem).torques
print(json.dumps({
    "same": scene.object.shape == again.object.shape,
    "contacts": np.hstack([problem.positions, problem.normals]).tolist(),
    "margin": maximize_margin(problem).margin,
    "margin_again": maximize_margin(again.problem()).margin,
    "many": many.margins.tolist(),
    "alone": [evaluator.evaluate(one).margin for one in q],
    "outcome": simulate(scene, torques, seconds=0.1).runs[0].outcome,
    "drawn": len(draw_bodies(scene).meshes),
    "verdict": str(scene.stability(torques).status),
}))
"""
ALONE = """
import json, sys
from graspless_pin import load_scene

scene = load_scene(sys.argv[1])
print(json.dumps({
    "positions": scene.problem().positions.tolist(),
    "mass": scene.object.mass,
    "holds": str(scene.stability(()).status),
}))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the repository in which the walk-through was followed."""
    return followed(
        tmp_path_factory.mktemp("package"),
        "Ellipsoid",
        BODIES / "ellipsoid.py",
        BODIES / "shapes.py",
        "from graspless_pin.geometry.bodies.meshes import",
        ELLIPSOID.read_text(encoding="utf-8"),
    )


def shown(package: Path, folder: Path, shape: dict[str, Any]) -> dict[str, Any]:
    """What the copy says of the ball on a slope with another shape of the object."""
    scene = yaml.safe_load((ROOT / "examples" / "allegro_sphere_on_slope.yaml").read_text())
    scene["object"]["shape"] = shape
    file = folder / f"{shape['type']}.yaml"
    file.write_text(yaml.safe_dump(scene))
    result = run(package, SHOWN, str(file))
    assert result.returncode == 0, result.stderr
    return json.loads(result.stdout)


def test_one_with_like_axes_is_held_as_a_sphere_is(package, tmp_path):
    egg = shown(package, tmp_path, {"type": "ellipsoid", "radii": [0.06, 0.06, 0.06]})
    ball = shown(package, tmp_path, {"type": "sphere", "radius": 0.06})
    # coal's normals at curved surfaces are good to some 1e-5.
    assert np.array(egg["contacts"]) == pytest.approx(np.array(ball["contacts"]), abs=2e-5)
    assert len(egg["contacts"]) > 2
    assert egg["margin"] == pytest.approx(ball["margin"], rel=1e-4)
    assert egg["margin_again"] == pytest.approx(egg["margin"], rel=1e-9)
    assert egg["same"]
    assert egg["many"] == pytest.approx(egg["alone"], rel=1e-6)
    for key in ("outcome", "verdict", "drawn"):
        assert egg[key] == ball[key]


def test_the_page_names_what_a_set_has_to_tell():
    page = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    section = page.partition("## Add a shape")[2].partition("\n## ")[0]
    assert {name for name in BoundedSet.__abstractmethods__ if f"`{name}`" not in section} == set()


def test_alone_on_a_table_it_touches_at_one_point(package, tmp_path):
    """On a slope that friction would hold a box on, it rolls like a ball."""
    found = []
    for degrees in (0.0, 10.0):
        turn = Rotation.from_euler("y", degrees, degrees=True).as_matrix().tolist()
        scene = {
            "name": "table",
            "friction": 0.5,
            "object": {
                "name": "egg",
                "shape": {"type": "ellipsoid", "radii": [0.03, 0.02, 0.01]},
                "density": 1000.0,
                "pose": {"position": [0.0, 0.0, 0.01]},
            },
            "supports": [{"name": "table", "shape": {"type": "half_space"}}],
            "gravity": (9.81 * np.array(turn).T @ [0.0, 0.0, -1.0]).tolist(),
        }
        file = tmp_path / "table.yaml"
        file.write_text(yaml.safe_dump(scene))
        result = run(package, ALONE, str(file))
        assert result.returncode == 0, result.stderr
        found.append(json.loads(result.stdout))
    flat, tilted = found
    assert flat["positions"] == [pytest.approx([0.0, 0.0, -0.01], abs=1e-9)]
    assert flat["mass"] == pytest.approx(4e3 / 3.0 * np.pi * 0.03 * 0.02 * 0.01)
    assert (flat["holds"], tilted["holds"]) == ("strong", "none")
