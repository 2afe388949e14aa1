"""Moving supports, materials, density and cut meshes in a scene file."""

import numpy as np
import pytest
import yaml

from graspless_pin import load_scene
from graspless_pin.errors import SceneError

BELT = {
    "object": {
        "shape": {"type": "box", "size": [0.2, 0.2, 0.2]},
        "density": 125.0,
        "pose": {"position": [0.0, 0.0, 0.1]},
        "material": "steel",
    },
    "supports": [
        {
            "name": "belt",
            "shape": {"type": "half_space"},
            "velocity": {"linear": [0.5, 0.0, 0.0]},
            "material": "rubber",
        }
    ],
    "friction": 0.1,
    "materials": {"rubber": {"steel": 0.6}},
}


def scene(tmp_path, **changes):
    path = tmp_path / "scene.yaml"
    path.write_text(yaml.safe_dump(BELT | changes))
    return load_scene(path)


def test_a_belt_slides_under_a_box_at_rest(tmp_path):
    problem = scene(tmp_path).problem()
    np.testing.assert_allclose(problem.sliding, np.tile([-0.5, 0.0, 0.0], (4, 1)))
    np.testing.assert_allclose(problem.friction, 0.6)
    np.testing.assert_allclose(problem.external_wrench[:3], [0.0, 0.0, -9.81])


def test_a_box_that_rides_on_the_belt_sticks(tmp_path):
    motion = {"object_twist": {"linear": [0.5, 0.0, 0.0]}}
    assert not scene(tmp_path, motion=motion).problem().is_sliding.any()


def test_an_unknown_material_names_its_line(tmp_path):
    with pytest.raises(SceneError, match=r"scene\.yaml:\d+: object\.material: .*glass.*rubber"):
        scene(tmp_path, object=BELT["object"] | {"material": "glass"})


def test_mass_and_density_exclude_each_other(tmp_path):
    with pytest.raises(SceneError, match="mass"):
        scene(tmp_path, object=BELT["object"] | {"mass": 1.0})


def test_the_centre_of_a_cone_is_its_centroid(tmp_path):
    cone = {"shape": {"type": "cone", "radius": 0.1, "length": 0.2}, "mass": 1.0}
    cone["pose"] = {"position": [0.0, 0.0, 0.1]}
    loaded = scene(tmp_path, object=cone)
    np.testing.assert_allclose(loaded.object.center_of_mass_world, [0.0, 0.0, 0.05], atol=1e-9)
