"""Poses of a scene: what closing, placing and settling do to it, and to its problem."""

from typing import Any

import numpy as np
import pytest
from scene_tools import ALLEGRO, BOX, content, hand_of, loaded, unit, without_hand

from graspless_pin import load_scene
from graspless_pin.errors import SceneError
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.scene import close_fingers, fingertip_contact, settle

# A ball of 50 mm radius 10 um off the palm's front, x = 0.0111 m; thumb opposed.
PALM_UP: dict[str, Any] = {
    "gravity": [0, 0, -9.81],
    "friction": {"hand": 0.8, "supports": 0.4},
    "hand": {"robot": "allegro_right", "q": {"joint_12.0": 1.2}, "control": {"ring": "position"}},
    "object": {
        "name": "ball",
        "shape": {"type": "sphere", "radius": 0.05},
        "mass": 0.2,
        "pose": {"position": [0.06111, 0.01, -0.005]},
    },
}


@pytest.fixture(scope="module")
def wrapped(tmp_path_factory):
    """The hand wrapped about the ball, its ring finger under position control."""
    scene = loaded(tmp_path_factory.mktemp("wrap"), PALM_UP)
    return close_fingers(scene, wrap=True)


def test_wrapping_touches_with_palm_proximal_links_and_tips(wrapped):
    scene, touching = wrapped.scene, set(wrapped.scene.contacts.bodies)
    assert touching >= {*wrapped.closing.touching, "palm_link"}
    assert wrapped.closing.all_touch
    tips = {spec.tip for spec in scene.hand.fingers.values()}
    assert touching & tips
    assert touching - tips - {"palm_link"}
    of_finger = [scene.hand.finger_of(link) for link in scene.contacts.bodies]
    assert max(of_finger.count(name) for name in scene.hand.fingers) >= 2
    assert set(scene.contacts.arrays.kinds) == {BodyKind.HAND}


def test_palm_and_held_fingers_are_environment(wrapped):
    scene = wrapped.scene
    problem = scene.problem()
    assert len(problem.joint_names) == 12
    blocks = problem.jacobian.reshape(-1, 3, 12)
    for link, block in zip(scene.contacts.bodies, blocks, strict=True):
        moves = scene.hand.finger_of(link) not in (None, "ring")
        assert np.any(block != 0.0) == moves, link
    assert {scene.hand.finger_of(link) for link in scene.contacts.bodies} >= {None, "ring"}


def test_only_chosen_fingers_close_and_the_scene_given_stays(tmp_path):
    scene = loaded(tmp_path, PALM_UP)
    hand = hand_of(scene)
    before = dict(hand.q)
    result = close_fingers(scene, fingers=["index"])
    assert [finger.finger for finger in result.closing.fingers] == ["index"]
    moved = {name for name, value in hand_of(result.scene).q.items() if value != before[name]}
    assert moved and moved <= set(hand.fingers["index"].joints)
    assert hand.q == before
    assert "index: touches with" in str(result.closing)


def test_closing_into_a_support_is_reported(tmp_path):
    data = content(BOX)
    data["hand"]["q"] = {"hinge": 0.0}
    data["object"]["pose"] = {"position": [0, 0.04, 0]}
    free = close_fingers(loaded(tmp_path, data))
    assert free.overlaps == ()
    tip = free.scene.contacts.points[0].position.tolist()
    wall = {"name": "post", "shape": {"type": "sphere", "radius": 0.01}}
    wall["pose"] = {"position": [tip[0], tip[1] - 0.02, tip[2]]}
    data["supports"].append(wall)
    (overlap,) = close_fingers(loaded(tmp_path, data)).overlaps
    assert (overlap.other, overlap.kind) == ("post", BodyKind.SUPPORT)


def test_fingertips_go_back_to_where_they_were():
    scene = load_scene(ALLEGRO)
    hand = hand_of(scene)
    goals = {
        str(hand.finger_of(point.body)): (point.position, point.normal)
        for point in scene.contacts.points
        if point.kind is BodyKind.HAND
    }
    rng = np.random.default_rng(4)
    joints = [joint for finger in goals for joint in hand.fingers[finger].joints]
    nudged = {joint: hand.q[joint] - rng.uniform(0.0, 0.1) for joint in joints}
    elsewhere = scene.with_changes(hand=hand.with_configuration(nudged))
    result = fingertip_contact(elsewhere, goals)
    assert result.overlaps == ()
    still = {name: q for name, q in hand.q.items() if name not in joints}
    assert still.items() <= hand_of(result.scene).q.items()
    found = [point for point in result.scene.contacts.points if point.kind is BodyKind.HAND]
    assert len(found) == len(goals)
    for point in found:
        goal, normal = goals[str(hand.finger_of(point.body))]
        assert np.linalg.norm(point.position - goal) < 1e-3
        assert point.normal @ normal > 0.999
    assert result.scene.solve("margin").found


def test_settling_follows_gravity_and_leaves_no_gap(tmp_path):
    for gravity in ([0, 0, -9.8], (9.8 * unit(0.3, 0.1, -1.0)).tolist()):
        data: dict[str, Any] = content(BOX) | {"gravity": gravity}
        del data["hand"]
        data["object"]["pose"] = {"position": [0.1, 0.2, 0.5]}
        scene = loaded(tmp_path, data)
        with pytest.raises(SceneError, match="nothing touches"):
            scene.problem()
        settled = settle(scene)
        assert settled.contacts.bodies == ("floor",) * 4
        assert max(abs(point.distance) for point in settled.contacts.points) < 1e-6
        shift = settled.object.T_world_object[:3, 3] - [0.1, 0.2, 0.5]
        assert np.cross(shift, gravity) == pytest.approx(np.zeros(3), abs=1e-9)


def test_nothing_settles_without_gravity(tmp_path):
    scene = loaded(tmp_path, content(BOX) | {"gravity": [0, 0, 0]})
    with pytest.raises(
        SceneError, match=r"\.yaml:\d+: gravity: is zero, so the object does not settle"
    ):
        settle(scene)


def test_a_scene_without_a_hand_has_no_fingers(tmp_path):
    scene = without_hand(tmp_path)
    with pytest.raises(SceneError, match=r"\.yaml: this requires a hand"):
        close_fingers(scene)
    with pytest.raises(SceneError, match="the scene has none"):
        fingertip_contact(scene, {})
