"""CONTRIBUTING's walk-through "Add an objective by name", done to a copy of the package."""

import json
import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from package_copy import command, copied, inserted, run, walkthrough
from page_blocks import ROOT
from scipy.optimize import linprog
from tests.core.edge_form import Mode, constraints_in_mode, letters_of

from graspless_pin import QuasistaticProblem, enumerate_modes, load_scene
from graspless_pin.report import read_solution
from graspless_pin.report.verify import verify_document

PACKAGE = Path("src") / "graspless_pin"
EXAMPLES = ROOT / "examples"
HAND = "allegro_box_on_slope"
PAIR = "sphere_on_slope"
PLACES = {HAND: EXAMPLES / f"{HAND}.yaml", PAIR: EXAMPLES / "paper" / f"{PAIR}.yaml"}
MARGIN, EVENNESS = 0.2, 0.5
USED = """
import json, sys
import numpy as np
from graspless_pin import Evaluator, compare_rules, load_scene
from graspless_pin.viewer import answer_settings, initial_settings
from graspless_pin.viewer.panels import result_html

named, plain = map(load_scene, sys.argv[1:])
evaluators = (
    Evaluator(named),
    Evaluator(plain, algorithm="total_torque", margin=0.2, evenness=0.5),
)
q = evaluators[0].configuration() + np.array([0.0, 1e-4, 2e-4])[:, None]
states = [one.evaluate_many(q, evaluations=[0, 1, 2]) for one in evaluators]
rules = compare_rules(named.problem(), "total_torque", margin=0.2).solutions
try:
    evaluators[0].with_regularization(0.1)
    refused = ""
except ValueError as error:
    refused = str(error)
answer = answer_settings(named, initial_settings(named))
print(json.dumps({
    "scene": named.solve().value,
    "plain": plain.solve("total_torque", margin=0.2, evenness=0.5).value,
    "one": [one.evaluate().solution.value for one in evaluators],
    "many": [[one.solution.value for one in found.evaluations.values()] for found in states],
    "bounds": [found.bounds.tolist() for found in states],
    "rules": {str(one.sign): found.value for one, found in rules.items() if found.found},
    "refused": refused,
    "page": answer.solution.value,
    "html": result_html(answer, None, dark=False),
}))
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory) -> Path:
    """A copy of the repository in which the walk-through was followed."""
    folder = copied(tmp_path_factory.mktemp("package"))
    module, listed = walkthrough("TotalTorque")[:2]
    (folder / PACKAGE / "programs" / "total_torque.py").write_text(module, encoding="utf-8")
    imported, line = listed.splitlines()
    names = folder / PACKAGE / "algorithms" / "options.py"
    inserted(names, line, '}\n"""All objectives')
    inserted(names, imported, "\n\nclass NamedObjective")
    return folder


@pytest.fixture(scope="module")
def scenes(tmp_path_factory) -> dict[str, Path]:
    """Both scenes with the objective as what they ask for."""
    folder, found = tmp_path_factory.mktemp("scenes"), {}
    for name, place in PLACES.items():
        content = yaml.safe_load(place.read_text())
        content["solve"] = {
            "algorithm": "total_torque", "margin": MARGIN, "evenness": EVENNESS,
        }  # fmt: skip
        found[name] = folder / f"{name}.yaml"
        found[name].write_text(yaml.safe_dump(content))
    return found


def least(problem: QuasistaticProblem, evenness: float, mode: Mode | None) -> float:
    """The optimum by scipy, in edge weights; None: plain Coulomb friction, which bounds all modes.

    To the columns of `constraints_in_mode`, the last of which is the largest |torque|, come the
    sizes of all torques.
    """
    below, b_ub, equal, b_eq, bounds = constraints_in_mode(problem, mode, MARGIN)
    size, joints = len(bounds), problem.joint_count
    torques = np.eye(size)[-1 - joints : -1]
    sizes = [np.hstack([sign * torques, -np.eye(joints)]) for sign in (1.0, -1.0)]
    rows = [np.hstack([one, np.zeros((len(one), joints))]) for one in (below, equal)]
    found = linprog(
        np.concatenate([np.zeros(size - 1), [evenness], np.ones(joints)]),
        np.vstack([rows[0], *sizes]), np.append(b_ub, np.zeros(2 * joints)),
        rows[1], b_eq, [*bounds, *[(0.0, None)] * joints],
    )  # fmt: skip
    return float(found.fun) if found.status == 0 else np.inf


@pytest.fixture(scope="module")
def expected() -> dict[str, float]:
    """Of the pair the least of all modes; of the hand what no mode is below, and one reaches."""
    hand, pair = (load_scene(PLACES[name]).problem() for name in (HAND, PAIR))
    modes = enumerate_modes(pair, maximal=True)
    return {
        HAND: least(hand, EVENNESS, None),
        PAIR: min(least(pair, EVENNESS, letters_of(mode)) for mode in modes),
    }


@pytest.fixture(scope="module")
def documents(package, scenes, expected, tmp_path_factory) -> dict[str, dict]:
    """What ``solve`` writes of both scenes."""
    folder, found = tmp_path_factory.mktemp("documents"), {}
    for name, scene in scenes.items():
        file = folder / f"{name}.json"
        shown = command(package, "solve", str(scene), "--no-verdict", "--json", str(file))
        assert shown.returncode == 0, shown.stderr
        assert f"total_torque at margin {MARGIN:g} N: optimal" in shown.stdout
        assert f", value = {expected[name]:g}\n" in shown.stdout
        found[name] = json.loads(file.read_text())
    return found


@pytest.mark.parametrize("name", PLACES)
def test_a_scene_that_names_it_has_the_optimum_of_scipy(documents, expected, name):
    document = documents[name]
    assert document["objective"]["name"] == "total_torque"
    assert document["objective"]["value"] == pytest.approx(expected[name], rel=1e-7)
    sizes = [abs(joint["torque"]) for joint in document["joints"]]
    assert sum(sizes) + EVENNESS * max(sizes) == pytest.approx(expected[name], rel=1e-6)


@pytest.mark.parametrize("name", PLACES)
def test_its_document_is_proven_by_the_checker_of_a_package_without_it(documents, name):
    """A document says what its objective is: no name is believed."""
    document = documents[name]
    assert document["algorithm"] is None
    assert verify_document(document).passed
    read = read_solution(document)
    assert read.objective.name == "total_torque"
    forged = json.loads(json.dumps(document))
    forged["algorithm"] = "total_torque"
    with pytest.raises(ValueError, match="algorithm is 'total_torque'; it must be one of margin"):
        verify_document(forged)


def test_the_command_line_asks_for_it(package, expected, tmp_path):
    file = tmp_path / "solution.json"
    asked = ("--algorithm", "total_torque", "--margin", f"{MARGIN}", "--evenness", f"{EVENNESS}")
    scene = str(PLACES[PAIR])
    shown = command(package, "solve", scene, "--no-verdict", *asked, "--json", str(file))
    assert shown.returncode == 0, shown.stderr
    document = json.loads(file.read_text())
    assert document["objective"]["value"] == pytest.approx(expected[PAIR], rel=1e-7)
    for name in ("solve", "simulate", "robustness"):
        text = " ".join(command(package, name, "--help").stdout.replace("│", "").split())
        assert "<margin|torque|total_torque>" in text
        assert "total_torque: least sum of all torques" in text
        assert "--evenness" in text


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (("--algorithm", "total_torque", "--evenness", "-1"), "error: --evenness: is -1"),
        (("--algorithm", "total_torque", "--scale", "limits"),
         "scale: has no effect with algorithm 'total_torque'"),
        (("--margin", "0.1"), "use algorithm 'torque' or 'total_torque', or leave it out"),
        (("--algorithm", "total"), "'total' is not one of 'margin', 'torque', 'total_torque'"),
    ],
)  # fmt: skip
def test_what_does_not_do_is_told(package, words, message):
    shown = command(package, "solve", str(PLACES[PAIR]), *words)
    assert shown.returncode == 2
    assert message in " ".join(shown.stderr.replace("│", "").split())


def test_a_wrong_figure_in_a_scene_is_told_with_its_line(package, scenes, tmp_path):
    file = tmp_path / "wrong.yaml"
    text = scenes[PAIR].read_text().replace(f"evenness: {EVENNESS}", "evenness: -2")
    file.write_text(text)
    line = text[: text.index("evenness")].count("\n") + 1
    shown = command(package, "solve", str(file))
    assert shown.returncode == 2
    assert f"{file}:{line}: solve.evenness: found -2" in shown.stderr


def test_the_schemas_have_its_name_and_figure(package):
    for words, entry in ((("schema",), "SolveEntry"), (("schema", "--study"), "ComputeEntry")):
        schema = json.loads(command(package, *words).stdout)["$defs"][entry]["properties"]
        assert "total_torque" in json.dumps(schema["algorithm"])
        assert "beside the sum" in json.dumps(schema["evenness"])
        assert '"minimum": 0.0' in json.dumps(schema["evenness"])


def test_evaluators_and_the_page_solve_for_it(package, scenes, expected):
    shown = run(package, USED, str(scenes[PAIR]), str(PLACES[PAIR]))
    assert shown.returncode == 0, shown.stderr
    found = json.loads(shown.stdout)
    for value in (found["scene"], found["plain"], *found["one"], found["page"]):
        assert value == pytest.approx(expected[PAIR], rel=1e-7)
    assert found["refused"] == "regularization: has no effect with 'total_torque'"
    assert set(found["rules"]) == {"strict", "exact", "nonzero"}
    for values, bounds in zip(found["many"], found["bounds"], strict=True):
        assert values[0] == pytest.approx(expected[PAIR], rel=1e-7)
        assert values == pytest.approx(bounds, rel=1e-6)
        assert len(set(values)) == 3
    assert f"total_torque at margin {MARGIN:g} N" in found["html"]


def test_a_study_computes_it_and_varies_its_figure(package, tmp_path):
    pd = pytest.importorskip("pandas")
    study = {
        "scene": str(PLACES[HAND]),
        "vary": {"solve.evenness": {"values": [0.0, 0.5, 5.0]}},
        "compute": {"algorithm": "total_torque", "margin": MARGIN},
    }
    file, output = tmp_path / "study.yaml", tmp_path / "results.csv"
    file.write_text(yaml.safe_dump(study))
    shown = command(package, "study", str(file), "-o", str(output), "--workers", "1")
    assert shown.returncode == 0, shown.stderr
    table = pd.read_csv(output, comment="#")
    problem = load_scene(PLACES[HAND]).problem()
    values = [least(problem, evenness, None) for evenness in (0.0, 0.5, 5.0)]
    assert table["objective_value"].tolist() == pytest.approx(values, rel=1e-7)
    assert len(set(np.round(values, 4))) == 3
    study["compute"]["scale"] = "limits"
    file.write_text(yaml.safe_dump(study))
    refused = command(package, "study", str(file), "-o", str(output))
    assert "compute.scale: has no effect with algorithm 'total_torque'" in refused.stderr


def test_the_report_names_it_and_how_to_ask_for_it(package, scenes, tmp_path):
    page = tmp_path / "report.html"
    less = ("--no-ranges", "--no-verdict")
    shown = command(package, "report", str(scenes[PAIR]), "-o", str(page), *less)
    assert shown.returncode == 0, shown.stderr
    html = page.read_text(encoding="utf-8")
    assert "Algorithm total_torque: least sum of all torques" in html
    asked = f"--algorithm total_torque --margin {MARGIN} --evenness {EVENNESS}"
    assert asked in re.sub("<[^>]*>", "", html)


def test_round_cones_have_no_document_but_an_answer(package, scenes, tmp_path):
    file = tmp_path / "round.yaml"
    file.write_text(scenes[PAIR].read_text() + "cone: round\n")
    target = str(tmp_path / "solution.json")
    refused = command(package, "solve", str(file), "--no-verdict", "--json", target)
    assert refused.returncode == 2
    assert f"total_torque at margin {MARGIN:g} N" in refused.stdout
    assert (
        "'total_torque' cannot be written as a document: the friction cones are round"
        in refused.stderr
    )
