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


def fields_of(model: type[BaseModel]) -> Iterator[Any]:
    """Every field of a model, with its type and its checks."""
    for key, field in model.model_fields.items():
        kind: Any = field.annotation
        for check in field.metadata:
            kind = Annotated[kind, check]
        yield pytest.param(TypeAdapter(kind), id=f"{model.__name__}.{key}")


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
NUMBERS = [
    field
    for model in (*MODELS, *(shape.entry() for shape in SHAPES.values()))
    for field in fields_of(model)
    if list(truths(field.values[0].json_schema()))
]


@pytest.mark.parametrize("adapter", NUMBERS)
def test_truth_values_are_no_numbers(adapter):
    # A study's values may be true or false themselves: those of keys that are.
    if "boolean" in str(adapter.json_schema()):
        assert adapter.validate_python([True]) == [True]
        return
    for value in truths(adapter.json_schema()):
        with pytest.raises(ValidationError):
            adapter.validate_python(value)


def test_there_are_numbers():
    expected = """SceneEntry.cone_edges ObjectEntry.mass BoxEntry.size PoseEntry.matrix
        MountEntry.concavity HandEntry.effort_limits SamplingEntry.samples SamplingEntry.seed
        VariableEntry.steps ComputeEntry.node_limit EffortEntry.limit TendonEntry.moment_arms
        RobotFile.concavity"""
    assert set(expected.split()) <= {field.id for field in NUMBERS}
