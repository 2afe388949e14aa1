"""Gradients of robust optima by the figures of the set, against differences of whole solves."""

from functools import partial
from typing import Any

import numpy as np
import pytest

from graspless_pin import (
    SlidingMode,
    Uncertainty,
    load_scene,
    maximize_margin,
    minimize_torque,
    uncertainty_gradients,
)
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.errors import ArgumentError, NoSolutionError

STEP = 1e-3  # of a figure


def differences(solve: Any, given: dict[str, Any], name: str) -> np.ndarray:
    """Central differences of the optimum by each entry of a figure."""
    figure = np.asarray(given[name], dtype=float)

    def value(place: int, times: float) -> float:
        other = figure.copy().reshape(-1)
        other[place] *= times
        shaped = other.reshape(figure.shape) if figure.ndim else float(other[0])
        return solve(uncertainty=Uncertainty(**{**given, name: shaped})).solution.value

    found = [
        (value(k, 1.0 + STEP) - value(k, 1.0 - STEP)) / (2.0 * STEP * size)
        for k, size in enumerate(figure.reshape(-1).tolist())
    ]
    return np.array(found).reshape(figure.shape)


def agree(solve: Any, given: dict[str, Any]) -> None:
    found = uncertainty_gradients(solve(uncertainty=Uncertainty(**given)))
    moved = 0
    for name in given:
        values = found.values[name]
        if np.ndim(given[name]) == 0 and values.ndim:
            values = values.sum()  # one figure for all axes
        assert found.unique[name].all()
        np.testing.assert_allclose(values, differences(solve, given, name), rtol=2e-3, atol=1e-5)
        moved += bool(np.abs(values).max() > 1e-3)
    assert moved
    assert np.isnan(found.values["tilt"]) or "tilt" in given


@pytest.mark.parametrize("algorithm", [maximize_margin, partial(minimize_torque, margin=0.02)])
@pytest.mark.parametrize(
    ("name", "given", "feedback"),
    [
        (
            "paper/cuboid_at_rest",
            {"mass": 0.1, "force": [0.1, 0.2, 0.05], "friction": 0.1, "torque": [0.02, 0.03]},
            None,
        ),
        ("paper/cuboid_at_rest", {"center_of_mass": 0.01, "torque_offset": 0.02}, None),
        ("paper/cuboid_sliding_up", {"friction": 0.1, "mass": 0.1}, None),
        ("allegro_sphere_on_slope", {"mass": 0.2, "center_of_mass": 0.004}, 1.0),
    ],
)
def test_gradients_are_differences(algorithm, name, given, feedback):
    problem = load_scene(f"examples/{name}.yaml").problem().with_changes(cone_edges=8)
    agree(partial(algorithm, problem, static_friction="coulomb", feedback=feedback), given)


def test_gradients_of_a_scene_by_its_tilt_and_of_motors_that_lack_effort():
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    tilted = partial(scene.solve, "torque", margin=0.02, static_friction="coulomb")
    agree(tilted, {"tilt": 0.03, "mass": 0.1})
    weak = scene.problem().with_changes(torque_limits=(-1.5, 1.5))
    agree(partial(maximize_margin, weak, static_friction="coulomb"), {"effort": 0.1, "mass": 0.1})


def test_gradients_in_one_mode():
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem().with_changes(cone_edges=8)
    best = minimize_torque(problem, 0.02, uncertainty=Uncertainty(mass=0.2))
    every = best.solution.given_mode
    assert every is not None
    size = problem.contact_count
    mode = SlidingMode(every.selection[:size], every.signs[:size])
    agree(partial(minimize_torque, problem, 0.02, mode=mode), {"mass": 0.2, "force": 0.05})


def test_what_has_no_gradients():
    problem = load_scene("examples/paper/sphere_on_slope.yaml").problem()
    unknown = Uncertainty(mass=0.2, center_of_mass=0.01)
    none = minimize_torque(problem, 0.1, static_friction="coulomb", uncertainty=unknown)
    with pytest.raises(NoSolutionError):
        uncertainty_gradients(none)
    bare = RobustSolution(none.solution, none.coverage, none.bound, none.members, none.joint_names)
    with pytest.raises(ArgumentError, match="does not state its uncertainty"):
        uncertainty_gradients(bare)
