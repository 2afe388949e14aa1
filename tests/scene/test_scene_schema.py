"""The published JSON schema accepts every example and refuses what the loader refuses."""

import json
import math

import jsonschema
import pytest
from scene_tools import BOX, EXAMPLES, ROOT, content

from graspless_pin.scene import scene_json_schema

FILES = sorted(file for file in EXAMPLES.rglob("*.yaml") if file.parent.name != "studies")


@pytest.fixture(scope="module")
def validator():
    schema = scene_json_schema()
    jsonschema.Draft202012Validator.check_schema(schema)
    return jsonschema.Draft202012Validator(schema)


@pytest.mark.parametrize("file", FILES, ids=lambda file: file.stem)
def test_every_example_is_valid(validator, file):
    validator.validate(content(file))


def test_the_published_file_is_up_to_date():
    published = (ROOT / "docs" / "scene.schema.json").read_text(encoding="utf-8")
    assert published == json.dumps(scene_json_schema(), indent=2) + "\n", (
        "run: graspless-pin schema > docs/scene.schema.json"
    )


@pytest.mark.parametrize(
    ("key", "value"),
    [
        ("frction", 0.3),
        ("friction", -0.3),
        ("friction", {"floor": "slippery"}),
        ("gravity", [0, -9.8]),
        ("gravity", [0, 0, 0, -9.8]),
        ("cone_edges", 2),
        ("cone_edges", 6.5),
        ("max_normal_force", 0),
        ("tangent_axes", [1, 0, 0]),
        ("supports", {"name": "floor"}),
        ("supports", [{"name": "floor", "shape": {"type": "plane"}}]),
        ("object", {"shape": {"type": "half_space"}, "mass": 1}),
        ("object", {"shape": {"type": "box", "size": [1, 0, 1]}, "mass": 1}),
        ("object", {"shape": {"type": "sphere", "radius": 0.1}}),
        ("object", {"shape": {"type": "sphere", "radius": 0.1}, "mass": True}),
        ("motion", {"hand": {}}),
        ("contacts", [{"body": "floor", "position": [0, 0, 0]}]),
        ("solve", {"algorithm": "best"}),
        ("hand", {"control": "soft"}),
    ],
)
def test_a_bad_scene_is_refused(validator, key, value):
    data = content(BOX)
    validator.validate(data)
    data[key] = value
    with pytest.raises(jsonschema.ValidationError):
        validator.validate(data)


def test_defaults_of_the_schema_are_plain_json():
    def finite(value):
        if isinstance(value, dict):
            return all(finite(item) for item in value.values())
        if isinstance(value, list):
            return all(finite(item) for item in value)
        return not isinstance(value, float) or math.isfinite(value)

    assert finite(scene_json_schema())
