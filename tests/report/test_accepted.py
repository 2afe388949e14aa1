"""What is told as proven is what the checker accepts of the document."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from tests.cli.cli_tools import PAPER, run

from graspless_pin import Scene, Stability, StabilityVerdict, Status, TorqueSolution, load_scene
from graspless_pin.holding.verdict import DualBound, OutcomeSet
from graspless_pin.report import solution_document
from graspless_pin.report.document import with_proven_claims
from graspless_pin.report.verify import verify_document
from graspless_pin.solution.certificate import ModeProof, SolutionProof

CUBOID = PAPER / "cuboid_at_rest.yaml"


@pytest.fixture(scope="module")
def scene() -> Scene:
    return load_scene(CUBOID)


@pytest.fixture(scope="module")
def best(scene: Scene) -> TorqueSolution:
    return scene.solve()


@pytest.fixture(scope="module")
def strong(scene: Scene, best: TorqueSolution) -> StabilityVerdict:
    return scene.stability(best.torques)


def unproven(solution: TorqueSolution) -> TorqueSolution:
    """The same solution where its proof does not close."""
    other = replace(solution)
    proof = SolutionProof(ModeProof((), "the relaxation does not prove the bound"), other.motion)
    vars(other)["proof"] = proof
    return other


def doubled(one: OutcomeSet) -> OutcomeSet:
    """A proof with other multipliers."""
    dual = one.dual and DualBound(2.0 * one.dual.motion, one.dual.normal, one.dual.tangential)
    return replace(one, dual=dual, children=tuple(map(doubled, one.children)))


def test_what_is_proven_stays(scene, best, strong):
    assert strong.status is Stability.STRONG
    assert with_proven_claims(best, scene, strong) == (best, strong)
    assert with_proven_claims(best, scene) == (best, None)


def test_an_optimum_whose_proof_does_not_close_is_the_best_found(scene, best, strong):
    told, verdict = with_proven_claims(unproven(best), scene, strong)
    assert told.status is Status.LIMIT_REACHED
    assert verdict is strong
    assert told.margin == best.margin
    assert "optimal" not in told.text()
    assert verify_document(solution_document(told, scene, verdict)).passed


def test_a_verdict_whose_proof_does_not_hold_is_undecided(scene, best):
    torque = scene.solve("torque", margin=0.3)
    verdict = scene.stability(torque.torques)
    assert verdict.status is Stability.STRONG
    assert verdict.proof is not None
    if verdict.proof.tree is None:
        proof = replace(verdict.proof, forces=0.5 * verdict.proof.forces)
    else:
        proof = replace(verdict.proof, tree=doubled(verdict.proof.tree))
    told, less = with_proven_claims(torque, scene, replace(verdict, proof=proof))
    assert told is torque
    assert less is not None
    assert less.status is Stability.UNDECIDED
    assert "its proof fails verification (rest is the only outcome" in less.message
    assert verify_document(solution_document(told, scene, less)).proven


def test_an_answer_that_fails_its_check_is_none(scene, best, strong):
    forged: Any = replace(best, _forces=1.1 * best.contact_forces)
    told, _ = with_proven_claims(forged, scene, strong)
    assert told.status is Status.UNVERIFIED
    assert "balance of forces" in told.explanation


def test_an_infeasibility_that_is_not_proven_is_not_said(scene):
    none = scene.solve("torque", margin=30.0)
    assert none.status is Status.INFEASIBLE_FORCES
    assert with_proven_claims(none, scene) == (none, None)
    assert with_proven_claims(unproven(none), scene)[0].status is Status.UNVERIFIED


def test_the_command_line_says_so(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    solve = Scene.solve
    monkeypatch.setattr(Scene, "solve", lambda *args, **options: unproven(solve(*args, **options)))
    file = tmp_path / "solution.json"
    said = run("solve", CUBOID, "--json", file)
    assert said.exit_code == 0
    assert "a better answer is not ruled out" in said.stdout
    assert "optimal over all" not in said.stdout
    assert "not-proven-optimal" in said.stderr
    assert '"status": "limit_reached"' in file.read_text()
