"""The page of a scene that says what is not known exactly of it."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from report_cases import AT_REST, SPHERE, read_html
from tests.cli.cli_tools import run, stating

from graspless_pin import Uncertainty, load_scene

pytestmark = pytest.mark.usefixtures("without_plots")

SET = {"mass": 0.2, "center_of_mass": 0.01}
QUICK = ("--no-ranges", "--no-verdict")
KEYS = {
    "uncertainty": SET,
    "solve": {"algorithm": "torque", "margin": 0.1, "static_friction": "coulomb"},
}


def test_torques_for_the_whole_set(tmp_path: Path) -> None:
    file, target = (
        stating(tmp_path, AT_REST, **KEYS),
        tmp_path / "report.html",
    )
    assert run("report", file, "-o", target, *QUICK).exit_code == 0
    page = read_html(target.read_text(encoding="utf-8"))
    section = page.section("unknown")
    scene = load_scene(file)
    robust, nominal = scene.solve(uncertainty=True), scene.solve()
    assert "mass ±20 %, centre of mass ±1 cm" in section.text
    assert f"max |torque| = {robust.max_torque:.6g} N m, proven for the whole set" in section.text
    alone = f"margin e = 0.1 N, max |torque| = {nominal.max_torque:.6g}"
    assert f"for the nominal scene alone {alone}" in section.text
    shown = {
        row[0]: row[1:]
        for body in section.all("tbody")
        for tr in body.all("tr")
        if (row := [cell.text for cell in tr.everything() if cell.tag in ("th", "td")])
    }
    for name in robust.joint_names:
        both = robust.torques_by_joint[name], nominal.torques_by_joint[name]
        assert shown[name] == [f"{one:+.4f}".replace("-", "−") for one in both]
    off = scene.tolerances(robust.torques, static_friction="coulomb")
    told = {row[0]: row[1:] for row in page.section("off").rows()}
    for row in off.table()[1]:
        assert told[row[0]][:2] == [*row[1:3]]
    assert "proven for the whole set" in page.text
    rows = page.section("joints").rows()  # the scene stands under the same torques
    assert {row[0]: row[1] for row in rows} == {name: shown[name][0] for name in robust.joint_names}
    # The document that goes along, and a page of it.
    document = tmp_path / "solution.json"
    run("solve", file, "--no-verdict", "--json", document)
    assert run("report", document, "-o", target, "--no-ranges").exit_code == 0
    again = read_html(target.read_text(encoding="utf-8"))
    assert "mass ±20 %" in again.section("unknown").text
    assert "How far may each be off" not in again.text
    content = json.loads(document.read_text(encoding="utf-8"))
    del content["uncertainty"]["nominal"]
    document.write_text(json.dumps(content), encoding="utf-8")
    refused = run("report", document, "-o", target, "--no-ranges")
    assert refused.exit_code == 2 and "uncertainty: is not complete" in refused.stderr


def test_where_nothing_serves_the_set(tmp_path: Path) -> None:
    file, target = stating(tmp_path, SPHERE, **KEYS), tmp_path / "report.html"
    assert run("report", file, "-o", target, *QUICK).exit_code == 1
    page = read_html(target.read_text(encoding="utf-8"))
    section = page.section("unknown")
    scene = load_scene(file)
    robust = scene.solve(uncertainty=Uncertainty(**SET))
    for number in robust.conflict:
        assert robust.members[number].words in section.text
    assert "Not found for the whole uncertain set." in page.text
    assert "of the set is served: mass ±" in section.text
    assert len(page.section("contacts").rows()) == scene.problem().contact_count
    with pytest.raises(ValueError, match="not enough values"):
        page.section("why")
