"""Verdicts on the corners of what a scene may be, against scenes that are changed by hand."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.oracles.uncertain_members import BALANCED, imbalance

from graspless_pin import Holding, Stability, Status, Uncertainty, load_scene, minimize_torque
from graspless_pin.errors import ArgumentError
from graspless_pin.scene import Load
from graspless_pin.scene.scene_stability import scene_of_member, torques_at_rest

STRONG = {"stability": "strong"}
SETS = {
    "paper/cuboid_at_rest": {"mass": 0.2, "center_of_mass": (0.01, 0.004, 0.0), "force": 0.1},
    "paper/cuboid_sliding_up": {"mass": 0.1, "friction": 0.1, "moment": (0.0, 0.01, 0.0)},
    "allegro_sphere_on_slope": {"mass": 0.2, "tilt": 0.02, "friction": 0.1},
    "allegro_box_on_slope": {
        "mass": 0.1,
        "center_of_mass_radius": 0.004,
        "force_radius": 0.1,
        "moment_radius": 0.001,
    },
}


def robust_torques(scene, given, **options):
    unknown = Uncertainty(**given)
    return scene.solve(
        "torque", margin=0.02, static_friction="coulomb", uncertainty=unknown, **options
    )


@pytest.mark.parametrize("name", SETS)
def test_a_changed_scene_has_the_load_and_inertia_of_its_member(name):
    """The member's arrays are worked out without the scene's object."""
    scene = load_scene(f"examples/{name}.yaml")
    lamp = Load("lamp", mass=0.05), Load("cable", force=(0.1, 0.0, 0.2), at=(0.01, 0.0, 0.02))
    scene = scene.with_changes(loads=lamp)
    found = robust_torques(scene, SETS[name], feedback=1.0)
    assert found.found
    nominal = scene.problem()
    for member in found.members[:: max(1, len(found.members) // 40)]:
        changed = scene_of_member(scene, member)
        problem, off = changed.problem(), changed.object.center_of_mass_world
        off = off - scene.object.center_of_mass_world
        force, moment = problem.external_wrench[:3], problem.external_wrench[3:]
        about = np.concatenate([force, moment + np.cross(off, force)])
        np.testing.assert_allclose(about, member.problem.external_wrench, atol=1e-12)
        carried = member.problem.gravity_torques
        np.testing.assert_allclose(problem.gravity_torques, carried, atol=1e-12)
        np.testing.assert_allclose(problem.positions + off, nominal.positions, atol=1e-12)
        # A body has one coefficient: the least of its contacts, which differ where they slide.
        bodies = changed.contacts.bodies
        for number, body in enumerate(bodies):
            least = min(
                mu for mu, one in zip(member.problem.friction, bodies, strict=True) if one == body
            )
            assert problem.friction[number] == pytest.approx(least)
        share = changed.object.mass / scene.object.mass
        np.testing.assert_allclose(
            changed.object.own_inertia, share * scene.object.own_inertia, rtol=1e-12
        )


def test_feedback_makes_what_the_joined_problem_found():
    """Of each member alone, the small motion that equilibrium picks is the one of all together."""
    scene = load_scene("examples/allegro_sphere_on_slope.yaml")
    found = robust_torques(scene, {"mass": 0.2, "center_of_mass": 0.005}, feedback=1.0)
    assert np.ptp(found.commands, axis=0).max() > 1e-3
    for member, commands in zip(found.members, found.commands, strict=False):
        made = torques_at_rest(member, found.torques, found.feedback)
        np.testing.assert_allclose(made, commands, atol=1e-9)


def test_verdicts_are_those_of_scenes_that_are_changed_by_hand():
    """Torques for 5 % of mass, asked at 60 %, too: there the heavy one falls."""
    scene = load_scene("examples/box_between_walls.yaml").with_changes(supports=())
    found, wider = (robust_torques(scene, {"mass": share}) for share in (0.05, 0.6))
    found = replace(found, members=(*found.members, *wider.members))
    verdicts = scene.stability_of_members(found)
    corners = [one.corner for one in found.members if one.corner is not None]
    assert len(corners) == len(found.members)
    masses = [scene.object.mass * (1.0 + one.mass) for one in corners]
    by_hand = [
        scene.with_changes(object=scene.object.with_mass(mass)).stability(found.torques)
        for mass in masses
    ]
    said = [one.holding for one in verdicts.verdicts]
    assert said == [one.holding for one in by_hand]
    assert verdicts.worst == int(np.argmax(masses))
    assert verdicts.holding == "fails"
    assert said.count(Holding.FAILS) == 1
    assert "mass +60 %: fails: rest is no outcome" in str(verdicts)
    assert "between the corners nothing is proven about rest" in str(verdicts)


def test_the_gains_that_the_torques_were_found_with_count():
    scene = load_scene("examples/allegro_sphere_on_slope.yaml")
    given = {"mass": 0.2, "center_of_mass": 0.005}
    for gain, said in ((0.2, "needs_feedback"), (2.0, "holds")):
        found = robust_torques(scene, given, feedback=gain)
        assert scene.stability_of_members(found).holding == said


def test_what_is_no_answer_for_this_scene_is_refused():
    scene = load_scene("examples/allegro_sphere_on_slope.yaml")
    unknown = {"mass": 0.2, "center_of_mass": 0.005}
    wrong: Any
    for wrong in (scene.solve("torque"), robust_torques(scene, unknown)):
        with pytest.raises(ArgumentError, match="uncertainty="):
            scene.stability_of_members(wrong)
    other = load_scene("examples/paper/cuboid_at_rest.yaml")
    with pytest.raises(ArgumentError, match="another scene"):
        other.stability_of_members(robust_torques(scene, unknown, feedback=1.0))
    with pytest.raises(ArgumentError, match=r"use a scene: scene.solve"):
        minimize_torque(
            other.problem(), 0.1, uncertainty=Uncertainty(**unknown), stability="strong"
        )


def test_strong_torques_for_a_set_keep_each_corner_at_rest():
    """The least torques squeeze the box too little to guarantee either mass; more do both."""
    scene = load_scene("examples/box_between_walls.yaml")
    weak, found = (
        robust_torques(scene, {"mass": 0.1}, stability=one) for one in ("weak", "strong")
    )
    assert found.status is Status.STRONG and found.found
    assert found.max_torque >= found.bound == weak.bound
    for share in (0.9, 1.1):
        changed = scene.with_changes(object=scene.object.with_mass(share * scene.object.mass))
        assert changed.stability(weak.torques).status is not Stability.STRONG
        assert changed.stability(found.torques).status is Stability.STRONG
        assert imbalance(changed.problem(), found.torques) < BALANCED
    assert found.margin >= 0.02 - 1e-6
    rest = found.rest
    assert rest is not None and sorted(rest.corners) == [0, 1] and rest.tried > 1
    assert "rest is the only outcome at 2 corners" in str(found)
    assert weak.rest is None


def test_strong_torques_rest_under_the_feedback_that_they_have():
    """At 0.2 N m/rad the ball rolls away whatever the torques are, at 2 it rests."""
    scene = load_scene("examples/allegro_sphere_on_slope.yaml")
    given = {"mass": 0.2, "center_of_mass": 0.005}
    soft, stiff = (robust_torques(scene, given, feedback=gain, **STRONG) for gain in (0.2, 2.0))
    assert not soft.found and soft.status is Status.STRONG_NOT_FOUND
    assert soft.rest is not None and "rolls" in str(soft)
    assert stiff.found and stiff.rest is not None and stiff.rest.kept
    least = robust_torques(scene, given, feedback=2.0)
    assert stiff.max_torque == pytest.approx(least.max_torque, rel=1e-6)


def test_verdicts_that_were_left_out_are_told():
    scene = load_scene("examples/box_between_walls.yaml").with_changes(supports=())
    found = robust_torques(scene, {"mass": 0.05})
    none = scene.stability_of_members(found, time_limit=0.0)
    assert none.holding is Holding.UNDECIDED and none.left_out == len(found.members) == 2
    assert "2 corners have no verdict" in str(none)
    open_still = robust_torques(scene, {"mass": 0.05}, stability="strong", time_limit=0.0)
    assert not open_still.found
