"""Smallest normal forces that nodes of a proof of rest prove for what is below them."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from verified_documents import failed

from graspless_pin import load_scene
from graspless_pin.report import solution_document, write_document
from graspless_pin.report.verify import verify_document

GRIPS = Path(__file__).parents[1] / "simulation" / "grips"


@pytest.fixture(scope="module")
def gripped(tmp_path_factory) -> dict[str, Any]:
    """A grip whose proof leans on forces that its nodes prove: of which one, trees decide."""
    path = tmp_path_factory.mktemp("gripped") / "document.json"
    for name in ("talos_gripper_ball_0", "tiago_pro_gripper_ball_0", "talos_gripper_box_0"):
        scene = load_scene(GRIPS / f"{name}.yaml")
        solution = scene.solve("margin")
        verdict = scene.stability(solution.torques, node_limit=100)
        write_document(solution_document(solution, scene, verdict), path)
        document = json.loads(path.read_text())
        if failed(without_loads(document)):
            return document
    pytest.fail("no proof leans on the loads of its nodes")


def without_loads(document: dict[str, Any]) -> dict[str, Any]:
    without = copy.deepcopy(document)
    for node in nodes_of(without):
        node["loads"] = []
    return without


def nodes_of(document: dict[str, Any]) -> list[dict[str, Any]]:
    return document["stability"]["proof"]["nodes"]


def test_what_nodes_prove_counts_below_them(gripped) -> None:
    assert any(node["loads"] for node in nodes_of(gripped))
    assert failed(gripped) == []
    assert failed(without_loads(gripped)) == ["rest is the only outcome"]


@pytest.mark.parametrize("factor", [10.0, 1e6])
def test_a_larger_force_than_is_proven_counts_no_more(gripped, factor) -> None:
    forged = copy.deepcopy(gripped)
    for node in nodes_of(forged):
        for load in node["loads"]:
            load["force"] *= factor
    assert failed(forged) == []  # by what the multipliers prove
    for node in nodes_of(forged):
        for load in node["loads"]:
            for part in ("motion", "normal", "tangential"):
                load["multipliers"][part] = np.zeros_like(load["multipliers"][part]).tolist()
    assert failed(forged) == ["rest is the only outcome"]


def test_loads_of_a_node_that_are_none_are_named(gripped) -> None:
    forged = copy.deepcopy(gripped)
    node = next(node for node in nodes_of(forged) if node["loads"])
    node["loads"][0]["contact"] = 17
    with pytest.raises(ValueError, match="a load of node"):
        verify_document(forged)
