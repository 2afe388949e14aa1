"""No number of a file may be true or false, wherever in a scene, study or robot file it stands."""

import inspect
from collections.abc import Iterator
from types import ModuleType
from typing import Annotated, Any

import pytest
from pydantic import BaseModel, TypeAdapter, ValidationError

from graspless_pin.geometry.bodies.shapes import SHAPES
from graspless_pin.geometry.robots import files
from graspless_pin.scene import body_schema, scene_schema
from graspless_pin.studies import study_schema


def models_of(module: ModuleType) -> Iterator[type[BaseModel]]:
    """The models that a module defines."""
    for _, model in inspect.getmembers(module, inspect.isclass):
        if issubclass(model, BaseModel) and model.__module__ == module.__name__:
            yield model


def fields_of(model: type[BaseModel]) -> Iterator[tuple[str, TypeAdapter[Any]]]:
    """Every field of a model by its name, with its type and its checks."""
    for key, field in model.model_fields.items():
        kind: Any = field.annotation
        for check in field.metadata:
            kind = Annotated[kind, check]
        yield f"{model.__name__}.{key}", TypeAdapter(kind)


def truths(node: dict[str, Any]) -> Iterator[Any]:
    """Values with true in the place of every number that a part of a JSON schema allows."""
    for branch in node.get("anyOf", []):
        yield from truths(branch)
    match node.get("type"):
        case "number" | "integer":
            yield True
            yield False
        case "array" if "prefixItems" in node:
            places = node["prefixItems"]
            yield from ([value] * len(places) for value in truths(places[0]))
        case "array":
            yield from ([value] for value in truths(node.get("items", {})))
        case "object" if isinstance(node.get("additionalProperties"), dict):
            yield from ({"name": value} for value in truths(node["additionalProperties"]))


MODULES = (body_schema, scene_schema, study_schema, files)
MODELS = [model for module in MODULES for model in models_of(module)]
EXPECTED = """SceneEntry.cone_edges ObjectEntry.mass BoxEntry.size PoseEntry.matrix
    MountEntry.concavity HandEntry.effort_limits SamplingEntry.samples SamplingEntry.seed
    VariableEntry.steps ComputeEntry.node_limit EffortEntry.limit TendonEntry.moment_arms
    RobotFile.concavity"""


def test_truth_values_are_no_numbers():
    numbers = set()
    for model in (*MODELS, *(shape.entry() for shape in SHAPES.values())):
        for name, adapter in fields_of(model):
            schema = adapter.json_schema()
            wrong = list(truths(schema))
            numbers.update([name] if wrong else [])
            # A study's values may be true or false themselves: those of keys that are.
            if wrong and "boolean" in str(schema):
                assert adapter.validate_python([True]) == [True], name
                continue
            for value in wrong:
                with pytest.raises(ValidationError):
                    pytest.fail(f"{name} is {adapter.validate_python(value)}")
    assert set(EXPECTED.split()) <= numbers
