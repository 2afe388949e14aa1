"""Which files commands may replace, and that outputs are checked before anything is computed."""

import json
from pathlib import Path

import pytest
from cli_tools import LINES, ROOT, assert_refused, run

MODEL = """\
<mujoco model="lever">
  <compiler angle="radian"/>
  <include file="part.xml"/>
</mujoco>
"""
PART = """\
<mujoco>
  <worldbody>
    <body name="palm">
      <geom name="palm" type="sphere" size="0.005" contype="0" conaffinity="0"/>
      <body name="finger">
        <joint name="hinge" type="hinge" axis="0 0 1" range="-1.5 1.5"/>
        <geom name="tip" type="capsule" fromto="0 0 0 0.1 0 0" size="0.002" mass="0.1"/>
      </body>
    </body>
  </worldbody>
  <actuator>
    <motor name="motor" joint="hinge" ctrlrange="-1 1" ctrllimited="true"/>
  </actuator>
</mujoco>
"""
QUICK = {
    "solve": ("--no-verdict", "--json"),
    "tolerances": ("--json",),
    "report": ("--no-verdict", "--no-ranges", "-o"),
    "simulate": ("--seconds", "0.1", "--export"),
}


@pytest.fixture
def scene(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    file = Path("scene.yaml")
    file.write_text(LINES)
    return file


@pytest.mark.parametrize("name", ["hand.xml", "part.xml"])
def test_what_a_scene_reads_is_never_replaced(scene, name):
    Path("hand.xml").write_text(MODEL)
    Path("part.xml").write_text(PART)
    scene.write_text(
        LINES.replace("robot: lever_100mm", "urdf: hand.xml\n  fingers: {one: {joints: [hinge]}}")
    )
    before = Path(name).read_text()
    for options in ((), ("--overwrite",)):
        refused = run("simulate", scene, "--export", name, *options)
        told = "is an input of this command and would be lost" if options else "exists already"
        assert_refused(refused, f"--export: {name} {told}")
    assert Path(name).read_text() == before


def test_robot_files_and_documents_are_never_replaced(scene):
    for file in (ROOT / "robots").glob("lever_100mm.*"):
        Path(file.name).write_bytes(file.read_bytes())
    scene.write_text(LINES.replace("lever_100mm", "lever_100mm.yaml"))
    for command in ("settle", "close", "place"):
        refused = run(command, scene, "-o", "lever_100mm.yaml", "--overwrite")
        assert_refused(refused, "--output: lever_100mm.yaml is an input of this command")
    refused = run("new", "lever_100mm.yaml", "box:1,1,1", "-o", "lever_100mm.yaml", "--overwrite")
    assert_refused(refused, "--output: lever_100mm.yaml is an input of this command")
    assert run("solve", scene, "--no-verdict", "--json", "sol.json").exit_code == 0
    refused = run("report", "sol.json", "-o", "sol.json", "--overwrite")
    assert_refused(refused, "--output: sol.json is an input of this command")
    refused = run("plot", scene, "--kind", "tolerances", "-o", scene)
    assert_refused(refused, "--output: scene.yaml must end with .png")


def test_a_scene_file_may_be_replaced_by_its_own_next_state(scene):
    assert_refused(run("settle", scene, "-o", scene), "replace it (--overwrite)")
    assert run("settle", scene, "-o", scene, "--overwrite").exit_code == 0


@pytest.mark.parametrize("command", QUICK)
@pytest.mark.usefixtures("without_plots")
def test_own_files_are_replaced_and_others_are_not(scene, command):
    file = Path("out.html" if command == "report" else "out.json")
    options = *QUICK[command], file
    for foreign in ('{"mine": 1}', "<!DOCTYPE html>\n<title>mine</title>", "<mujoco/>", ""):
        file.write_text(foreign)
        assert_refused(run(command, scene, *options), f"{file} exists already and is not a ")
        assert file.read_text() == foreign
    written = run(command, scene, *options, "--overwrite")
    assert written.exit_code in (0, 1), written.output
    assert file.read_text() != foreign
    again = run(command, scene, *options)
    assert again.exit_code == written.exit_code, again.output


def test_a_solution_is_not_replaced_by_tolerances(scene):
    assert run("solve", scene, "--no-verdict", "--json", "a.json").exit_code == 0
    refused = run("tolerances", scene, "--json", "a.json")
    assert_refused(
        refused, "--json: a.json exists already and is not a table of tolerances; choose"
    )
    assert "certificate" in json.loads(Path("a.json").read_text())


def test_pages_of_simulations_are_told_from_others(scene):
    page = Path("page.html")
    page.write_text("<!DOCTYPE html><title>mine</title>")
    refused = run("simulate", scene, "--save", page)
    assert_refused(refused, "--save: page.html exists already and is not a page of graspless-pin")
    for options in (("--overwrite",), ()):
        made = run("simulate", scene, "--seconds", "0.1", "--save", page, *options)
        assert made.exit_code in (0, 1), made.output


@pytest.mark.parametrize("command", [*QUICK, "settle", "plot"])
def test_outputs_are_checked_before_anything_is_computed(scene, command):
    Path("file").touch()
    Path("folder.png").mkdir()
    options = QUICK.get(command, ("-o",))
    if command == "plot":
        options = "--kind", "squeeze", *options
    assert_refused(run(command, scene, *options, "folder.png"), "folder.png is a folder; name a")
    assert_refused(run(command, scene, *options, "file/x.png"), "file/x.png' cannot be written (")
