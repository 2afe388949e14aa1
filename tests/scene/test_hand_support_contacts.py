"""Links that torques can move and that touch supports."""

from dataclasses import replace

import numpy as np
import pytest
from scene_tools import ALLEGRO, BOX, EXAMPLES, content, hand_of, loaded, without_hand

from graspless_pin import load_scene
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.scene.scene_stability import hand_support_contacts


def with_wall(folder, gap, control=None, **wall):
    """The lever's tip touches the box; a wall stands below the tip, ``gap`` away."""
    data = content(BOX)
    if control is not None:
        data["hand"]["control"] = control
    scene = loaded(folder, data)
    tip = next(body for body in hand_of(scene).collision_bodies() if body.name == "tip")
    top = tip.T_world_geometry[:3, 3] - [0.0, 0.0, tip.geometry.radius + gap]
    shape = {"type": "box", "size": [0.02, 0.02, 0.02]}
    pose = {"position": (top - [0.0, 0.0, 0.01]).tolist()}
    data["supports"].append({"name": "wall", "shape": shape, "pose": pose, **wall})
    return loaded(folder, data)


@pytest.mark.parametrize(("gap", "touches"), [(0.0, True), (9e-4, True), (1.1e-3, False)])
def test_a_link_touches_within_the_contact_tolerance(tmp_path, gap, touches):
    scene = with_wall(tmp_path, gap)
    assert hand_support_contacts(scene) == ((("tip", "wall"),) if touches else ())
    wider = scene.with_changes(contact_tolerance=2e-3)
    assert hand_support_contacts(wider) == (("tip", "wall"),)


@pytest.mark.parametrize(
    ("control", "touches"), [("position", False), ("force", True), ({"finger": "hybrid"}, True)]
)
def test_only_links_that_can_move_count(tmp_path, control, touches):
    scene = with_wall(tmp_path, 0.0, control)
    assert bool(hand_support_contacts(scene)) == touches


def test_a_palm_may_lie_on_a_support():
    """A small box in the middle of the palm, which nothing moves."""
    scene = load_scene(ALLEGRO)
    palm = next(body for body in hand_of(scene).collision_bodies() if body.name == "palm_link")
    T = np.eye(4)
    T[:3, 3] = palm.T_world_geometry[:3, 3]
    wall = Support("wall", Box((0.01, 0.01, 0.01)), T)
    touched = {one.link for one in unwanted_overlaps(hand_of(scene), [wall])}
    assert {"palm_link", "link_12.0"} <= touched  # the palm, and the thumb's first link
    found = hand_support_contacts(scene.with_changes(supports=(wall,)))
    assert found == (("link_12.0", "wall"),)


def test_without_a_hand_nothing_touches(tmp_path):
    assert hand_support_contacts(without_hand(tmp_path)) == ()


@pytest.mark.sampled(5)
@pytest.mark.parametrize("file", sorted(EXAMPLES.glob("*.yaml")), ids=lambda file: file.stem)
def test_no_example_leans_its_fingers_on_supports(file):
    scene = load_scene(file)
    assert hand_support_contacts(scene) == ()
    if not scene.supports:
        return
    # Half-spaces that are moved along their normals reach the fingers.
    first = scene.supports[0]
    if isinstance(first.shape, HalfSpace):
        moved = np.array(first.T_world_support)
        moved[:3, 3] += 0.3 * moved[:3, 2]
        supports = (replace(first, T_world_support=moved),)
        assert hand_support_contacts(scene.with_changes(supports=supports))
