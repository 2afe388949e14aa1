"""The feedback that is said to be needed, tried a little below and a little above it in MuJoCo."""

from pathlib import Path

import pytest

from graspless_pin import load_scene, minimum_stiffness
from graspless_pin.simulation import SimulatedOutcome, simulate
from graspless_pin.simulation.model import STIFF

SPHERE = Path(__file__).parents[2] / "examples" / "allegro_sphere_on_slope.yaml"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_the_ball_stays_from_the_stated_feedback_on(algorithm):
    """With the rotors and damping of the simulated joints, on stiff contacts."""
    scene = load_scene(SPHERE)
    torques = scene.solve(algorithm).torques
    needed = minimum_stiffness(scene, torques, armature=1e-4, damping=0.02).stiffness
    for factor, held, seconds in ((0.9, False, 10.0), (1.1, True, 4.0)):
        (stiff,) = simulate(
            scene,
            torques,
            controller=factor * needed,
            seconds=seconds,
            contact_models=[STIFF],
        ).runs
        # Below it the ball may come to rest again a few millimetres off.
        assert (stiff.outcome is SimulatedOutcome.HELD) is held, (factor, stiff)
