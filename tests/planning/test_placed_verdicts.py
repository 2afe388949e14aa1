"""What is said of a place is what `solve` says of the file that is written of it."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from planning_scenes import EXAMPLES

from graspless_pin import load_scene, place_hand
from graspless_pin.planning import HandPlacement

NODES = 30


@pytest.fixture(
    scope="module",
    params=[("trihand_push_box", "margin"), ("panda_slide_cuboid_up_slope", "torque")],
)
def found(request: pytest.FixtureRequest) -> HandPlacement:
    name, algorithm = request.param
    scene = load_scene(EXAMPLES / f"{name}.yaml").with_changes(motion=None)
    options = {**scene.solve_options, "algorithm": algorithm, "margin": 0.1}
    scene = scene.with_changes(solve_options=options)
    options = {"aim": "press", "verdict_nodes": NODES, "verdicts": None, "seed": 3}
    return place_hand(scene, candidates=8, workers=1, **options)


def test_a_place_and_its_file_have_the_same_problem_and_verdict(
    found: HandPlacement, tmp_path: Path
) -> None:
    """Verdicts at a limit that ends them in the midst of the search, on the scene's own torques."""
    assert len(found.places) > 1
    for place in found.places:
        again = load_scene(place.scene.save(tmp_path / "placed.yaml", overwrite=True))
        mine, theirs = place.scene.problem(), again.problem()
        for name in ("positions", "normals", "jacobian", "external_wrench", "gravity_torques"):
            np.testing.assert_array_equal(getattr(mine, name), getattr(theirs, name))
        said = again.stability(again.solve().torques, node_limit=NODES)
        assert place.verdict is not None
        assert (place.verdict.nodes, place.verdict.status) == (said.nodes, said.status)
        np.testing.assert_array_equal(place.verdict.torques, said.torques)
