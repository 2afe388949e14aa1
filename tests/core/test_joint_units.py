"""Units of joint torques: from arguments and hands to tables, files and messages."""

import json
from pathlib import Path

import numpy as np
import pytest
from scenes import cuboid_arguments

from graspless_pin import (
    ControlMode,
    FingerContacts,
    QuasistaticProblem,
    assemble_joint_space,
    compare_rules,
    load_scene,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.checks import JointUnit, units_text
from graspless_pin.report.document import solution_document, write_document
from graspless_pin.report.reading import read_solution

EXAMPLES = Path(__file__).parents[2] / "examples"
MIXED = ("N m", "N")


def problem(units=None):
    return QuasistaticProblem(**cuboid_arguments(), joint_units=units)


def test_without_units_all_joints_turn():
    assert problem().joint_units == (JointUnit.TORQUE, JointUnit.TORQUE)
    assert maximize_margin(problem()).max_torque_unit == "N m"


@pytest.mark.parametrize(
    ("units", "message"),
    [
        (("N m",), r"^joint_units: has 1 units; the jacobian has 2 columns"),
        (("N m", "Nm"), r"^joint_units: is 'Nm' at index 1; it must be one of 'N m', 'N'"),
        ("N m", r"^joint_units: is 'N m'; it must be a sequence"),
        ((1, 2), r"^joint_units: is 1 at index 0"),
    ],
)
def test_wrong_units_are_named(units, message):
    with pytest.raises(ArgumentError, match=message):
        problem(units)


def test_units_stay_where_the_joints_do():
    mixed = problem(MIXED)
    assert mixed.with_changes(friction=0.5).joint_units == MIXED
    for names in (["a", "b"], np.array(["a", "b"]), None):
        assert mixed.with_changes(joint_names=names).joint_units == MIXED
    assert mixed.with_changes(jacobian=mixed.jacobian.tolist()).joint_units == MIXED
    wider = np.hstack([mixed.jacobian, mixed.jacobian[:, :1]])
    other = mixed.with_changes(
        jacobian=wider,
        joint_names=["a", "b", "c"],
        torque_limits=(-1.0, 1.0),
        gravity_torques=None,
    )
    assert other.joint_units == ("N m",) * 3


def test_the_largest_torque_has_the_unit_of_its_joint():
    for units in (MIXED, MIXED[::-1]):
        solution = minimize_torque(problem(units), 0.1)
        largest = int(np.abs(solution.torques).argmax())
        assert solution.max_torque_unit == units[largest]
        assert f"max |torque| = {solution.max_torque:.6g} {units[largest]}\n" in str(solution)


def test_a_table_of_mixed_joints_has_a_column_for_the_unit():
    lines = str(maximize_margin(problem(MIXED))).splitlines()
    header = next(k for k, line in enumerate(lines) if line.startswith("joint"))
    assert lines[header].split()[:2] == ["joint", "unit"]
    assert [line.split("  ")[1].strip() for line in lines[header + 2 : header + 4]] == [*MIXED]
    assert "unit" not in str(maximize_margin(problem())).split("touching")[0].split()


def test_fingers_say_what_their_joints_are():
    normals = np.array([[0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    fingers = [
        FingerContacts(ControlMode.FORCE, [0], np.ones((3, 2)), joint_units=MIXED),
        FingerContacts(ControlMode.HYBRID, [1], max_force=5.0),
    ]
    assert assemble_joint_space(normals, fingers).joint_units == ("N m", "N", "N")
    wrong = FingerContacts(ControlMode.FORCE, [0], np.ones((3, 2)), joint_units=["N m"])
    with pytest.raises(ArgumentError, match=r"^fingers\[0\]\.joint_units: has 1 units"):
        assemble_joint_space(normals, [wrong])


@pytest.mark.parametrize(
    ("example", "units"),
    [("panda_slide_cuboid_up_slope", {"N"}), ("trihand_push_box", {"N m"})],
)
def test_a_hand_tells_the_units_of_its_joints(example, units):
    scene = load_scene(EXAMPLES / f"{example}.yaml")
    assert set(scene.problem().joint_units) == units


def test_units_are_written_and_read_back(tmp_path):
    path = tmp_path / "solution.json"
    write_document(solution_document(maximize_margin(problem(MIXED))), path)
    document = json.loads(path.read_text(encoding="utf-8"))
    assert [joint["unit"] for joint in document["joints"]] == [*MIXED]
    assert read_solution(document).problem.joint_units == MIXED


def test_many_units_in_words():
    torque, force = JointUnit
    assert units_text((torque, torque)) == "N m"
    assert units_text((force,)) == "N"
    assert units_text((torque, force)) == "N m; N for prismatic and hybrid joints"
    assert units_text(()) == "N m"


@pytest.mark.parametrize("unit", JointUnit)
def test_a_comparison_of_rules_has_the_unit_of_the_joints(unit):
    assert f"max |torque| [{unit}]" in str(compare_rules(problem((unit, unit))))
