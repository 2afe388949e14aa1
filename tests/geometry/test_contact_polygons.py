"""Plane convex polygons: hulls and intersections against known areas, reduction."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from graspless_pin.geometry.contact.polygons import (
    Polygon,
    first_corner,
    intersection,
    planar_hull,
    plane_fit,
    reduce_polygon,
)

SQUARE: Polygon = [(0.0, 0.0), (1.0, 0.0), (1.0, 1.0), (0.0, 1.0)]


def area(polygon: Polygon) -> float:
    following = polygon[1:] + polygon[:1]
    return 0.5 * sum(a[0] * b[1] - a[1] * b[0] for a, b in zip(polygon, following, strict=True))


def regular(count: int, radius: float = 1.0) -> Polygon:
    turns = [2.0 * math.pi * k / count for k in range(count)]
    return [(radius * math.cos(t), radius * math.sin(t)) for t in turns]


def test_the_hull_of_a_grid_is_its_corners_counterclockwise() -> None:
    grid = [(x / 4, y / 4) for x in range(5) for y in range(5)]
    hull = planar_hull(grid)
    assert set(hull) == set(SQUARE)
    assert area(hull) == pytest.approx(1.0)


@pytest.mark.parametrize("noise", [0.0, 1e-12])
def test_points_without_area_give_a_segment_or_a_point(noise: float) -> None:
    line = [(0.1 * k, 0.2 * k + noise * (-1) ** k) for k in range(5)]
    assert planar_hull(line) == [line[0], line[-1]]
    upright = [(noise * (-1) ** k, 0.1 * k) for k in range(5)]
    assert sorted(round(v, 9) for _, v in planar_hull(upright)) == [0.0, 0.4]
    assert len(planar_hull([(noise, 0.0), (0.0, noise), (0.0, 0.0)])) == 1


def test_a_segment_is_cut_at_the_polygon() -> None:
    for pair in ((SQUARE, [(-1.0, 0.5), (2.0, 0.5)]), ([(-1.0, 0.5), (2.0, 0.5)], SQUARE)):
        assert np.allclose(sorted(intersection(*pair)), [(0.0, 0.5), (1.0, 0.5)])


def test_crossing_segments_meet_in_a_point_and_parallel_ones_in_their_overlap() -> None:
    level = [(0.0, 0.0), (1.0, 0.0)]
    for other, common in (
        ([(0.3, -1.0), (0.3, 1.0)], [(0.3, 0.0)]),
        ([(1.5, 0.0), (0.4, 0.0)], [(0.4, 0.0), (1.0, 0.0)]),
        ([(1.0, 0.0), (2.0, 0.0)], [(1.0, 0.0)]),
    ):
        assert np.allclose(intersection(level, other), common)


coordinates = st.floats(-1.0, 1.0)
clouds = st.lists(st.tuples(coordinates, coordinates), min_size=3, max_size=12)


@settings(max_examples=40)
@given(clouds, clouds, st.lists(st.tuples(coordinates, coordinates), min_size=1, max_size=20))
def test_a_point_is_in_the_intersection_if_and_only_if_it_is_in_both(
    first: Polygon, second: Polygon, probes: Polygon
) -> None:
    one, two = planar_hull(first), planar_hull(second)
    if min(len(one), len(two)) < 3:
        return
    both = intersection(one, two)

    def depth(polygon: Polygon, point: tuple[float, float]) -> float:
        if len(polygon) < 3:
            return -1.0
        a = np.array(polygon)
        d = np.roll(a, -1, axis=0) - a
        p = np.array(point) - a
        return float(np.min((d[:, 0] * p[:, 1] - d[:, 1] * p[:, 0]) / np.hypot(*d.T)))

    for probe in probes:
        inside = min(depth(one, probe), depth(two, probe))
        if inside > 1e-5:
            assert depth(both, probe) > -1e-5
        elif inside < -1e-5:
            assert depth(both, probe) < 1e-5


def reduced(polygon: Polygon, merge_distance: float, max_points: int) -> Polygon:
    """The points that a reduction leaves: the means of its groups."""
    groups = reduce_polygon(polygon, merge_distance, max_points)
    means = [np.mean([polygon[k] for k in group], axis=0).tolist() for group in groups]
    return [(u, v) for u, v in means]


def test_rounding_does_not_decide_what_a_reduction_keeps() -> None:
    rng = np.random.default_rng(0)
    exact = reduced(regular(64), 1e-3, 8)
    assert len(exact) == 8
    assert area(exact) == pytest.approx(area(regular(8)))
    for _ in range(20):
        noisy = [(u + 1e-12 * rng.normal(), v + 1e-12 * rng.normal()) for u, v in regular(64)]
        assert np.allclose(reduced(noisy, 1e-3, 8), exact, atol=1e-10)


def test_close_corners_become_their_mean_and_the_others_stay_exact() -> None:
    chamfered = [(0.0, 0.0), (1.0, 0.0), (1.0, 0.9996), (0.9996, 1.0), (0.0, 1.0)]
    assert reduced(chamfered, 1e-3, 8) == [
        (0.0, 0.0),
        (1.0, 0.0),
        pytest.approx((0.9998, 0.9998)),
        (0.0, 1.0),
    ]


def test_a_tiny_patch_becomes_its_middle() -> None:
    assert reduced(regular(16, 1e-4), 1e-3, 8) == [pytest.approx((0.0, 0.0), abs=1e-5)]


def test_a_thin_strip_becomes_a_segment() -> None:
    strip = [(0.0, 0.0), (1.0, 0.0), (1.0, 5e-4), (0.0, 5e-4)]
    assert np.allclose(sorted(reduced(strip, 1e-3, 8)), [(0, 2.5e-4), (1, 2.5e-4)])


def test_the_first_corner_ignores_differences_below_the_resolution() -> None:
    assert first_corner([[1e-8, 1.0], [0.0, 2.0], [-1e-8, 0.5]]) == 2
    assert first_corner([[0.0, 1.0], [-1.0, 2.0]]) == 1


def test_the_plane_through_points_is_found_and_a_strip_stays_level_across() -> None:
    rng = np.random.default_rng(2)
    flat = rng.uniform(-0.1, 0.1, (6, 2))
    height = plane_fit([(u, v, 0.3 + 0.004 * u - 0.002 * v) for u, v in flat.tolist()])
    assert height((0.05, -0.02)) == pytest.approx(0.3 + 0.004 * 0.05 + 0.002 * 0.02, abs=1e-12)
    strip = [(0.0, 0.0, 0.0), (0.1, 1e-7, 1e-3), (0.1, -1e-7, -1e-3), (0.2, 0.0, 0.0)]
    assert plane_fit(strip)((0.1, 0.1)) == pytest.approx(0.0, abs=1e-12)
    assert plane_fit([(0.1, 0.2, 0.3)])((5.0, 5.0)) == 0.3
