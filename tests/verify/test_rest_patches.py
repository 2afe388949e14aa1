"""Parts of trees at patches: what is left out, or does not follow, is refused."""

import copy
from dataclasses import replace

import numpy as np
import pytest
from rest_documents import document, is_refused, rest_lines, seeded, slack_of

from graspless_pin.report.verify.rest_bounds import KnownStates
from graspless_pin.report.verify.rest_patches import (
    MotionCone,
    PatchSlip,
    uncovered_motions,
    unproven_arcs,
)

TREES = ("slope", "pressed")


def nodes_of(made):
    return made["stability"]["proof"]["nodes"]


def planar(count=5, seed=0):
    """Places in a plane, and rows of slips there of motions of four numbers, three of the plane."""
    rng = np.random.default_rng(seed)
    places = rng.uniform(-1.0, 1.0, (count, 2))
    images = np.zeros((count, 2, 3))
    images[:, :, :2] = np.eye(2)
    images[:, 0, 2], images[:, 1, 2] = -places[:, 1], places[:, 0]
    turns = rng.uniform(-np.pi, np.pi, count)
    frames = np.array([[[np.cos(t), np.sin(t)], [-np.sin(t), np.cos(t)]] for t in turns])
    images, rows = frames @ images, np.zeros((count, 3, 4))
    rows[:, 1:, :3] = images
    rows[:, 0, 3] = 1.0
    return images, rows


def cone_of(part):
    assert part.cone is not None
    return part.cone


def faces(images, axes):
    """The parts of which nothing is known of the slips, and the one of no slip."""
    whole = np.tile([0.0, np.pi], (len(images), 1))
    contacts = tuple(range(len(images)))
    cones = [MotionCone(axes, k, s, -np.ones(2), np.ones(2)) for k in range(3) for s in (1, -1)]
    return [PatchSlip(contacts, images, whole, one) for one in (None, *cones)]


@pytest.mark.parametrize("name", TREES)
def test_parts_are_of_patches(name):
    nodes = nodes_of(document(name))
    assert all(line.passed is True for line in rest_lines(document(name)))
    assert sum(node["patch"] is not None for node in nodes) > 10
    assert any(node["patch"] and node["patch"]["cone"] is None for node in nodes)


@pytest.mark.parametrize("name", TREES)
def test_no_part_can_say_other_than_follows(name):
    nodes, said = nodes_of(document(name)), 0
    for index, node in list(enumerate(nodes))[1::3]:
        if node["patch"] is None:
            continue
        patch, cone = node["patch"], node["patch"]["cone"]
        changes = [
            {"contacts": patch["contacts"][::-1]},
            {"images": (1.1 * np.array(patch["images"])).tolist()},
            {"cone": None if cone else {"axes": np.eye(3).tolist(), "axis": 0, "sign": 1,
                                        "low": [-1, -1], "high": [1, 1]}},
        ]  # fmt: skip
        if cone is not None:
            told = [k for k, (_, width) in enumerate(patch["arcs"]) if width < np.pi]
            for k in told:
                for middle, width in ((0.0, 0.8), (0.1, 1.0)):
                    arcs = copy.deepcopy(patch["arcs"])
                    arcs[k] = [arcs[k][0] + middle, width * arcs[k][1]]
                    changes.append({"arcs": arcs})
            low, high = np.array(cone["low"]), np.array(cone["high"])
            changes += [
                {"cone": cone | {"high": (0.9 * high + 0.1 * low).tolist()}},
                {"cone": cone | {"low": (0.9 * low + 0.1 * high).tolist()}},
                {"cone": cone | {"sign": -cone["sign"]}},
                {"cone": cone | {"sign": 0}},
                {"cone": cone | {"axis": (cone["axis"] + 1) % 3}},
                {"cone": cone | {"axes": np.roll(cone["axes"], 1, axis=0).tolist()}},
            ]
        for change in changes[index % 2 :: 2]:
            made = copy.deepcopy(document(name))
            nodes_of(made)[index]["patch"] |= change
            assert is_refused(made), (index, change)
            said += 1
        for change in ({"patch": None}, {"contact": patch["contacts"][1]}, {"state": "closed"}):
            made = copy.deepcopy(document(name))
            nodes_of(made)[index] |= change
            assert is_refused(made), (index, change)
    assert said > 15


def test_axes_in_a_plane_are_refused():
    made = copy.deepcopy(document("slope"))
    for node in nodes_of(made):
        if node["patch"] and node["patch"]["cone"]:
            node["patch"]["cone"]["axes"][2] = node["patch"]["cone"]["axes"][1]
    assert is_refused(made)


@pytest.mark.parametrize("seed", range(20))
def test_parts_cover_each_motion(seed):
    """Held against motions one by one: what is left out is told, and only that."""
    rng = np.random.default_rng(seed)
    images, _ = planar(seed=seed)
    axes = rng.normal(size=(3, 3))
    parts = faces(images, axes)
    assert uncovered_motions(parts, None) == ""
    for number in range(7):
        assert uncovered_motions(parts[:number] + parts[number + 1 :], None) != ""
    outer = parts[1 + rng.integers(6)]
    side, middle = int(rng.integers(2)), float(rng.uniform(-0.9, 0.9))
    gap = float(rng.choice([-0.05, 0.0, 0.05]))
    high, low = np.ones(2), -np.ones(2)
    high[side], low[side] = middle, middle + gap
    halves = [
        replace(outer, cone=replace(cone_of(outer), high=high)),
        replace(outer, cone=replace(cone_of(outer), low=low)),
    ]
    share = rng.uniform(-1.0, 1.0, (4000, 2))
    share[:9] = middle + 0.04 * np.linspace(-1.0, 1.0, 9)[:, None]
    held = [
        ((share >= cone_of(one).low) & (share <= cone_of(one).high)).all(axis=1) for one in halves
    ]
    covered = bool((held[0] | held[1]).all())
    assert covered == (gap <= 0.0)
    assert (uncovered_motions(halves, outer) == "") == covered
    assert uncovered_motions(halves[:1], outer) != ""
    assert uncovered_motions([parts[0], halves[1]], outer) != ""
    assert uncovered_motions(halves, parts[0]) != ""


@pytest.mark.parametrize("seed", range(10))
def test_arcs_that_are_accepted_have_each_slip(seed):
    rng = np.random.default_rng(seed)
    images, rows = planar(seed=seed)
    off = 10.0 ** rng.uniform(-17.0, -13.0)
    rows[:, 1:, 3] = off * rng.uniform(-1.0, 1.0, (len(images), 2))
    outer = faces(images, rng.normal(size=(3, 3)))[1 + rng.integers(6)]
    middle = rng.uniform(-0.9, 0.9, 2)
    cone = replace(cone_of(outer), low=middle - 0.05, high=middle + 0.05)
    motions = rng.dirichlet(0.3 * np.ones(4), 300) @ cone.rays()
    refused = np.zeros(2, dtype=int)
    for contact, image in enumerate(images):
        slips = motions @ image.T
        way = np.mean(slips, axis=0)
        for half_width in (0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 1.5):
            arcs = outer.arcs.copy()
            arcs[contact] = np.arctan2(way[1], way[0]), half_width
            wrong = unproven_arcs(replace(outer, cone=cone, arcs=arcs), rows, 1e-12)
            # Slips as slow as may be, with all that the motion does not tell of them.
            speed = 1e-12 / np.linalg.norm(images @ motions.T, axis=1).max(axis=0)
            real = speed[:, None] * slips + 2.0 * off * rng.uniform(-1.0, 1.0, slips.shape)
            away = np.arctan2(real[:, 1], real[:, 0]) - arcs[contact, 0]
            inside = np.abs((away + np.pi) % (2.0 * np.pi) - np.pi).max() <= half_width
            assert wrong or inside
            refused[int(bool(wrong))] += 1
    assert off > 1e-14 or refused.min() > 0


def test_what_a_motion_does_not_tell_turns_slips_by_all_of_it():
    """Two contacts slip along t2 with y_2 = e, and to both sides with y_4, which may be 2 long."""
    images = np.array([[[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]], [[1.0, 0.0, 0.0], [0.0, 1.0, 1.0]]])
    slowest, share = 1e-12, 0.05
    rows = np.zeros((2, 3, 4))
    rows[:, 1:, :3], rows[:, 1, 3] = images, [share * slowest, -share * slowest]
    turned = np.arcsin(2.0 * share)  # where a slip of both parts is e long
    along_t2 = MotionCone(np.eye(3), 1, 1, np.zeros(2), np.zeros(2))
    for half_width, follows in ((0.95 * turned, False), (2.0 * turned, True)):
        arcs = np.tile([0.5 * np.pi, half_width], (2, 1))
        wrong = unproven_arcs(PatchSlip((0, 1), images, arcs, along_t2), rows, slowest)
        assert (wrong == "") == follows


@pytest.mark.sampled(1)
@pytest.mark.parametrize("number", [1, 3, 4, 7, 13])
def test_bounds_hold_for_what_a_patch_does(number):
    """As contacts of a patch slip in arcs, or not at all, whatever else they do."""
    (body, outcome), rng = seeded(number), np.random.default_rng(number)
    dynamics = body.dynamics(body.load)
    y, f = body.coordinates(dynamics, outcome.acceleration, outcome.forces)
    u = dynamics.rows @ y
    ways, speeds = np.arctan2(u[:, 2], u[:, 1]), np.hypot(u[:, 1], u[:, 2])
    for _ in range(300):
        some = rng.random(len(f)) < 0.5
        width = np.where(speeds > 1e-6, rng.uniform(0.1, 1.5, len(f)), np.pi)
        arcs = np.column_stack([ways + 0.9 * width * rng.uniform(-1.0, 1.0, len(f)), width])
        arcs[~some] = 0.0, np.pi
        contacts = tuple(range(len(f)))
        cone = MotionCone(np.eye(3), 0, 1, -np.ones(2), np.ones(2))
        states = KnownStates.all_free(len(f)).with_patch(
            PatchSlip(contacts, np.zeros((len(f), 2, 3)), arcs, cone), 0.0
        )
        if rng.random() < 0.3:
            still = PatchSlip(contacts, np.zeros((len(f), 2, 3)), arcs, None)
            states = states.with_patch(still, float(speeds.max()))
        assert slack_of(dynamics, states, y, f, rng) >= -1e-8


def test_what_is_known_of_two_patches_is_kept_apart():
    """The latest of each, in whichever order they come."""
    images, axes = planar(4)[0], np.eye(3)
    one, other = (
        [replace(part, contacts=contacts) for part in faces(images[:2], axes)]
        for contacts in ((0, 1), (2, 3))
    )
    states = KnownStates.all_free(4)
    latest = {}
    for part in (one[1], other[2], one[3], other[4], one[5]):
        states, latest[part.contacts] = states.with_patch(part, 0.0), part
        for patch in (one[0], other[0]):
            assert states.known_slip(patch) is latest.get(patch.contacts)
