"""Poses, Jacobian columns and weights of the compiled loops are Pinocchio's."""

from concurrent.futures import ThreadPoolExecutor
from types import SimpleNamespace
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from test_work_space import GRAVITIES, MODEL

from graspless_pin import compiled, load_scene
from graspless_pin.geometry.hand.work_space import WorkSpace, joint_motions

pytestmark = pytest.mark.skipif(compiled.core is None, reason="nothing was compiled")


def chains_of(model: pin.Model) -> Any:
    parents, placements, axes = joint_motions(SimpleNamespace(pinocchio_model=model))
    inertias = model.inertias.tolist()
    return compiled.core.KinematicChains(
        parents=parents,
        placements=placements,
        axes=axes,
        masses=np.array([inertia.mass for inertia in inertias]),
        centers=np.array([inertia.lever for inertia in inertias]).reshape(-1, 3),
    )


def states(count: int) -> np.ndarray:
    """Positions of all joints, many turns of the continuous ones among them."""
    return np.random.default_rng(6).normal(0.0, 3.0, (count, MODEL.nv))


def as_pinocchio_takes(positions: np.ndarray) -> np.ndarray:
    entries: list[float] = []
    for joint in range(1, MODEL.njoints):
        angle = positions[joint - 1]
        entries += [np.cos(angle), np.sin(angle)] if MODEL.nqs[joint] == 2 else [angle]
    return np.array(entries)


@pytest.mark.parametrize("gravity", GRAVITIES, ids=str)
def test_they_are_pinocchios(gravity: np.ndarray) -> None:
    chains, space, kept = chains_of(MODEL), WorkSpace(MODEL), []
    for positions in states(8):
        q = as_pinocchio_takes(positions)
        expected, found = space.kinematics(q), chains.kinematics(positions)
        kept.append((expected, found))
        np.testing.assert_allclose(
            chains.gravity_torques(positions, gravity),
            space.gravity_torques(q, gravity),
            rtol=0,
            atol=1e-12,
        )
    for expected, found in kept:  # and the next ones do not write over them
        for one, other in zip(found, expected, strict=True):
            assert not one.flags.writeable
            np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)


def test_there_may_be_no_joint() -> None:
    chains = chains_of(pin.Model())
    T, J = chains.kinematics(np.zeros(0))
    np.testing.assert_array_equal(T, np.eye(4)[None])
    assert J.shape == (6, 0)
    assert chains.gravity_torques(np.zeros(0), GRAVITIES[0]).shape == (0,)


def test_threads_may_share_them() -> None:
    chains, many = chains_of(MODEL), states(40)
    expected = [chains.gravity_torques(one, GRAVITIES[0]) for one in many]
    with ThreadPoolExecutor(4) as pool:
        found = list(pool.map(lambda one: chains.gravity_torques(one, GRAVITIES[0]), [*many] * 5))
    np.testing.assert_array_equal(found, expected * 5)


def test_what_does_not_fit_is_refused() -> None:
    chains = chains_of(MODEL)
    with pytest.raises(ValueError, match="needs"):
        chains.kinematics(np.zeros(MODEL.nv - 1))
    with pytest.raises(ValueError, match="needs"):
        chains.gravity_torques(np.zeros(MODEL.nv), np.zeros(2))


@pytest.mark.parametrize("name", ["allegro_box_on_slope", "two_hands_slide_crate"])
def test_the_chains_of_hands_stand_where_pinocchio_says(name: str) -> None:
    hand = load_scene(f"examples/{name}.yaml").hand
    assert hand is not None
    tree, positions = hand.tree, np.array(hand.positions)
    chains = compiled.core.KinematicChains(**tree.chains)
    for one, other in zip(chains.kinematics(positions), tree.kinematics(positions), strict=True):
        np.testing.assert_allclose(one, other, rtol=0, atol=1e-13)
    weights = tree.gravity_torques(positions, GRAVITIES[1])
    found = chains.gravity_torques(positions, GRAVITIES[1])
    np.testing.assert_allclose(found, weights, rtol=0, atol=1e-13)
