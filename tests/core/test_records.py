"""Records are frozen, records of arrays compare by identity, and what is returned is read-only."""

import pkgutil
from dataclasses import fields, is_dataclass
from importlib import import_module

import numpy as np
import pytest
from scenes import scene

import graspless_pin
from graspless_pin import (
    contact_force_bounds,
    disturbance_margin,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    optimum_gradients,
)

PACKAGES = (
    "problem", "modes", "programs", "solvers", "solution", "holding", "algorithms", "report.verify",
)  # fmt: skip
MUTABLE = {
    "CurveSearch", "KeptWalk", "ModeProver", "ModeOracle", "Proof", "RestWalk", "SearchState",
    "TreeWalk", "_Node", "_Search", "_WarmState",
}  # fmt: skip
"""They gather what they find."""


def records():
    for package in PACKAGES:
        root = import_module(f"graspless_pin.{package}")
        names = [one.name for one in pkgutil.walk_packages(root.__path__, f"{root.__name__}.")]
        for name in names:
            for kind in vars(import_module(name)).values():
                if isinstance(kind, type) and is_dataclass(kind) and kind.__module__ == name:
                    yield kind


@pytest.mark.parametrize("kind", list(records()), ids=lambda kind: kind.__name__)
def test_records_are_frozen(kind):
    options = kind.__dataclass_params__
    assert options.frozen or kind.__name__ in MUTABLE
    arrays = any("Array" in str(one.type) or "ndarray" in str(one.type) for one in fields(kind))
    # Two arrays are neither equal nor different: comparing records of them would be an error.
    assert not (options.frozen and options.eq and arrays)


def test_there_are_many_records():
    assert len(list(records())) > 30
    assert graspless_pin.__all__


def arrays_of(record):
    for name in (one.name for one in fields(record)):
        value = getattr(record, name)
        if isinstance(value, np.ndarray):
            yield name, value


RESULTS = {
    "curve": lambda: margin_torque_curve(scene("rest")),
    "ranges": lambda: contact_force_bounds(scene("up"), maximize_margin(scene("up")).torques),
    "disturbances": lambda: disturbance_margin(scene("sphere"), directions=np.eye(6)),
    "gradients": lambda: optimum_gradients(minimize_torque(scene("rest"), 0.1)).values,
}


@pytest.mark.parametrize("make", RESULTS.values(), ids=RESULTS)
def test_arrays_of_results_are_read_only(make):
    found = list(arrays_of(make()))
    assert found
    for name, value in found:
        assert not value.flags.writeable, name


def test_arrays_of_gradients_say_read_only_whether_they_are_unique():
    gradients = optimum_gradients(minimize_torque(scene("rest"), 0.1))
    assert gradients.unique
    for name, value in gradients.unique.items():
        assert value.dtype == bool and not value.flags.writeable, name
