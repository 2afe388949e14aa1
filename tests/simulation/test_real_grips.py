"""What is said of grips of real hands is what MuJoCo does: a slice of `make real-grips`."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from benchmarks.grip_runs import growth_between
from benchmarks.real_grips import Case, cases, summary

from graspless_pin import load_scene
from graspless_pin.simulation import SimulatedOutcome, SimulatedRun, simulate
from graspless_pin.simulation.model import STIFF

GRIPS = sorted(Path(__file__).with_name("grips").glob("*.yaml"))


@pytest.mark.sampled(10)
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


def test_growth_is_what_two_runs_part_by_whatever_both_do() -> None:
    """A shift while the object is let go, which both runs make, is no growth."""
    rate, times = 40.0, np.linspace(0.0, 0.1, 60)
    size = 1e-4 * np.exp(rate * times)

    def run(side: float) -> SimulatedRun:
        poses = np.repeat(np.eye(4)[None], len(times), axis=0)
        poses[:, 0, 3] = 5e-4 * times / times[-1] + side * size
        joints = 0.02 + side * size[:, None]
        return SimulatedRun(STIFF, SimulatedOutcome.MOVED, 0.1, 0.0, 0.1, {}, times, poses, joints)

    assert growth_between(run(1.0), run(-1.0)) == pytest.approx(rate, rel=1e-6)


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
