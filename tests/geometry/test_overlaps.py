"""Unwanted overlaps: known depths, and what is not reported."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from planar_fingers import RADIUS, allegro, lever

from graspless_pin.errors import ArgumentError, GrasplessPinWarning
from graspless_pin.findings import FindingCode
from graspless_pin.geometry.bodies.object_and_supports import Support
from graspless_pin.geometry.bodies.shapes import Box, HalfSpace
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.poses import pose_matrix
from graspless_pin.geometry.posing.overlaps import unwanted_overlaps
from graspless_pin.geometry.robots.files import load_robot


def wall_at(height: float) -> Support:
    """Everything above y = height."""
    return Support("wall", HalfSpace(), pose_matrix((0, height, 0), (np.pi / 2, 0, 0)))


def test_a_tip_in_a_support_is_named_with_its_depth():
    # The tip's centre is at y = RADIUS, so that it reaches up to 2 RADIUS.
    (overlap,) = unwanted_overlaps(lever(), [wall_at(2 * RADIUS - 0.003)])
    assert (overlap.link, overlap.other, overlap.kind) == ("tip", "wall", BodyKind.SUPPORT)
    assert overlap.depth == pytest.approx(0.003, abs=1e-8)
    assert str(overlap) == "hand link 'tip' and support 'wall' overlap by 3.00 mm"


def test_a_touch_is_no_overlap():
    wall = wall_at(2 * RADIUS - 5e-5)
    assert unwanted_overlaps(lever(), [wall]) == ()
    assert len(unwanted_overlaps(lever(), [wall], tolerance=1e-5)) == 1


def test_a_tip_that_is_smaller_than_what_passes_is_seen_deep_in_a_block():
    block = Support("block", Box((0.2, 0.2, 0.2)), pose_matrix((0.15, RADIUS, 0)))
    (overlap,) = unwanted_overlaps(lever(), [block], tolerance=1.5 * RADIUS)
    assert overlap.link == "tip" and overlap.depth > 2 * RADIUS


def test_two_mounted_robots_in_each_other_are_reported():
    mounts = [
        Mount(load_robot("lever_150mm"), np.eye(4), prefix="a/"),
        Mount(load_robot("lever_150mm"), pose_matrix((0, 0, 0.015)), prefix="b/"),
    ]
    (overlap,) = unwanted_overlaps(Hand.assemble(mounts))
    assert (overlap.link, overlap.other, overlap.kind) == ("a/tip", "b/tip", BodyKind.HAND)
    assert overlap.depth == pytest.approx(2 * RADIUS - 0.015, abs=1e-8)
    apart = Hand.assemble(mounts, q={"b/hinge": 0.2})
    assert unwanted_overlaps(apart) == ()


def chain(folder: Path, last: float, *, q: float = 0.0) -> Hand:
    """Three spheres of radius 0.05 m, 0.06 m apart on two hinges about z; the last one further."""
    ball = '<collision><geometry><sphere radius="0.05"/></geometry></collision>'

    def hinge(name: str, parent: str, child: str, x: float) -> str:
        return (
            f'<joint name="{name}" type="revolute"><parent link="{parent}"/><child link="{child}"/>'
            f'<origin xyz="{x} 0 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
        )

    text = (
        f'<link name="a">{ball}</link>{hinge("ab", "a", "b", 0.06)}<link name="b">{ball}</link>'
        f'{hinge("bc", "b", "c", 0.0)}<link name="c"><collision><origin xyz="{last} 0 0"/>'
        '<geometry><sphere radius="0.05"/></geometry></collision></link>'
    )
    file = folder / "chain.urdf"
    file.write_text(f'<robot name="chain">{text}</robot>')
    return Hand.from_urdf(file, q={"bc": q})


def test_links_that_fold_onto_each_other_are_reported_and_neighbours_are_not(tmp_path):
    # a and b, b and c overlap but are neighbours; a and c are 0.12 m apart at zero.
    assert unwanted_overlaps(chain(tmp_path, 0.06)) == ()
    (overlap,) = unwanted_overlaps(chain(tmp_path, 0.06, q=2.0))
    assert (overlap.link, overlap.other) == ("a", "c")
    apart = np.hypot(0.06 + 0.06 * np.cos(2.0), 0.06 * np.sin(2.0))
    assert overlap.depth == pytest.approx(0.1 - apart, abs=1e-8)
    # Where a and c are 0.09 m apart at zero they overlap by 0.01 m there already.
    assert unwanted_overlaps(chain(tmp_path, 0.03, q=2.0)) == ()


SRDF = '<robot name="chain"><disable_collisions link1="c" link2="a" reason="User"/></robot>'


@pytest.mark.parametrize("place", ["chain.srdf", "../srdf/chain.srdf"])
def test_pairs_that_an_srdf_disables_are_not_reported(tmp_path, place):
    folder = tmp_path / "urdf"
    folder.mkdir()
    assert len(unwanted_overlaps(chain(folder, 0.06, q=2.0))) == 1
    file = folder / place
    file.parent.mkdir(exist_ok=True)
    file.write_text(SRDF)
    assert unwanted_overlaps(chain(folder, 0.06, q=2.0)) == ()
    mounted = Hand.assemble([Mount(folder / "chain.urdf", prefix="one/")], q={"one/bc": 2.0})
    assert unwanted_overlaps(mounted) == ()
    file.write_text(SRDF.replace('"c"', '"b"'))
    assert len(unwanted_overlaps(chain(folder, 0.06, q=2.0))) == 1


def test_an_srdf_that_cannot_be_read_is_told(tmp_path):
    (tmp_path / "chain.srdf").write_text("<robot")
    with pytest.warns(GrasplessPinWarning, match=r"chain\.srdf.*not well-formed"):
        hand = chain(tmp_path, 0.06, q=2.0)
    assert len(unwanted_overlaps(hand)) == 1
    assert FindingCode.READER_REMARK in {one.code for one in hand.findings}


def boxes(folder: Path, *, q: float) -> Hand:
    """Two arms on one base, 0.2 m apart: a long box on each, the second turned by q about z."""

    def arm(name: str, y: float) -> str:
        return (
            f'<joint name="{name}" type="revolute"><parent link="base"/><child link="{name}_arm"/>'
            f'<origin xyz="0 {y} 0"/><axis xyz="0 0 1"/>'
            '<limit lower="-3" upper="3" effort="1" velocity="1"/></joint>'
            f'<link name="{name}_arm"><collision><origin xyz="0.2 0 0"/><geometry>'
            '<box size="0.4 0.02 0.02"/></geometry></collision></link>'
        )

    file = folder / "boxes.urdf"
    file.write_text(f'<robot name="boxes"><link name="base"/>{arm("a", 0)}{arm("b", 0.2)}</robot>')
    return Hand.from_urdf(file, q={"b": q})


@pytest.mark.sampled(8)
@pytest.mark.parametrize("turn", np.linspace(-0.75, -0.45, 31))
def test_boxes_are_compared_from_the_depth_on(tmp_path, turn):
    """Box b's end corners are at known places: coal and the boxes around shapes agree on them."""
    ends = [np.array([0.4 * np.cos(turn), 0.2 + 0.4 * np.sin(turn)])]
    across = 0.01 * np.array([-np.sin(turn), np.cos(turn)])
    lowest = min((end + sign * across)[1] for end in ends for sign in (-1.0, 1.0))
    deep = max(0.01 - lowest, 0.0)  # below the top of box a
    hand = boxes(tmp_path, q=turn)
    for tolerance in (0.0, 1e-3, 5e-3):
        found = unwanted_overlaps(hand, tolerance=tolerance)
        # Past the middle of box a the shortest way out is another one.
        if deep < 0.01:
            assert len(found) == (deep > tolerance), (turn, tolerance)
            assert not found or found[0].depth == pytest.approx(deep, abs=1e-8)


def test_an_open_allegro_hand_is_clear_and_its_thumb_may_run_into_the_palm():
    assert unwanted_overlaps(allegro()) == ()
    pairs = {
        (overlap.link, overlap.other)
        for overlap in unwanted_overlaps(allegro(joint_12=1.2, joint_14=1.644, joint_15=1.719))
    }
    assert pairs == {("palm_link", "link_15.0"), ("palm_link", "link_15.0_tip")}


@pytest.mark.parametrize("tolerance", [-1e-3, np.nan, "deep"])
def test_a_bad_tolerance_is_named(tolerance):
    with pytest.raises(ArgumentError, match=r"tolerance: is .*; it must be a finite number >= 0"):
        unwanted_overlaps(lever(), tolerance=tolerance)
