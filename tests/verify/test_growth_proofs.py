"""No small motion grows: Lyapunov's proofs in documents, and what they refuse."""

import copy
import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from tests.scene.scene_tools import EXAMPLES
from verified_documents import failed

from graspless_pin import Controller, load_scene
from graspless_pin.holding.small_motions import lyapunov_matrix
from graspless_pin.report import solution_document, write_document
from graspless_pin.report.verify import verify_document

BALL, BOX = EXAMPLES / "allegro_sphere_on_slope.yaml", EXAMPLES / "box_between_walls.yaml"
TUMBLER = """
name: A ball that is heavy below, on a floor
friction: 0.5
max_normal_force: 30
object:
  shape: {type: sphere, radius: 0.05}
  mass: 0.5
  center_of_mass: [0, 0, -0.02]
supports: [{name: floor, shape: {type: half_space}, pose: {position: [0, 0, -0.05]}}]
"""


def made(path: Path, stiffness: float | dict[str, float], tmp_path: Any) -> dict[str, Any]:
    scene = load_scene(path).with_changes(controller=Controller(stiffness))
    solution = scene.solve("margin")
    target = tmp_path / "document.json"
    write_document(solution_document(solution, scene, scene.stability(solution.torques)), target)
    return json.loads(target.read_text())


@pytest.fixture(scope="module")
def held_ball(tmp_path_factory) -> dict[str, Any]:
    return made(BALL, 2.0, tmp_path_factory.mktemp("ball"))


def test_a_rest_that_holds_is_proven(held_ball) -> None:
    assert failed(held_ball) == []
    names = [one.name for one in verify_document(held_ball).checks]
    assert "no small motion grows (facets)" in names
    proof = {
        key: np.array(value) for key, value in held_ball["holding"]["proofs"]["facets"].items()
    }
    N, driven = proof["velocities"], proof["velocities"][6 + proof["joints"]]
    inertia = np.zeros((len(N), len(N)))
    inertia[:6, :6], inertia[6:, 6:] = held_ball["object_inertia"], held_ball["joint_inertia"]
    inertia[6 + proof["joints"], 6 + proof["joints"]] += proof["rotors"]
    K = proof["geometric_stiffness"] + driven.T @ np.diag(proof["gains"]) @ driven
    D = driven.T @ np.diag(proof["damping"]) @ driven
    back = -np.linalg.solve(N.T @ inertia @ N, np.hstack([K, D]))
    system = np.vstack([np.eye(len(K), 2 * len(K), len(K)), back])
    assert np.linalg.eigvals(system).real.max() < 0.1
    loose = -np.linalg.solve(N.T @ inertia @ N, np.hstack([proof["geometric_stiffness"], D]))
    assert np.linalg.eigvals(np.vstack([system[: len(K)], loose])).real.max() > 10.0


def test_gains_that_differ_are_told_from_the_least_to_the_largest(held_ball, tmp_path) -> None:
    joint = held_ball["joints"][held_ball["holding"]["proofs"]["facets"]["joints"][0]]["name"]
    document = made(BALL, {"default": 2.0, joint: 3.0}, tmp_path)
    assert failed(document) == []
    lines = {one.name: one.detail for one in verify_document(document).checks}
    words = "joint feedback of 2 N m/rad at joints, 3 N m/rad at joints"
    assert lines["the controller is that of the proof (facets)"] == words


def test_a_rest_without_small_motions_is_proven(tmp_path) -> None:
    document = made(BOX, 0.0, tmp_path)
    assert document["holding"]["proofs"]["any"]["velocities"][0] == []
    assert failed(document) == []


def _columns(proof: dict[str, Any], kept: int) -> None:
    """Leave some of the motions out."""
    count = len(proof["geometric_stiffness"])
    both = np.r_[np.arange(kept), count + np.arange(kept)]
    for key, rows, columns in (
        ("velocities", slice(None), slice(kept)),
        ("geometric_stiffness", slice(kept), slice(kept)),
    ):
        proof[key] = np.array(proof[key])[rows, columns].tolist()
    proof["lyapunov"] = np.array(proof["lyapunov"])[np.ix_(both, both)].tolist()


def _scaled(key: str, factor: float):
    def change(proof: dict[str, Any]) -> None:
        proof[key] = (factor * np.array(proof[key])).tolist()

    return change


def _put(key: str, value: object):
    def change(proof: dict[str, Any]) -> None:
        proof[key] = value

    return change


def _turned(proof: dict[str, Any]) -> None:
    rows = np.array(proof["velocities"])
    rows[0] += 0.01 * np.abs(rows).max()
    proof["velocities"] = rows.tolist()


def _hidden_slip(proof: dict[str, Any], share: float) -> None:
    """Put a slip in the place of the last motion: tiny, or beside another motion."""
    rows = np.array(proof["velocities"])
    slip = np.zeros(len(rows))
    slip[0] = 1e-7 * np.abs(rows).max()
    rows[:, -1] = share * rows[:, 0] + slip
    proof["velocities"] = rows.tolist()


def _identity(proof: dict[str, Any]) -> None:
    proof["lyapunov"] = np.eye(len(proof["lyapunov"])).tolist()


def _fewer_joints(proof: dict[str, Any]) -> None:
    for key in ("joints", "gains", "damping", "rotors"):
        proof[key] = proof[key][1:]


def _scaled_proof(key: str, factor: float) -> Any:
    return lambda holding: _scaled(key, factor)(holding["proofs"]["facets"])


@pytest.mark.parametrize(
    "forge",
    [
        _scaled("gains", 0.0),
        _scaled("gains", -1.0),
        _scaled("damping", -1.0),
        _scaled("rotors", -1.0),
        _scaled("geometric_stiffness", 50.0),
        _scaled("lyapunov", -1.0),
        _scaled("lyapunov", 0.0),
        _identity,
        _put("rate", 50.0),
        _put("rate", -1.0),
        _scaled("velocities", 0.0),
        _turned,
        lambda proof: _columns(proof, len(proof["geometric_stiffness"]) - 1),
        lambda proof: _columns(proof, 0),
        _fewer_joints,
    ],
)
def test_what_is_no_proof_is_refused(held_ball, forge) -> None:
    forged = copy.deepcopy(held_ball)
    forge(forged["holding"]["proofs"]["facets"])
    *others, last = failed(forged)
    assert last == "no small motion grows (facets)"
    assert set(others) <= {"the controller is that of the proof (facets)"}


@pytest.mark.parametrize(
    "forge",
    [
        lambda holding: holding.update(controller="joint feedback of 0.01 N m/rad"),
        lambda holding: holding.update(controller="constant torques"),
        lambda holding: holding.update(stable_stiffness=[[5.0, None]]),
        lambda holding: holding.update(stable_stiffness=[[0.0, 1.0], [3.0, 4.0]]),
        _scaled_proof("gains", 1.5),
    ],
)
def test_the_gains_are_those_of_the_controller(held_ball, forge) -> None:
    forged = copy.deepcopy(held_ball)
    forge(forged["holding"])
    assert "the controller is that of the proof (facets)" in failed(forged)


def test_a_proof_without_joints_is_of_no_gain(tmp_path) -> None:
    file = tmp_path / "tumbler.yaml"
    file.write_text(TUMBLER)
    document = made(file, 0.0, tmp_path)
    holding = document["holding"]
    assert holding["status"] == "holds" and holding["proofs"]["facets"]["joints"] == []
    assert failed(document) == []
    holding["stable_stiffness"] = [[0.5, None]]
    assert failed(document) == ["the controller is that of the proof (facets)"]


@pytest.mark.parametrize("share", [0.0, 1.0])
def test_small_or_nearly_equal_columns_hide_no_slip(held_ball, share) -> None:
    forged = copy.deepcopy(held_ball)
    _hidden_slip(forged["holding"]["proofs"]["facets"], share)
    (check,) = (one for one in verify_document(forged).checks if one.passed is False)
    assert check.detail == "some of the motions slip or open a contact"


def test_without_a_proof_it_does_not_hold(held_ball) -> None:
    forged = copy.deepcopy(held_ball)
    forged["holding"]["proofs"] = {}
    assert failed(forged) == ["no small motion grows"]


def test_a_rest_that_grows_cannot_be_said_to_hold(tmp_path) -> None:
    document = made(BALL, 0.1, tmp_path)
    assert failed(document) == [] and document["holding"]["proofs"] == {}
    document["holding"] |= {"status": "holds", "growth_rate": 0.0}
    assert failed(document) == ["no small motion grows"]


@pytest.mark.parametrize("growth", [0.05, 0.2])
def test_lyapunovs_matrix_is_there_where_nothing_grows_as_fast(growth) -> None:
    """An inverted pendulum and a neutral motion: y'' = growth^2 y, and y'' = 0."""
    stiffness, free = np.diag([-(growth**2), 0.0]), np.zeros((2, 2))
    found = lyapunov_matrix(np.eye(2), stiffness, free, 0.1)
    assert (found is None) == (growth > 0.1)
