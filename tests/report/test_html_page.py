"""What the page says is what the library computes, and it stands alone."""

import base64
import json
import re
import shutil
import sys
from dataclasses import dataclass, replace
from functools import cache

import numpy as np
import pytest
from report_cases import (
    ALLEGRO,
    SLIDING,
    SPHERE,
    Element,
    micro_block,
    pinched_block,
    read_html,
    solved,
    through_json,
)

from graspless_pin import (
    Objective,
    ProgramBuilder,
    QuasistaticProblem,
    Status,
    contact_force_bounds,
    maximize_margin,
    minimize_torque,
    optimize,
    stability,
)
from graspless_pin.errors import GrasplessPinError
from graspless_pin.report import solution_document
from graspless_pin.report.html import case_of_document, case_of_scene, report_html
from graspless_pin.visualization import Role
from graspless_pin.visualization.contacts import draw_contacts


def number(text: str) -> float:
    """A figure of the page."""
    return float(text.replace("−", "-").split()[0])


@cache
def solved_allegro():
    scene, solution = solved(ALLEGRO)
    return scene, solution, contact_force_bounds(solution.problem, solution.torques)


@pytest.fixture(scope="module")
def allegro():
    scene, solution, bounds = solved_allegro()
    return scene, solution, report_html(case_of_scene(scene, solution, ALLEGRO), bounds)


@pytest.fixture(scope="module")
def page(allegro) -> Element:
    return read_html(allegro[2])


TEXT_ALONE = pytest.mark.usefixtures("without_plots")


def test_it_is_small_and_its_colours_follow_the_page(page: Element, allegro):
    assert len(allegro[2].encode()) < 5_000_000
    # No drawing has a fixed colour of the light palette.
    text = allegro[2]
    drawings = "".join(re.findall(r"<svg.*?</svg>", text, flags=re.DOTALL))
    assert "currentColor" in drawings and f"var(--{Role.CONE})" in drawings
    colors = set(re.findall(r"#[0-9a-f]{6}\b", drawings))
    assert colors <= {"#ffffff", "#000000", "#b0b0b0"}, colors


@TEXT_ALONE
def test_it_says_which_cones_there_are(page: Element):
    assert "32 cone edges" in page.text
    rounded = solved(SPHERE)[0].with_changes(cone="round")
    text = read_html(report_html(case_of_scene(rounded, rounded.solve("margin")))).text
    assert "round cones" in text and "cone edges" not in text


def test_nothing_is_fetched(allegro, page: Element):
    """Every address is inside the page, and the page forbids all others."""
    for element in page.everything():
        for name in ("src", "href", "xlink:href", "action", "poster", "data", "srcset"):
            address = element.attributes.get(name)
            assert address is None or re.match(r"#|data:application/json;base64,", address)
    assert not page.all("link") and not page.all("img") and not page.all("iframe")
    (policy,) = (
        item.attributes["content"]
        for item in page.all("meta")
        if item.attributes.get("http-equiv") == "Content-Security-Policy"
    )
    assert policy is not None and policy.startswith("default-src 'none';")
    assert "@import" not in allegro[2] and "url(http" not in allegro[2]


def test_sections_and_links_between_them(page: Element):
    assert [item.text for item in page.all("h1")] == [
        "Allegro hand keeps a box from sliding down a slope"
    ]
    assert [item.text for item in page.all("h2")] == [
        "Answer",
        "Scene",
        "Joint torques against limits",
        "Contacts",
        "Friction use per contact",
        "Force ranges",
        "Modes examined",
        "How to reproduce",
    ]
    ids = [item.attributes["id"] for item in page.everything() if "id" in item.attributes]
    assert len(ids) == len(set(ids))
    for element in page.everything():
        for name in ("href", "xlink:href"):
            target = element.attributes.get(name) or ""
            assert not target.startswith("#") or target[1:] in ids
        for reference in (element.attributes.get("aria-labelledby") or "").split():
            assert reference in ids


def test_the_torques(allegro, page: Element):
    _, solution, _ = allegro
    rows = page.section("joints").rows()
    assert [row[0] for row in rows] == list(solution.problem.joint_names)
    np.testing.assert_allclose([number(row[1]) for row in rows], solution.torques, atol=5.1e-5)
    assert {row[4] for row in rows} == {"+0.7000"}
    share = 100 * np.abs(solution.torques) / 0.7
    np.testing.assert_allclose([number(row[2]) for row in rows], share, atol=0.051)


def test_the_contacts(allegro, page: Element):
    scene, solution, _ = allegro
    rows = page.section("contacts").rows()
    assert [row[1] for row in rows] == list(scene.contacts.bodies)
    problem = solution.problem
    for index, row in enumerate(rows):
        position = [number(part) for part in row[-1].split(", ")]
        np.testing.assert_allclose(position, scene.contacts.points[index].position, atol=5.1e-5)
        frame = np.column_stack([problem.normals[index], problem.tangents[index]])
        expected = frame.T @ solution.contact_forces[index]
        np.testing.assert_allclose([number(text) for text in row[3:6]], expected, atol=5.1e-5)
    assert len(page.section("friction").all("svg")) == len(rows) == 7


def test_the_ranges(page: Element):
    _, _, bounds = solved_allegro()
    rows = page.section("ranges").rows()
    for index, row in enumerate(rows):
        for k, text in enumerate(row[1:]):
            ends = [number(part) for part in text.split(" to ")]
            assert (len(ends) == 2) == bounds.indeterminate[index, k]
            assert ends[0] == pytest.approx(bounds.lower[index, k], abs=1e-4)
            assert ends[-1] == pytest.approx(bounds.upper[index, k], abs=1e-4)


@TEXT_ALONE
@pytest.mark.parametrize("rough", [False, True])
def test_ranges_over_all_outcomes_of_rest_are_told_where_they_differ(rough: bool):
    walls = QuasistaticProblem(
        [(-0.05, 0.0, 0.0), (0.05, 0.0, 0.0), (0.0, 0.0, -0.05)],
        [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)],
        [0.0, 0.0, -9.81, 0.0, 0.0, 0.0],
        friction=[0.3 * rough, 0.3 * rough, 0.5],
        cone="round",
    )
    solution = maximize_margin(walls)
    case = case_of_document(through_json(solution))
    ruled = contact_force_bounds(walls, solution.torques)
    every = contact_force_bounds(walls, solution.torques, static_friction="coulomb")
    section = read_html(report_html(case, ruled, rest_bounds=every)).section("ranges")
    assert "admissible contact forces" in section.text
    pressed = "contacts 0, 1 and 2" if rough else "contacts 0 and 1"
    assert f"the supports may squeeze the object with unbounded force: {pressed}" in section.text
    assert ruled.covers in section.text and every.covers in section.text
    assert ("The ranges are the same" in section.text) is not rough
    rows = section.rows()  # of one table
    if rough:
        assert [row[:2] for row in rows] == [
            ["0", "both"],
            ["1", "both"],
            ["2", "by the rule"],
            ["2", "any at rest"],
        ]
        assert rows[-1][2:] == ["same", "unbounded", "same"]
    else:
        assert [row[0] for row in rows] == ["0", "1", "2"]


def test_the_proof_and_its_checks(allegro, page: Element):
    _, solution, _ = allegro
    section = page.section("modes")
    facts = dict(
        zip((i.text for i in section.all("dt")), (i.text for i in section.all("dd")), strict=True)
    )
    examined = facts["modes solved or ruled out one by one"]
    assert int(examined) == solution.certificate.modes_examined
    assert facts["mode of the answer"].startswith(str(solution.mode))
    verdicts = [row[1] for row in section.rows()]
    assert len(verdicts) >= 13 and set(verdicts) == {"passed", "taken as given"}


def test_the_command_and_the_document(allegro, page: Element):
    scene, solution, _ = allegro
    section = page.section("reproduce")
    assert section.all("pre")[0].text.startswith(f"graspless-pin solve {ALLEGRO} --algorithm")
    assert page.section("reproduce").text.count("SHA-256") == 2
    (link,) = section.all("a")
    href = link.attributes["href"]
    assert href is not None
    document = json.loads(base64.b64decode(href.split(",")[1]))
    assert document == through_json(solution, scene)


def test_what_does_not_see_is_told(page: Element):
    for drawing in page.all("svg"):
        if drawing.attributes.get("aria-hidden") == "true":  # filled by the page's script
            assert drawing.children == []
            continue
        assert drawing.attributes["role"] == "img"
        (title,) = (child for child in drawing.children if child.tag == "title")
        assert drawing.attributes["aria-labelledby"] == title.attributes["id"]
        assert len(title.text) > 30
    words = page.with_id("view-words").text
    assert "the object box" in words and "supported by slope" in words and "7 contact" in words


@TEXT_ALONE
def test_why_not():
    scene, solution = solved(SLIDING, sliding_rule="constrained")
    page = read_html(report_html(case_of_scene(scene, solution)))
    section = page.section("why")
    cause, *suggestions = solution.explanation.splitlines()
    assert cause in section.text
    changes = [line[2:] for line in suggestions if line.startswith("- ")]
    assert changes and [item.text for item in section.all("li")] == changes
    headings = [item.text for item in page.all("h2")]
    assert "Why not" in headings and "Force ranges" not in headings
    assert {row[1] for row in page.section("joints").rows()} == {"–"}
    assert len(page.section("contacts").rows()) == 6


@TEXT_ALONE
def test_a_document_brings_its_scene(tmp_path):
    scene, solution = solved(SPHERE)
    document = through_json(solution, scene)
    case = case_of_document(document, SPHERE)
    assert case.missing == "" and case.command is not None
    assert case.picture.of(Role.OBJECT) and case.picture.of(Role.HAND)
    page = read_html(report_html(case))
    assert page.all("h1")[0].text == scene.name
    assert [row[1] for row in page.section("contacts").rows()] == list(scene.contacts.bodies)


@TEXT_ALONE
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("loops", "said"), [("yes", "yes"), ("no", "no: numpy was used instead"), (None, None)]
)
def test_it_says_whether_compiled_loops_ran(loops, said):
    document = through_json(maximize_margin(pinched_block()))
    del document["provenance"]["versions"]["compiled loops"]
    if loops is not None:
        document["provenance"]["versions"]["compiled loops"] = loops
    section = read_html(report_html(case_of_document(document))).section("reproduce")
    names, facts = ([item.text for item in section.all(tag)] for tag in ("dt", "dd"))
    assert dict(zip(names, facts, strict=True)).get("compiled loops") == said


@TEXT_ALONE
def test_no_file_that_a_document_names_is_opened(tmp_path, monkeypatch):
    scene, solution = solved(SPHERE)
    document = through_json(solution, scene)
    opened = []
    monkeypatch.setattr("os.open", lambda path, *_: opened.append(path))
    secret = tmp_path / "secret.yaml"
    secret.write_text("password: tulip\n", encoding="utf-8")
    for name in (str(SPHERE), str(secret), "../scene.yaml", 7, None):
        document["provenance"]["scene_file"] = name
        case = case_of_document(document)
        assert "scene file" in case.missing and case.command is None
        assert name != str(secret) or "tulip" not in report_html(case)
    document["provenance"] = 5
    assert case_of_document(document).missing == "The document names no scene file."
    assert opened == []


@TEXT_ALONE
@pytest.mark.sampled(1)
@pytest.mark.parametrize(
    ("old", "new", "message"),
    [("mass: 1.0", "mass: 1.1", "changed since"), ("friction:", "frictoin:", "changed since")],
)
def test_another_scene_is_not_drawn(tmp_path, old, new, message):
    file = tmp_path / "scene.yaml"
    shutil.copy(SPHERE, file)
    scene, solution = solved(file)
    document = through_json(solution, scene)
    text = file.read_text(encoding="utf-8")
    assert old in text
    file.write_text(text.replace(old, new), encoding="utf-8")
    case = case_of_document(document, file)
    assert message in case.missing and case.command is None
    assert not case.picture.of(Role.HAND, Role.OBJECT, Role.SUPPORT)
    assert case.picture.of(Role.NORMAL_FORCE)
    page = read_html(report_html(case))
    assert message in page.section("scene").text
    assert not page.section("reproduce").all("pre")


def test_a_scene_changed_in_python_has_no_command():
    scene, _ = solved(SPHERE)
    changed = scene.with_changes(gravity=np.array([0.0, 0.0, -5.0]))
    case = case_of_scene(changed, changed.solve())
    assert case.command is None and case.missing == ""
    assert case_of_scene(scene, scene.solve(), SPHERE).command is not None
    # Its document cannot be drawn from the file either.
    again = case_of_document(through_json(case.solution, changed), changed.path)
    assert "no longer gives the problem of the document" in again.missing


@TEXT_ALONE
def test_a_problem_from_arrays():
    case = case_of_document(through_json(maximize_margin(pinched_block())))
    page = read_html(report_html(case))
    assert "names no scene file" in page.section("scene").text
    (head,) = page.section("contacts").all("thead")
    assert "touching" not in head.text
    rows = page.section("joints").rows()
    assert [row[4] for row in rows] == ["+2.0000", "+∞"]
    document = through_json(maximize_margin(pinched_block()))
    document["contacts"][0]["force"][1] += 0.1
    refused = report_html(case_of_document(document))
    assert "FAILED" in {row[1] for row in read_html(refused).section("modes").rows()}
    assert "<strong>Refused:</strong>" in refused


@TEXT_ALONE
@pytest.mark.parametrize("rows", [[2], [0, 2], [0, 1, 2, 3, 4, 5, 0, 2]])
def test_a_problem_in_other_coordinates(rows: list[int]):
    """Some of one free object's coordinates: on a rail, say; and all, two of them twice."""
    free = pinched_block()
    units = ["N" if row < 3 else "N m" for row in rows]
    problem = pinched_block(
        wrench_matrix=free.W[rows],
        external_wrench=free.external_wrench[rows],
        passive_units=units,
        object_inertia=np.eye(len(rows)),
        joint_inertia=np.eye(2),
    )
    solution = maximize_margin(problem)
    lost = stability(problem, np.array([0.0, 0.0]))
    for verdict in (None, lost):
        document = solution_document(solution, verdict=verdict)
        case = case_of_document(json.loads(json.dumps(document)))
        assert case.motion is None and case.sliding is None
        page = read_html(report_html(case))
        assert f"margin e at best {solution.margin:.4f} N" in page.text
    drawn = draw_contacts(free, maximize_margin(free)).of(Role.VIRTUAL_SLIDING)
    arrows = case.picture.of(Role.VIRTUAL_SLIDING)
    assert len(arrows) == len(drawn) or len(rows) < len(free.W)


def test_names_cannot_break_the_page():
    """A name with markup stays a name, in text, drawings and data."""
    evil = "</script><script>alert(1)</script>&\"'"
    scene, solution = solved(SPHERE)
    named = scene.with_changes(name=evil)
    page = read_html(report_html(case_of_scene(named, solution)))
    assert page.all("h1")[0].text == evil
    assert len(page.all("script")) == 2
    joints = maximize_margin(pinched_block(joint_names=[evil, "b"]))
    page = read_html(report_html(case_of_document(solution_document(joints))))
    assert page.section("joints").rows()[0][0] == evil
    assert len(page.all("script")) == 2


@pytest.mark.parametrize("module", ["jinja2", "matplotlib"])
def test_without_the_extra(monkeypatch, module, allegro):
    scene, solution, _ = allegro
    case = case_of_scene(scene, solution)
    monkeypatch.setitem(sys.modules, module, None)
    with pytest.raises(GrasplessPinError, match=r"pip install 'graspless-pin\[report\]'"):
        report_html(case)


@TEXT_ALONE
def test_ranges_that_take_too_long_are_marked():
    """Where a limit came before the proof the page has what was reached, and says so."""
    scene, solution = solved(SPHERE)
    bounds = contact_force_bounds(solution.problem, solution.torques, node_limit=4)
    page = read_html(report_html(case_of_scene(scene, solution), bounds))
    assert bounds.status is Status.LIMIT_REACHED and not bounds.proven.all()
    section = page.section("ranges")
    said = f"{bounds.proven.sum()} of {bounds.proven.size} ranges are proven"
    assert said in section.text and "--ranges-time" in section.text
    assert "Their margin lies between" not in section.text
    assert "as far as was reached" in section.text
    assert "torques determine the force" not in section.text
    for row, low, high, proven in zip(
        section.rows(), bounds.lower, bounds.upper, bounds.proven, strict=True
    ):
        for cell, a, b, sure in zip(row[1:], low, high, proven, strict=True):
            assert cell.endswith("*") != sure
            if not sure:
                first, last = cell.removesuffix("*").split(" to ")
                assert number(first) == pytest.approx(a, abs=1e-4)
                assert number(last) == pytest.approx(b, abs=1e-4)


@TEXT_ALONE
def test_marks_are_only_spoken_of_where_there_are_some():
    """All ranges can be proven where only the margin at worst is not."""
    scene, solution, bounds = solved_allegro()
    unsure = replace(bounds, status=Status.LIMIT_REACHED)
    assert unsure.proven.all()
    section = read_html(report_html(case_of_scene(scene, solution), unsure)).section("ranges")
    assert not any(cell.endswith("*") for row in section.rows() for cell in row)
    assert "marked" not in section.text
    assert "as far as" not in section.text
    assert "torques determine the force" in section.text
    assert "The margins reached go from 0 to 0.7437" in section.text
    assert "--ranges-time" in section.text
    scene, solution = solved(SPHERE)
    nothing = replace(
        contact_force_bounds(solution.problem, solution.torques, time_limit=0.0),
        status=Status.NOT_FOUND_IN_LIMIT,
    )
    section = read_html(report_html(case_of_scene(scene, solution), nothing)).section("ranges")
    assert "No ranges: nothing found when a node or time limit ended the search." in section.text
    assert not section.all("table")


@TEXT_ALONE
def test_micro_figures_have_digits():
    """A millionth of the forces on a thousandth of the lengths, and no row of zeros."""
    solution = minimize_torque(micro_block(), 1e-7)
    bounds = contact_force_bounds(solution.problem, solution.torques)
    page = read_html(report_html(case_of_document(through_json(solution)), bounds))
    for row, torque in zip(page.section("joints").rows(), solution.torques, strict=True):
        assert number(row[1]) == pytest.approx(torque, rel=1e-4)
    normal = np.einsum("ij,ij->i", solution.problem.normals, solution.contact_forces)
    for row, force, point in zip(
        page.section("contacts").rows(), normal, solution.problem.positions, strict=True
    ):
        assert number(row[2]) == pytest.approx(force, rel=1e-4)
        assert [number(one) for one in row[-1].split(", ")] == pytest.approx(point, rel=1e-4)
    for row, low in zip(page.section("ranges").rows(), bounds.lower[:, 0], strict=True):
        assert number(row[1]) == pytest.approx(low, rel=1e-4, abs=1e-12)
    assert f"{solution.margin:.5g}".replace("-", "−") in page.text


@TEXT_ALONE
def test_an_objective_of_ones_own_is_named():
    """Solved, or read back from its document."""

    @dataclass(frozen=True)
    class Loaded(Objective):
        name = "least load"

        def build(self, program: ProgramBuilder) -> None:
            program.balance()
            program.cones(0.0)
            program.normal_limits(0.0)
            program.regularize(1.0)

    solution = optimize(pinched_block(), Loaded())
    page = read_html(report_html(case_of_document(through_json(solution))))
    assert "least load" in page.text
    assert "FAILED" not in page.section("modes").text
    assert "taken as given" in page.section("modes").text
