"""`graspless-pin robots` and `graspless-pin inspect`."""

import pytest
from cli_tools import run

from graspless_pin.geometry.robots.files import robot_names


def test_robots_are_listed_and_one_shows_its_joints_and_sources():
    result = run("robots")
    assert result.exit_code == 0
    lines = result.stdout.splitlines()[2:]
    assert [line.split()[0] for line in lines if line[0] != " "] == list(robot_names())
    assert max(map(len, result.stdout.splitlines())) <= 80
    allegro = next(line for line in lines if line.startswith("allegro_right"))
    assert "index, middle, ring," in allegro and "0.7" in allegro
    assert any("coupled" in line for line in lines)
    result = run("robots", "allegro_right")
    assert result.exit_code == 0
    assert "joint_15.0" in result.stdout and "-0.7 .. 0.7" in result.stdout
    assert "data sheet" in result.stdout


@pytest.mark.parametrize("command", ["robots", "inspect"])
def test_an_unknown_robot_is_refused_by_name(command):
    result = run(command, "allegrow_right")
    assert "allegrow_right" in result.output and "allegro_right" in result.output


def test_an_audit_says_what_to_do(tmp_path):
    urdf = tmp_path / "finger.urdf"
    urdf.write_text(
        '<robot name="finger"><link name="base"/><link name="tip"><collision><geometry>'
        '<mesh filename="tip.stl"/></geometry></collision></link><joint name="bend" '
        'type="revolute"><parent link="base"/><child link="tip"/><axis xyz="0 0 1"/>'
        '<limit lower="0" upper="1" effort="0" velocity="1"/></joint></robot>'
    )
    result = run("inspect", urdf)
    assert result.exit_code == 1
    assert "missing collision mesh" in result.stdout and "tip.stl" in result.stdout
    assert "placeholder effort" in result.stdout and "bend" in result.stdout
    assert "2 links without mass (verdicts and simulations are impossible)" in result.stdout
    # A sound robot passes.
    result = run("inspect", "trihand")
    assert result.exit_code == 0
    assert "can be mounted as it is" in result.stdout and "without mass" not in result.stdout


def test_a_hand_that_touches_nothing_loads_and_is_doubtful(tmp_path):
    urdf = tmp_path / "bare.urdf"
    urdf.write_text('<robot name="bare"><link name="base"/></robot>')
    result = run("inspect", urdf, "--root-link", "base")
    assert result.exit_code == 4
    assert "can be mounted, but something serious is wrong" in result.stdout
    result = run("inspect", urdf, "--root-link", "palm")
    assert result.exit_code == 1
    assert "there is no link 'palm'" in result.stdout and "0 links" not in result.stdout
    assert "fingers:\n  none found\n" in run("robots", urdf).stdout
