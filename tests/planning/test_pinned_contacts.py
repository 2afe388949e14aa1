"""Pinned contacts: what they are at a contact, away from one, and for an optimiser."""

import pickle
from typing import Any

import numpy as np
import pytest
from planning_scenes import example, nearby, shifted, turned
from tests.oracles.pinned_states import STEP, displaced, figures, pins_of

from graspless_pin import Evaluator, minimize_torque
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.planning import StateStatus

TIPS = [(f"finger_{k}_tip", "object") for k in (1, 2, 3)]


def pinned(name, **options):
    scene = example(name).with_changes(motion=None)
    return Evaluator(scene, pins=pins_of(scene), **options)


@pytest.mark.parametrize(
    "name", ["allegro_box_on_slope", "trihand_push_box", "panda_slide_cuboid_up_slope"]
)
def test_where_bodies_touch_the_pins_are_the_contacts(name):
    evaluator = pinned(name)
    scene, state = example(name).with_changes(motion=None), evaluator.pinned()
    assert sorted(state.bodies) == sorted(scene.contacts.bodies)
    assert state.bodies == state.evaluation.contacts.bodies
    for body in {*state.bodies}:
        rows = np.array([one == body for one in state.bodies])
        theirs = [one for one in scene.contacts.points if one.body == body]
        order = np.lexsort(state.evaluation.contacts.arrays.positions[rows].T.round(6))
        other = np.lexsort(np.array([one.position for one in theirs]).T.round(6))
        for ours, there in zip(order, other, strict=True):
            contact = theirs[there]
            assert state.gaps[rows][ours] == pytest.approx(contact.distance, abs=1e-9)
            position = state.evaluation.contacts.arrays.positions[rows][ours]
            np.testing.assert_allclose(position, contact.position, atol=1e-9)
    assert state.margin == pytest.approx(Evaluator(scene).evaluate().margin, rel=1e-4)


def test_away_from_contact_there_are_still_gaps_and_a_margin():
    scene = example("trihand_push_box").with_changes(motion=None)
    evaluator = Evaluator(scene, pins=[*TIPS, ("object", "table")])
    up = shifted(scene.object.T_world_object, [0.0, 0.0, 0.02])
    opened = {f"finger_{k}_distal": 1.0 for k in (1, 2, 3)}  # rad
    assert Evaluator(scene).evaluate(opened, up).status is StateStatus.NO_CONTACT
    state = evaluator.pinned(opened, up)
    assert state.evaluation.found and state.margin > 0.0
    assert state.torques.shape == (9,)
    on_table = np.array([body == "table" for body in state.bodies])
    np.testing.assert_allclose(state.gaps[on_table], 0.02, atol=1e-6)
    assert (state.gaps[~on_table] > 0.003).all()
    assert evaluator.is_feasible(opened, up, margin=0.5 * state.margin)
    assert not evaluator.is_feasible(opened, up, margin=2.0 * state.margin)


def test_the_gradient_of_the_gaps_leads_back_to_contact():
    """Gauss-Newton from open fingers ends where the other evaluator finds all contacts."""
    scene = example("trihand_push_box").with_changes(motion=None)
    evaluator = Evaluator(scene, pins=[*TIPS, ("object", "table")])
    q = evaluator.configuration({f"finger_{k}_distal": 0.95 for k in (1, 2, 3)})
    state = evaluator.pinned(q)
    hand = [k for k, body in enumerate(state.bodies) if body != "table"]
    for _ in range(8):
        state = evaluator.pinned(q)
        q = q - np.linalg.pinv(state.by_gaps.q[hand]) @ state.gaps[hand]
    found = Evaluator(scene).evaluate(q)
    assert found.found
    assert set(found.contacts.bodies) == set(state.bodies)
    assert np.abs(evaluator.pinned(q).gaps[hand]).max() < 1e-9


def test_a_face_is_pinned_beyond_its_border():
    """Beside the box, above its top: the nearest point is on an edge, but the side is stated."""
    scene = example("trihand_push_box").with_changes(motion=None)
    free = Evaluator(scene, pins=[*TIPS, ("object", "table")])
    sides = [(tip, body, [0.0, 0.0, 1.0]) for tip, body in TIPS]
    top = Evaluator(scene, pins=[*sides, ("object", "table")])
    there = free.pinned().gaps, top.pinned().gaps
    assert there[0] != pytest.approx(there[1])
    normals = top.evaluate().scene.contacts.arrays.normals[:3]
    down = -scene.object.T_world_object[:3, 2]
    np.testing.assert_allclose(normals, [down] * 3, atol=1e-12)


LOADS = [
    {"name": "push", "force": [0.2, 0.1, 0.0], "at": [0.02, 0.0, 0.02], "axes": "object"},
    {"name": "payload", "mass": 0.05, "at": [0.0, 0.02, 0.01]},
]


@pytest.mark.parametrize("slides", [True, False], ids=["sliding", "loaded"])
def test_sliding_and_loads_turn_with_the_object(slides):
    """A box that spins and slides on its slope: each contact's friction has its own direction.

    Or a push in object axes at a corner, and a payload: their wrench changes with the pose.
    """
    scene = example("allegro_box_on_slope").with_changes({} if slides else {"loads": LOADS})
    evaluator = Evaluator(scene, pins=pins_of(scene), algorithm="torque", collisions=False)
    along, _, up = scene.supports[0].T_world_support[:3, :3].T
    twist = np.concatenate([0.05 * along, 0.5 * up]) if slides else None
    q, T = nearby(evaluator, np.random.default_rng(0), 0.01), scene.object.T_world_object
    state = evaluator.pinned(q, twist=twist)
    assert state.evaluation.solution.problem.is_sliding.sum() == 4 * slides
    mode, size = state.evaluation.solution.mode, np.abs(state.by_optimum.pose).max()
    assert state.by_optimum.unique.all()

    def optimum(step):
        problem = evaluator.scene_at(q, displaced(scene, T, step), twist).problem()
        return minimize_torque(problem, margin=evaluator.required_margin, mode=mode).max_torque

    for column, step in enumerate(STEP * np.eye(6)):
        slope = (optimum(step) - optimum(-step)) / (2.0 * STEP)
        assert state.by_optimum.pose[column] == pytest.approx(slope, abs=1e-3 * size)


def test_parallel_faces_are_marked_as_a_kink():
    scene = example("trihand_push_box").with_changes(motion=None)
    up = shifted(scene.object.T_world_object, [0.0, 0.0, 0.01])
    tilted = scene.with_changes(
        object=scene.object.with_pose(turned(turned(up, 0.1), 0.1, axis=(1.0, 0.0, 0.0)))
    )
    # In this state a corner is nearest; flat over the table, all of the face is.
    evaluator = Evaluator(tilted, pins=[*TIPS, ("object", "table", [0.0, 0.0, 1.0])])
    flat = evaluator.pinned(None, up)
    table = [k for k, body in enumerate(flat.bodies) if body == "table"]
    assert len(table) == 1
    assert not flat.by_gaps.unique[table].any()
    assert evaluator.pinned().by_gaps.unique.all()


def test_pinned_evaluators_are_pickled_and_take_many_states():
    evaluator = pinned("trihand_push_box")
    q = np.array([evaluator.configuration() + step for step in (0.0, 0.01, 0.03)])
    again = pickle.loads(pickle.dumps(evaluator))  # noqa: S301 - our own bytes
    alone = [again.evaluate(one).margin for one in q]
    np.testing.assert_allclose(evaluator.evaluate_many(q).margins, alone, rtol=1e-6)


def test_a_state_without_torques_still_has_gaps():
    evaluator = pinned("trihand_push_box", algorithm="torque", margin=1e3)
    state = evaluator.pinned()
    assert not state.evaluation.found
    assert state.margin == -np.inf and np.isnan(state.optimum)
    assert state.by_gaps.q.shape == (len(state.gaps), 9)
    for ask in ("by_optimum", "by_torques", "torques"):
        with pytest.raises(NoSolutionError):
            getattr(state, ask)


@pytest.mark.parametrize(
    ("pins", "message"),
    [
        ([], r"pins: needs at least one pair"),
        ([("finger_1_tip",)], r"pins\[0\]: needs two bodies"),
        (5, r"pins: needs at least one pair"),
        ([5], r"pins\[0\]: needs two bodies"),
        ([*TIPS, ("object", "tabel")], r"pins\[3\]: unknown body 'tabel'; did you mean 'table'"),
        (
            [("finger_1_tip", "table")],
            r"pins\[0\]: pairs .* exactly one of them must be the object",
        ),
        ([("finger_1_tip", "object", [0.0, 1.0, 1.0])], r"pins\[0\]: .*no face has this normal"),
        ([("finger_1_tip", "object", [0.0, 0.0, 0.0])], r"pins\[0\]: needs a direction"),
    ],
)
def test_what_cannot_be_pinned_is_named(pins, message):
    with pytest.raises(ArgumentError, match=message):
        Evaluator(example("trihand_push_box"), pins=pins)


def test_what_has_no_pinned_state_is_named():
    evaluator = pinned("trihand_push_box")
    with pytest.raises(ArgumentError, match="pins: this evaluator has none"):
        Evaluator(evaluator.scene).pinned()
    with pytest.raises(ArgumentError, match=r"q: is not valid: .*outside"):
        evaluator.pinned({"finger_1_distal": 9.0})
    smooth = pinned("trihand_push_box", regularization=1e-3).pinned()
    with pytest.raises(ArgumentError, match="regularisation"):
        _ = smooth.by_optimum


def test_friction_and_mass_that_are_given_are_those_of_the_state():
    """Whatever the scene has them from: a number, a support's own, or materials."""
    plain = example("trihand_push_box").with_changes(motion=None)
    told = {
        "object.material": "box",
        "hand.material": "rubber",
        "materials": {"rubber": {"box": 0.7}},
    }
    of_materials = plain.with_changes({"friction": 0.3, **told})
    found = []
    for scene in (plain, of_materials):
        state = Evaluator(scene, pins=[*TIPS, ("object", "table")]).pinned(
            friction=[0.5, 0.6, 0.7, 0.4], mass=0.4
        )
        problem = state.evaluation.solution.problem
        assert problem.friction.tolist() == [0.5, 0.6, 0.7, 0.4, 0.4, 0.4, 0.4]
        np.testing.assert_allclose(problem.external_wrench[:3], 0.4 * scene.gravity)
        found.append(state.optimum)
    assert found[0] == pytest.approx(found[1], rel=1e-9)
    evaluator = pinned("trihand_push_box")
    wrong: Any
    for wrong, message in (
        ({"friction": [0.5]}, "friction"),
        ({"friction": [0.5, 0.5, 0.5, -0.1]}, "friction"),
        ({"mass": 0.0}, "mass: is 0.0; it must be positive"),
    ):
        with pytest.raises(ArgumentError, match=message):
            evaluator.pinned(**wrong)


def test_figures_of_the_oracle_are_those_of_the_state():
    evaluator = pinned("paper/cuboid_at_rest")
    state = evaluator.pinned()
    found = figures(
        evaluator, evaluator.configuration(), evaluator.scene.object.T_world_object,
        state.evaluation.solution.mode,
    )  # fmt: skip
    assert found["optimum"] == pytest.approx(state.optimum, rel=1e-6)
    np.testing.assert_array_equal(found["gaps"], state.gaps)


def test_a_corner_on_two_bodies_goes_with_each_of_them():
    """The box's lower edge is on the floor and at the wall: two contacts at one place."""
    scene = example("pivot_against_wall")
    evaluator = Evaluator(scene, pins=pins_of(scene), static_friction="coulomb")
    q, T = evaluator.configuration({"x": -0.21, "y": 0.01, "z": 0.09}), scene.object.T_world_object
    state = evaluator.pinned(q)  # m
    places = state.evaluation.contacts.arrays.positions.round(9).tolist()
    assert len({*map(tuple, places)}) < len(places)
    assert state.by_optimum.unique.all()
    friction = np.array([0.4, 0.2, 0.2])
    for told, ask, size in (
        (state.by_optimum.pose, lambda way: {"T_world_object": displaced(scene, T, way)}, 6),
        (state.by_optimum.friction, lambda way: {"friction": friction + way}, 3),
    ):
        ends = []
        for step in STEP * np.vstack([np.eye(size), -np.eye(size)]):
            changed: dict[str, Any] = ask(step)
            ends.append(evaluator.pinned(q, **changed).optimum)
        slopes = (np.array(ends[:size]) - ends[size:]) / (2.0 * STEP)
        np.testing.assert_allclose(told, slopes, rtol=1e-3, atol=1e-3)
