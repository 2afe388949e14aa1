"""The page leads with the verdict, and its motion is the one that the verdict states."""

import json
import re
from typing import Any

import numpy as np
import pytest
from report_cases import AT_REST, BALL, WALLS, Element, read_html, solved, through_json

from graspless_pin import Scene, StabilityVerdict, TorqueSolution
from graspless_pin.errors import ArgumentError
from graspless_pin.report import solution_document
from graspless_pin.report.html import case_of_document, case_of_scene, report_html
from graspless_pin.visualization.motion import draw_motion

pytestmark = pytest.mark.usefixtures("without_plots")

Weak = tuple[Scene, TorqueSolution, StabilityVerdict]


@pytest.fixture(scope="module")
def weak(tmp_path_factory: pytest.TempPathFactory) -> Weak:
    """Between the two walls a rod, which touches each along a line."""
    box, rod = "{type: box, size: [0.1, 0.06, 0.1]}", "{type: cylinder, radius: 0.03, length: 0.1}"
    text = WALLS.read_text(encoding="utf-8")
    text = text.replace(box, f"{rod}\n  pose: {{rpy_deg: [0, 90, 0]}}")
    file = tmp_path_factory.mktemp("walls") / "walls.yaml"
    file.write_text(text, encoding="utf-8")
    scene, solution = solved(file)
    return scene, solution, scene.stability(solution.torques)


@pytest.fixture(scope="module")
def weak_page(weak: Weak) -> Element:
    scene, solution, verdict = weak
    return read_html(report_html(case_of_scene(scene, solution, None, verdict)))


def status(page: Element) -> str:
    *_, line = (p for p in page.all("p") if "status" in (p.attributes.get("class") or "").split())
    return line.text


def model_of(page: Element, name: str) -> dict[str, Any]:
    (view,) = (item for item in page.everything() if item.attributes.get("id") == name)
    return json.loads(view.all("script")[0].text)


def test_rest_that_is_proven():
    scene, solution = solved(AT_REST)
    verdict = scene.stability(solution.torques)
    page = read_html(report_html(case_of_scene(scene, solution, None, verdict)))
    told = r"Holds: the object provably stays at rest \(\d+ LPs\); no small motion grows"
    assert re.fullmatch(told, status(page))
    assert "That the object stays is proven nevertheless" in page.text
    assert "What can happen" not in page.text
    rows = {row[0]: row[1] for row in page.section("modes").rows()}
    assert "FAILED" not in rows.values()
    counted = json.loads(json.dumps(solution_document(solution, scene, verdict)))
    counted["stability"] |= {"message": "holds with 1 N m/rad; and so"}
    counted["holding"] |= {"status": "needs_feedback", "growth_rate": 3.0}
    (line,) = (
        p
        for p in read_html(report_html(case_of_document(counted))).all("p")
        if "care" in (p.attributes.get("class") or "")
    )
    assert line.text == "Holds with 1 N m/rad: and so"


def test_a_motion_that_may_happen(weak: Weak, weak_page: Element):
    _, solution, verdict = weak
    assert status(weak_page).startswith("May fail: the object can slip down, ")
    assert verdict.motion is not None
    rows = weak_page.section("motion").rows()
    assert [row[2] for row in rows] == [str(state) for state in verdict.motion.states]
    normal = np.einsum("ij,ij->i", solution.problem.normals, verdict.motion.contact_forces)
    np.testing.assert_allclose([float(row[3]) for row in rows], normal, atol=5.1e-5)
    # Where nobody asked, the page says so.
    page = read_html(report_html(case_of_document(through_json(solution))))
    assert status(page).endswith("Whether the object stays was not computed.")


def test_the_motion_of_the_page_is_that_of_the_verdict(weak: Weak, weak_page: Element):
    scene, solution, verdict = weak
    assert verdict.motion is not None
    expected = draw_motion(solution.problem, verdict.motion, scene=scene)
    model = model_of(weak_page, "motion-view")
    assert model["seconds"] == expected.times[-1]
    for mesh, stated in zip(expected.picture.meshes, model["meshes"], strict=True):
        path = expected.path_of.get(mesh.name)
        assert stated["path"] == path
        if path is not None:
            shown = np.array(model["paths"][path]).reshape(-1, 3, 4)
            np.testing.assert_allclose(shown, expected.paths[path][:, :3], atol=1e-6)
    assert model["plays"] and not model_of(weak_page, "view")["plays"]


def test_a_document_says_the_same_without_its_scene(weak: Weak):
    scene, solution, verdict = weak
    document = json.loads(json.dumps(solution_document(solution, scene, verdict)))
    alone = read_html(report_html(case_of_document(document)))
    whole = read_html(report_html(case_of_document(document, scene.path)))
    assert status(alone) == status(whole)
    first, second = (model_of(page, "motion-view") for page in (alone, whole))
    assert first["paths"] == second["paths"][:1]  # the object's; no link is known
    roles = [{mesh["role"] for mesh in model["meshes"]} for model in (first, second)]
    assert "object" not in roles[0] and "object" in roles[1]


def test_a_declared_motion_that_is_lost():
    """Contacts that slide as declared are closed in the verdict, and slip in the view."""
    scene, solution = solved(WALLS.parent / "trihand_push_box.yaml")
    verdict = scene.stability(0.8 * solution.torques, node_limit=20)
    page = read_html(report_html(case_of_scene(scene, solution, None, verdict)))
    assert status(page).startswith("Loses its motion: keeping the motion is no outcome")
    assert "on top of the declared one" in page.section("motion").text
    roles = [mesh["role"] for mesh in model_of(page, "motion-view")["meshes"]]
    assert roles.count("slipping_contact") == 4


@pytest.mark.parametrize(
    "spoil",
    [
        lambda motion: motion.pop("states"),
        lambda motion: motion.update(states=["flying"] * 6),
        lambda motion: motion.update(states=["free"] * 6),
        lambda motion: motion["states"].pop(),
        lambda motion: motion.update(object_acceleration=[1.0]),
        lambda motion: motion.update(point_acceleration="fast"),
        lambda motion: motion.update(object_acceleration=[0.0] * 6, joint_accelerations=[0.0] * 2),
    ],
)
def test_a_motion_that_is_none_is_refused(weak: Weak, spoil: Any):
    scene, solution, verdict = weak
    document = json.loads(json.dumps(solution_document(solution, scene, verdict)))
    spoil(document["stability"]["motion"])
    with pytest.raises(ArgumentError, match="motion"):
        case_of_document(document)


def test_the_small_motion_that_grows_is_played(tmp_path) -> None:
    scene, solution = solved(BALL)
    verdict = scene.stability(solution.torques)
    small = verdict.small_motions
    assert small is not None and small.motion is not None
    case = case_of_scene(scene, solution, None, verdict)
    page = read_html(report_html(case))
    (section,) = (
        item for item in page.all("section") if item.attributes.get("aria-labelledby") == "motion"
    )
    assert f"this small motion grows at {small.growth:.2g} /s" in section.text
    assert not section.all("table")
    assert "paths" in json.dumps(model_of(page, "motion-view"))
    again = case_of_document(json.loads(json.dumps(solution_document(solution, scene, verdict))))
    assert again.motion is not None and case.motion is not None
    np.testing.assert_allclose(again.motion.paths[0], case.motion.paths[0], atol=1e-12)
