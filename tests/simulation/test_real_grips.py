"""What is said of grips of real hands is what MuJoCo does: a slice of `make real-grips`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.grip_runs import growth_of
from benchmarks.real_grips import Case, cases, summary

from graspless_pin import load_scene
from graspless_pin.simulation import SimulatedOutcome, SimulatedRun, simulate
from graspless_pin.simulation.model import STIFF

GRIPS = sorted(Path(__file__).with_name("grips").glob("*.yaml"))


@pytest.mark.parametrize("file", GRIPS, ids=lambda file: file.stem)
def test_a_grip_does_as_it_is_said_to(file: Path) -> None:
    found = cases(file, ["margin"], soft=False)
    assert found and not [str(one) for one in found if one.is_odd]
    for one in found:
        if one.measured and one.holding == "needs_feedback":
            assert one.growth_is_near, str(one)


def test_normals_of_meshes_are_those_of_the_scene() -> None:
    """With that of one fingertip a degree off, the capsule rolls by half a millimetre."""
    scene = load_scene(next(file for file in GRIPS if file.stem == "dex3_right_capsule_3"))
    torques = scene.solve("torque", margin=0.1).torques
    (run,) = simulate(scene, torques, controller=0.2, contact_models=[STIFF]).runs
    assert run.displacement < 5e-5


@pytest.mark.parametrize("released", [1.0, 19.0])
def test_growth_counts_from_the_rest_wherever_the_run_is_released(released: float) -> None:
    """An object that has gone along by 19 starts before it is let go grows no faster for that."""
    rate, times = 40.0, np.linspace(0.0, 0.29, 30)
    size = released * np.exp(rate * times)
    rest, closing = np.eye(4), np.array([0.02, -0.01])
    poses = np.repeat(rest[None], len(times), axis=0)
    poses[:, 0, 3] = 1e-4 * size
    run = SimulatedRun(
        STIFF, SimulatedOutcome.MOVED, 0.1, 0.0, 0.1, {}, times, poses,
        closing + 1e-4 * size[:, None],
    )  # fmt: skip
    measured = growth_of(run, rest, closing)
    assert measured == pytest.approx(rate, rel=1e-6)


def test_what_is_not_as_it_is_said_to_be_is_listed() -> None:
    held = Case(
        grip="a", contacts=4, algorithm="margin", holding="holds", controller="constant",
        bodies="stiff", stiffness=0.0, growth=0.0, is_mesh=False, outcome="held", fingers=0.0,
        measured=None, displacement=0.0, rotation=0.0, seconds=0.1, said="holds",
    )  # fmt: skip
    lost = replace(held, grip="b", outcome="moved", displacement=0.02)
    bent = replace(held, grip="c", fingers=0.1)
    loose = replace(held, grip="d", holding="needs_feedback", stiffness=0.5, growth=2.0)
    text = summary([held, lost, bent, loose])
    listed = text.partition("Not as said, stiff bodies:")[2].split("\n- ")[1:]
    assert [line[0] for line in listed] == ["b", "c", "d"]
    assert "- 1 of 3 of answers with `holds`, held (33 %; wanted 99%)" in text
