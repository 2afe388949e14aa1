"""Waypoints read from tables, and the example's plan of contact points."""

import numpy as np
import pytest
from planning_scenes import example, turned
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation

from graspless_pin.errors import ArgumentError
from graspless_pin.planning import (
    Evaluator,
    Waypoint,
    evaluate_path,
    read_path_csv,
    write_path_csv,
)

HEADER = "object_x_m,object_y_m,object_z_m,object_qx,object_qy,object_qz,object_qw"


@pytest.mark.parametrize("name", ["trihand_pivot_box", "panda_slide_cuboid_up_slope"])
def test_a_written_profile_reads_back_as_its_waypoints(tmp_path, name):
    scene = example(name)
    T = scene.object.T_world_object
    turns = (0.0, 0.001, 0.002) if "pivot" in name else (0.0,)
    given = [Waypoint(None, turned(T, -angle), 1.0 + angle) for angle in turns]
    profile = evaluate_path(scene, given)
    write_path_csv(profile, tmp_path / "path.csv")
    read = read_path_csv(tmp_path / "path.csv")
    assert [one.time for one in read] == [one.time for one in given]
    for k, one in enumerate(read):
        np.testing.assert_allclose(
            np.asarray(one.T_world_object), profile.object_poses[k], atol=1e-14
        )
        assert one.q == dict(zip(profile.position_names, profile.positions[k], strict=True))
    again = evaluate_path(scene, read)
    np.testing.assert_allclose(again.margins, profile.margins, atol=1e-9)
    assert again.found == profile.found


def test_columns_may_be_few_and_in_any_order(tmp_path):
    file = tmp_path / "plan.csv"
    text = "cost, position_a_b_m ,position_arm_m_rad\n9,0.25,-1e-3\n\n8,1,2\n"
    file.write_text(text, "utf-8-sig")
    first, second = read_path_csv(file)
    assert [first.q, second.q] == [{"a_b": 0.25, "arm_m": -0.001}, {"a_b": 1, "arm_m": 2}]
    assert first.T_world_object is None and first.time is None
    names = HEADER.split(",")
    file.write_text(",".join(reversed(names)) + "\n0.5,0.5,0.5,0.5,3,2,1\n", "utf-8")
    (only,) = read_path_csv(str(file))
    assert only.q is None and only.time is None
    # A third of a turn about the diagonal takes x to y, y to z and z to x.
    expected = [[0, 0, 1, 1], [1, 0, 0, 2], [0, 1, 0, 3], [0, 0, 0, 1]]
    np.testing.assert_allclose(np.asarray(only.T_world_object), expected, atol=1e-15)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is not a table of comma-separated values"),
        ('time_s\n"1\n', "is not a table of comma-separated values"),
        ("time_s\n", "has no row below its header"),
        ("x,y\n1,2\n", "has the columns x, y; it must have time_s, the seven columns"),
        ("object_x_m,time_s\n1,2\n", "has no column object_y_m, object_z_m, object_qx"),
        (
            "position_a_deg\n1\n",
            "column 'position_a_deg' has no unit; its name must end in _rad or _m",
        ),
        ("time_s,position_a_rad\n1,2\n2,x\n", r"row 3, column position_a_rad: found 'x'; must be"),
        ("time_s,time_s\n0,5\n", "has two columns 'time_s'; keep one"),
        ("time_s\nnan\n", r"row 2, column time_s: found 'nan'; must be a finite number"),
        ("time_s\n1,2\n", "row 2 has 2 cells, but the header has 1; if it has decimal commas"),
        ("time_s,a,b\n1,2\n", "row 2 has 2 cells, but the header has 3$"),
        (
            "time_s;position_a_rad\n1;0,2\n",
            "has semicolons between its columns; separate columns by commas",
        ),
        (
            "time_s\tposition_a_rad\n1\t0.2\n",
            "has tabs between its columns; separate columns by commas",
        ),
        (
            'time_s,a\n"0,5",1\n',
            r"column time_s: found '0,5'; must be .* with a decimal point \(0.5\)",
        ),
        ("time_s,q1 [deg]\n1,2\n", r"column 'q1 \[deg\]' has its unit .* 'position_q1_rad' and"),
        ("time_s,position_a (mm)\n1,2\n", r"'position_a \(mm\)' has .* 'position_a_m' and give"),
        ("time [s],position_a_rad\n1,2\n", r"'time \[s\]' has its unit .* name it 'time_s'"),
        ("object x [m],time_s\n1,2\n", r"'object x \[m\]' has .* name it 'object_x_m'"),
        ("Time_S,position_a_rad\n1,2\n", "column 'Time_S': did you mean 'time_s'?"),
        ("time_s,Positon_a_rad\n1,2\n", "'Positon_a_rad': did you mean 'position_a_rad'?"),
        ("obj_x_m,time_s\n1,2\n", "column 'obj_x_m': did you mean 'object_x_m'?"),
        (f"{HEADER}\n0,0,0,0,0,0,2\n", r"waypoint 0: the quaternion \(x, y, z, w\) has the norm 2"),
    ],
)
def test_a_bad_table_is_told(tmp_path, text, message):
    file = tmp_path / "plan.csv"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(ArgumentError, match=message):
        read_path_csv(file)
    with pytest.raises(ArgumentError, match="cannot read"):
        read_path_csv(tmp_path / "none.csv")


LENGTH, HEIGHT, AT = 0.2, 0.1, 0.03  # m: of the box, and of the finger above its middle


def ladder(angle):
    """The box's pose with its lower edge on the floor and its upper edge at the wall."""
    T = np.eye(4)
    T[:3, :3] = Rotation.from_euler("y", angle).as_matrix()
    lower = [-HEIGHT * np.sin(angle), 0.0, 0.0]
    T[:3, 3] = lower - T[:3, :3] @ [LENGTH / 2, 0.0, -HEIGHT / 2]
    return T


def balances(angle, mu_hand, mu_support, largest):
    """Whether forces of finger, floor and wall in the plane can hold the box, by a program."""
    T, weight = ladder(angle), 9.81
    finger = T[:3, :3] @ [-LENGTH / 2, 0.0, AT]
    floor, wall = (T[:3, :3] @ [LENGTH / 2, 0, z] for z in (-HEIGHT / 2, HEIGHT / 2))
    into = T[:3, 0]
    points = (finger, into, mu_hand), (floor, [0, 0, 1], mu_support), (wall, [-1, 0, 0], mu_support)
    columns = []
    for point, normal, mu in points:
        along = np.cross(normal, [0.0, 1.0, 0.0])
        edges = [np.add(normal, sign * mu * along) for sign in (1, -1)]
        columns += [[f[0], f[2], np.cross(point, f)[1]] for f in edges]
    A = np.array(columns).T
    tip = np.column_stack([into + s * mu_hand * np.cross(into, [0, 1, 0]) for s in (1, -1)])
    limits = np.vstack([tip[[0, 2]], -tip[[0, 2]]])
    A_ub = np.hstack([limits, np.zeros((4, 4))])
    program = linprog(np.zeros(6), A_ub, np.full(4, largest), A, [0.0, weight, 0.0])
    return program.status == 0


def test_the_examples_plan_is_a_ladder_that_slips_and_balances_where_statics_says_so():
    scene = example("pivot_against_wall")
    plan = np.loadtxt(scene.path.with_suffix(".csv"), delimiter=",", skiprows=1)
    angles = np.deg2rad(np.arange(0, 61, 5))
    poses = np.array([ladder(angle) for angle in angles])
    np.testing.assert_allclose(plan[:, 6:9], poses[:, :3, 3], atol=1e-9)
    turns = Rotation.from_quat(plan[:, 9:]).as_matrix()
    np.testing.assert_allclose(turns, poses[:, :3, :3], atol=1e-8)
    np.testing.assert_array_equal(plan[:, :6], [[-LENGTH / 2, 0, AT, 1, 0, 0]] * 13)
    tips = (poses @ [-LENGTH / 2 - 0.001, 0.0, AT, 1.0])[:, :3]
    states = Evaluator(scene).evaluate_many(tips, poses, evaluations=range(13), workers=1)
    assert states.found.all() and states.margins.min() > 1.0
    for k in range(1, 13):
        found = states.evaluations[k].contacts
        assert sorted(found.bodies) == ["floor", "floor", "tip", "wall", "wall"]
        at = dict(zip(found.bodies, found.arrays.positions, strict=True))
        expected = (poses[k] @ [-LENGTH / 2, 0, AT, 1])[:3]
        np.testing.assert_allclose(at["tip"], expected, atol=1e-8)
        np.testing.assert_allclose(at["floor"][::2], [-HEIGHT * np.sin(angles[k]), 0], atol=1e-8)
        np.testing.assert_allclose(at["wall"][::2], [0, HEIGHT * np.cos(angles[k])], atol=1e-8)
    outcomes = set()
    for mu_hand, mu_support in [(0.05, 0.05), (0.1, 0.3), (0.2, 0.05), (0.3, 0.0), (0.0, 0.4)]:
        with_friction = scene.with_changes(friction={"hand": mu_hand, "supports": mu_support})
        found = Evaluator(with_friction, static_friction="coulomb").evaluate_many(tips, poses).found
        stated = [balances(angle, mu_hand, mu_support, 60.0) for angle in angles[1:]]
        assert found[1:].tolist() == stated
        outcomes |= {*stated}
    assert outcomes == {True, False}
