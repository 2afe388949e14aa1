"""Small motions at stated contacts: those of shapes that touch so, or of points that stay."""

import json
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import null_space
from tests.scene.scene_tools import EXAMPLES, content, loaded

from graspless_pin import Scene, load_scene, minimum_stiffness
from graspless_pin.geometry import unwanted_overlaps
from graspless_pin.report import solution_document, write_document
from graspless_pin.report.verify import verify_document

G, RADIUS, MASS, LINK = 9.81, 0.05, 0.5, 0.1
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
BENT = np.array([0.5, -0.9, 0.6])
ARM = """<robot name="arm"><link name="base"/>{links}</robot>"""
JOINT = """<link name="{name}"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial></link>
<joint name="j{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{at} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="5" velocity="1"/></joint>"""


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


def pressing_arm(folder: Path, **more: object) -> Scene:
    """Three links without shapes press a box against a wall with the end of the last."""
    parents = zip("abc", ("base", "a", "b"), (0.0, LINK, LINK), strict=True)
    links = "".join(JOINT.format(name=name, parent=by, at=at) for name, by, at in parents)
    (folder / "arm.urdf").write_text(ARM.format(links=links))
    corners = [(0.1, y, z) for y in (-0.05, 0.05) for z in (-0.05, 0.05)]
    x, y = end_of(BENT).tolist()
    data = {
        "gravity": [0, 0, -G],
        "friction": 0.8,
        "hand": {
            "urdf": "arm.urdf",
            "q": dict(zip(("ja", "jb", "jc"), BENT.tolist(), strict=True)),
            "count_own_weight": False,
            "base_pose": {"position": [-x, -y, 0.0]},
        },
        "object": {
            "shape": {"type": "box", "size": [0.1, 0.1, 0.1]},
            "mass": MASS,
            "pose": {"position": [0.05, 0, 0]},
        },
        "supports": [{
            "name": "wall", "shape": {"type": "half_space"},
            "pose": {"position": [0.1, 0, 0], "rpy": [0, -np.pi / 2, 0]},
        }],
        "contacts": [
            {"body": "c", "position": [0, 0, 0], "normal": [1, 0, 0]},
            *({"body": "wall", "position": [*one], "normal": [-1, 0, 0]} for one in corners),
        ],
    }  # fmt: skip
    return loaded(folder, data | more)


def end_of(q: np.ndarray) -> np.ndarray:
    """Where the last link ends."""
    angles = np.cumsum(q)
    return LINK * np.array([np.cos(angles).sum(), np.sin(angles).sum()])


def test_an_arm_without_shapes_buckles_about_its_stated_contact(tmp_path: Path) -> None:
    """One motion is left: U = -tau q along the curve on which the arm's end stays."""
    scene = pressing_arm(tmp_path)
    problem = scene.problem()
    torques = problem.jacobian[:3].T @ [20.0, 0.0, 0.0]
    found = minimum_stiffness(scene, torques, armature=0.0, damping=0.0)
    slope = np.array([(end_of(BENT + e) - end_of(BENT - e)) / 2e-6 for e in 1e-6 * np.eye(3)]).T
    tangent = null_space(slope)[:, 0]

    def energy(s: float) -> float:
        q = BENT + s * tangent
        for _ in range(20):  # back to the curve, across it
            off = end_of(q) - end_of(BENT)
            q = q - np.linalg.solve(np.vstack([slope, tangent]), [*off, 0.0])
        return -torques @ q

    step = 1e-3
    K = (energy(step) - 2.0 * energy(0.0) + energy(-step)) / step**2
    assert K < 0.0 and found.assumed == (0,)
    inertia = tangent @ problem.joint_inertia @ tangent
    assert found.growth == pytest.approx(np.sqrt(-K / inertia), rel=1e-4)
    assert found.stiffness == pytest.approx(-K, rel=1e-4)


def test_a_hand_without_shapes_is_in_nothing(tmp_path: Path) -> None:
    scene = pressing_arm(tmp_path)
    assert scene.hand is not None
    assert unwanted_overlaps(scene.hand, scene.supports) == ()


def test_a_document_tells_what_is_assumed_of_contacts(tmp_path: Path) -> None:
    arm = pressing_arm(tmp_path)
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
    assert told.detail.endswith("; points that stay on both bodies are assumed at 1")
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
