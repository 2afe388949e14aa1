"""Exit codes, what goes to which stream, and how the JSON file is written."""

import json
import os
import platform
import re
import shutil
import stat
import subprocess
import sys
import threading
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pytest
import trimesh
from cli_tools import ALLEGRO, LINES, PAPER, ROOT, assert_refused, run, solve_text, spoilt
from matplotlib.image import imread

from graspless_pin import Status, bounds, compiled, contact_force_bounds, load_scene
from graspless_pin.cli import solve
from graspless_pin.scene import scene_json_schema

SPHERE = PAPER / "sphere_on_slope.yaml"
HEAVY = spoilt("friction: 0.3", "friction: 0.3\nmax_normal_force: 1")


def test_exit_code_0_prints_the_tables():
    result = run("solve", ALLEGRO, "--no-verdict")
    assert result.exit_code == 0 and result.stderr == ""
    for word in ("joint", "gravity", "of limit", "touching", "of mu", "slides", "certificate"):
        assert word in result.stdout
    assert "link_3.0_tip" in result.stdout and "slope" in result.stdout
    assert "margin e = 0.743" in result.stdout


def test_what_matters_stands_before_the_tables():
    result = run("solve", PAPER / "cuboid_sliding_up.yaml")
    head = " ".join(result.stdout.split("\n\n")[0].split())
    places = [
        head.index(words)
        for words in (
            "keeps its motion: nothing else is an outcome",
            "margin e = 2.30006 N",
            "These torques do not enforce that margin: it may be as small as 0 N, over all",
            "The margin is limited by the distance to losing contact at contacts 3, 4",
            "/hinge is nearest its limit: ",  # both fingers are, up to rounding
            "4.7700 of ",
        )
    ]
    assert places == sorted(places)
    alone = run("solve", PAPER / "cuboid_sliding_up.yaml", "--no-verdict").stdout
    assert "keeps its motion" not in alone and "enforce" not in alone
    assert "The margin is limited by" in alone


@pytest.mark.parametrize(
    "name", ["allegro_mug_against_wall", "panda_arm_drag_board", "trihand_pivot_box"]
)
@pytest.mark.sampled(1)
def test_the_margin_at_worst_of_an_example_is_proven_on_any_machine(name, monkeypatch):
    asked = []
    monkeypatch.setattr(solve, "contact_force_bounds", lambda *_, **options: asked.append(options))
    scene = load_scene(ROOT / "examples" / f"{name}.yaml")
    solution = scene.solve()
    solve._force_bounds(scene, solution)
    del asked[0]["time_limit"]
    worst = contact_force_bounds(scene.problem(), solution.torques, **asked[0])
    assert worst.status is Status.OPTIMAL


def test_guaranteed_torques_state_what_they_cost_and_verify(tmp_path):
    file = tmp_path / "solution.json"
    result = run("solve", PAPER / "cuboid_at_rest.yaml", "--stability", "strong", "--json", file)
    assert result.exit_code == 0, result.output
    told = r"holds: the object provably stays at rest \(\d+ LPs\); no small motion grows"
    assert re.search(told, result.stdout)
    assert "guaranteed: 0 N from the best case (1.65039 N)" in result.stdout
    checked = run("verify", file)
    assert checked.exit_code == 0, checked.output
    assert "the torques are guaranteed: verdict: strong" in checked.stdout
    *_, empty, last = checked.stdout.splitlines()
    assert empty == "" and last.startswith("Verified: all figures and proofs of the document, in ")


def test_exit_code_1_says_why_and_writes_the_document(tmp_path):
    file = tmp_path / "solution.json"
    result = solve_text(tmp_path, HEAVY, "--json", file)
    assert result.exit_code == 1 and result.stderr == ""
    assert "not found: infeasible\n\nNo contact forces inside the friction cones" in result.stdout
    assert json.loads(file.read_text())["found"] is False


def test_the_program_itself(tmp_path):
    """Streams and exit code of the real process, C++ output included."""
    trimesh.creation.box((0.2, 0.2, 0.2)).export(tmp_path / "box.stl")
    mesh = spoilt("{type: box, size: [0.2, 0.2, 0.2]}", "{type: mesh, path: box.stl}", HEAVY)
    (tmp_path / "heavy.yaml").write_text(mesh)
    heavy = subprocess.run(  # noqa: S603 - our own program
        [Path(sys.executable).with_name("graspless-pin"), "solve", "heavy.yaml", "--json", "-"],
        cwd=tmp_path, capture_output=True, text=True, check=False, timeout=600,
    )  # fmt: skip
    assert (heavy.returncode, heavy.stderr) == (1, "")
    assert json.loads(heavy.stdout)["found"] is False


@pytest.mark.parametrize("there", [True, False], ids=["compiled", "numpy"])
def test_the_version_says_which_compiled_loops_run(there, monkeypatch):
    monkeypatch.setattr(compiled, "core", object() if there else None)
    result = run("--version")
    assert result.exit_code == 0
    first, second = result.output.splitlines()
    assert first == f"graspless-pin {version('graspless-pin')}, Python {platform.python_version()}"
    loops = "yes" if there else "none, numpy is used instead and is slower; "
    assert second.startswith(f"compiled loops: {loops}")


@pytest.mark.parametrize("command", [(), ("solve",), ("robots",)], ids=" ".join)
def test_help_has_a_short_name(command):
    short, long = run(*command, "-h"), run(*command, "--help")
    assert short.exit_code == 0
    assert short.output == long.output
    assert "Usage:" in short.output


@pytest.mark.parametrize(
    "arguments",
    [
        (),
        ("solve",),
        ("solve", SPHERE, "--algorithm", "best"),
        ("solve", SPHERE, "--sign-rule", "lax"),
        ("solve", SPHERE, "--margin", "much"),
        ("solve", SPHERE, "--colour", "red"),
        ("slove", SPHERE),
    ],
)
def test_wrong_usage_is_exit_code_2(arguments):
    result = run(*arguments)
    assert result.exit_code == 2
    assert "Traceback" not in result.output
    assert "Usage:" in result.output


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--algorithm", "torque", "--margin", "-1"), "error: --margin: is -1.0; it"),
        (("--algorithm", "torque", "--margin", "nan"), "error: --margin: is nan; it"),
        (("--algorithm", "torque", "--margin", "1e200"), "is 1e+200; it must be from 0 to 1e+30"),
        (("--node-limit", "0"), "error: --node-limit: is 0"),
        (("--solver", "gurobi2"), "error: --solver: 'gurobi2' is unknown or not installed"),
        (
            ("--scale", "limits"),
            "error: --scale: has no effect with algorithm 'margin'; use",
        ),
    ],
)
def test_bad_options(options, message):
    assert_refused(run("solve", SPHERE, *options), message)


def test_what_is_no_choice_is_told_with_the_nearest():
    for algorithm in ("Torque", "torqe"):
        said = " ".join(run("solve", SPHERE, "--algorithm", algorithm).output.split())
        assert f"'{algorithm}' is not one of 'margin', 'torque'." in said.replace(" │ │ ", " ")
        assert "Did you mean 'torque'?" in said.replace(" │ │ ", " ")
        assert "Value error" not in said


def test_shapes_and_tables_that_are_none(tmp_path):
    for text in ("cube:0.06", "cube:6,5,8"):
        refused = run("new", "allegro_right", text, "-o", tmp_path / "scene.yaml")
        assert_refused(refused, "error: OBJECT: 'cube' is not a shape; known: ")
    refused = run("plot", SPHERE, "-o", tmp_path / "x.png")
    assert_refused(refused, f"error: TABLE|SCENE: {SPHERE} is not a table; for a scene choose")
    assert not [*tmp_path.iterdir()]


def test_arguments_are_named_as_the_help_does():
    assert_refused(run("example", "foo"), "error: NAME: there is no example 'foo'")
    refused = run("close", ALLEGRO, "-o", "x.yaml", "--finger", "pinky")
    assert_refused(refused, "error: --finger: unknown finger 'pinky'")


def solved(*options):
    result = run("solve", SPHERE, "--no-verdict", *options, "--json", "-")
    assert result.exit_code == 0
    return json.loads(result.stdout)


def test_options_reach_the_algorithms():
    assert solved()["algorithm"] == "margin"
    assert solved()["margin"] == pytest.approx(1.4509, abs=1e-4)
    least = solved("--algorithm", "torque", "--margin", "0.3")
    assert least["algorithm"] == "torque" and least["required_margin"] == 0.3
    assert least["margin"] == pytest.approx(0.3, rel=1e-4)
    rules = solved("--sign-rule", "exact", "--sliding-rule", "constrained")["rules"]
    assert (rules["sign_rule"], rules["sliding_rule"]) == ("exact", "constrained")
    coulomb = solved("--static-friction", "coulomb", "--solver", "clarabel")
    assert coulomb["rules"]["static_friction"] == "coulomb"
    assert coulomb["certificate"]["solver"] == "clarabel"
    assert solved("--algorithm", "torque", "--scale", "limits")["found"]


def test_the_scenes_own_options_count_unless_overruled(tmp_path):
    text = spoilt("friction: 0.3", "friction: 0.3\nsolve: {algorithm: torque, margin: 0.2}")
    own = json.loads(solve_text(tmp_path, text, "--json", "-").stdout)
    assert (own["algorithm"], own["required_margin"]) == ("torque", 0.2)
    other = json.loads(solve_text(tmp_path, text, "--margin", "0.05", "--json", "-").stdout)
    assert (other["algorithm"], other["required_margin"]) == ("torque", 0.05)
    best = json.loads(solve_text(tmp_path, text, "--algorithm", "margin", "--json", "-").stdout)
    assert best["algorithm"] == "margin"


def test_friction_by_directions(tmp_path):
    text = spoilt("friction: 0.3", "friction: 0.3\nsolve: {sign_rule: direction}")
    told = run("solve", SPHERE, "--sign-rule", "direction", "--direction-gap", "1e-3")
    for result, value in ((solve_text(tmp_path, text), "0.384001"), (told, "1.45735")):
        assert result.exit_code == 0
        line = result.stdout.splitlines()[-1]
        assert line == f"rule of directions, round cones: inner value {value}, outer {value} N"
    refused = run("solve", SPHERE, "--sign-rule", "direction", "--json", "-")
    assert_refused(refused, "--sign-rule: is 'direction', but a document requires modes with signs")
    refused = run("solve", SPHERE, "--sign-rule", "direction", "--direction-gap", "1e-9")
    assert_refused(refused, "--direction-gap: is 1e-09; it must be a finite number >= 1e-06")


def test_a_json_file_is_the_same_document_beside_the_tables(tmp_path):
    file = tmp_path / "solution.json"
    result = run("solve", SPHERE, "--no-verdict", "--json", file)
    assert result.exit_code == 0 and "margin e = " in result.stdout
    assert file.read_text() == run("solve", SPHERE, "--no-verdict", "--json", "-").stdout
    assert [path.name for path in tmp_path.iterdir()] == ["solution.json"]
    # It is as readable as any other file.
    other = tmp_path / "other"
    other.touch()
    assert stat.S_IMODE(file.stat().st_mode) == stat.S_IMODE(other.stat().st_mode)


@pytest.mark.parametrize(
    ("options", "told"),
    [
        (("--no-verdict", "--verdict-nodes", "5"), "--verdict-nodes: has no effect with"),
        (("--no-verdict", "--controller", "5"), "--controller: has no effect with"),
        (("--direction-gap", "0.1"), "--direction-gap: has no effect with this sign rule"),
        (
            ("--static-friction", "coulomb", "--search", "enumerate"),
            "--search: has no effect with --static-friction coulomb",
        ),
    ],
)
def test_options_that_would_change_nothing_are_refused(options, told):
    assert_refused(run("solve", PAPER / "cuboid_at_rest.yaml", *options), told)


def test_options_that_the_scene_gives_a_meaning_are_taken(tmp_path):
    """What stands in the scene file is never refused."""
    text = f"{LINES}solve: {{sign_rule: exact, direction_gap: 0.1, stability: strong}}\n"
    given = "--no-verdict", "--verdict-nodes", "5", "--controller", "5"
    assert solve_text(tmp_path, text, *given, "--static-friction", "coulomb").exit_code != 2


@pytest.mark.parametrize(
    "command",
    [
        ("solve", "--no-verdict"),
        ("robustness",),
        ("tolerances",),
        ("tolerances", "--json", "-"),
        ("report", "--no-verdict", "--no-ranges"),
        ("simulate", "--seconds", "0.1"),
        ("plot", "--kind", "tolerances", "-o", "x.png"),
    ],
)
@pytest.mark.usefixtures("without_plots")
def test_no_command_ends_with_0_where_a_finding_is_serious(command, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    scene = tmp_path / "scene.yaml"
    scene.write_text(spoilt("position: [-0.1, -0.1, 0.0]", "position: [-0.6, -0.1, 0.0]"))
    name, *options = command
    result = run(name, scene, *options)
    assert "[hand-touches-nothing]" in result.stderr
    assert result.exit_code == 4, result.output


def test_settling_an_object_is_done_before_the_hand_is_placed(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(spoilt("position: [-0.1, -0.1, 0.0]", "position: [-0.6, -0.1, 0.0]"))
    settled = run("settle", scene, "-o", tmp_path / "settled.yaml")
    assert settled.exit_code == 0 and settled.stderr == ""


def test_bad_input_leaves_the_json_file_alone(tmp_path):
    file = tmp_path / "solution.json"
    file.write_text("old")
    assert solve_text(tmp_path, "", "--json", file).exit_code == 2
    assert file.read_text() == "old"


@pytest.mark.parametrize("step", ["write_text", "replace"])
def test_a_failed_write_keeps_what_was_there(tmp_path, monkeypatch, step):
    file = tmp_path / "solution.json"
    old = '{"format": 2, "status": "optimal"}'
    file.write_text(old)

    def fail(path, *_, **__):
        path.touch()  # a disk that fills up leaves a part of the draft behind
        raise OSError(28, os.strerror(28), str(path))

    with monkeypatch.context() as patch:
        patch.setattr(Path, step, fail)
        result = run("solve", SPHERE, "--no-verdict", "--json", file)
    told = f"{file}: cannot be written (No space left on device); choose another"
    assert_refused(result, told, "margin e = ")
    assert file.read_text() == old
    assert [path.name for path in tmp_path.iterdir()] == ["solution.json"]


@pytest.mark.parametrize(
    "command",
    [
        ("solve", "--no-verdict", "--json"),
        ("report", "--no-verdict", "--no-ranges", "-o"),
        ("settle", "-o"),
        ("new", "-o"),
        ("plot", "--kind", "tolerances", "-o"),
        ("simulate", "--export"),
    ],
)
@pytest.mark.usefixtures("without_plots")
def test_folders_of_outputs_are_made(command, tmp_path):
    """Paths in scene files are those from there."""
    scene, folder = tmp_path / "scene.yaml", tmp_path / "a" / "b"
    scene.write_text(LINES.replace("lever_100mm", "lever_100mm.yaml"), encoding="utf-8")
    for file in (ROOT / "robots").glob("lever_100mm.*"):
        shutil.copy(file, tmp_path)
    name, *options = command
    source = ("lever_100mm", "sphere:0.03") if name == "new" else (scene,)
    suffix = {"settle": ".yaml", "new": ".yaml", "plot": ".png", "report": ".html"}
    file = folder / f"out{suffix.get(name, '.json')}"
    result = run(name, *source, *options, file)
    assert result.exit_code in (0, 1), result.output
    assert file.is_file()


def test_a_pipe_is_written_to_and_not_replaced(tmp_path):
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    received = []
    reader = threading.Thread(target=lambda: received.append(pipe.read_text()), daemon=True)
    reader.start()
    result = run("solve", SPHERE, "--no-verdict", "--json", pipe)
    reader.join(timeout=300)
    assert result.exit_code == 0
    assert json.loads(received[0])["found"] is True
    assert pipe.is_fifo()


def test_schema_prints_the_schema():
    result = run("schema")
    assert result.exit_code == 0
    assert json.loads(result.stdout) == scene_json_schema()


def test_the_schema_of_studies_states_their_bounds():
    parts = json.loads(run("schema", "--study").stdout)["$defs"]

    def most(part, key):
        return parts[part]["properties"][key]["anyOf"][0]["maximum"]

    assert most("SamplingEntry", "samples") == bounds.MOST_SAMPLES
    assert most("VariableEntry", "steps") == bounds.MOST_SAMPLES
    assert most("SamplingEntry", "depth") == bounds.DEEPEST_HALVINGS
    for key in ("time_limit", "sample_time_limit"):
        assert most("ComputeEntry", key) == bounds.LONGEST_TIME


def test_commands_that_need_torques_take_the_figures_of_algorithms():
    def told(command, *options):
        return run(command, PAPER / "cuboid_at_rest.yaml", *options)

    asked = ("--algorithm", "torque")
    by_default, other = (told("tolerances", *asked, *more) for more in ((), ("--margin", "0.4")))
    assert other.exit_code == by_default.exit_code == 0
    assert other.stdout != by_default.stdout  # more margin, other torques
    for command in ("tolerances", "robustness", "simulate"):
        useless = told(command, "--algorithm", "margin", "--margin", "0.4")
        assert useless.exit_code == 2
        assert "--margin: has no effect with algorithm" in useless.stderr


@pytest.mark.usefixtures("without_plots")
def test_a_report_is_of_the_algorithm_that_is_asked_for(tmp_path: Path):
    page = tmp_path / "page.html"
    asked = ("--algorithm", "torque", "--margin", "0.4", "--no-ranges", "--no-verdict", "-o", page)
    assert run("report", PAPER / "cuboid_at_rest.yaml", *asked).exit_code == 0
    assert "at a margin of 0.4 N" in page.read_text(encoding="utf-8")


def test_a_report_of_a_document_takes_no_option_of_scenes(tmp_path: Path):
    (tmp_path / "answer.json").write_text("{}", encoding="utf-8")
    refused = run("report", tmp_path / "answer.json", "--margin", "0.4")
    assert refused.exit_code == 2 and "--margin: requires a scene file" in refused.stderr


def test_tolerances_are_told_in_their_units():
    told = run("tolerances", PAPER / "cuboid_at_rest.yaml", "--algorithm", "torque")
    assert told.exit_code == 0 and "With --controller K" in told.stdout
    for words in ("more mass", "centre of mass", " cm", " deg", "push", " N m"):
        assert words in told.stdout
    ball = ROOT / "examples" / "allegro_sphere_on_slope.yaml"
    held = run("tolerances", ball, "--controller", "1").stdout
    masses = [text.split("%")[0].split()[-1] for text in (held, run("tolerances", ball).stdout)]
    assert float(masses[0]) > 1.0 and float(masses[1]) == 0.0
    assert "--controller" not in held
    assert run("tolerances", ball, "--controller", "-1").exit_code == 2


def test_tolerances_are_drawn_by_direction(tmp_path: Path):
    ball, picture = ROOT / "examples" / "allegro_sphere_on_slope.yaml", tmp_path / "ball.svg"
    drawn = run("plot", ball, "--kind", "tolerances", "--controller", "1", "-o", picture)
    assert drawn.exit_code == 0 and f"wrote {picture}" in drawn.stdout
    assert "centre of mass" in drawn.stdout and "more mass" not in drawn.stdout
    assert picture.read_text(encoding="utf-8").count("smallest: ") == 3
    image = picture.with_suffix(".png")
    assert (
        run("plot", PAPER / "cuboid_at_rest.yaml", "--kind", "tolerances", "-o", image).exit_code
        == 0
    )
    edges = imread(image)[[0, -1]]
    np.testing.assert_array_equal(edges, 1.0)  # white: titles and legends are whole
    (tmp_path / "lost.yaml").write_text(HEAVY, encoding="utf-8")
    lost = run("plot", tmp_path / "lost.yaml", "--kind", "tolerances", "-o", picture)
    assert lost.exit_code == 1 and lost.stdout.startswith("no torques were found: ")
