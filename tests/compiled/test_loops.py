"""The compiled loops do what the numpy beside their callers does, and refuse what does not fit."""

from __future__ import annotations

import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from graspless_pin import Scene, caching, compiled, load_scene
from graspless_pin.geometry import poses
from graspless_pin.geometry.contact import motion
from graspless_pin.geometry.contact.contact_points import BodyKind, ContactArrays
from graspless_pin.problem import QuasistaticProblem, checks, cones
from graspless_pin.problem.joint_units import JointUnit
from graspless_pin.problem.own_arrays import problem_of_own_arrays
from graspless_pin.scene.motion_and_contacts import Motion

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
ARRAYS = (
    "positions", "normals", "tangents", "external_wrench", "jacobian", "friction", "sliding",
    "gravity_torques", "lower_torque", "upper_torque",
)  # fmt: skip
NUMBERS = [0.0, 1.0, -1.0, np.inf, -np.inf, np.nan]
NOT_FINITE = st.sampled_from([np.nan, np.inf, -np.inf])

needs_loops = pytest.mark.skipif(
    compiled.small_arrays is None, reason="the loops are not compiled: there is no C compiler"
)


def test_the_loops_are_compiled_where_there_is_a_compiler() -> None:
    headers = Path(sysconfig.get_path("include"), "Python.h")
    if not any(map(shutil.which, ("cc", "gcc", "clang"))) or not headers.exists():
        pytest.skip("there is no C compiler, or none of Python's headers")
    for name in compiled.__all__:
        assert getattr(compiled, name).__file__.endswith((".so", ".pyd"))


def test_without_the_loops_no_module_has_them(without_loops: None) -> None:
    holders = [
        name
        for name, module in sys.modules.items()
        if name.startswith("graspless_pin.") and module is not compiled
        for loops in compiled.__all__
        if getattr(module, loops, None) is not None
    ]
    assert not holders


@needs_loops
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_the_same_problem(path: Path, outcome, by_numpy) -> None:
    if "scene:" in path.read_text():
        pytest.skip("a study, not a scene")
    rng = np.random.default_rng(1)
    scene = load_scene(path)
    twist = np.concatenate([0.05 * scene.object.T_world_object[:3, 0], [0.0, 0.0, 0.3]])
    for moving in (None, Motion(twist), Motion(np.zeros(6))):
        for _ in range(10):
            posed = moved(scene, rng)
            if moving is not None:
                posed = posed.with_changes(motion=moving)
            fresh = posed.with_changes()
            ours, theirs = outcome(posed.problem), by_numpy(fresh.problem)
            if isinstance(theirs, tuple):
                assert ours == theirs
                continue
            assert isinstance(ours, QuasistaticProblem)
            assert posed.contacts.arrays.bodies == fresh.contacts.arrays.bodies
            for name in ARRAYS:
                assert not getattr(ours, name).flags.writeable
                np.testing.assert_allclose(
                    getattr(ours, name), getattr(theirs, name), rtol=0, atol=1e-12, err_msg=name
                )


def moved(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with the hand and the object moved by up to 0.2 mm and mrad."""
    T = np.array(scene.object.T_world_object)
    T[:3, 3] += rng.uniform(-2e-4, 2e-4, 3)
    changes: dict[str, object] = {"object": scene.object.with_pose(T)}
    if scene.hand is not None:
        leaders = list(scene.hand.tree.coupling.leaders)
        lower, upper = scene.hand.tree.lower[leaders], scene.hand.tree.upper[leaders]
        q = scene.hand.positions[leaders] + rng.uniform(-2e-4, 2e-4, len(leaders))
        changes["hand"] = scene.hand.with_positions(np.clip(q, lower, upper))
    return scene.with_changes(**changes)


@needs_loops
@settings(max_examples=200)
@given(
    count=st.integers(0, 6),
    seed=st.integers(0, 10_000),
    still=st.booleans(),
    turning=st.booleans(),
    level=st.sampled_from([0.0, 1.0, 1e-12]),
)
def test_motions_are_told_alike(by_numpy, count, seed, still, turning, level) -> None:
    rng = np.random.default_rng(seed)
    normals = rng.normal(size=(count, 3))
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    touching = ContactArrays(
        ("body",) * count, (BodyKind.SUPPORT,) * count, rng.normal(size=(count, 3)), normals,
        (0.0,) * count,
    )  # fmt: skip
    twist = level * rng.choice([0.0, 1.0], 6) * rng.normal(size=6)
    others = None if still else rng.choice([0.0, 1e-4, 1.0], (count, 1)) * rng.normal(size=3)
    turns = rng.choice([0.0, 1.0], (count, 1)) * rng.normal(size=3) if turning else None
    center = rng.normal(size=3)

    def classified():
        return motion.classify_motion(touching, twist, center, others, turns)

    ours, theirs = classified(), by_numpy(classified)
    assert ours.states == theirs.states
    np.testing.assert_allclose(ours.sliding, theirs.sliding, rtol=0, atol=1e-14)
    np.testing.assert_allclose(ours.normal_speeds, theirs.normal_speeds, rtol=0, atol=1e-14)

    def velocities():
        return motion.twist_velocities(twist, center, touching.positions)

    np.testing.assert_allclose(velocities(), by_numpy(velocities), rtol=0, atol=1e-14)


@needs_loops
@settings(max_examples=100)
@given(
    normals=arrays(np.float64, (4, 3), elements=st.sampled_from([0.0, 1.0, -1.0, 0.3])),
    axes=st.lists(arrays(np.float64, 3, elements=st.sampled_from([0.0, 1.0, -2.0])), max_size=3),
)
def test_tangents_are_alike(by_numpy, normals, axes) -> None:
    lengths = np.linalg.norm(normals, axis=1, keepdims=True)
    normals = normals / np.where(lengths > 0.0, lengths, 1.0)

    def tangents():
        return cones.projected_tangents(normals, axes)

    np.testing.assert_allclose(tangents(), by_numpy(tangents), rtol=0, atol=1e-14)


@needs_loops
@given(
    T=arrays(np.float64, (4, 4), elements=st.floats(-1.0, 1.0)),
    spoilt=st.one_of(st.none(), NOT_FINITE, st.just(0.5)),
    place=st.tuples(st.integers(0, 3), st.integers(0, 3)),
    mirrored=st.booleans(),
)
def test_poses_are_judged_alike(outcome, by_numpy, T, spoilt, place, mirrored) -> None:
    near = np.linalg.qr(T[:3, :3] + 3.0 * np.eye(3))[0]
    if (np.linalg.det(near) < 0.0) != mirrored:
        near[:, 0] *= -1.0
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = near, T[:3, 3]
    if spoilt is not None:
        pose[place] = spoilt

    def judged():
        return np.array(poses.as_pose("T", pose))

    ours, theirs = outcome(judged), by_numpy(judged)
    if isinstance(theirs, tuple):
        assert ours == theirs
    else:
        np.testing.assert_array_equal(ours, theirs)


@needs_loops
@given(
    first=arrays(
        np.float64, 5, elements=st.sampled_from([0.0, 1.0, -1.0, np.inf, -np.inf, np.nan])
    ),
    second=arrays(np.float64, 5, elements=st.sampled_from([0.0, 1.0, np.inf, np.nan])),
    strictly=st.booleans(),
)
def test_numbers_are_checked_alike(by_numpy, first, second, strictly) -> None:
    for call in (
        lambda: checks.in_order((first, second), strictly=strictly),
        lambda: checks.all_finite((first,)),
        lambda: checks.all_finite((np.ones((3, 2)), second[:1])),
        lambda: checks.all_within((first, np.ones((3, 2)))),
        lambda: checks.all_finite(()),
        lambda: checks.all_within(()),
    ):
        assert call() == by_numpy(call)


ARRAY = np.ones(3)
SOURCES = [ARRAY, np.ones(3), None, 0.0, -0.0, 1.0, 1, True, "1", b"1", np.nan, 10**40, "a" * 40]


@needs_loops
@given(
    first=st.lists(st.sampled_from(SOURCES), max_size=3),
    second=st.lists(st.sampled_from(SOURCES), max_size=3),
)
def test_what_a_value_is_made_from_is_told_apart_alike(by_numpy, first, second) -> None:
    def kept() -> bool:
        values = caching.Latest()
        # Equal numbers and texts are others as objects where they are computed.
        others = [one * 1 if type(one) in (int, float, str) else one for one in second]
        return values.of("x", tuple(first), object) is values.of("x", tuple(others), object)

    assert kept() is by_numpy(kept)
    assert kept() is (list(map(described, first)) == list(map(described, second)))


def described(source: object) -> object:
    return id(source) if isinstance(source, np.ndarray) else (type(source), repr(source))


@needs_loops
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf, -1.0, 0.0, 1e14, -1e14, 1e31])
@pytest.mark.parametrize(
    "name", ["positions", "external_wrench", "jacobian", "friction", "lower", "upper"]
)
@pytest.mark.parametrize("place", [0, -1])
def test_numbers_of_own_arrays_are_judged_alike(outcome, by_numpy, name, place, bad) -> None:
    def made():
        given = {
            "positions": np.array([[0.1, 0.0, 0.0], [0.0, 0.2, 0.0]]),
            "external_wrench": np.array([0.0, 0.0, -9.8, 0.0, 0.0, 0.0]),
            "jacobian": np.arange(12.0).reshape(6, 2),
            "friction": np.array([0.3, 0.5]),
            "lower": np.array([-1.0, -1.0]),
            "upper": np.array([1.0, 1.0]),
        }
        given[name].flat[place] = bad
        problem = problem_of_own_arrays(
            given["positions"], np.array([[0.0, 0.0, 1.0]] * 2), given["external_wrench"],
            given["jacobian"], friction=given["friction"],
            tangents=np.array([[[1.0, 0.0], [0.0, 1.0], [0.0, 0.0]]] * 2), sliding=np.zeros((2, 3)),
            torque_limits=(given["lower"], given["upper"]), max_normal_force=20.0, cone_edges=8,
            joint_names=("a", "b"), joint_units=(JointUnit.TORQUE,) * 2,
            gravity_torques=np.zeros(2),
        )  # fmt: skip
        return problem.joint_names

    assert outcome(made) == by_numpy(made)


@needs_loops
def test_strides_and_types_do_not_matter() -> None:
    assert compiled.small_arrays is not None
    assert compiled.rigid_bodies is not None
    wide: np.ndarray = np.arange(24.0).reshape(4, 6)
    whole: np.ndarray = np.ones((2, 3), dtype=np.int8)
    T = np.asfortranarray(poses.pose_matrix((1.0, 2.0, 3.0), (0.1, 0.2, 0.3)))
    twist = np.array([1.0, 2.0, 3.0, 0.4, 0.5, 0.6])
    for points in (wide[:, ::2], whole):
        velocities = compiled.rigid_bodies.twist_velocities(twist, T[:3, 3], points)
        expected = twist[:3] + np.cross(twist[3:], points - T[:3, 3])
        np.testing.assert_allclose(velocities, expected, atol=1e-14)
    (placed,) = compiled.rigid_bodies.placed(T[None], np.zeros(1, dtype=np.intp), T[None])
    np.testing.assert_allclose(placed, T @ T, atol=1e-15)


@needs_loops
@pytest.mark.parametrize("far", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("slip", [0.1, 3e-3, 3e-4, 1e-6])
def test_turning_is_weighed_by_the_longest_arm(far, slip, by_numpy) -> None:
    """A contact near the axis of a turning object moves at a share of the fastest speed."""
    positions = np.array([[far, 0.0, 0.0], [0.0, slip * far, 0.0]])
    normals = np.array([[0.0, 0.0, 1.0]] * 2)
    touching = ContactArrays(("body",) * 2, (BodyKind.SUPPORT,) * 2, positions, normals, (0.0,) * 2)

    def classified():
        twist = np.array([0.0, 0.0, 0.0, 0.0, 0.0, 1.0])
        return motion.classify_motion(touching, twist, np.zeros(3), None, None)

    slides = motion.ContactMotion.SLIDING
    assert classified().states == by_numpy(classified).states
    assert classified().states[0] is slides
    assert (classified().states[1] is slides) == (slip > motion.SPEED_TOLERANCE)


@needs_loops
@pytest.mark.parametrize("place", [(0, 0), (1, 2), (2, 2), (0, 3), (2, 3)])
@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
def test_what_is_no_number_passes_no_check(place, bad) -> None:
    assert compiled.rigid_bodies is not None and compiled.small_arrays is not None
    pose = np.eye(4)
    assert compiled.rigid_bodies.is_rigid(pose)
    pose[place] = bad
    assert not compiled.rigid_bodies.is_rigid(pose)
    assert not compiled.small_arrays.all_within((pose,), 1e30)
    assert not compiled.small_arrays.all_finite((pose,))
    assert compiled.small_arrays.all_within((np.eye(4),), 1.0)
    assert not compiled.small_arrays.all_within((np.eye(4),), 0.9)


@needs_loops
@pytest.mark.parametrize(("first", "second"), [(0, 1), (0, 2), (1, 2)])
@pytest.mark.parametrize(("angle", "rigid"), [(5e-7, True), (2e-6, False), (0.1, False)])
def test_columns_that_are_not_at_right_angles(
    first, second, angle, rigid, outcome, by_numpy
) -> None:
    pose = np.eye(4)
    pose[first, second], pose[second, second] = np.sin(angle), np.cos(angle)

    def judged():
        return np.array(poses.as_pose("T", pose))

    ours, theirs = outcome(judged), by_numpy(judged)
    assert isinstance(ours, tuple) is isinstance(theirs, tuple) is not rigid


ONES = np.ones((2, 3))
POSES = np.repeat(np.eye(4)[None], 2, axis=0)


@needs_loops
@pytest.mark.parametrize(
    ("loops", "name", "arguments"),
    [
        ("small_arrays", "in_order", ((np.ones(2), np.ones(3)), False)),
        ("small_arrays", "tangents", (np.ones((2, 4)), ())),
        ("small_arrays", "about", (ONES, np.ones(2))),
        ("small_arrays", "about", (np.ones((2, 4)), np.ones(3))),
        ("small_arrays", "stacked", (ONES, np.ones((2, 2)))),
        ("small_arrays", "are_possible", ((), *map(np.ones, (2, 5, 1, 1)), 1.0, 1.0)),
        ("small_arrays", "are_possible", ((), *map(np.ones, (2, 6, 2, 1)), 1.0, 1.0)),
        ("small_arrays", "tangents", (ONES, (np.ones(2),))),
        ("rigid_bodies", "placed", (POSES, [0, 2], POSES)),
        ("rigid_bodies", "placed", (POSES, [-1, 0], POSES)),
        ("rigid_bodies", "placed", (POSES[:, :3], [0, 0], POSES)),
        ("rigid_bodies", "point_jacobians", (np.ones((6, 2)), np.ones((3, 2)), [0, 3], ONES)),
        ("rigid_bodies", "point_jacobians", (np.ones((6, 2)), np.ones((3, 1)), [0, 1], ONES)),
        ("rigid_bodies", "point_jacobians", (np.ones((5, 2)), np.ones((3, 2)), [0, 1], ONES)),
        ("rigid_bodies", "point_jacobians", (np.ones((6, 2)), np.ones((3, 2)), [0], ONES)),
        ("rigid_bodies", "twist_velocities", (np.ones(5), np.ones(3), ONES)),
        ("rigid_bodies", "is_rigid", (np.eye(3),)),
        (
            "rigid_bodies", "motion_states",
            (ONES, ONES, np.ones(6), np.ones(3), np.ones((1, 3)), None, 1e-3),
        ),
        (
            "contact_search", "ConvexSets",
            ([1], [1], ONES[:1], ONES[:1], [1], [[0] * 4], [0, 0], np.ones((0, 4))),
        ),
        (
            "contact_search", "ConvexSets",
            ([1], [0], ONES[:1], ONES[:1], [1], [[0] * 4], [0, 1], np.ones((2, 4))),
        ),
        (
            "contact_search", "ConvexSets",
            ([1], [0], ONES[:1], ONES[:1], [1], [[0] * 4], [-1, 2], np.ones((2, 4))),
        ),
        (
            "contact_search", "ConvexSets",
            ([3], [0], ONES[:1], ONES[:1], [1], [[0] * 4], [0, 0], np.ones((0, 4))),
        ),
        (
            "contact_search", "ConvexSets",
            ([1], [0], ONES, ONES[:1], [1], [[0] * 4], [0, 0], np.ones((0, 4))),
        ),
    ],
)  # fmt: skip
def test_what_does_not_fit_is_refused(loops: str, name: str, arguments: tuple) -> None:
    with pytest.raises(ValueError):
        getattr(getattr(compiled, loops), name)(*arguments)


@needs_loops
def test_one_pose_for_each_set() -> None:
    assert compiled.contact_search is not None
    sets = compiled.contact_search.ConvexSets(
        [compiled.contact_search.BALL], [0], ONES[:1], ONES[:1], np.ones(1), [[0] * 4], [0, 0],
        np.ones((0, 4)),
    )  # fmt: skip
    pairs = compiled.body_pairs.BodyPairs(sets, [0], [0])
    with pytest.raises(ValueError, match="one pose for each set"):
        pairs.within(POSES, 5e-3)
    with pytest.raises(ValueError, match="one pose for each set"):
        pairs.beside(POSES[:1], sets, POSES, 5e-3)
    with pytest.raises(ValueError, match="sets that exist"):
        compiled.body_pairs.BodyPairs(sets, [0], [1])
    with pytest.raises(ValueError, match="one pose for each set"):
        compiled.contact_search.plain_contacts(
            sets, POSES, sets, POSES[:1], 1e-3, 5e-3, lambda *_: None
        )
    nothing: Any = None
    with pytest.raises(TypeError):
        compiled.contact_search.plain_contacts(
            nothing, POSES, sets, POSES[:1], 1e-3, 5e-3, lambda *_: None
        )
