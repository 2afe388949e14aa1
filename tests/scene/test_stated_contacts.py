"""Small motions at stated contacts: those of shapes that touch so, or of points that stay."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scene_tools import EXAMPLES, content, loaded
from test_minimum_stiffness import G, assert_buckles, end_of, pressing_arm

from graspless_pin import Scene, load_scene, minimum_stiffness
from graspless_pin.geometry import unwanted_overlaps
from graspless_pin.report import solution_document, write_document
from graspless_pin.report.verify import verify_document

RADIUS, MASS = 0.05, 0.5
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"


def stated(scene: Scene) -> list[dict[str, object]]:
    """The contacts that a scene finds."""
    return [
        {"body": one.body, "position": one.position.tolist(), "normal": one.normal.tolist()}
        for one in scene.contacts.points
    ]


def test_contacts_that_are_stated_where_shapes_touch_roll_as_those_do(tmp_path: Path) -> None:
    scene = load_scene(BALL)
    torques = scene.solve("torque").torques
    again = loaded(tmp_path, content(BALL) | {"contacts": stated(scene)})
    found, given = minimum_stiffness(scene, torques), minimum_stiffness(again, torques)
    assert given.growth == pytest.approx(found.growth, rel=1e-6) and found.growth > 1.0
    assert given.stiffness == pytest.approx(found.stiffness, rel=1e-6)
    assert given.assumed == ()
    assert str(again.stability(torques)) == str(scene.stability(torques))


@pytest.mark.parametrize("off", [0.0, 0.01])
def test_a_ball_that_is_said_to_touch_far_from_all_shapes_stands_on_a_point(
    off: float, tmp_path: Path
) -> None:
    """It falls as a pendulum about that point; the table may lie as deep as it likes."""
    scene = loaded(
        tmp_path,
        {
            "gravity": [0, 0, -G],
            "friction": 0.8,
            "object": {"shape": {"type": "sphere", "radius": RADIUS}, "mass": MASS,
                       "pose": {"position": [0, 0, RADIUS]}},
            "supports": [{"name": "table", "shape": {"type": "half_space"},
                          "pose": {"position": [0, 0, -off]}}],
            "contacts": [{"body": "table", "position": [0, 0, 0], "normal": [0, 0, 1]}],
        },
    )  # fmt: skip
    found, said = minimum_stiffness(scene, []), str(scene.stability([]))
    about_the_point = (2 / 5 + 1) * MASS * RADIUS**2
    falls = np.sqrt(MASS * G * RADIUS / about_the_point) if off else 0.0
    assert found.growth == pytest.approx(falls, rel=1e-6)
    assert found.assumed == ((0,) if off else ())
    words = "; assumed: contact 0 has a point that stays on both bodies, as no shapes touch there"
    assert said.endswith(words) is (off > 0.0)


def stating_arm(folder: Path) -> Scene:
    """The arm without shapes, and where it and the wall touch the box."""
    corners = [(0.1, y, z) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    rows = [("c", (0.0, 0.0, 0.0), 1), *(("wall", corner, -1) for corner in corners)]
    contacts = [{"body": body, "position": [*at], "normal": [n, 0, 0]} for body, at, n in rows]
    return pressing_arm(folder, radius=0.0, contacts=contacts)


def test_an_arm_without_shapes_buckles_about_its_stated_contact(tmp_path: Path) -> None:
    """The arm's end stays."""
    scene = stating_arm(tmp_path)
    torques = scene.problem().jacobian[:3].T @ [20.0, 0.0, 0.0]
    assert assert_buckles(scene, torques, end_of)[0].assumed == (0,)


def test_a_hand_without_shapes_is_in_nothing(tmp_path: Path) -> None:
    scene = stating_arm(tmp_path)
    assert scene.hand is not None
    assert unwanted_overlaps(scene.hand, scene.supports) == ()


def test_a_document_tells_what_is_assumed_of_contacts(tmp_path: Path) -> None:
    arm = stating_arm(tmp_path)
    needed = minimum_stiffness(arm, arm.solve("torque").torques).stiffness
    scene = arm.with_changes(controller=2.0 * needed)
    solution = scene.solve("torque")
    verdict = scene.stability(solution.torques)
    assert verdict.holding == "holds" and "; assumed: contact 0 has a point" in str(verdict)
    file = tmp_path / "solution.json"
    write_document(solution_document(solution, scene, verdict), file)
    document = json.loads(file.read_text())
    assert document["holding"]["assumed_contacts"] == [0]
    checks = verify_document(document).checks
    assert not [one.name for one in checks if one.passed is False]
    (told,) = (one for one in checks if one.name.endswith("do under the controller"))
    assert told.detail.endswith("; 1 contact points are assumed to stay on both bodies")
    strong = scene.solve("torque", stability="strong")
    assert strong.found and strong.guarantee is not None


def found_of(
    folder: Path,
    shape: dict[str, object],
    rows: Sequence[tuple[str, Sequence[float], Sequence[float]]],
    **more: object,
) -> dict[str, str]:
    """What is found of an object on a table whose contacts are stated."""
    data = {
        "friction": 0.5,
        "object": {"name": "thing", "shape": shape, "mass": 0.3,
                   "pose": {"position": [0, 0, 0.03]}},
        "supports": [{"name": "table", "shape": {"type": "half_space"}},
                     {"name": "wall", "shape": {"type": "half_space"},
                      "pose": {"position": [0, 0.03, 0], "rpy": [np.pi / 2, 0, 0]}}],
        "contacts": [{"body": body, "position": p, "normal": n} for body, p, n in rows],
    }  # fmt: skip
    return {one.code: str(one) for one in loaded(folder, data | more).findings}


BLOCK: dict[str, object] = {"type": "box", "size": [0.06, 0.06, 0.06]}
CORNERS = [[0.03, 0.03, 0.0], [-0.03, 0.03, 0.0], [0.0, -0.02, 0.0]]


def test_stated_contacts_that_the_shapes_contradict_are_told(tmp_path: Path) -> None:
    up, down = [0, 0, 1], [0, 0, -1]
    right = [("table", one, up) for one in CORNERS]
    edge = [("wall", [0.01, 0.03, 0.0], normal) for normal in ([0, -1, 0], [0, -1, 1], [0, 0, 1])]
    assert found_of(tmp_path, BLOCK, [*right, *edge]) == {}
    out = found_of(tmp_path, BLOCK, [("table", one, down) for one in CORNERS])
    assert [*out] == ["normal-points-out"]
    assert "contacts[0].normal" in out["normal-points-out"]
    assert "contacts 0, 1, 2 point out of object 'thing'" in out["normal-points-out"]
    off = found_of(tmp_path, BLOCK, [*right[:2], ("table", [0, -0.2, 0.5], up)])
    assert [*off] == ["contact-off-surface"]
    away = 1e3 * np.hypot(0.2 - 0.03, 0.5 - 0.06)
    words = (
        f"{away:.4g} mm from the surface of object 'thing' and 500 mm from the surface of 'table'"
    )
    assert f"contact 2 is {words}" in off["contact-off-surface"]
    other = found_of(tmp_path, BLOCK, [*right, ("wall", [0, 0.01, 0], up)])
    assert "contact 3 is 20 mm from the surface of 'wall';" in other["contact-off-surface"]


@pytest.mark.parametrize("share", [0.9, 1.1])
def test_shapes_that_are_simplified_on_purpose_have_a_tolerance(
    share: float, tmp_path: Path
) -> None:
    ball: dict[str, object] = {"type": "sphere", "radius": 0.03}
    rows = [("table", [0.0, 0.01, 0.0], [0, 0, 1])]
    gap = float(np.hypot(0.03, 0.01)) - 0.03
    found = found_of(tmp_path, ball, rows, contact_tolerance=share * gap)
    assert [*found] == (["contact-off-surface"] if share < 1.0 else [])
