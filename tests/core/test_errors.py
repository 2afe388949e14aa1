"""Errors keep their data and message on the way from one process to another."""

import pickle

import pytest

from graspless_pin.errors import (
    ArgumentError,
    GrasplessPinError,
    NoSolutionError,
    SceneError,
    StateError,
    StateFault,
    TextError,
)

ERRORS = [
    (ArgumentError("friction", "is -1.0 at index 2"), "friction: is -1.0 at index 2"),
    (SceneError("scene.yaml:3: friction: is -1"), "scene.yaml:3: friction: is -1"),
    (StateError(StateFault.BLOCKED, "box runs into floor"), "box runs into floor"),
    (NoSolutionError("nothing to read"), "nothing to read"),
    (TextError("is not plain YAML", 3), "is not plain YAML"),
]


@pytest.mark.parametrize(("error", "message"), ERRORS)
def test_an_error_survives_pickling(error, message):
    read = pickle.loads(pickle.dumps(error))  # noqa: S301
    assert type(read) is type(error)
    assert isinstance(read, GrasplessPinError)
    assert str(read) == str(error) == message
    assert vars(read) == vars(error)


def test_an_argument_error_names_the_argument():
    assert ArgumentError("normals", "has no row").argument == "normals"


@pytest.mark.parametrize("fault", StateFault)
def test_a_place_before_the_message_keeps_what_is_wrong(fault):
    error = StateError(fault, "box and floor").at("scene.yaml").at("study.yaml")
    assert isinstance(error, SceneError)
    assert error.kind is fault
    assert str(error) == "study.yaml: scene.yaml: box and floor"
