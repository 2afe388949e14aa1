"""A slice of `make scales`: no answer at any scale is wrong, and next to none is missing."""

from tests.oracles.scales import judged, passes

SLICE = range(30, 60)


def test_scenes_of_every_scale_agree_with_the_exact_optimum():
    lines = [judged(seed) for seed in SLICE]
    assert passes(lines), [line for line in lines if line.outcome != "agree"]
    assert sum(line.found for line in lines) >= 17
