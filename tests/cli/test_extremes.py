"""Counts and magnitudes beyond all bounds: refused with key, value and range, at once."""

import pytest
from cli_tools import LINES, assert_refused, run, solve_text, spoilt

from graspless_pin.cli.outcome import echo_note, plain_errors, show_findings
from graspless_pin.findings import Finding, FindingCode, emit

FRICTION = "friction: 0.3"
ONE_HAND = LINES[LINES.index("  robot") : LINES.index("object:")]
MOUNTS = "".join(f"    - {{robot: lever_100mm, prefix: p{i}_}}\n" for i in range(300))
SUPPORTS = "".join(f"  - {{name: s{i}, shape: {{type: half_space}}}}\n" for i in range(101))

CASES = {
    "mass": ("mass: 1.0", "mass: 1.0e+31", "10: object.mass: found 1e+31; needs a finite number"),
    "weight": (
        "mass: 1.0",
        "mass: 1.0e+22",
        "1: max_normal_force: is 50 N, but the object weighs 9.8e+22 N; its weight may be at most",
    ),
    "gravity": (
        "[0, 0, -9.8]",
        "[1.0e+300, 0, 0]",
        "1: gravity[0]: found 1e+300; needs a finite number within ±1e+12",
    ),
    "weight of no size": (
        "[0, 0, -9.8]",
        "[0, 0, -1.0e-300]",
        "1: gravity: is [0.0, 0.0, -1e-300], so the object weighs 1e-300 N; its weight must be 0",
    ),
    "size": (
        "[0.2, 0.2, 0.2]",
        "[1.0e+160, 0.2, 0.2]",
        "9: object.shape.size[0]: found 1e+160; needs a finite number > 0, from 1e-12 to 1e+12",
    ),
    "friction": (
        FRICTION,
        "friction: 1.0e+300",
        "2: friction: found 1e+300; needs a finite number >= 0, at most 10000",
    ),
    "friction in sixteens": (
        FRICTION,
        "friction: 0x" + 400 * "f",
        "2: friction: found 44462416477094044",
    ),
    "friction by the clock": (
        FRICTION,
        "friction: " + ":".join(300 * ["59"]),
        "2: friction: found '59:59:59:59:...9:59:59:59:59'; needs a finite number",
    ),
    "position": ("position: [0, 0, 0]", "position: [1.0e+13, 0, 0]", "11: object.pose.position[0]"),
    "limit": (
        "  q: {hinge: 0.0}",
        "  effort_limits: {hinge: 1.0e+31}",
        "6: hand.effort_limits.hinge: found 1e+31; needs",
    ),
    "mounts": (ONE_HAND, f"  mounts:\n{MOUNTS}", "4: hand.mounts: found [{'prefix': 'p0_', "),
    "supports": (
        "supports:\n",
        f"supports:\n{SUPPORTS}",
        "12: supports: found [{'name': 's0', ",
    ),
    "name": ("name: box", "name: " + 300 * "x", "8: object.name: found 'xxx"),
    "unknown key": (FRICTION, f"friction: 0.3\n? {100_000 * 'x'}\n: 1", "3: xxx"),
}


ADDED = {
    "solve: {margin: 1.0e+200}": (
        "3: solve.margin: found 1e+200; needs a finite number >= 0, at most 1e+30"
    ),
    "points_per_patch: 65": (
        "3: points_per_patch: found 65; needs a whole number >= 3, at most 64"
    ),
    "max_normal_force: 1.0e-20": (
        "3: max_normal_force: is 1e-20 N, but the object weighs 9.8 N; its weight may be at most"
    ),
    "max_normal_force: 1.0e-31": (
        "3: max_normal_force: found 1e-31; needs a finite number > 0, from 1e-30 to 1e+30"
    ),
    "solve: {regularization: 1.0e+20}": (
        "3: solve.regularization: found 1e+20; needs a finite number >= 0, at most 1e+09"
    ),
    "cone_edges: 100000": "3: cone_edges: found 100000; needs a whole number >= 3, at most 1024",
    "contact_tolerance: 1.0e+20": "3: contact_tolerance: found 1e+20; needs",
}
"""A line that is added to the scene, and the message."""
CASES |= {added: (FRICTION, f"{FRICTION}\n{added}", said) for added, said in ADDED.items()}


@pytest.mark.parametrize("kind", CASES)
def test_numbers_and_counts_beyond_all_bounds(tmp_path, kind):
    old, new, message = CASES[kind]
    result = solve_text(tmp_path, spoilt(old, new))
    assert_refused(result, f"scene.yaml:{message}")
    assert len(result.stderr.encode()) < 2000
    assert len(result.stderr.splitlines()) <= 9


def test_many_mistakes_are_counted(tmp_path):
    text = "friction: 0.3\n" + "".join(f"key_{i}: 1\n" for i in range(1000))
    result = solve_text(tmp_path, spoilt(FRICTION, text))
    assert result.stderr.splitlines()[-1] == "... and 995 more mistakes"


@pytest.mark.parametrize(("gravity", "margin"), [("0", "1e-33"), ("1.0e-30", "1e-12")])
def test_a_margin_where_next_to_nothing_pulls(tmp_path, capfd, gravity, margin):
    """HiGHS ended the process, and PIQP printed kilobytes."""
    text = spoilt("[0, 0, -9.8]", f"[0, 0, -{gravity}]")
    result = solve_text(tmp_path, text, "--algorithm", "torque", "--margin", margin)
    assert result.exit_code in (0, 1) and result.stderr == ""
    assert capfd.readouterr() == ("", "")


def test_outputs_that_no_file_can_have(tmp_path):
    scene, study = tmp_path / "scene.yaml", tmp_path / "study.yaml"
    scene.write_text(LINES, encoding="utf-8")
    study.write_text("scene: scene.yaml\nvary: {friction: {values: [0.3]}}\n", encoding="utf-8")
    result = run("study", study, "-o", tmp_path / (300 * "x" + ".csv"))
    assert_refused(result, "its name has 304 bytes; it must have at most 220")
    for name, *options in (("report", "--no-ranges", "-o"), ("solve", "--json")):
        result = run(name, scene, "--no-verdict", *options, tmp_path / (300 * "x"))
        assert_refused(result, "cannot be written (File name too long)")


def test_many_findings_and_a_note_are_cut_to_two_kilobytes(capsys):
    findings = [
        Finding(FindingCode.STEEP_FRICTION, str(i), f"{i}: " + 90 * "x", "do this")
        for i in range(60)
    ]
    with plain_errors():
        emit(*findings)
        show_findings()
        echo_note(1000 * "y")
    said = capsys.readouterr().err
    assert len(said.encode()) < 2000
    assert said.count("steep-friction") >= 12
    assert "more findings: see" in said
    assert said.splitlines()[-1].startswith("note: y")
