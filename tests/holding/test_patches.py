"""Contacts of one plane: what a patch is split into leaves out no motion, and tells each slip."""

from __future__ import annotations

import numpy as np
import pytest
from cases import block_between_walls, block_on_slope, dynamics_of, pressed_on_wall
from scipy.optimize import linprog
from tests.core.random_scenes import slope_scene

from graspless_pin import QuasistaticProblem, Stability, maximize_margin, stability
from graspless_pin.holding.bounds import States
from graspless_pin.holding.branching import forced_state
from graspless_pin.holding.patches import Patch, PatchSlip, find_patches
from graspless_pin.holding.verdict import ContactState

TOLERANCE = 1e-10


def rim(count: int = 8, *, warped: float = 0.0) -> QuasistaticProblem:
    """A disc of 1 kg on points of its rim, each with tangents of its own; some off the plane."""
    rng, angles = np.random.default_rng(count), 2.0 * np.pi * np.arange(count) / count
    places = 0.03 * np.column_stack([np.cos(angles), np.sin(angles), np.full(count, -1.0)])
    places[::2, 2] += warped
    turns = rng.uniform(0.0, 2.0 * np.pi, count)
    first = np.column_stack([np.cos(turns), np.sin(turns), np.zeros(count)])
    normals = np.tile([0.0, 0.0, 1.0], (count, 1))
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    return QuasistaticProblem(
        places, normals, [2.0, 0.0, -9.81, 0.0, 0.0, 0.01], friction=0.5, tangents=tangents,
        object_inertia=np.diag([1.0] * 3 + [1e-3] * 3),
    )  # fmt: skip


def patch_of(problem: QuasistaticProblem) -> tuple[Patch, np.ndarray]:
    dynamics = dynamics_of(problem, ())
    (patch,) = find_patches(dynamics.rows, dynamics.friction, TOLERANCE)
    return patch, dynamics.rows


def _holds(slip: PatchSlip, motion: np.ndarray) -> bool:
    """Whether a motion is one of a cone: of the rays with weights that are not negative."""
    assert slip.cone is not None
    share = motion @ np.linalg.inv(slip.cone.axes)
    size = slip.cone.sign * share[slip.cone.axis]
    others = np.delete(share, slip.cone.axis)
    low, high = size * slip.cone.low, size * slip.cone.high
    return bool(size >= 0.0 and (others >= low - 1e-12).all() and (others <= high + 1e-12).all())


@pytest.mark.parametrize("count", [3, 4, 8])
def test_each_motion_is_in_a_part_whose_arcs_have_its_slips(count: int) -> None:
    patch, rows = patch_of(rim(count))
    assert patch.contacts == (*range(count),)
    rng = np.random.default_rng(count)
    first = patch.split(None, rng.normal(size=6))
    told = 0
    for y in rng.normal(size=(200, 6)):
        motion, known = patch.motion @ y, first[1:]
        slips = rows[:, 1:] @ y
        np.testing.assert_allclose(patch.images @ motion, slips, atol=1e-13)
        for _ in range(rng.integers(1, 12)):
            part = next(one for one in known if _holds(one, motion))
            for slip, (middle, half_width) in zip(slips, part.arcs, strict=True):
                way = np.arctan2(slip[1], slip[0]) - middle
                assert abs((way + np.pi) % (2.0 * np.pi) - np.pi) <= half_width
                told += half_width < 0.5 * np.pi
            known = patch.split(part, y)
    assert told > 1000
    still = first[0]
    assert still.cone is None and (still.arcs[:, 1] == -1.0).all()
    assert patch.split(still, np.ones(6)) == []


def test_a_centre_of_rotation_at_a_contact_leaves_its_slip_untold() -> None:
    patch, _ = patch_of(rim())
    y = np.array([0.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    turning = y.copy()
    # Contact 0 stays where it is: in every part that has this motion, its slip is not told.
    images = patch.images[0] @ patch.motion
    turning[5] = -images[np.argmax(np.abs(images @ y))] @ y
    turning[5] /= images[np.argmax(np.abs(images @ y)), 5]
    assert np.abs(images @ turning).max() < 1e-12
    known = patch.split(None, turning)[1:]
    for halvings in range(8):
        part = next(one for one in known if _holds(one, patch.motion @ turning))
        assert part.arcs[0, 1] == np.pi
        assert halvings < 7 or (part.arcs[[2, 4, 6], 1] < 0.5).all()
        known = patch.split(part, turning)


def test_contacts_are_joined_by_plane_and_bodies() -> None:
    """Of several small faces none is a patch: one by one their contacts are split better."""
    even_and_odd = [tuple(range(0, 12, 2)), tuple(range(1, 12, 2))]
    for problem, known in (
        (rim(12, warped=1e-6), even_and_odd),
        (rim(8, warped=1e-6), []),
        (block_between_walls(0.5), []),
        (pressed_on_wall(), [(0, 1, 2, 3)]),
    ):
        dynamics = dynamics_of(problem, np.ones(problem.joint_count))
        found = find_patches(dynamics.rows, dynamics.friction, TOLERANCE)
        assert [one.contacts for one in found] == known
    smooth = rim().with_changes(friction=0.0)
    assert find_patches(dynamics_of(smooth, ()).rows, smooth.friction, TOLERANCE) == []


@pytest.mark.parametrize("turn", [0.0, 0.4])
def test_a_push_that_a_whole_rim_just_bears_or_not(turn: float) -> None:
    """A pure push at the centre of mass's height over the plane: mu m g is what bears it."""
    way = np.array([np.cos(turn), np.sin(turn)])
    for share, status in ((0.97, Stability.STRONG), (1.03, Stability.NONE)):
        force = share * 0.5 * 9.81 * way
        # At the plane, so that it does not tip: the moment about the centre of mass.
        moment = np.cross([0.0, 0.0, -0.03], [*force, 0.0])
        problem = rim().with_changes(external_wrench=[*force, -9.81, *moment])
        assert stability(problem, []).status is status


def test_a_disc_on_a_slope_needs_few_sets_of_outcomes() -> None:
    """Eight contacts are split together: one by one they take hundreds of sets."""
    problem = block_on_slope(0.5, 0.4)
    verdict = stability(problem, maximize_margin(problem).torques)
    assert verdict.status is Stability.STRONG
    tilted = rim().with_changes(
        external_wrench=[9.81 * np.sin(0.4), 0.0, -9.81 * np.cos(0.4), 0.0, 0.0, 0.0]
    )
    verdict = stability(tilted, [])
    assert verdict.status is Stability.STRONG
    assert verdict.nodes < 100


@pytest.mark.parametrize("angle", [0.2, 0.44])
def test_a_corner_that_is_there_twice_changes_no_verdict(angle: float) -> None:
    """Two contacts in one place do not tell that a third does not slip."""
    once, twice = block_on_slope(0.5, angle), [0, 0, 1, 2, 3]
    doubled = once.with_changes(
        positions=once.positions[twice], normals=once.normals[twice], friction=0.5,
        tangents=None, sliding=None, max_normal_force=50.0, jacobian=None,
    )  # fmt: skip
    assert stability(doubled, []).status is stability(once, []).status is Stability.STRONG


def test_a_motion_in_which_contacts_stick_with_friction_at_its_limit_is_found() -> None:
    """Five contacts of one plane: no point of the split patch is near the outcome that moves."""
    problem = slope_scene(806, 6).with_changes(
        object_inertia=np.diag([1.0, 1.0, 1.0, 0.01, 0.01, 0.01]), joint_inertia=[[1e-3]]
    )
    assert stability(problem, [-0.06699656], node_limit=3000).status is Stability.WEAK


def test_what_follows_is_proven_from_what_was_split_alone() -> None:
    """Proofs from proofs would make tolerances grow from contact to contact, past the limit."""
    dynamics = dynamics_of(rim(8), ())
    states = States.all_free(8)
    for contact in range(3):
        states = states.with_state(contact, ContactState.CLOSED)
    for contact in range(2):
        states = states.with_state(contact, ContactState.STICKING)
    followed = 0
    while (forced := forced_state(dynamics, states)) is not None:
        for dual in forced.duals:
            assert not dual.normal[3:].any() and not dual.tangential[2:].any()
        states = states.with_state(forced.contact, forced.state, depends=forced.depends)
        followed += 1
    assert followed == 5 + 6


def test_what_follows_from_what_is_not_exact_is_known_to_what_that_adds_up_to() -> None:
    """Held against the largest motion within these tolerances, by linear programs."""
    unit, rng = 1e-13, np.random.default_rng(3)
    dynamics = dynamics_of(rim(8), ())
    parts, slips = rng.uniform(0.2, 1.0, 3), rng.uniform(0.2, 1.0, 2)
    states = States.all_free(8)
    for contact, most in enumerate(parts):
        states = states.with_state(contact, ContactState.CLOSED, most=unit * most)
    for contact, most in enumerate(slips):
        states = states.with_state(contact, ContactState.STICKING, most=unit * most)
    told = np.vstack([dynamics.rows[:3, 0], *dynamics.rows[:2, 1:]])
    within = np.repeat(slips, 2) / np.sqrt(2.0)
    most, least = np.concatenate([parts, within]), np.concatenate([0.0 * parts, -within])
    followed = 0
    while (forced := forced_state(dynamics, states)) is not None:
        rows = dynamics.rows[forced.contact]
        for row in rows[:1] if forced.state is ContactState.CLOSED else [*rows[1:], *-rows[1:]]:
            sides = np.concatenate([most, -least])
            farthest = linprog(-row, np.vstack([told, -told]), sides, bounds=(None, None))
            assert forced.most >= unit * -farthest.fun - 1e-16 > 0.0
        states = states.with_state(
            forced.contact, forced.state, depends=forced.depends, most=forced.most
        )
        followed += 1
    assert followed == 5 + 6
    # An open contact parts by no more than its closed sibling may.
    opened = States.all_free(8).with_state(3, ContactState.OPEN)
    for contact in range(3):
        opened = opened.with_state(contact, ContactState.CLOSED, most=unit)
    found = forced_state(dynamics, opened)
    assert found is None or found.contact != 3
