"""CONTRIBUTING's walk-through "Add an analysis with its command", done to a copy of the package."""

import shutil
import xml.etree.ElementTree as ET
from pathlib import Path

import pytest
import yaml
from package_copy import command, copied, inserted, run, walkthrough
from page_blocks import ROOT

PACKAGE = Path("src") / "graspless_pin"
SCENE = ROOT / "examples" / "trihand_push_box.yaml"
LISTS = ("index", "packages_export", "each_page", "promise_on_threads")
"""Tests of `test_api` that hold lists of public names against each other."""


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the repository in which the walk-through was followed."""
    folder = copied(tmp_path_factory.mktemp("package"))
    module, listed = walkthrough("travel")[:2]
    (folder / PACKAGE / "cli" / "travel.py").write_text(module, encoding="utf-8")
    assert len(listed.splitlines()) == 1
    inserted(folder / PACKAGE / "cli" / "commands.py", listed, '    "verify"')
    return folder


def ways() -> dict[str, tuple[float, float]]:
    """To both limits of each joint of the scene, by the hand's own file."""
    q = yaml.safe_load(SCENE.read_text())["hand"]["q"]
    found = {}
    urdf = ET.parse(ROOT / "robots" / "trihand.urdf")  # noqa: S314 - our own file
    for joint in urdf.getroot().iter("joint"):
        if joint.get("type") == "revolute":
            name, (limit,) = joint.attrib["name"], joint.findall("limit")
            at = q.get(name, 0.0)
            found[name] = at - float(limit.attrib["lower"]), float(limit.attrib["upper"]) - at
    return found


def test_the_list_of_commands_and_its_help_have_it(package):
    shown = command(package, "--help")
    (line,) = [line for line in shown.stdout.splitlines() if " travel " in line]
    assert "Tell how far each joint of the hand may move" in line
    shown = command(package, "travel", "--help")
    assert "--least" in shown.stdout
    assert "graspless-pin travel scene.yaml --least 0.1" in shown.stdout


def test_it_tells_the_ways_to_the_limits_of_the_file(package):
    shown = command(package, "travel", str(SCENE))
    assert shown.returncode == 0, shown.stderr
    rows = [line.split() for line in shown.stdout.splitlines()[2:]]
    found = {name: (float(down), float(up)) for name, down, up in rows}
    expected = ways()
    assert len(expected) == 9
    assert found == {name: pytest.approx(both, abs=6e-4) for name, both in expected.items()}
    nearest = [min(both) for both in found.values()]
    assert nearest == sorted(nearest)
    # The exit code says whether all have as much.
    nearest = min(min(both) for both in ways().values())
    for least, code in ((nearest - 1e-3, 0), (nearest + 1e-3, 1)):
        shown = command(package, "travel", str(SCENE), "--least", f"{least}")
        assert shown.returncode == code


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (
            (str(SCENE), "--least", "-0.1"),
            "error: --least: is -0.1; it must be a finite number",
        ),
        (("nowhere.yaml",), "error: nowhere.yaml: "),
    ],
)
def test_bad_input_is_told_as_by_any_command(package, words, message):
    shown = command(package, "travel", *words)
    assert shown.returncode == 2
    assert message in " ".join(shown.stderr.replace("│", "").split())


def test_a_public_name_takes_two_lines(package, tmp_path):
    """One where names are loaded from, and one in the index."""
    for name in ("docs", "tests", "mkdocs_hooks"):
        shutil.copytree(ROOT / name, tmp_path / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copytree(package / "src", tmp_path / "src")
    public = tmp_path / PACKAGE / "__init__.pyi"
    for name in ("JointTravel", "joint_travel"):
        inserted(public, f"from .cli.travel import {name} as {name}", "from .errors import")
    entry = (
        "| [`joint_travel`](api/scenes.md#graspless_pin.joint_travel) → "
        "[`JointTravel`](api/scenes.md#graspless_pin.JointTravel) | how far joints may move |"
    )
    inserted(tmp_path / "docs" / "api.md", entry, "| [`settle`]")
    tests = [
        "-q",
        "-p",
        "no:cacheprovider",
        "tests/documents/test_api.py",
        "-k",
        " or ".join(LISTS),
    ]
    found = run(tmp_path, f"import pytest, sys; sys.exit(pytest.main({tests}))")
    assert found.returncode == 0, found.stdout
    assert "passed" in found.stdout
    used = "import graspless_pin; print(graspless_pin.joint_travel.__module__)"
    assert run(tmp_path, used).stdout == "graspless_pin.cli.travel\n"
