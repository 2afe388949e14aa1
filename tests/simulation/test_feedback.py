"""The feedback that is said to be needed, tried a little below and a little above it in MuJoCo."""

from pathlib import Path

import pytest

from graspless_pin import load_scene, minimum_stiffness
from graspless_pin.simulation import SimulatedOutcome, simulate

SPHERE = Path(__file__).parents[2] / "examples" / "allegro_sphere_on_slope.yaml"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_the_ball_stays_from_the_stated_feedback_on(algorithm):
    """With the rotors and damping of the simulated joints, on stiff contacts."""
    scene = load_scene(SPHERE)
    torques = scene.solve(algorithm).torques
    needed = minimum_stiffness(scene, torques, armature=1e-4, damping=0.02).stiffness
    for factor, outcome, seconds in (
        (0.9, SimulatedOutcome.MOVED, 10.0),
        (1.1, SimulatedOutcome.HELD, 4.0),
    ):
        stiff = simulate(scene, torques, controller=factor * needed, seconds=seconds).runs[0]
        assert stiff.outcome is outcome, (factor, stiff)
