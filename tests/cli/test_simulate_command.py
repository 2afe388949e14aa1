"""``graspless-pin simulate``: exit codes, what it prints and what it writes."""

import os
import re
import sys
from dataclasses import replace

import pytest
from cli_tools import EXAMPLES, LINES, PAPER, assert_refused, run, spoilt

from graspless_pin import load_scene
from graspless_pin.cli.simulate import simulation_summary
from graspless_pin.findings import capture
from graspless_pin.simulation import SimulatedOutcome, simulate, video
from graspless_pin.simulation.protocol import load_mujoco

BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
CUBOID = PAPER / "cuboid_at_rest.yaml"
BRIEFLY = ("--seconds", "0.2")


def test_a_scene_that_holds():
    result = run("simulate", CUBOID, *BRIEFLY)
    assert result.exit_code == 0, result.output
    assert result.stdout.startswith("held: the object stays")
    assert "48.3496 .. 48.3496" in result.stdout
    assert "no force is outside these ranges by more than 1 % of the load" in result.stdout
    assert "verdict: holds: the object provably stays at rest" in result.stdout
    # Torques that are guaranteed, too.
    result = run("simulate", CUBOID, "--stability", "strong", *BRIEFLY)
    assert result.exit_code == 0, result.output
    assert "verdict: holds: the object provably stays at rest" in result.stdout


def test_a_scene_that_moves_has_a_time_lapse_and_is_held_by_feedback(tmp_path):
    file = tmp_path / "ball.html"
    moved = run("simulate", BALL, "--algorithm", "margin", "--seconds", "1.2", "--save", file)
    assert moved.exit_code == 1
    assert moved.stdout.startswith("moved: the object does not stay")
    needed = r"needs joint feedback of at least 0\.\d+ N m/rad; without it the object rolls"
    assert re.search(needed, moved.stdout)
    page = file.read_text(encoding="utf-8")
    assert "<strong>Moved.</strong>" in page
    assert "the object ball at each time" in page
    assert "http" not in page.replace("http-equiv", "")
    held = run("simulate", BALL, "--controller", "2", *BRIEFLY)
    assert held.exit_code == 0
    assert held.stdout.startswith("held: the object stays")


def test_the_first_line_names_bodies_with_another_outcome():
    scene = load_scene(CUBOID)
    found = simulate(scene, scene.solve().torques, seconds=0.01)
    stiff, soft = found.runs
    assert found.outcome is stiff.outcome is SimulatedOutcome.HELD
    crept = replace(found, runs=(stiff, replace(soft, outcome=SimulatedOutcome.CREPT)))
    first = simulation_summary(scene, crept).splitlines()[0]
    assert first == "held: the object stays (soft bodies: crept)"


def test_the_first_line_names_bodies_that_bear_nothing_where_some_force_is_proven():
    scene = load_scene(CUBOID)
    found = simulate(scene, scene.solve().torques, seconds=0.01)
    stiff, soft = found.runs
    finger, *_ = scene.contacts.bodies
    left = {name: force for name, force in soft.normal_forces.items() if name != finger}
    lost = replace(found, runs=(stiff, replace(soft, normal_forces=left)))
    first = simulation_summary(scene, lost).splitlines()[0]
    assert (
        first == f"held: the object stays; but at the end {finger} carries no force (soft bodies)"
    )


def test_options_change_the_outcome():
    assert run("simulate", CUBOID, "--friction-factor", "0.02", *BRIEFLY).exit_code == 1
    pushed = run("simulate", CUBOID, "--push", "-30,0,30", *BRIEFLY)
    assert pushed.exit_code == 1
    assert "no force ranges:" in pushed.stdout


def test_without_torques_there_is_nothing_to_simulate(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_text(LINES.replace("friction: 0.3", "friction: 0.3\nmax_normal_force: 2.0"))
    result = run("simulate", file)
    assert result.exit_code == 1
    assert result.stdout.startswith("no torques were found: ")


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--push", "1,2"), "--push: found '1,2'; needs three numbers such as 1,0,0"),
        (("--push", "1,2,nan"), "--push: found '1,2,nan'; needs three numbers"),
        (
            ("--save", "out.gif"),
            "--save: found 'out.gif'; needs a file that ends with .html or .mp4",
        ),
        (("--seconds", "-1"), "--seconds: is -1.0"),
        (("--controller", "-1"), "--controller: is -1.0"),
        (("--friction-factor", "-1"), "--friction-factor: is -1.0"),
        (("--save", "a.html", "--export", "a.html"), "--export: is the same file as --save"),
    ],
)
def test_bad_options_are_refused_before_anything_is_solved(options, message, tmp_path):
    file = tmp_path / "infeasible.yaml"
    file.write_text(LINES.replace("friction: 0.3", "friction: 0.3\nmax_normal_force: 2.0"))
    assert_refused(run("simulate", file, *options), message)


def test_a_motion_and_a_missing_file_are_refused():
    moving = run("simulate", PAPER / "cuboid_sliding_up.yaml")
    assert_refused(moving, "cuboid_sliding_up.yaml: motion: is not supported by the simulation")
    assert_refused(run("simulate", "nowhere.yaml"), "nowhere.yaml")


def test_a_body_without_friction_is_named(tmp_path):
    """Tables of friction may leave out links that touch nothing; the simulation needs all."""
    text = BALL.read_text(encoding="utf-8")
    file = tmp_path / "scene.yaml"
    tips = "{link_3.0_tip: 0.9, link_11.0_tip: 0.9, supports: 0.35}"
    file.write_text(spoilt("{hand: 0.9, supports: 0.35}", tips, text), encoding="utf-8")
    assert run("solve", file, "--no-verdict").exit_code == 0
    assert_refused(run("simulate", file), "scene.yaml: friction: has no coefficient for")


def test_without_mujoco_one_message_names_the_extra(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco", None)
    assert_refused(run("simulate", CUBOID), "pip install 'graspless-pin[simulate]'")
    assert run("solve", CUBOID, "--no-verdict").exit_code == 0


def test_the_model_is_written(tmp_path):
    file = tmp_path / "model.xml"
    assert run("simulate", CUBOID, "--export", file, *BRIEFLY).exit_code == 0
    model = load_mujoco().MjModel.from_xml_path(str(file))
    assert model.nu == 2
    printed = run("simulate", CUBOID, "--export", "-", *BRIEFLY)
    assert printed.stdout == file.read_text(encoding="utf-8")


def test_without_an_encoder_there_is_no_video(tmp_path, monkeypatch):
    monkeypatch.setattr(video, "_encoder", lambda: None)
    result = run("simulate", CUBOID, "--save", tmp_path / "cuboid.mp4", *BRIEFLY)
    assert result.exit_code == 0
    assert list(tmp_path.iterdir()) == []
    assert "warning: no video was written: no encoder was found" in result.stderr


@pytest.mark.parametrize(
    ("script", "why"),
    [
        ("echo No space left on device >&2; exit 1", "ffmpeg: No space left on device)"),
        ("cat > /dev/null; exit 3", "ffmpeg: exit code 3)"),
    ],
)
def test_an_encoder_that_fails_is_told_from_a_renderer(tmp_path, monkeypatch, script, why):
    encoder, file = tmp_path / "bin" / "ffmpeg", tmp_path / "cuboid.mp4"
    encoder.parent.mkdir()
    encoder.write_text(f"#!/bin/sh\n{script}\n", encoding="utf-8")
    encoder.chmod(0o700)
    monkeypatch.setenv("PATH", str(encoder.parent), prepend=os.pathsep)
    result = run("simulate", CUBOID, "--save", file, *BRIEFLY)
    if "MuJoCo cannot draw here" in result.stderr:
        pytest.skip("MuJoCo cannot draw here")
    assert result.exit_code == 0 and not file.exists()
    told = " ".join(result.stderr.split())
    assert f"warning: no video was written: the encoder failed ({encoder.parent}/{why}" in told


def test_each_frame_goes_to_the_encoder(tmp_path, monkeypatch):
    """This one stores what it gets: 24 bits for each pixel of each second pose."""
    encoder, file = tmp_path / "encoder.sh", tmp_path / "cuboid.mp4"
    encoder.write_text('#!/bin/sh\nfor last; do :; done\ncat > "$last"\n', encoding="utf-8")
    encoder.chmod(0o700)
    monkeypatch.setattr(video, "_encoder", lambda: str(encoder))
    scene = load_scene(CUBOID)
    found = simulate(scene, scene.solve().torques, seconds=0.2)
    with capture() as findings:
        video.write_video(found, file)
    if any("MuJoCo cannot draw here" in one.message for one in findings):
        pytest.skip("MuJoCo cannot draw here")
    frames = (len(found.runs[0].T_world_object) + 1) // 2
    assert file.stat().st_size == frames * 480 * 640 * 3
