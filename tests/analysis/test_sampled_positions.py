"""Contacts that may be elsewhere, against scenes that state them there and another program."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from tests.oracles.uncertain_members import BALANCED, imbalance, yielding

from graspless_pin import (
    Coverage,
    Evaluator,
    Scene,
    Torque,
    Uncertainty,
    load_scene,
    maximize_margin,
    minimize_torque,
    optimize,
    uncertainty_gradients,
)
from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.errors import ArgumentError
from graspless_pin.problem.members import join_members
from graspless_pin.scene import GivenContact

STIFFNESS = 2.0  # N m/rad
CUBOID: dict[str, Any] = {"mass": 0.1, "contact_position": 0.003}
BOX: dict[str, Any] = {"mass": 0.2, "contact_position": {"hand": 0.001}}


def solved(name: str, unknown: dict[str, Any], feedback: float | None = None, **options: Any):
    scene = load_scene(f"examples/{name}.yaml")
    options = {"static_friction": "coulomb", "margin": 0.05, **options}
    return scene, scene.solve(
        "torque", uncertainty=Uncertainty(**unknown), feedback=feedback, **options
    )


@pytest.fixture(scope="module")
def cuboid() -> tuple[Scene, RobustSolution]:
    return solved("paper/cuboid_at_rest", CUBOID)


@pytest.fixture(scope="module")
def box() -> tuple[Scene, RobustSolution]:
    return solved("allegro_box_on_slope", BOX, STIFFNESS)


def stated_at(scene: Scene, moved: np.ndarray) -> Scene:
    """A scene whose contacts are stated to be elsewhere."""
    found = scene.contacts.arrays
    points = zip(found.bodies, found.positions + moved, found.normals, strict=True)
    return scene.with_changes(given_contacts=[GivenContact(*one) for one in points])


def test_members_are_scenes_with_contacts_stated_there(cuboid, box):
    """Also where a finger touches: its Jacobian is that of the point there."""
    for scene, robust in (cuboid, box):
        nominal, weight = scene.problem(), scene.object.mass * 9.81
        moved = [one for one in robust.members if one.moved is not None]
        assert len(moved) == robust.samples.solved
        radii = robust.uncertainty.contact_position
        for member in moved[::7]:
            there = stated_at(scene, member.moved).problem()
            np.testing.assert_allclose(member.problem.W, there.W, atol=1e-12)
            np.testing.assert_allclose(member.problem.jacobian, there.jacobian, atol=1e-12)
            np.testing.assert_allclose(np.linalg.norm(member.moved, axis=1), radii, atol=1e-12)
            assert np.abs((member.moved * nominal.normals).sum(axis=1)).max() < 1e-15
            share = float(member.corner.mass)
            load = member.problem.external_wrench[:3] - nominal.external_wrench[:3]
            assert np.linalg.norm(load) == pytest.approx(abs(share) * weight, rel=1e-2)


@pytest.mark.parametrize("name", ["cuboid", "box"])
def test_scenes_drawn_anew_balance_as_often_as_is_told(name, request):
    """Members of the set, drawn and judged by a program of its own."""
    scene, robust = request.getfixturevalue(name)
    unknown, feedback = (CUBOID, None) if name == "cuboid" else (BOX, STIFFNESS)
    assert robust.coverage is Coverage.SAMPLED
    assert robust.samples.where_meant is Coverage.WHOLE_SET
    assert robust.samples.served >= 0.95 * robust.samples.count
    nominal, rng, failed = scene.problem(), np.random.default_rng(5), 0
    radii = robust.uncertainty.contact_position * np.ones(nominal.contact_count)
    for _ in range(60):
        angle, off = rng.uniform(0.0, 2.0 * np.pi, len(radii)), radii * np.sqrt(rng.random())
        within = off[:, None] * np.array([np.cos(angle), np.sin(angle)]).T
        there = stated_at(scene, np.einsum("lij,lj->li", nominal.tangents, within))
        mass = scene.object.mass * (1.0 + unknown["mass"] * rng.uniform(-1.0, 1.0))
        drawn = there.with_changes(object=replace(scene.object, mass=mass, inertia=None)).problem()
        added = None if feedback is None else feedback * yielding(drawn)
        failed += imbalance(drawn, robust.torques, added) > BALANCED
    assert failed <= 3
    # Torques that know nothing of it fail nearly everywhere: what has been solved for counts.
    alone = scene.solve("torque", margin=0.05, static_friction="coulomb")
    bad = 0
    for member in robust.members[-20:]:
        added = None if feedback is None else feedback * yielding(member.problem)
        assert imbalance(member.problem, robust.torques, added) < BALANCED
        bad += imbalance(member.problem, alone.torques, added) > BALANCED
    assert bad > 0


def test_members_that_join_one_by_one_cost_as_much_as_all_at_once(cuboid):
    scene, robust = cuboid
    whole = minimize_torque(join_members(robust.members), 0.05, static_friction="coulomb")
    assert robust.max_torque == pytest.approx(whole.max_torque, rel=1e-6)
    assert robust.bound == pytest.approx(robust.max_torque, rel=1e-6)
    assert len(robust.contact_forces) < len(robust.members)
    gradients = uncertainty_gradients(robust).values
    assert np.isnan(gradients["contact_position"]).all()
    _, less = solved("paper/cuboid_at_rest", {**CUBOID, "mass": 0.099})
    slope = (robust.max_torque - less.max_torque) / 0.001
    assert gradients["mass"] == pytest.approx(slope, rel=1e-3)
    verdicts = scene.stability_of_members(robust)
    assert [one.moved for one in verdicts.members] == [None, None]
    _, again = solved("paper/cuboid_at_rest", CUBOID)
    assert again.max_torque == robust.max_torque
    assert again.samples is not None and again.samples.served == robust.samples.served


def test_contacts_that_stay_are_not_sampled(cuboid):
    _, robust = cuboid
    _, still = solved("paper/cuboid_at_rest", {**CUBOID, "contact_position": 0.0})
    assert still.samples is None and still.coverage is Coverage.WHOLE_SET
    assert still.max_torque < robust.max_torque
    _, less = solved("paper/cuboid_at_rest", {**CUBOID, "contact_position": 0.001})
    assert still.max_torque < less.max_torque < robust.max_torque
    assert "sampled: 200 of 200 random members with contacts moved keep the margin" in str(less)


def test_positions_that_no_torques_serve_are_named():
    """Of joints without feedback any other position of a fingertip asks for other torques."""
    _, robust = solved("allegro_box_on_slope", BOX)
    assert not robust.found and robust.samples is None
    conflict = [robust.members[number] for number in robust.conflict]
    assert any(one.moved is not None for one in conflict)
    options: dict[str, Any] = {"static_friction": "coulomb"}
    assert not minimize_torque(join_members(conflict), 0.05, **options).found
    for left_out in range(len(conflict)):
        fewer = [one for number, one in enumerate(conflict) if number != left_out]
        assert minimize_torque(join_members(fewer), 0.05, **options).found


def test_modes_differ_under_the_papers_rules():
    _, robust = solved("paper/cuboid_at_rest", CUBOID, static_friction="virtual_sliding")
    assert robust.found and robust.coverage is Coverage.SAMPLED
    assert robust.samples is not None
    assert robust.samples.where_meant in (Coverage.WHOLE_SET, Coverage.CORNERS)
    _, coulomb = solved("paper/cuboid_at_rest", CUBOID)
    assert robust.max_torque >= coulomb.max_torque - 1e-9


def test_mistakes():
    scene = load_scene("examples/paper/cuboid_at_rest.yaml")
    unknown = Uncertainty(contact_position=0.002)
    with pytest.raises(ArgumentError, match="arrays do not state how their Jacobian changes; use"):
        maximize_margin(scene.problem(), uncertainty=unknown)
    on_slope = Uncertainty(contact_position=[0.0, 0.0, 0.002, 0.002, 0.002, 0.002])
    samples = maximize_margin(scene.problem(), uncertainty=on_slope).samples
    assert samples is not None and samples.solved == 50
    with pytest.raises(ArgumentError, match="is not supported together with a set with balls"):
        scene.solve(uncertainty=Uncertainty(contact_position=0.002, force_radius=0.1))
    with pytest.raises(ArgumentError, match=r"may be off by 2 m, .* m large; give metres"):
        scene.solve(uncertainty=Uncertainty(contact_position=2.0))
    with pytest.raises(ArgumentError, match=r"contact_position\['slop'\]: is not a body; did you"):
        scene.solve(uncertainty=Uncertainty(contact_position={"slop": 0.1}))
    with pytest.raises(ArgumentError, match="is sampled, which takes too long for many states"):
        Evaluator(scene, uncertainty=unknown)
    with pytest.raises(ArgumentError, match="wrench_matrix"):
        given = scene.problem()
        optimize(given.with_changes(wrench_matrix=given.W), Torque(0.1), uncertainty=on_slope)
