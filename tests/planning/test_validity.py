"""Valid states: reasons, margins, clearances and distances to joint limits."""

from collections import Counter
from itertools import product
from typing import Any

import coal  # pyright: ignore[reportMissingImports]
import numpy as np
import pytest
from planning_scenes import example, shifted

from graspless_pin import Evaluator, maximize_margin
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.planning import StateStatus
from graspless_pin.planning.edges import StateValidity

SPREADS = {
    "allegro_box_on_slope": 0.4,
    "panda_arm_drag_board": 0.3,
    "trihand_push_box": 0.6,
    "two_hands_slide_crate": 0.3,
}
COLLISIONS = {
    StateStatus.HAND_THROUGH_SUPPORT,
    StateStatus.HAND_THROUGH_ITSELF,
    StateStatus.OVERLAP,
}


def among_blocks(name: str):
    """A scene with two blocks more: one near a fingertip, one in the middle of the hand."""
    scene = example(name)
    first = scene.contacts.arrays
    at = first.positions[0] - 0.07 * first.normals[0] + [0.0, 0.0, 0.02]
    block = Support("block", Box((0.06, 0.04, 0.05)), pose_matrix(at, (0.3, 0.5, 0.7)))
    middle = np.mean([one.T_world_geometry[:3, 3] for one in scene.hand.placed_bodies], axis=0)
    post = Support("post", Box((0.02, 0.02, 0.02)), pose_matrix(middle + 0.05))
    return scene.with_changes(supports=(*scene.supports, block, post))


def states(evaluator: Evaluator, name: str, count: int) -> np.ndarray:
    """Configurations near the scene's own; some are outside the joints' limits."""
    rng, home = np.random.default_rng(5), evaluator.configuration()
    spreads = rng.choice([0.0, 0.01, 1.0], count, p=[0.1, 0.4, 0.5])[:, None] * SPREADS[name]
    return home + spreads * rng.uniform(-1.0, 1.0, (count, len(home)))


def distance(one, other) -> float:
    """Signed distance as coal has it, m."""
    placed = [
        (body.geometry, coal.Transform3s(np.array(T[:3, :3]), np.array(T[:3, 3])))
        for body in (one, other)
        for T in [body.T_world_geometry]
    ]
    return coal.distance(*placed[0], *placed[1], coal.DistanceRequest(), coal.DistanceResult())


def distances_to_supports(scene) -> list[float]:
    """All distances of links that move and supports, and of supports that the object is off."""
    tree = scene.hand.tree
    moving = [
        body
        for body, item in zip(scene.hand.collision_bodies(), tree.geometries, strict=True)
        if item.joint
    ]
    found = []
    for support in scene.supports:
        found += [distance(*pair) for pair in product(moving, support.placed_bodies)]
        own = min(distance(*p) for p in product(scene.object.placed_bodies, support.placed_bodies))
        if not -scene.max_penetration <= own <= scene.contact_tolerance:
            found.append(own)
    return found


@pytest.mark.parametrize("name", SPREADS)
def test_one_answer_and_all_its_reasons(name):
    evaluator = Evaluator(among_blocks(name))
    q = states(evaluator, name, 24)
    lower, upper = evaluator.joint_limits
    for margin in (0.05, -np.inf):
        many = Evaluator(evaluator.scene).are_feasible(q, margin=margin, workers=1)
        seen: Counter = Counter()
        for row, feasible in zip(q, many, strict=True):
            found = evaluator.validity(row, margin=margin)
            assert isinstance(found, StateValidity)
            assert found.valid is (found.message == "") is (found.reasons == ())
            assert found.valid == feasible == evaluator.is_feasible(row, margin=margin)
            outside = ((row < lower - 1e-6) | (row > upper + 1e-6)).any()
            assert (StateStatus.OUTSIDE_LIMITS in found.reasons) == outside
            np.testing.assert_array_equal(found.joint_distances, np.fmin(row - lower, upper - row))
            if found.valid:
                assert np.isnan(found.margin) if margin < 0.0 else found.margin >= margin - 1e-6
            seen.update(found.reasons or [StateStatus.FOUND])
        assert len(seen) >= 3


@pytest.mark.parametrize("name", SPREADS)
def test_clearance_is_the_least_of_all_distances(name):
    collided, nearest = set(), set()
    for scene in (example(name), among_blocks(name)):
        evaluator = Evaluator(scene, position_limits=False)
        supports = {support.name for support in scene.supports}
        for row in states(evaluator, name, 10):
            found = evaluator.validity(row, margin=-np.inf)
            there: Any = evaluator.scene_at(row)
            least = min(distances_to_supports(there))
            assert found.clearance <= least + 1e-6
            of_support = bool(supports.intersection(found.closest))
            if not of_support:  # two links, or a link too deep in the object
                bodies = [*there.hand.collision_bodies(), *there.object.placed_bodies]
                one, other = ([b for b in bodies if b.name == own] for own in found.closest)
                least = min(distance(*pair) for pair in product(one, other))
            assert found.clearance == pytest.approx(least, abs=1e-6)
            deep = bool(COLLISIONS.intersection(found.reasons))
            assert deep == (found.clearance < -scene.max_penetration)
            collided.add(deep)
            nearest.add(of_support)
    assert collided == nearest == {True, False}


def test_margin_is_the_largest_one():
    scene = example("trihand_push_box")
    evaluator = Evaluator(scene, algorithm="torque", margin=0.1)
    best = maximize_margin(scene.problem()).margin
    for required, valid in ((0.999 * best, True), (1.001 * best, False)):
        found = evaluator.validity(margin=required)
        assert found.valid is valid
        assert found.margin == pytest.approx(best, rel=1e-6)
        assert found.reasons == (() if valid else (StateStatus.BELOW_MARGIN,))
        assert ("below the" in found.message) is not valid
    assert evaluator.validity().valid  # the evaluator's own


def test_each_part_can_be_left_out():
    scene = among_blocks("allegro_box_on_slope")
    forearm = scene.hand.placed_bodies[0]
    wall = Support("wall", Box((0.05, 0.05, 0.05)), pose_matrix(forearm.T_world_geometry[:3, 3]))
    scene = scene.with_changes(supports=(*scene.supports, wall))
    evaluator = Evaluator(scene)
    q = evaluator.configuration()
    q[0] = evaluator.joint_limits[1][0] + 0.2
    found = evaluator.validity(q, margin=5.0)
    assert set(found.reasons) == {
        StateStatus.OUTSIDE_LIMITS,
        StateStatus.HAND_THROUGH_SUPPORT,
        StateStatus.BELOW_MARGIN,
    }
    assert "wall" in found.message and found.joint_distances.min() == pytest.approx(-0.2)
    without = {
        StateStatus.OUTSIDE_LIMITS: ({"position_limits": False}, 5.0),
        StateStatus.HAND_THROUGH_SUPPORT: ({"collisions": False}, 5.0),
        StateStatus.BELOW_MARGIN: ({}, -np.inf),
    }
    for reason, (options, margin) in without.items():
        other = Evaluator(scene, **options).validity(q, margin=margin)
        assert reason not in other.reasons
        assert set(found.reasons) - {reason} == set(other.reasons)
    bare = Evaluator(scene, position_limits=False, collisions=False)
    assert bare.is_feasible(q, margin=-np.inf)
    assert bare.are_feasible(q[None], margin=-np.inf).all()


def test_an_object_in_the_air_is_valid_where_nothing_has_to_hold_it():
    scene = example("trihand_push_box")
    above = shifted(scene.object.T_world_object, [0.0, 0.0, 0.2])
    evaluator = Evaluator(scene)
    found = evaluator.validity(T_world_object=above, margin=-np.inf)
    assert found.reasons == (StateStatus.NO_CONTACT,)
    free = Evaluator(scene, need_hand=False)
    assert free.validity(T_world_object=above, margin=-np.inf).valid
    assert free.validity(T_world_object=above).reasons == (StateStatus.NO_CONTACT,)
    assert free.validity(T_world_object=above).margin == -np.inf


def test_an_object_in_its_support_is_a_collision():
    scene = example("trihand_push_box")
    below = shifted(scene.object.T_world_object, [0.0, 0.0, -0.008])
    for margin in (0.1, -np.inf):
        found = Evaluator(scene).validity(T_world_object=below, margin=margin)
        assert StateStatus.OVERLAP in found.reasons
        assert found.clearance == pytest.approx(-0.008, abs=1e-6)
        assert found.closest == (scene.object.name, scene.supports[0].name)


def test_a_scene_without_a_hand_and_one_with_given_contacts():
    scene = example("trihand_push_box").with_changes(hand=None)
    found = Evaluator(scene).validity(margin=-np.inf)
    assert found.valid and found.joint_names == () and found.joint_distances.shape == (0,)
    assert str(found) == "valid" and found.clearance == np.inf and found.closest == ()
    given = example("paper/cuboid_at_rest")
    assert Evaluator(given).validity(margin=0.1).valid


def test_a_margin_that_is_none():
    evaluator = Evaluator(example("trihand_push_box"))
    for margin in (-0.1, np.nan, np.inf):
        with pytest.raises(ValueError, match="margin"):
            evaluator.validity(margin=margin)
