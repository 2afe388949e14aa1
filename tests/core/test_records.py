"""Records are frozen, records of arrays compare by identity, and what is returned is read-only."""

import pkgutil
from collections.abc import Mapping
from dataclasses import FrozenInstanceError, dataclass, fields, is_dataclass
from functools import cached_property
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from scenes import scene

import graspless_pin
from graspless_pin import (
    Uncertainty,
    compare_rules,
    contact_force_bounds,
    disturbance_margin,
    load_scene,
    margin_sensitivity,
    margin_torque_curve,
    maximize_margin,
    minimize_torque,
    optimum_gradients,
)
from graspless_pin.records import changed, unchecked

PACKAGES = (
    "problem", "modes", "programs", "solvers", "solution", "holding", "algorithms", "report.verify",
)  # fmt: skip
MUTABLE = {
    "CurveSearch", "ModeProver", "ModeOracle", "TreeProof", "RestWalk", "SearchState",
    "TreeWalk", "UnprovenSet", "_TorqueSearch", "_WarmState",
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
    assert dir(graspless_pin)


def changeable(value, where="it"):
    """Where arrays are writeable, and mappings and lists can be changed, fields of fields too."""
    if isinstance(value, np.ndarray):
        return [where] if value.flags.writeable else []
    if is_dataclass(value):
        names = [one.name for one in fields(value) if not one.name.startswith("_")]
        inside = {f".{name}": getattr(value, name) for name in names}
    elif isinstance(value, Mapping):
        inside = {f"[{key!r}]": one for key, one in value.items()}
    elif isinstance(value, tuple | list):
        inside = {f"[{index}]": one for index, one in enumerate(value)}
    else:
        return []
    own = [where] if isinstance(value, dict | list) else []
    return own + [place for name, one in inside.items() for place in changeable(one, where + name)]


CUBOID = Path(__file__).parents[2] / "examples" / "paper" / "cuboid_at_rest.yaml"
WHOLE = {
    "scene": lambda: load_scene(CUBOID),
    "changed scene": lambda: load_scene(CUBOID).with_changes(
        gravity=[0.0, 0.0, -1.0], friction={"default": 0.4}, tangent_axes=[[1.0, 0.0, 0.0]]
    ),
    "solution": lambda: load_scene(CUBOID).solve(),
    "proof": lambda: load_scene(CUBOID).solve().proof,
    "proof of a split search": lambda: maximize_margin(scene("up")).proof,
    "robust solution": lambda: load_scene(CUBOID).solve(uncertainty=Uncertainty(mass=0.1)),
    "comparison": lambda: compare_rules(scene("rest")),
    "verdict": lambda: load_scene(CUBOID).stability(load_scene(CUBOID).solve().torques),
    "sensitivity": lambda: margin_sensitivity(scene("rest")),
    "problem": lambda: scene("up"),
    "mode and forces": lambda: (
        (found := maximize_margin(scene("sphere"))).mode, found.contact_forces,
    ),
    "curve": lambda: margin_torque_curve(scene("rest")),
    "ranges": lambda: contact_force_bounds(scene("up"), maximize_margin(scene("up")).torques),
    "disturbances": lambda: disturbance_margin(scene("sphere"), directions=np.eye(6)),
    "gradients": lambda: optimum_gradients(minimize_torque(scene("rest"), 0.1)).values,
    "whether they are unique": lambda: optimum_gradients(maximize_margin(scene("up"))).unique,
}  # fmt: skip


@pytest.mark.parametrize("make", WHOLE.values(), ids=WHOLE)
def test_nothing_in_a_record_can_be_changed(make):
    """What was derived from it would be of other data, without a word."""
    assert changeable(make()) == []


@dataclass(frozen=True)
class Halved:
    whole: int

    def __post_init__(self) -> None:
        if self.whole % 2:
            raise ValueError("is odd")

    @cached_property
    def half(self) -> int:
        return self.whole // 2


def test_copies_of_records_are_not_checked_again_and_forget_what_they_are_told():
    one = Halved(8)
    assert one.half == 4
    other = changed(one, "half", whole=6)
    assert (type(other), other.whole, other.half) == (Halved, 6, 3)
    assert changed(one, whole=6).half == 4  # goes along: it was not said that it hangs on it
    assert (one.whole, one.half) == (8, 4)
    assert unchecked(Halved, whole=7).whole == 7
    with pytest.raises(FrozenInstanceError):
        other.whole = 2  # pyright: ignore[reportAttributeAccessIssue]
