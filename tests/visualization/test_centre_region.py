"""The region in which the centre of mass may lie, as it is drawn in the object."""

import numpy as np
import pytest
from tests.oracles.uncertain_members import BALANCED, imbalance

from graspless_pin import load_scene
from graspless_pin.visualization import Role, draw_scene
from graspless_pin.visualization.drawing import object_radius
from graspless_pin.visualization.motion import draw_virtual_sliding

CUBOID = "examples/paper/cuboid_at_rest.yaml"


def drawn(file=CUBOID, **options):
    scene = load_scene(file)
    solution = scene.solve("torque", margin=0.05)
    off = scene.tolerances(
        solution.torques, static_friction="coulomb", quantities=["centre of mass"], **options
    )
    return scene, solution, draw_scene(scene, solution, tolerances=off)


def test_weight_at_its_corners_is_just_borne():
    """Each corner against a linear program that knows nothing of regions."""
    scene, solution, picture = drawn()
    problem, center = solution.problem, scene.object.center_of_mass_world
    fan, rim = picture.of(Role.CENTER_REGION)
    middle, *ends = fan.vertices
    np.testing.assert_allclose(middle, center, atol=1e-12)
    np.testing.assert_allclose(fan.vertices[:, 2], center[2], atol=1e-9)
    size = object_radius(picture)
    sizes = np.linalg.norm(ends - center, axis=1)
    near = np.flatnonzero(sizes < 1.05 * size)
    assert len(near) == len(ends) > 72
    force = problem.external_wrench[:3]
    for end in np.array(ends)[near[:: max(1, len(near) // 16)]]:
        for times, is_borne in ((0.98, True), (1.03, False)):
            moment = np.cross(times * (end - center), force)
            wrench = problem.external_wrench + np.concatenate([np.zeros(3), moment])
            short = imbalance(problem.with_changes(external_wrench=wrench), solution.torques, None)
            assert (short < BALANCED) is is_borne, end
    assert np.linalg.norm(rim.vertices - center, axis=1).max() < 1.12 * size
    (ball,) = picture.of(Role.CENTER_OF_MASS)
    np.testing.assert_allclose(ball.vertices.mean(axis=0), center, atol=1e-3 * size)


def test_it_ends_with_the_object():
    """Between walls the centre of mass may be metres away: no rim, as nothing ends there."""
    scene, _, picture = drawn("examples/box_between_walls.yaml")
    (fan,) = picture.of(Role.CENTER_REGION)
    ends = fan.vertices[1:] - scene.object.center_of_mass_world
    np.testing.assert_allclose(np.linalg.norm(ends, axis=1), 1.1 * object_radius(picture))


def test_a_centre_that_may_be_nowhere_else_has_no_region():
    """A ball on fingertips rolls: constant torques are right for one centre of mass alone."""
    ball = "examples/allegro_sphere_on_slope.yaml"
    assert drawn(ball)[2].of(Role.CENTER_OF_MASS) and not drawn(ball)[2].of(Role.CENTER_REGION)
    assert drawn(ball, feedback=1.0)[2].of(Role.CENTER_REGION)
    scene = load_scene(CUBOID)
    assert not draw_scene(scene, scene.solve()).of(Role.CENTER_OF_MASS, Role.CENTER_REGION)


def test_it_goes_with_the_object():
    scene, solution, picture = drawn("examples/allegro_box_on_slope.yaml")
    moving = draw_virtual_sliding(picture, solution, scene.hand, scene.object.center_of_mass_world)
    assert moving is not None
    for mesh in picture.of(Role.CENTER_OF_MASS, Role.CENTER_REGION):
        assert moving.path_of[mesh.name] == 0
    assert picture.of(Role.CENTER_REGION)[0].opacity == pytest.approx(0.85)
