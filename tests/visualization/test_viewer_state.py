"""What the viewer's controls do to a scene, without a browser."""

import math
import re
from dataclasses import replace
from html import escape
from pathlib import Path

import numpy as np
import pytest
from tests.report.report_cases import micro_block

from graspless_pin import Stability, Uncertainty, maximize_margin
from graspless_pin.errors import ArgumentError
from graspless_pin.geometry.hand.model import displaced_hand
from graspless_pin.programs.objectives import Algorithm
from graspless_pin.scene import Acceleration, Scene, load_scene
from graspless_pin.viewer import (
    Settings,
    answer_settings,
    changed_scene,
    controls_of,
    initial_settings,
)
from graspless_pin.viewer.panels import (
    contacts_html,
    headline_html,
    legend_html,
    result_html,
    torque_html,
    verdict_html,
)
from graspless_pin.viewer.scene_process import contact_changes_text, with_region, with_verdict
from graspless_pin.visualization import Role

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ALLEGRO = EXAMPLES / "allegro_box_on_slope.yaml"
PAPER = EXAMPLES / "paper" / "cuboid_at_rest.yaml"


@pytest.fixture(scope="module")
def allegro():
    return load_scene(ALLEGRO)


@pytest.fixture(scope="module")
def paper():
    return load_scene(PAPER)


def by_key(scene):
    return {control.key: control for control in controls_of(scene)}


def write(folder: Path, text: str):
    file = folder / "scene.yaml"
    file.write_text(text, encoding="utf-8")
    return load_scene(file)


def torques_of(shown):
    assert shown.solution is not None and shown.solution.found
    return shown.solution.torques


def test_what_is_not_known_exactly_counts(paper):
    """The page shows the torques for the whole set, under the nominal scene."""
    unknown = paper.with_changes(uncertainty=Uncertainty(mass=0.2, center_of_mass=0.01))
    asked = Settings("torque", 0.1)
    shown = answer_settings(unknown, asked)
    robust = unknown.solve("torque", margin=0.1, uncertainty=True)
    np.testing.assert_allclose(torques_of(shown), robust.torques, atol=1e-9)
    assert shown.bodies == paper.contacts.bodies
    assert "mass ±20 %, centre of mass ±1 cm, proven for the whole set" in shown.limits[0]
    assert escape(shown.limits[0]) in result_html(shown, None, dark=False)
    heavier = answer_settings(unknown, replace(asked, values={"mass": 2.0 * paper.object.mass}))
    sizes = [np.abs(torques_of(one)).max() for one in (answer_settings(paper, asked), shown)]
    assert sizes[0] < sizes[1] < np.abs(torques_of(heavier)).max()


def test_members_in_conflict_are_told():
    box = load_scene(EXAMPLES / "trihand_push_box.yaml")
    unknown = box.with_changes(uncertainty=Uncertainty(mass=0.2))
    shown = answer_settings(unknown, Settings("margin", 0.1))
    assert shown.solution is not None and not shown.solution.found
    assert shown.solution.problem.contact_count == len(box.contacts.bodies)
    assert "mass -20 %" in shown.reason and "mass +20 %" in shown.reason


def test_an_internal_error_is_shown_at_its_state(paper, monkeypatch):
    settings, heavier = initial_settings(paper), {"mass": 2.0}
    solve = Scene.solve

    def broken(self, *given, **options):
        if self.object.mass > 1.5:
            raise ZeroDivisionError("ours")
        return solve(self, *given, **options)

    monkeypatch.setattr(Scene, "solve", broken)
    shown = answer_settings(paper, replace(settings, values=heavier))
    assert shown.solution is None and shown.picture.meshes
    assert re.fullmatch(
        r"internal error in scene_process\.py, line \d+: ZeroDivisionError: ours; "
        "please report it",
        shown.reason,
    )
    assert shown.reason in headline_html(shown, dark=False) + result_html(shown, None, dark=False)
    again = answer_settings(paper, settings).solution
    assert again is not None and again.found


def test_an_internal_error_in_a_verdict_is_shown(paper, monkeypatch):
    shown = answer_settings(paper, initial_settings(paper))
    monkeypatch.setattr("graspless_pin.scene.scene_stability.verdict_of", lambda *_, **__: 1 / 0)
    judged = with_verdict(shown)
    assert judged.solution is shown.solution and judged.stability is None
    assert "no verdict: internal error in scene_stability.py" in str(judged.verdict)
    assert "please report it" in verdict_html(judged, dark=False)

    def refuse(*_, **__):
        raise ArgumentError("joint_inertia", "no mass")

    monkeypatch.undo()
    monkeypatch.setattr("graspless_pin.scene.scene_stability.verdict_of", refuse)
    judged = with_verdict(answer_settings(paper, initial_settings(paper)))
    assert judged.verdict == "no verdict: joint_inertia: no mass"
    assert judged.stability is None


def test_controls_begin_at_the_scenes_own_values(allegro):
    controls = by_key(allegro)
    assert controls["friction/hand"].initial == 0.9
    assert controls["friction/supports"].initial == 0.35
    assert controls["mass"].initial == 1.0
    assert controls["slope"].initial == pytest.approx(30.0, abs=1e-3)
    joints = {key.removeprefix("joint/") for key in controls if key.startswith("joint/")}
    assert joints == set(allegro.hand.joint_names)
    for control in controls.values():
        assert control.low <= control.initial <= control.high
        assert control.low < control.high
        assert control.step > 0.0
    values = {key: control.initial for key, control in by_key(allegro).items()}
    assert changed_scene(allegro, values) is allegro


def test_friction_of_one_group_becomes_the_value(allegro):
    changed = changed_scene(allegro, {"friction/supports": 0.5})
    bodies = changed.contacts.bodies
    for body, mu in zip(bodies, changed.problem().friction, strict=True):
        assert mu == pytest.approx(0.5 if body == "slope" else 0.9)
    hand = changed_scene(allegro, {"friction/hand": 0.3}).problem().friction
    assert sorted(set(hand.round(9))) == [0.3, 0.35]
    none = changed_scene(changed_scene(allegro, {"friction/hand": 0.0}), {"friction/hand": 0.7})
    assert none.problem().friction.max() == pytest.approx(0.7)


SHELF = """\
friction: {default: 0.2, wall: 0.1}
materials: {wood: {steel: 0.4}}
hand: {robot: lever_100mm, base_pose: {position: [-0.1, -0.1, 0.0], rpy: [3.141592653589793, 0, 0]},
       material: wood}
object: {shape: {type: box, size: [0.2, 0.2, 0.2]}, mass: 1.0, material: steel}
supports:
  - {name: floor, shape: {type: half_space}, pose: {position: [0, 0, -0.1]}, material: wood}
  - {name: wall, shape: {type: half_space},
     pose: {position: [0, 0.1, 0], rpy: [1.5707963267948966, 0, 0]}}
"""


def test_materials_and_own_coefficients_scale_together(tmp_path):
    scene = write(tmp_path, SHELF)
    controls = by_key(scene)
    assert controls["friction/supports"].initial == 0.4
    assert "largest" in controls["friction/supports"].label
    changed = changed_scene(scene, {"friction/supports": 0.8, "friction/hand": 0.1})
    friction = dict(zip(changed.contacts.bodies, changed.problem().friction, strict=True))
    assert friction.pop("floor") == pytest.approx(0.8)
    assert friction.pop("wall") == pytest.approx(0.2)
    assert list(friction.values()) == pytest.approx([0.1] * len(friction))


def test_mass_scales_the_weight_and_joints_move_the_hand(allegro):
    weight = changed_scene(allegro, {"mass": 2.5}).problem().external_wrench[:3]
    assert weight == pytest.approx([0.0, 0.0, -2.5 * 9.81])
    changed = changed_scene(allegro, {"joint/joint_12.0": 0.6})
    assert changed.hand is not None
    assert changed.hand.q["joint_12.0"] == 0.6
    assert changed.hand.q["joint_1.0"] == allegro.hand.q["joint_1.0"]


def test_the_slope_is_the_angle_between_normal_and_up(allegro, paper):
    for scene in (allegro, paper):
        for angle in (5.0, 20.0, 60.0):
            changed = changed_scene(scene, {"slope": angle})
            normal = scene.supports[0].T_world_support[:3, 2]
            cosine = -normal @ changed.gravity / np.linalg.norm(changed.gravity)
            assert math.degrees(math.acos(cosine)) == pytest.approx(angle)
            assert np.linalg.norm(changed.gravity) == pytest.approx(np.linalg.norm(scene.gravity))
            # It tilts about the slope's level line: gravity stays in the plane of steepest fall.
            plane = np.cross(normal, scene.gravity)
            assert changed.gravity @ plane == pytest.approx(0.0, abs=1e-9)


def test_a_level_floor_can_be_tilted_both_ways():
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    assert by_key(scene)["slope"].low < 0.0
    left = changed_scene(scene, {"slope": -10.0}).gravity
    right = changed_scene(scene, {"slope": 10.0}).gravity
    assert left * [-1, 1, 1] == pytest.approx(right)
    assert right[0] == pytest.approx(9.81 * math.sin(math.radians(10.0)))


def test_the_object_is_shifted_and_turned_about_its_centre(paper):
    values = {"object/x": 1.0, "object/z": -2.0, "object/turn_z": 90.0}
    moved = changed_scene(paper, values).object
    expected = paper.object.center_of_mass_world + np.array([0.001, 0.0, -0.002])
    assert moved.center_of_mass_world == pytest.approx(expected)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    before = paper.object.T_world_object[:3, :3]
    assert moved.T_world_object[:3, :3] == pytest.approx(turn @ before)


def test_the_object_stays_in_the_supports_plane_where_it_is_asked_to(allegro):
    values = {"object/x": -10.0, "object/z": 5.0, "object/turn_x": 20.0, "object/along": 1.0}
    moved = changed_scene(allegro, values).object
    normal = allegro.supports[0].T_world_support[:3, 2]
    way = moved.center_of_mass_world - allegro.object.center_of_mass_world
    free = np.array([-0.01, 0.0, 0.005])
    assert way == pytest.approx(free - (free @ normal) * normal)
    turn = moved.T_world_object[:3, :3] @ allegro.object.T_world_object[:3, :3].T
    assert turn @ normal == pytest.approx(normal)
    assert changed_scene(allegro, values).contacts.bodies.count("slope") == 4


def test_the_hands_base_moves_and_its_links_with_it(allegro):
    changed = changed_scene(allegro, {"hand/x": 30.0, "hand/turn_z": 90.0})
    assert changed.hand is not None
    T = changed.hand.T_world_base @ np.linalg.inv(allegro.hand.T_world_base)
    turn = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    assert T[:3, :3] == pytest.approx(turn, abs=1e-9)
    base = allegro.hand.T_world_base[:3, 3]
    assert changed.hand.T_world_base[:3, 3] == pytest.approx(np.add(base, [0.03, 0.0, 0.0]))
    for link in allegro.hand.link_names:
        assert changed.hand.pose_of(link) == pytest.approx(T @ allegro.hand.pose_of(link))
    gravity = [0.0, 0.0, -9.81]
    bent = displaced_hand(allegro.hand, T)
    turned = T[:3, :3].T @ gravity
    assert bent.gravity_torques(gravity) == pytest.approx(allegro.hand.gravity_torques(turned))
    first, second = allegro.hand.placed_bodies, bent.placed_bodies
    assert len(first.poses) == len(second.poses)
    assert second.poses == pytest.approx(T @ first.poses)


def test_it_is_said_which_contacts_came_and_went(allegro):
    first = answer_settings(allegro, initial_settings(allegro))
    lifted = answer_settings(allegro, Settings(Algorithm.MARGIN, 0.1, {"object/z": 1.5}))
    assert first.bodies is not None and lifted.bodies is not None
    said = contact_changes_text(first.bodies, lifted.bodies)
    assert said == "4 contacts gone: slope (4)"
    back = contact_changes_text(lifted.bodies, first.bodies)
    assert back == said.replace(" gone: ", " new: ")
    assert (
        contact_changes_text(["a", "b", "b"], ["b", "c"])
        == "2 contacts gone: a (1), b (1); 1 contact new: c (1)"
    )
    assert contact_changes_text(["a", "b"], ["b", "a"]) == ""


def test_unknown_controls_and_values_are_refused(allegro):
    with pytest.raises(ArgumentError, match="unknown control 'frictoin'"):
        changed_scene(allegro, {"frictoin": 1.0})
    with pytest.raises(ArgumentError, match="finite"):
        changed_scene(allegro, {"mass": math.nan})


def test_given_contacts_leave_object_and_joints_alone(tmp_path):
    scene = write(
        tmp_path,
        "friction: 0.5\nobject: {shape: {type: box, size: [1, 1, 1]}, mass: 1}\n"
        "supports: [{name: floor, shape: {type: half_space}, pose: {position: [0, 0, -0.5]}}]\n"
        "contacts: [{body: floor, position: [0, 0, -0.5], normal: [0, 0, 1]}]\n",
    )
    assert set(by_key(scene)) == {"friction/supports", "mass", "slope"}


def test_the_evaluation_is_the_librarys(allegro):
    settings = Settings(Algorithm.MARGIN, 0.1, {"friction/supports": 0.5})
    result = answer_settings(allegro, settings)
    expected = changed_scene(allegro, settings.values).solve("margin")
    assert result.solution is not None
    assert result.solution.margin == expected.margin
    assert result.reason == ""
    assert result.picture.of(Role.NORMAL_FORCE)
    least = answer_settings(allegro, Settings(Algorithm.TORQUE, 0.3))
    assert least.solution is not None
    assert least.solution.required_margin == 0.3
    assert least.solution.margin >= 0.3 - 1e-6


def test_a_setting_that_is_infeasible_or_makes_no_sense_says_why(allegro):
    too_much = 0.6 * allegro.max_normal_force  # a margin is at most half of it
    result = answer_settings(allegro, Settings(Algorithm.TORQUE, too_much))
    assert result.solution is not None
    assert not result.solution.found
    assert "infeasible" in result.reason
    assert result.picture.of(Role.CONTACT)
    assert not result.picture.of(Role.NORMAL_FORCE)
    assert "Why there are no torques" in result_html(result, None, dark=False)
    assert "no torques" in torque_html(result, dark=False)
    result = answer_settings(allegro, Settings(Algorithm.MARGIN, 0.1, {"object/x": 20.0}))
    assert result.solution is None
    assert "overlap" in result.reason
    assert result.picture.of(Role.OBJECT)
    assert not result.picture.of(Role.CONTACT)


def test_the_page_begins_with_the_scenes_own_options():
    scene = load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml")
    settings = initial_settings(scene)
    assert settings.algorithm == Algorithm.TORQUE
    assert settings.required_margin == 1.0
    result = answer_settings(scene, settings)
    assert result.solution is not None
    assert result.solution.max_torque == scene.solve().max_torque


def test_readings_hold_the_figures_and_no_markup_of_the_scene(allegro):
    result = answer_settings(allegro, initial_settings(allegro))
    assert result.solution is not None
    html = result_html(result, result.solution, dark=True)
    assert f"{result.solution.margin:.4f}" in html
    assert f"{result.solution.max_torque:.4f}" in html
    bars = torque_html(result, dark=False)
    for name, torque in zip(
        allegro.hand.actuated_joint_names, result.solution.torques, strict=True
    ):
        assert f">{name}<" in bars
        told = f"{torque:+.4f}" if abs(torque) >= 5e-5 else f"{torque:+.1e}"
        assert f">{told if abs(torque) > 1e-6 else 0}<" in bars
    legend = legend_html(Role, result.picture, dark=True)
    assert all(words in legend for words in (*(role.label for role in Role), "index", "1 cm = "))
    assert "contact 3" not in contacts_html(result) and "slope<" in contacts_html(result)
    assert f"{result.solution.margin:.4f}</b> N" in headline_html(result, dark=False)
    hostile = answer_settings(allegro, Settings(Algorithm.MARGIN, 0.1, {"<script>": 1.0}))
    assert "<script>" not in result_html(hostile, None, dark=False)
    assert "&lt;script&gt;" in result_html(hostile, None, dark=False)


def test_no_torque_is_minus_nothing():
    scene = load_scene(EXAMPLES / "allegro_tumble_box.yaml")
    result = answer_settings(scene, initial_settings(scene))
    assert result.solution is not None
    torques = result.solution.torques
    assert ((torques < 0.0) & (torques > -5e-5)).any()  # what rounds to -0.0000
    assert "-0.0000" not in torque_html(result, dark=False)


def test_micro_figures_have_digits(paper):
    """A millionth of the forces on a thousandth of the lengths, and no zeros."""
    answer = answer_settings(paper, initial_settings(paper))
    solution = maximize_margin(micro_block())
    shown = result_html(replace(answer, solution=solution), solution, dark=False)
    assert f"{solution.margin:.5g}</b>" in shown and f"{solution.max_torque:.5g}</b>" in shown
    bars = torque_html(replace(answer, solution=solution), dark=False)
    assert all(f"{torque:+.5g}</span>" in bars for torque in solution.torques)


def test_the_largest_torque_has_the_unit_of_its_joint(allegro):
    linear = load_scene(EXAMPLES / "panda_slide_cuboid_up_slope.yaml")
    for scene, unit in ((allegro, "N m"), (linear, "N")):
        shown = result_html(answer_settings(scene, initial_settings(scene)), None, dark=False)
        assert f"</b> {unit}</span>" in shown.partition("max torque")[2]


def test_where_the_centre_of_mass_may_be_comes_with_the_verdict(allegro):
    first = answer_settings(allegro, initial_settings(allegro))
    assert not first.picture.of(Role.CENTER_REGION)
    judged = with_region(first)
    assert first.solution is not None and judged.sliding is not None
    for picture in (judged.picture, judged.sliding.picture):
        assert picture.of(Role.CENTER_REGION)
    nothing = replace(first, solution=None, reason="why")
    assert with_region(nothing) is nothing
    turning = allegro.with_changes(acceleration=Acceleration(angular=(0.0, 0.0, 0.1)))
    left_out = answer_settings(turning, initial_settings(turning))
    assert with_region(left_out) is left_out


def test_the_verdict_comes_after_the_solution(paper):
    first = answer_settings(paper, initial_settings(paper))
    assert (first.verdict, first.stability, first.motion) == (None, None, None)
    assert "being computed" in verdict_html(first, dark=False)
    judged = with_verdict(first)
    assert first.solution is not None
    assert (judged.stability, judged.motion) == (Stability.STRONG, None)
    assert judged.verdict == str(paper.stability(first.solution.torques, node_limit=300))
    assert "<b>Holds</b> the object provably stays at rest (" in verdict_html(judged, dark=False)
    walls = load_scene(EXAMPLES / "box_between_walls.yaml")
    may_fall = with_verdict(answer_settings(walls, initial_settings(walls)))
    assert may_fall.stability is Stability.WEAK and may_fall.motion is not None
    assert "<b>May fail</b> the object can slip down" in verdict_html(may_fall, dark=True)
    nothing = replace(first, solution=None, reason="why")
    assert with_verdict(nothing) is nothing and verdict_html(nothing, dark=False) == ""
