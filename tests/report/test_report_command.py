"""``graspless-pin report``: files, exit codes and messages."""

import json
import re

import pytest
from report_cases import SLIDING, SPHERE, WALLS, pinched_block, read_html, solved, through_json
from tests.cli.cli_tools import run as run_command
from typer.testing import Result

from graspless_pin import maximize_margin
from graspless_pin.plots.canvas import plain_text


def run(*arguments) -> Result:
    return run_command("report", *arguments)


def test_a_scene(tmp_path):
    target = tmp_path / "out" / "report.html"
    result = run(SPHERE, "-o", target)
    assert (result.exit_code, result.stderr) == (0, "")
    assert result.stdout.startswith(f"wrote {target} (0.")
    page = read_html(target.read_text(encoding="utf-8"))
    assert page.all("h1")[0].text == solved(SPHERE)[0].name
    assert [item.name for item in target.parent.iterdir()] == ["report.html"]
    result = run(SPHERE, "-o", "-", "--no-ranges", "--no-verdict")
    assert result.exit_code == 0
    assert read_html(result.stdout).all("h1")
    assert result.stdout.endswith("</html>\n")


NAMES = ["$\\frac$", "$x", "a$b$c", "_x^{", "two\nlines", "😀", "x" * 200]


@pytest.mark.sampled(2)
@pytest.mark.parametrize("name", NAMES)
def test_names_are_their_letters(tmp_path, name):
    """A dollar begins no mathematics, and no name makes matplotlib say anything."""
    file, target = tmp_path / "solution.json", tmp_path / "report.html"
    block = pinched_block(joint_names=[name, "other"])
    file.write_text(json.dumps(through_json(maximize_margin(block))), encoding="utf-8")
    result = run(file, "-o", target, "--no-ranges")
    assert (result.exit_code, result.stderr) == (0, "")
    page = read_html(target.read_text(encoding="utf-8"))
    assert "made from arrays" in page.all("h1")[0].text
    assert page.section("joints").rows()[0][0] == " ".join(name.split())
    texts = [one.text for one in page.section("joints").all("text")]
    assert plain_text(name).replace("\\$", "$") in texts


def test_without_force_ranges(tmp_path):
    options = ("--no-ranges", "--no-verdict")
    assert run(SPHERE, "-o", tmp_path / "report.html", *options).exit_code == 0
    page = read_html((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert page.section("ranges").text == "Force ranges No ranges: they were not requested."
    assert len(page.section("friction").all("svg")) == 3


def test_how_hard_the_hand_may_squeeze(tmp_path):
    target = tmp_path / "report.html"
    assert run(SPHERE, "-o", target, "--no-ranges", "--no-verdict", "--squeeze").exit_code == 0
    page = read_html(target.read_text(encoding="utf-8"))
    section = page.section("squeeze")
    assert "#squeeze" in [one.attributes.get("href") for one in page.all("a")]
    assert "times the torques of the internal forces" in section.text
    words = r"From end to end the hand presses with [\d.]+ to [\d.]+ N \(sum of normal forces\)"
    assert re.search(words, section.text)
    assert len(section.all("svg")) == 3


def test_how_far_each_may_be_off(tmp_path, monkeypatch):
    monkeypatch.setattr("graspless_pin.cli.tolerances.ATTAINABLE_TIME", 2.0)
    target, ball = tmp_path / "report.html", SPHERE.parents[1] / "allegro_sphere_on_slope.yaml"
    options = ("--no-ranges", "--no-verdict", "--tolerances")
    assert run(ball, "-o", target, "--controller", "1", *options).exit_code == 0
    page = read_html(target.read_text(encoding="utf-8"))
    section = page.section("off")
    assert "these torques and the joints' feedback" in section.text
    assert "one vector of torques, chosen for this quantity alone" in section.text
    assert re.search(r"centre of mass [\d.]+ cm [\d.]+ cm \[", section.text)
    titles = [one.text for one in section.all("title")]
    assert len(titles) == 3 and titles[0].startswith("How far the centre of mass may be off")
    assert "the horizontal region in which it may lie" in page.section("scene").text
    monkeypatch.setattr("graspless_pin.cli.tolerances.ATTAINABLE_TIME", 0.1)
    monkeypatch.setattr("graspless_pin.report.html.sections._inline_svg", lambda *_, **__: "")
    assert run(ball, "-o", target, *options).exit_code == 0
    page = read_html(target.read_text(encoding="utf-8"))
    assert "with constant torques" in page.section("off").text


def test_a_page_is_written_though_nothing_can_be_squeezed(tmp_path):
    target = tmp_path / "report.html"
    result = run(SPHERE, "-o", target, "--no-ranges", "--squeeze", "--controller", "position")
    assert result.exit_code == 0
    assert "note: --squeeze is left out: subject: has the controller 'position'" in result.stderr
    links = read_html(target.read_text(encoding="utf-8")).all("a")
    assert "#squeeze" not in [one.attributes.get("href") for one in links]


def test_what_needs_torques_says_that_there_are_none(tmp_path):
    """The slope is too steep and the hand too weak: nothing to squeeze with, nor to simulate."""
    target = tmp_path / "report.html"
    text = SPHERE.read_text(encoding="utf-8").replace("force: 50", "force: 0.1")
    (tmp_path / "weak.yaml").write_text(text, encoding="utf-8")
    result = run(tmp_path / "weak.yaml", "-o", target, "--squeeze", "--simulate", "--tolerances")
    assert result.exit_code == 1
    assert "note: --tolerances is left out: no torques were found" in result.stderr
    assert "note: --squeeze is left out: no torques were found" in result.stderr
    assert "note: --simulate is left out: no torques were found" in result.stderr


@pytest.mark.usefixtures("without_plots")
def test_infeasible_is_an_answer(tmp_path):
    scene, solution = solved(SLIDING, sliding_rule="constrained")
    file, target = tmp_path / "solution.json", tmp_path / "report.html"
    file.write_text(json.dumps(through_json(solution, scene)), encoding="utf-8")
    assert run(file, "--output", target).exit_code == 1
    assert "Why not" in target.read_text(encoding="utf-8")


@pytest.mark.parametrize(
    ("name", "text", "message"),
    [
        ("none.json", None, "there is no such file"),
        ("none.yaml", None, "none.yaml"),
        ("broken.json", "{", "broken.json: is not JSON: Expecting"),
        ("empty.json", "{}", "empty.json: document: lacks the key 'format'"),
        ("list.json", "[]", "list.json: document: is not a JSON object"),
    ],
)
def test_bad_input(tmp_path, name, text, message):
    file, target = tmp_path / name, tmp_path / "report.html"
    if text is not None:
        file.write_text(text, encoding="utf-8")
    result = run(file, "-o", target)
    assert result.exit_code == 2 and result.stdout == ""
    assert result.stderr.startswith("error: ") and message in result.stderr
    assert not target.exists()


@pytest.mark.parametrize("option", [["--no-verdict"], ["--verdict-nodes", "5"]])
def test_a_document_has_its_own_verdict(tmp_path, option):
    scene, solution = solved(SLIDING)
    file = tmp_path / "solution.json"
    file.write_text(json.dumps(through_json(solution, scene)), encoding="utf-8")
    result = run(file, "-o", tmp_path / "report.html", *option)
    assert result.exit_code == 2 and f"{option[0]}: requires a scene file" in result.stderr


def test_a_folder_that_cannot_be_made(tmp_path):
    (tmp_path / "file").write_text("", encoding="utf-8")
    result = run(SPHERE, "-o", tmp_path / "file" / "report.html")
    assert result.exit_code == 2
    assert "cannot be written" in result.stderr


@pytest.mark.usefixtures("without_plots")
@pytest.mark.usefixtures("without_plots")
def test_a_verdict_and_a_simulation(tmp_path):
    target = tmp_path / "report.html"
    assert run(WALLS, "-o", target, "--no-ranges", "--simulate").exit_code == 0
    text = target.read_text(encoding="utf-8")
    page = read_html(text)
    assert "May fail: the object can slip down" in page.text
    section = page.section("simulation").text
    assert "Moved." in section and "moved: the object does not stay" in section
    assert "bodies in MuJoCo, constant torques." in section
    asked = ("--no-ranges", "--no-verdict", "--simulate", "--controller", "3")
    assert run(SPHERE, "-o", target, *asked).exit_code == 0
    text = target.read_text(encoding="utf-8")
    assert "bodies in MuJoCo, joint feedback of 3 N m/rad." in text
    assert run(SPHERE, "-o", target, "--no-ranges", "--no-verdict").exit_code == 0
    assert "was not computed" in target.read_text(encoding="utf-8")


@pytest.mark.parametrize("option", ["--simulate", "--squeeze", "--tolerances"])
def test_what_needs_the_scene_says_so_before_the_force_ranges(tmp_path, monkeypatch, option):
    monkeypatch.delattr("graspless_pin.cli.report.contact_force_bounds")
    file = tmp_path / "solution.json"
    file.write_text(json.dumps(through_json(maximize_margin(pinched_block()))), encoding="utf-8")
    result = run(file, "-o", tmp_path / "report.html", option)
    assert result.exit_code == 2
    assert f"{option}: needs the scene file. The document names no scene file." in result.stderr


@pytest.mark.usefixtures("without_plots")
def test_a_document_that_is_refused_is_told_in_the_terminal_and_on_the_page(tmp_path):
    file, target = tmp_path / "solution.json", tmp_path / "report.html"
    document = through_json(maximize_margin(pinched_block()))
    document["margin"] += 0.1
    file.write_text(json.dumps(document), encoding="utf-8")
    result = run(file, "-o", target, "--no-ranges")
    assert result.exit_code == 4
    assert f"{file}: a check fails; graspless-pin verify {file} shows which" in result.stderr
    assert "These checks fail: margin as stated" in target.read_text(encoding="utf-8")


@pytest.mark.parametrize("origin", [None, 5, {}, {"versions": 3}, {"versions": {"numpy": "2.0"}}])
@pytest.mark.usefixtures("without_plots")
def test_a_document_need_not_say_what_it_was_made_of(tmp_path, origin):
    file, target = tmp_path / "solution.json", tmp_path / "report.html"
    document = {**through_json(maximize_margin(pinched_block())), "provenance": origin}
    file.write_text(json.dumps(document), encoding="utf-8")
    result = run(file, "-o", target, "--no-ranges")
    assert result.exit_code in (0, 4)
    assert "How to reproduce" in target.read_text(encoding="utf-8")
