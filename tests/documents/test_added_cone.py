"""CONTRIBUTING's walk-through "Add a friction model", done to a copy of the package."""

import json
import runpy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from package_copy import command, followed, run, shown, walkthrough
from page_blocks import ROOT
from tests.core.test_cone_models import Elliptic

from graspless_pin.problem.cones import CONE_MODELS

PROBLEM = Path("src") / "graspless_pin" / "problem"
SHOWN = """
import json, sys
import numpy as np
from graspless_pin import load_scene, maximize_margin, minimize_torque
from graspless_pin.report import read_solution, solution_document
from graspless_pin.report.verify import verify_document

scene = load_scene(sys.argv[1])
saved = scene.save(sys.argv[1].replace(".yaml", "_saved.yaml"), overwrite=True)
again = load_scene(saved)
problem = scene.problem()
found = {"repr": repr(problem), "same": again.cone == scene.cone, "solved": {}}
for name, solution in {
    "coulomb": maximize_margin(problem, static_friction="coulomb"),
    "torque": minimize_torque(problem, 0.0, static_friction="coulomb"),
    "margin": maximize_margin(problem),
}.items():
    document = solution_document(solution, scene)
    found["solved"][name] = {
        "found": solution.found,
        "value": solution.value if solution.found else None,
        "proven": verify_document(document).proven,
        "again": read_solution(document).value if solution.found else None,
    }
print(json.dumps(found))
"""
MANY = """
import json
import numpy as np
from graspless_pin import Evaluator, load_scene, run_study
from graspless_pin.errors import ArgumentError
from graspless_pin.planning import configuration_gradient
from graspless_pin.studies import Study

scene = load_scene("examples/allegro_push_up_slope.yaml")
scene = scene.with_changes(cone="ribbed", cone_edges=12, tangent_axes=[(1.0, 0.6, 0.3)])
evaluator = Evaluator(scene)
start = np.array([scene.hand.q[name] for name in evaluator.joint_names])
q = start + 1e-3 * np.random.default_rng(1).normal(size=(6, len(start)))
many = evaluator.evaluate_many(q, workers=1)
alone = [evaluator.evaluate(one) for one in q]
table = run_study(Study.from_data({
    "scene": "examples/paper/cuboid_at_rest.yaml",
    "vary": {
        "cone": {"values": ["edges", "ribbed", "round"]},
        "friction.default": {"from": 0.3, "to": 0.6, "steps": 2},
    },
}), "study.csv", workers=1, progress=False)
paper = load_scene("examples/paper/cuboid_at_rest.yaml")
try:
    configuration_gradient(alone[0])
except ArgumentError as error:
    refused = str(error)
print(json.dumps({
    "refused": refused,
    "many": many.margins.tolist(),
    "alone": [one.scene.solve("margin").margin for one in alone],
    "study": table["margin_N"].tolist(),
    "solved": [
        paper.with_changes(cone=cone, friction={"default": mu}).solve("margin").margin
        for cone, mu in zip(table["cone"], table["friction.default"], strict=True)
    ],
}))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the repository in which the walk-through was followed."""
    folder = tmp_path_factory.mktemp("package")
    beside = "_NEARLY_PARALLEL ="
    return followed(folder, "Ribbed", PROBLEM / "ribbed.py", PROBLEM / "cones.py", beside)


def scene_of(folder: Path, example: str, **changes: Any) -> Path:
    """One of the paper's scenes with ribbed contacts and other changes; None: no such key."""
    scene = yaml.safe_load((ROOT / "examples" / "paper" / example).read_text()) | changes
    scene = {"cone": "ribbed", **{key: one for key, one in scene.items() if one is not None}}
    file = folder / example
    file.write_text(yaml.safe_dump(scene))
    return file


def test_it_is_the_model_that_is_held_against_programs(tmp_path):
    """`test_cone_models` solves for its like, of another text."""
    module = tmp_path / "ribbed.py"
    module.write_text(walkthrough("Ribbed")[0], encoding="utf-8")
    names = runpy.run_path(str(module))
    ribbed, directions = names["Ribbed"](), np.random.default_rng(0).normal(size=(9, 2))
    np.testing.assert_allclose(ribbed.corners(16), Elliptic().corners(16), atol=1e-15)
    expected = Elliptic().kinetic_friction(directions)
    np.testing.assert_allclose(ribbed.kinetic_friction(directions), expected, atol=1e-15)


@pytest.mark.sampled(2)
@pytest.mark.parametrize(
    ("example", "axis"),
    [
        ("cuboid_at_rest.yaml", [1.0, 0.0, 0.0]),
        ("cuboid_at_rest.yaml", [0.0, 1.0, 0.0]),
        ("cuboid_sliding_up.yaml", [1.0, 1.0, 0.0]),
        ("sphere_on_slope.yaml", [0.0, 1.0, 0.0]),
    ],
)
def test_the_new_model_is_solved_and_its_documents_are_proven(package, tmp_path, example, axis):
    found = shown(package, SHOWN, scene_of(tmp_path, example, cone_edges=16, tangent_axes=[axis]))
    assert found["repr"].endswith("joints, ribbed cones of 16 edges)")
    assert found["same"]
    for solved in found["solved"].values():
        assert solved["proven"]
        assert solved["again"] == pytest.approx(solved["value"], rel=1e-9)


def test_the_commands_know_it(package, tmp_path):
    """Solve, verify and report a scene with it; the verdict is undecided and says why."""
    file = scene_of(tmp_path, "sphere_on_slope.yaml")
    document, page = tmp_path / "solution.json", tmp_path / "page.html"
    solved = command(package, "solve", str(file), "--json", str(document))
    assert solved.returncode == 0, solved.stderr
    assert "requires Coulomb's law, and the cone is 'ribbed'" in solved.stdout
    stated = json.loads(document.read_text())
    assert stated["cone"] == "ribbed"
    assert np.shape(stated["contacts"][0]["cone_corners"]) == (stated["cone_edges"], 2)
    verified = command(package, "verify", str(document))
    assert verified.returncode == 0, verified.stdout + verified.stderr
    assert "cones 'ribbed'" in verified.stdout
    for options in ([str(file), "--ranges"], [str(document), "--no-ranges"]):
        reported = command(package, "report", *options, "-o", str(page))
        assert reported.returncode == 0, reported.stderr
        assert "ribbed cones of" in page.read_text()
        assert "round cones" not in page.read_text()


def test_a_checker_that_does_not_know_the_name_checks_the_document(package, tmp_path):
    """That of the repository, which was not changed; reading the solution needs the model."""
    from graspless_pin.errors import ArgumentError
    from graspless_pin.report import read_document, read_solution
    from graspless_pin.report.verify import verify_document

    file, target = scene_of(tmp_path, "cuboid_at_rest.yaml"), tmp_path / "solution.json"
    command(package, "solve", str(file), "--no-verdict", "--json", str(target))
    document = read_document(target)
    assert verify_document(document).proven
    with pytest.raises(
        ArgumentError, match="cone: is 'ribbed'; it must be one of 'edges', 'round'"
    ):
        read_solution(document)


def test_the_schema_and_messages_know_it(package, tmp_path):
    schema = json.loads(command(package, "schema").stdout)["properties"]["cone"]
    assert schema["enum"] == ["ribbed", *CONE_MODELS]
    assert "ribbed: pyramids of cone_edges edges with half of the friction" in schema["description"]
    file = scene_of(tmp_path, "cuboid_at_rest.yaml", cone="ribed")
    file.write_text(file.read_text().replace("cone: ribbed", "cone: ribed"))
    result = command(package, "solve", str(file))
    assert "did you mean 'ribbed'?" in result.stderr
    file = scene_of(tmp_path, "cuboid_at_rest.yaml")
    direction = command(package, "solve", str(file), "--sign-rule", "direction")
    assert "is 'direction', which requires Coulomb's law" in direction.stderr
    robust = command(package, "robustness", str(file))
    assert robust.returncode == 3
    assert "requires Coulomb's law" in robust.stdout
    simulated = command(package, "simulate", str(file))
    assert "cone: is 'ribbed', but the simulation requires Coulomb's law" in simulated.stderr


def test_the_evaluator_and_studies_solve_it_as_it_is(package):
    """The compiled loops of both know the paper's pyramids and Coulomb's law alone."""
    result = run(package, MANY)
    assert result.returncode == 0, result.stderr
    found = json.loads(result.stdout)
    assert found["many"] == pytest.approx(found["alone"], rel=1e-6, nan_ok=True)
    assert found["study"] == pytest.approx(found["solved"], rel=1e-6, nan_ok=True)
    assert np.isfinite(found["many"]).sum() >= 3
    pyramids, ribbed, _ = np.reshape(found["study"], (3, 2))
    assert (ribbed < pyramids).all()
    assert "has sliding contacts with the cone 'ribbed'" in found["refused"]
