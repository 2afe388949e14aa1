"""All compiled loops at once: with and without them, every example scene has the same answers."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspless_pin import Stability, TorqueSolution, compiled, load_scene
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document

EXAMPLES = Path(__file__).parents[2] / "examples"
SCENES = sorted(
    path
    for path in [*EXAMPLES.glob("*.yaml"), *EXAMPLES.glob("paper/*.yaml")]
    if "\nobject:" in path.read_text(encoding="utf-8")
)
NODES = 20
"""Sets of outcomes that a verdict looks at: enough for most examples."""


def answers(path: Path) -> dict[str, Any]:
    """The way from a file to both algorithms' optima, their proofs and the verdict on one."""
    scene = load_scene(path)
    largest = scene.solve("margin")
    found: dict[str, Any] = {"problem": scene.problem(), "margin": largest}
    if largest.found:
        found["torque"] = scene.solve("torque", margin=0.5 * largest.margin)
        found["verdict"] = scene.stability(largest.torques, node_limit=NODES).status
    return found


@pytest.mark.sampled(6)
@pytest.mark.skipif(
    compiled.core is None, reason="the loops are not compiled: there is no C compiler"
)
@pytest.mark.parametrize("path", SCENES, ids=lambda path: path.stem)
def test_every_example_has_the_same_answers(path: Path, by_numpy) -> None:
    ours, theirs = answers(path), by_numpy(lambda: answers(path))
    assert ours.keys() == theirs.keys()
    J = ours["problem"].jacobian
    np.testing.assert_allclose(theirs["problem"].jacobian, J, rtol=0, atol=1e-12)
    load = np.abs(ours["problem"].external_wrench).max()
    for name in ("margin", "torque"):
        one, other = ours[name], theirs[name]
        assert isinstance(one, TorqueSolution)
        assert one.status is other.status
        for solution in (one, other):
            assert verify_document(solution_document(solution)).passed
        if one.found:
            assert other.margin == pytest.approx(one.margin, abs=1e-6 * load)
        if name == "torque":
            assert other.max_torque == pytest.approx(one.max_torque, rel=1e-6, abs=1e-9)
    decided = {ours["verdict"], theirs["verdict"]} - {Stability.UNDECIDED}
    assert len(decided) <= 1
