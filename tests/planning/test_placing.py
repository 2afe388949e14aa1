"""A hand that is anywhere is brought to the object; the answer says why it does not hold it."""

from __future__ import annotations

import itertools
import re
from collections.abc import Callable
from dataclasses import replace
from typing import Any
from unittest.mock import MagicMock

import numpy as np
import pytest
import trimesh

from graspless_pin import Hand, QuasistaticProblem, Scene, place_hand
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.geometry.bodies.object_and_supports import ManipulatedObject, Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace, MeshShape, Sphere
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import displaced_hand
from graspless_pin.geometry.poses import invert, pose_matrix
from graspless_pin.geometry.posing.closing import centering_shift, retraction_distance, shortfall
from graspless_pin.geometry.posing.opposing import fingers_that_close, opposing_postures
from graspless_pin.geometry.robots.files import describe_urdf
from graspless_pin.planning import (
    HandPlacement,
    PlacedHand,
    PlacingFault,
    placing,
    placing_candidates,
)
from graspless_pin.planning.placing_candidates import can_squeeze
from graspless_pin.planning.placing_plan import PlacingAim

FINGER = """
<joint name="{side}_slide" type="prismatic"><parent link="palm"/><child link="{side}_jaw"/>
<origin xyz="{x} 0 0.05"/><axis xyz="{axis} 0 0"/>{mimic}
<limit lower="0" upper="0.05" effort="20" velocity="1"/></joint>
<link name="{side}_jaw"><inertial><mass value="0.05"/>
<inertia ixx="1e-5" iyy="1e-5" izz="1e-5" ixy="0" ixz="0" iyz="0"/></inertial>
<collision><geometry><box size="0.01 0.02 0.06"/></geometry></collision></link>"""
GRIPPER = (
    '<link name="palm"><collision><geometry><box size="0.14 0.04 0.02"/></geometry></collision>'
    "</link>"
    + FINGER.format(side="left", x=-0.01, axis=-1, mimic="")
    + FINGER.format(side="right", x=0.01, axis=1, mimic='<mimic joint="left_slide"/>')
)
CUBE = Box((0.05, 0.05, 0.05))
DOWN = np.array([0.0, 0.0, -1.0])


@pytest.fixture(scope="module")
def robot_of(tmp_path_factory: pytest.TempPathFactory) -> Callable[[str], Any]:
    """Describes a robot by its links and joints."""

    def described(text: str) -> Any:
        file = tmp_path_factory.mktemp("robot") / "robot.urdf"
        file.write_text(f'<robot name="robot">{text}</robot>')
        return describe_urdf(file)

    return described


@pytest.fixture(scope="module")
def gripper(robot_of) -> Hand:
    """Two jaws of one motor, 1 to 11 cm apart, closing at zero; the palm looks along +z."""
    return Hand.assemble([Mount(robot_of(GRIPPER))])


def scene_of(hand: Hand, mass: float = 0.3) -> Scene:
    """A cube above a table, and the hand two metres above both."""
    return Scene(
        name="a cube",
        object=ManipulatedObject.from_shape("cube", CUBE, pose_matrix([0.0, 0.0, 1.2]), mass=mass),
        friction={"default": 0.6},
        hand=displaced_hand(hand, pose_matrix([0.0, 0.0, 2.0])),
        supports=(Support("table", HalfSpace(), np.eye(4)),),
    )


@pytest.fixture(scope="module")
def scene(gripper: Hand) -> Scene:
    return scene_of(gripper)


@pytest.fixture(scope="module")
def found(scene: Scene) -> HandPlacement:
    return place_hand(scene, candidates=60, workers=1, verdict_nodes=100)


def quickly(scene: Scene, **options: Any) -> Any:
    return place_hand(scene, **{"workers": 1, "verdict_nodes": 0, **options})


def test_the_best_place_holds_with_two_links_and_clear_of_the_table(scene: Scene, found) -> None:
    """The object is put down first."""
    assert scene.object.T_world_object[2, 3] == 1.2
    assert found.scene.object.T_world_object[2, 3] == pytest.approx(0.025, abs=2e-6)
    assert found.places
    for place in found.places:
        assert place.solution.margin >= 0.1
        assert {"left_jaw", "right_jaw"} <= set(place.touching)
        assert place.scene.solve().margin == pytest.approx(place.solution.margin, abs=1e-9)
        assert not [one for one in place.scene.findings if one.severity == "serious"]
        # Corners of all boxes of the hand, of which none may be at the table.
        for body in place.scene.hand.collision_bodies():
            half = np.array(body.geometry.halfSide)
            corners = half * (np.indices((2, 2, 2)).reshape(3, -1).T * 2 - 1)
            T = np.array(body.T_world_geometry)
            assert (corners @ T[:3, :3].T + T[:3, 3])[:, 2].min() > place.scene.contact_tolerance


def rank_of(place: PlacedHand, press: bool = False) -> tuple[float, ...]:
    """What a place is sorted by, told independently of the search."""
    status = "undecided" if place.verdict is None else str(place.verdict.status)
    proven = ["strong", "undecided", "weak", "none"].index(status)
    if press:
        return proven, -place.margin
    lifted = place.scene.with_changes(supports=()).solve("margin")
    alone = lifted.margin if lifted.found else -1.0
    return alone < 0.1, proven, -max(alone, 0.0), -place.solution.margin


def test_grips_that_carry_come_first_then_what_is_proven_then_the_margins(found) -> None:
    order = [rank_of(one) for one in found.places]
    assert np.allclose(order, sorted(order), atol=1e-6) and found.places[0].holds
    assert not order[0][0] and found.places[0].carrying_margin == pytest.approx(-order[0][2])
    assert [one.verdict is not None for one in found.places[:6]] == [True] * 5 + [False]


def test_all_places_are_told_in_a_table(scene: Scene, found) -> None:
    assert found.found == len(found.places) > 5 and f"and {found.found - 5} more" in str(found)
    asked = place_hand(scene, candidates=20, workers=1, verdict_nodes=20, verdicts=None)
    assert asked.places and all(one.verdict is not None for one in asked.places)
    assert [row[:3] for row in asked.table.rows] == [
        (rank, one.margin, f"{one.carrying_margin:.3g}") for rank, one in enumerate(asked.places, 1)
    ]
    assert str(asked.table).splitlines()[0].split() == asked.table.headers


# Two fingers side by side that bend the same way: they press on a lid, and oppose nothing.
PRESS = (
    '<link name="palm"><collision><geometry><box size="0.02 0.06 0.02"/></geometry></collision>'
    "</link>"
    + "".join(
        f"""<joint name="{side}_hinge" type="revolute"><parent link="palm"/>
    <child link="{side}_finger"/><origin xyz="0.02 {y} 0"/><axis xyz="0 1 0"/>
    <limit lower="0" upper="1.2" effort="2" velocity="1"/></joint>
    <link name="{side}_finger"><collision><origin xyz="0.04 0 0"/><geometry>
    <box size="0.08 0.01 0.01"/></geometry></collision></link>"""
        for side, y in (("left", 0.015), ("right", -0.015))
    )
)


@pytest.fixture(scope="module")
def press(robot_of) -> Any:
    return scene_of(Hand.assemble([Mount(robot_of(PRESS))]))


def test_feet_that_press_a_lid_are_no_grip_unless_that_is_asked_for(press: Any) -> None:
    pressed = quickly(press, aim="press", candidates=9)
    assert pressed.places and all(one.margin >= 0.1 for one in pressed.places)
    order = [rank_of(one, press=True) for one in pressed.places]
    assert order == sorted(order)
    for place in pressed.places:
        lifted = place.scene.with_changes(supports=()).solve("margin")
        assert not lifted.found and np.isnan(place.carrying_margin)
        assert "without supports none" in str(place)
    for aim in ("grip", "carry"):
        none = quickly(press, aim=aim, candidates=9)
        assert not none.places and none.faults[PlacingFault.NOTHING_OPPOSES] > 0
        assert "--press" in none.advice


def test_one_link_is_no_grip(press: Any) -> None:
    one = replace(press.hand, fingers=dict([*press.hand.fingers.items()][:1]))
    alone = press.with_changes(hand=one)
    assert quickly(alone, aim="press", candidates=15).places
    assert not [one for one in quickly(alone, candidates=15).places if len(one.touching) < 2]


def test_a_jaw_and_a_fixed_one_grip(robot_of) -> None:
    bar = '<collision><origin xyz="0 0 {z}"/><geometry><box size="0.01 0.03 {length}"/></geometry>'
    jaws = (
        f'<link name="palm">{bar.format(z=0.05, length=0.14)}</collision></link>'
        '<joint name="hinge" type="revolute"><parent link="palm"/><child link="jaw"/>'
        '<origin xyz="0.02 0 0.02"/><axis xyz="0 1 0"/>'
        '<limit lower="-0.1" upper="1.5" effort="2" velocity="1"/></joint>'
        f'<link name="jaw">{bar.format(z=0.05, length=0.1)}</collision></link>'
    )
    hand = Hand.assemble([Mount(robot_of(jaws))])
    small = ManipulatedObject.from_shape(
        "cube", Box((0.02, 0.02, 0.02)), pose_matrix([0.0, 0.0, 0.01]), mass=0.05
    )
    found = quickly(scene_of(hand).with_changes(object=small), candidates=60)
    assert found.places and found.places[0].carrying_margin > 0.1
    for place in found.places:
        assert {"palm", "jaw"} == set(place.touching)


# The gripper on an arm of six joints, one link of 0.3 m after another.
ARM = "".join(
    f"""<link name="{below}"><collision><origin xyz="0 0 {z}"/><geometry>
    <box size="0.03 0.03 {length}"/></geometry></collision></link>
    <joint name="{name}" type="revolute"><parent link="{below}"/><child link="{above}"/>
    <origin xyz="0 0 {2 * z}"/><axis xyz="{axis}"/>
    <limit lower="-2.8" upper="2.8" effort="50" velocity="1"/></joint>"""
    for name, below, above, axis, z, length in [
        ("turn", "base", "shoulder", "0 0 1", 0.03, 0.05),
        ("lift", "shoulder", "upper", "0 1 0", 0.02, 0.03),
        ("bend", "upper", "lower", "0 1 0", 0.15, 0.26),
        ("roll", "lower", "wrist", "0 0 1", 0.15, 0.26),
        ("nod", "wrist", "flange", "0 1 0", 0.02, 0.03),
        ("spin", "flange", "palm", "0 0 1", 0.03, 0.05),
    ]
)


@pytest.fixture(scope="module")
def on_arm(robot_of) -> Any:
    """A cube beside the base of the arm that carries the gripper."""
    hand = Hand.assemble([Mount(robot_of(ARM + GRIPPER), pose_matrix([-0.35, 0.0, 0.0]))])
    cube = ManipulatedObject.from_shape("cube", CUBE, pose_matrix([0.0, 0.0, 0.025]), mass=0.3)
    return scene_of(hand).with_changes(hand=hand, object=cube)


def test_an_arm_reaches_from_where_its_base_is(on_arm: Any) -> None:
    found = quickly(on_arm, candidates=12, approach=DOWN)
    assert found.places and found.places[0].carrying_margin > 0.1
    for place in found.places:
        hand = place.scene.hand
        np.testing.assert_array_equal(hand.T_world_base, on_arm.hand.T_world_base)
        assert any(hand.q[name] != on_arm.hand.q[name] for name in ("turn", "lift", "bend"))
        assert {"left_jaw", "right_jaw"} <= set(place.touching)
    moved = quickly(on_arm, candidates=8, approach=DOWN, move_base=True).places[0].scene.hand
    assert moved.q["bend"] == on_arm.hand.q["bend"]
    assert not np.allclose(moved.T_world_base, on_arm.hand.T_world_base)
    far = on_arm.with_changes(hand=displaced_hand(on_arm.hand, pose_matrix([-1.0, 0.0, 0.0])))
    none = quickly(far, candidates=4)
    assert not none.places and none.faults == {PlacingFault.OUT_OF_REACH: 4}
    assert "--move-base" in none.advice
    # One of all that gets farther does not change what nearly all of them need.
    nearly = replace(none, tried=10, faults={**none.faults, PlacingFault.TOUCHES_NOTHING: 1})
    assert "fingers" in nearly.advice
    for count in (8, 9):
        nearly = replace(nearly, faults={**nearly.faults, PlacingFault.OUT_OF_REACH: count})
        assert nearly.advice == none.advice


@pytest.fixture(scope="module")
def two_grippers(robot_of) -> Any:
    """A beam on a table, and two grippers above it."""
    robot = robot_of(GRIPPER)
    mounts = [
        Mount(robot, pose_matrix([0.0, side, 1.0]), prefix)
        for prefix, side in (("a_", -0.2), ("b_", 0.2))
    ]
    beam = ManipulatedObject.from_shape(
        "beam", Box((0.05, 0.4, 0.05)), pose_matrix([0.0, 0.0, 0.025]), mass=0.3
    )
    hand = Hand.assemble(mounts)
    return scene_of(hand).with_changes(hand=hand, object=beam)


def test_each_of_two_hands_is_placed_by_itself(two_grippers: Any) -> None:
    apart = [*two_grippers.hand.base_poses.values()]
    found = quickly(two_grippers, candidates=12, approach=DOWN)
    assert found.places
    for place in found.places:
        assert {link[:2] for link in place.touching} == {"a_", "b_"}
        now = [*place.scene.hand.base_poses.values()]
        assert not np.allclose(invert(now[0]) @ now[1], invert(apart[0]) @ apart[1])
    one_body = quickly(two_grippers, candidates=6, approach=DOWN, together=True, aim="press")
    for place in one_body.places:
        now = [*place.scene.hand.base_poses.values()]
        np.testing.assert_allclose(invert(now[0]) @ now[1], invert(apart[0]) @ apart[1], atol=1e-9)


def test_what_cannot_be_parted_is_said(two_grippers: Any, on_arm: Any) -> None:
    hand = two_grippers.hand
    jaws = {name: spec for name, spec in hand.fingers.items() if "left" in str(spec.joints)}
    lone = replace(hand, fingers=jaws, palms=())
    with pytest.raises(ArgumentError, match=r"together: .* only fingers of their mounts"):
        place_hand(two_grippers.with_changes(hand=lone))
    assert quickly(two_grippers.with_changes(hand=lone), candidates=2, together=True).tried == 2
    with pytest.raises(ArgumentError, match="together: moves the bases of arms"):
        place_hand(on_arm, together=True)


def test_an_object_too_heavy_to_be_carried_is_still_gripped(gripper: Hand) -> None:
    # Friction of 0.6 at two jaws of 20 N carries 24 N.
    heavy = scene_of(gripper, mass=4.0)
    gripped = quickly(heavy, candidates=12)
    assert gripped.places and all(np.isnan(one.carrying_margin) for one in gripped.places)
    none = quickly(heavy, candidates=12, aim="carry")
    assert not none.places and none.faults[PlacingFault.CANNOT_CARRY] > 0
    assert "by itself" in none.advice
    light = quickly(scene_of(gripper, mass=0.3), candidates=12, aim="carry")
    assert light.places and all(one.carrying_margin >= 0.1 for one in light.places)


@pytest.mark.parametrize(
    ("normals", "friction", "bodies", "expected"),
    [
        ([[1, 0, 0], [-1, 0, 0]], 0.0, "ab", True),
        ([[1, 0, 0], [-1, 0, 0]], 0.5, "aa", False),  # one body
        ([[1, 0, 0], [0, 1, 0]], 0.5, "ab", False),
        ([[1, 0, 0], [0, 1, 0]], 1.01, "ab", True),  # the line between them is in both cones
        ([[0, 0, -1], [0, 0, -1]], 2.0, "ab", False),  # on a lid
    ],
)
def test_two_bodies_squeeze_where_their_forces_balance(normals, friction, bodies, expected) -> None:
    normals = np.array(normals, dtype=float)
    problem = QuasistaticProblem(-0.03 * normals, normals, np.zeros(6), friction=friction)
    assert can_squeeze(problem, tuple(bodies)) is expected


def test_every_candidate_is_accounted_for(found) -> None:
    assert found.complete and found.tried == 60
    assert found.found + sum(found.faults.values()) == 60
    assert list(found.faults) == [fault for fault in PlacingFault if fault in found.faults]
    assert f"{found.found} of 60 candidates hold the object" in str(found)
    ranked = "\nranked by: carrying it without supports, verdict, margin without supports\n"
    assert ranked in str(found)
    assert "\nranked by: verdict, margin with supports\n" in str(
        replace(found, aim=PlacingAim.PRESS)
    )


def test_processes_find_the_same_places_and_another_seed_others(scene: Scene, found) -> None:
    again = quickly(scene, candidates=60, workers=2)
    assert again.faults == found.faults and again.found == found.found
    here, there = ({round(one.solution.margin, 6) for one in two.places} for two in (again, found))
    assert here == there
    assert quickly(scene, candidates=60, seed=1).faults != found.faults


def test_the_palm_comes_from_where_and_goes_for_what_it_is_told(scene: Scene) -> None:
    seen: list[tuple[int, int, int]] = []
    placed = quickly(
        scene, approach=1e-200 * DOWN, candidates=12, progress=lambda *told: seen.append(told)
    ).places
    assert placed and [one[:2] for one in seen] == [(k, 12) for k in range(1, 13)]
    for place in placed:
        way = place.scene.object.center_of_mass_world - place.scene.hand.T_world_base[:3, 3]
        assert way @ DOWN > 0.8 * np.linalg.norm(way)
    aside = np.array([0.0, 0.02, 0.04])
    (place, *_) = quickly(scene, approach=DOWN, point=aside, candidates=12).places
    T = place.scene.hand.T_world_base
    across = np.eye(3) - np.outer(T[:3, 2], T[:3, 2])
    assert np.linalg.norm(across @ (T[:3, 3] - aside)) < 0.03


@pytest.mark.parametrize(
    ("mass", "options", "fault", "advice"),
    [
        (0.3, {"approach": -DOWN}, PlacingFault.SUPPORT_IN_THE_WAY, "touches a support"),
        (100.0, {"approach": DOWN}, PlacingFault.INFEASIBLE, "effort limits"),
        (0.3, {"margin": 1e3}, PlacingFault.MARGIN_TOO_SMALL, ""),
    ],
)
def test_no_place_is_an_answer_with_a_reason(gripper, mass, options, fault, advice) -> None:
    found = quickly(scene_of(gripper, mass=mass), candidates=20, **options)
    assert found.scene is None and not found.places and found.faults[fault] > 0
    assert advice in found.advice and str(found).endswith(found.advice)


def test_an_internal_error_costs_one_candidate_and_is_told(scene: Scene, monkeypatch) -> None:
    """Closing a hand raises what nobody foresaw, at every fifth candidate."""
    close, calls = placing_candidates.close_hand, itertools.count()

    def broken(*arguments: Any, **options: Any) -> Any:
        if next(calls) % 5 == 0:
            raise ZeroDivisionError("a fault\nof ours")
        return close(*arguments, **options)

    monkeypatch.setattr(placing_candidates, "close_hand", broken)
    found = quickly(scene, candidates=30)
    lost = found.faults[PlacingFault.INTERNAL_ERROR]
    assert found.places and 0 < lost < 10 and found.complete
    assert found.found + sum(found.faults.values()) == 30
    ((error, count),) = found.errors.items()
    assert count == lost and re.fullmatch(
        r"internal error in \w+\.py, line \d+: ZeroDivisionError: a fault of ours", error
    )
    assert f"{error} (x {lost}); please report it" in str(found)
    assert f"{lost} an internal error occurred" in str(found)


def test_an_internal_error_at_each_candidate_is_no_place(scene: Scene, monkeypatch) -> None:
    """What is refused on purpose is no internal error."""
    monkeypatch.setattr(placing_candidates, "close_hand", lambda *_, **__: 1 / 0)
    found = quickly(scene, candidates=10, approach=DOWN)
    assert not found.places and found.faults == {PlacingFault.INTERNAL_ERROR: 10}
    assert "please report it with the scene" in found.advice

    def refuse(*_: Any, **__: Any) -> None:
        raise SceneError("refused")

    monkeypatch.setattr(placing_candidates, "close_hand", refuse)
    with pytest.raises(SceneError, match="refused"):
        quickly(scene, candidates=10, approach=DOWN)


def test_an_internal_error_costs_a_verdict_and_is_told(scene: Scene, monkeypatch) -> None:
    monkeypatch.setattr(Scene, "stability", lambda *_, **__: 1 / 0)
    found = quickly(scene, candidates=12, verdict_nodes=100)
    assert found.places and all(one.verdict is None for one in found.places)
    assert "no verdict: internal error in placing.py" in str(found)


@pytest.mark.sampled(2)
@pytest.mark.parametrize("apex", [8, 30, 55, 100])
def test_a_wedge_is_placed_like_anything_else(gripper: Hand, tmp_path, apex: float) -> None:
    half = 0.04 * np.tan(np.radians(0.5 * apex))
    shrink = min(1.0, 0.025 / half)
    base = [(x, y, -0.04) for x in (-half, half) for y in (-0.03, 0.03)]
    corners = np.array([(0.0, -0.03, 0.0), (0.0, 0.03, 0.0), *base]) * [shrink, 1.0, shrink]
    file = tmp_path / "wedge.stl"
    trimesh.convex.convex_hull(corners).export(file)
    scene = scene_of(gripper)
    wedge = ManipulatedObject.from_shape(
        "wedge", MeshShape(file), pose_matrix([0.0, 0.0, 0.1]), mass=0.1
    )
    found = quickly(scene.with_changes(object=wedge), candidates=20)
    assert found.tried == 20 and not found.errors
    assert len(found.faults) + found.found > 1


@pytest.mark.parametrize("workers", [1, 2])
def test_time_that_is_up_ends_the_search(scene: Scene, workers: int, monkeypatch) -> None:
    processes = MagicMock()  # start slowly; what each would compute is computed here
    processes.return_value.take.return_value.iterate = lambda call, *of: call(*of)
    monkeypatch.setattr(placing, "ChildProcesses", processes)
    found = quickly(scene, candidates=500, time_limit=0.0, workers=workers)
    assert not found.complete and found.tried < 500
    assert "ended by the time limit" in str(found)


def test_without_gravity_the_object_stays_where_it_is(scene: Scene) -> None:
    T = np.array(scene.object.T_world_object)
    T[2, 3] += 0.5
    floating = scene.with_changes(gravity=np.zeros(3), object=scene.object.with_pose(T))
    assert quickly(floating, candidates=4).tried == 4


def test_what_cannot_be_placed_is_refused(scene: Scene, gripper: Hand) -> None:
    with pytest.raises(SceneError, match="no hand to be placed"):
        place_hand(scene.with_changes(hand=None))
    with pytest.raises(SceneError, match="contacts are given"):
        place_hand(scene.with_changes(given_contacts=()))
    buried = scene.object.with_pose(np.eye(4))
    with pytest.raises(SceneError, match="move one until they touch"):
        place_hand(scene.with_changes(object=buried))
    with pytest.raises(ArgumentError, match=r"fingers: unknown finger 'thumb'"):
        place_hand(scene, fingers=["thumb"])
    with pytest.raises(ArgumentError, match="fingers: is empty"):
        place_hand(scene, fingers=[])
    with pytest.raises(ArgumentError, match="approach: needs a direction"):
        place_hand(scene, approach=(0, 0, 0))
    wrong: list[dict[str, Any]] = [{"verdicts": -1}, {"verdict_nodes": -1}]
    for options in wrong:
        with pytest.raises(ArgumentError, match=f"{next(iter(options))}: is -1"):
            place_hand(scene, progress=lambda *_: pytest.fail("it has begun"), **options)
    mistaken: list[dict[str, Any]] = [{"together": "no"}, {"move_base": None}, {"progress": 3}]
    for options in mistaken:
        with pytest.raises(ArgumentError, match=f"{next(iter(options))}: is "):
            place_hand(scene, **{"workers": "none", **options})
    bare = replace(gripper.tree, geometries=gripper.tree.geometries[:1])
    with pytest.raises(ArgumentError, match="both a joint and a collision shape"):
        place_hand(scene.with_changes(hand=replace(gripper, tree=bare)))


def test_jaws_meet_in_their_middle_and_open_apart(gripper: Hand) -> None:
    names = fingers_that_close(gripper, None)
    posture = opposing_postures(gripper, names, 4, np.random.default_rng(0))[0]
    assert posture.opposition == pytest.approx(-1.0) and posture.overlap == 0.0
    np.testing.assert_allclose(posture.meeting, [0.0, 0.0, 0.05], atol=1e-9)
    np.testing.assert_allclose(posture.palm, [0.0, 0.0, 0.05], atol=1e-9)
    assert posture.opened[0] == 0.05 > posture.closed[0]
    assert posture.closing_rates(posture.opened)[0] == -1.0


def test_an_open_hand_backs_off_as_far_as_it_must() -> None:
    ball = ManipulatedObject.from_shape("ball", Sphere(0.03), np.eye(4), mass=1.0).placed_bodies
    table = Support("table", HalfSpace(), np.eye(4)).placed_bodies
    back, last = retraction_distance(ball, [(table, 0.01)], DOWN, 1.0)
    assert back == pytest.approx(0.04, abs=1e-6) and last == 0
    assert retraction_distance(ball, [(table, 0.01)], DOWN, 0.02) == (None, 0)
    assert retraction_distance(ball, [(table, 0.01)], np.array([1.0, 0.0, 0.0]), 0.5)[0] is None
    assert shortfall(ball, table, 0.0) == pytest.approx(0.03, abs=1e-6)


def test_a_gripper_is_shifted_until_both_jaws_are_equally_near(gripper: Hand) -> None:
    ball = ManipulatedObject.from_shape(
        "ball", Sphere(0.02), pose_matrix([0.006, 0.0, 0.06]), mass=1.0
    ).placed_bodies
    shift = centering_shift(
        gripper.with_configuration({"left_slide": 0.03}),
        [spec.links for spec in gripper.fingers.values()],
        ball,
    )
    assert shift is not None
    np.testing.assert_allclose(shift, [0.006, 0.0, 0.0], atol=1e-6)
