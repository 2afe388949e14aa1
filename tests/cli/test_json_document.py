"""The JSON document: what an outsider needs, rechecked from its figures with numpy alone."""

import json
import math

import numpy as np
import pytest
from cli_tools import EXAMPLES, LINES, PAPER, run, solve_text, spoilt

SOLVED = [
    *((PAPER / f"{name}.yaml", "margin") for name in ("cuboid_at_rest", "cuboid_sliding_up")),
    *((PAPER / f"{name}.yaml", "torque") for name in ("cuboid_sliding_down", "sphere_on_slope")),
    (EXAMPLES / "allegro_push_up_slope.yaml", "margin"),
    (EXAMPLES / "allegro_sphere_on_slope.yaml", "torque"),
]


def strict(text: str) -> dict:
    """Read JSON as its standard has it: NaN and Infinity are no numbers."""

    def refuse(word):
        raise AssertionError(f"{word} is not JSON")

    return json.loads(text, parse_constant=refuse)


@pytest.fixture(
    scope="module",
    params=SOLVED,
    ids=lambda param: f"{param[0].stem}-{param[1]}",
)
def document(request):
    file, algorithm = request.param
    result = run("solve", file, "--algorithm", algorithm, "--no-verdict", "--json", "-")
    assert result.exit_code == 0 and result.stderr == ""
    return strict(result.stdout)


def column(entries, key):
    return np.array([entry[key] for entry in entries], dtype=float)


def test_it_holds_what_it_should(document):
    assert {
        "status",
        "found",
        "algorithm",
        "margin",
        "max_torque",
        "gravity",
        "object",
        "hand",
        "joints",
        "contacts",
        "certificate",
    } <= set(document)
    assert document["status"] == "optimal" and document["found"] is True
    assert document["algorithm"] in ("margin", "torque")
    assert np.shape(document["gravity"]) == (3,)
    assert {"mass", "center_of_mass", "pose"} <= set(document["object"])
    assert np.shape(document["object"]["center_of_mass"]) == (3,)
    assert np.shape(document["object"]["pose"]) == (4, 4)
    assert np.shape(document["hand"]["base_pose"]) == (4, 4)
    assert all(isinstance(value, float) for value in document["hand"]["q"].values())
    joints, contacts = document["joints"], document["contacts"]
    assert {joint["name"] for joint in joints} <= set(document["hand"]["q"])
    for joint in joints:
        assert {"torque_contact", "torque_gravity", "torque", "lower", "upper"} <= set(joint)
    shapes = {
        "position": (3,),
        "normal": (3,),
        "tangents": (2, 3),
        "force": (3,),
        "friction": (),
        "sliding": (3,),
        "selected": (),
        "signs": (2,),
        "jacobian": (3, len(joints)),
    }
    for contact in contacts:
        assert len(contact["bodies"]) == 2 and contact["bodies"][1] == document["object"]["name"]
        assert {key: np.shape(contact[key]) for key in shapes} == shapes
        assert isinstance(contact["selected"], bool)
        assert set(contact["signs"]) <= {-1, 0, 1}
    for key in ("primal_residual", "duality_gap", "bound", "gap", "modes_examined", "solver"):
        assert key in document["certificate"]


def test_forces_balance_the_weight(document):
    force, where = column(document["contacts"], "force"), column(document["contacts"], "position")
    weight = document["object"]["mass"] * np.array(document["gravity"])
    scale = np.linalg.norm(weight)
    arms = where - np.array(document["object"]["center_of_mass"])
    assert np.linalg.norm(force.sum(axis=0) + weight) < 1e-6 * scale
    assert np.linalg.norm(np.cross(arms, force).sum(axis=0)) < 1e-6 * scale * np.abs(arms).max()


def test_frames_are_orthonormal_and_right_handed(document):
    for contact in document["contacts"]:
        frame = np.array([contact["normal"], *contact["tangents"]])
        np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-9)
        assert np.linalg.det(frame) == pytest.approx(1.0)


def face_distances(contact, edges):
    """Distances (N) of the force to the sides of the inscribed cone, first edge along t1."""
    force = np.array(contact["force"])
    normal = force @ contact["normal"]
    along = np.array(contact["tangents"]) @ force
    slope = contact["friction"] * math.cos(math.pi / edges)
    angles = (2 * np.arange(edges) + 1) * math.pi / edges
    outward = np.stack([np.cos(angles), np.sin(angles)], axis=1) @ along
    return (slope * normal - outward) / math.hypot(1.0, slope)


def test_forces_keep_the_stated_margin(document):
    distances = []
    for contact in document["contacts"]:
        normal = np.dot(contact["force"], contact["normal"])
        distances += [normal, contact["max_normal_force"] - normal]
        if contact["friction"] > 0 and not any(contact["sliding"]):
            distances += face_distances(contact, document["cone_edges"]).tolist()
    assert min(distances) == pytest.approx(document["margin"], abs=1e-6)
    assert document["margin"] >= document["required_margin"] - 1e-6


def test_friction_opposes_sliding(document):
    """Kinetic friction mu f_n against the actual sliding; static only against a virtual one."""
    for contact in document["contacts"]:
        normal = np.array(contact["normal"])
        force, sliding = np.array(contact["force"]), np.array(contact["sliding"])
        pressing = force @ normal
        along = np.array(contact["tangents"]) @ force
        if sliding.any():
            assert abs(sliding @ normal) < 1e-9 * np.linalg.norm(sliding) + 1e-12
            kinetic = -contact["friction"] * pressing * sliding / np.linalg.norm(sliding)
            np.testing.assert_allclose(force - pressing * normal, kinetic, atol=1e-6)
        elif contact["selected"]:
            assert np.abs(contact["signs"]).max() == 1
            assert (along * contact["signs"]).max() < 1e-6
        else:
            assert contact["signs"] == [0, 0]
            assert np.abs(along).max() < 1e-6


def test_sliding_scenes_slide(document):
    moves = any(word in document["scene"] for word in (" slid ", " pushes "))
    expected = 4 if moves else 0
    assert sum(any(contact["sliding"]) for contact in document["contacts"]) == expected


def test_torques_are_the_forces_through_the_jacobian(document):
    joints, contacts = document["joints"], document["contacts"]
    expected = sum(np.array(c["jacobian"]).T @ np.array(c["force"]) for c in contacts)
    np.testing.assert_allclose(column(joints, "torque_contact"), expected, atol=1e-9)
    total = column(joints, "torque_contact") + column(joints, "torque_gravity")
    np.testing.assert_allclose(column(joints, "torque"), total, atol=1e-12)
    assert (total >= column(joints, "lower") - 1e-6).all()
    assert (total <= column(joints, "upper") + 1e-6).all()
    assert document["max_torque"] == pytest.approx(np.abs(total).max())


def test_the_certificate_proves_it(document):
    proof = document["certificate"]
    assert 0 <= proof["primal_residual"] < 1e-6
    value = document["margin"] if document["algorithm"] == "margin" else document["max_torque"]
    assert value == pytest.approx(proof["bound"], abs=1e-5)


# Infeasible: too heavy, or a margin that nobody can keep.
INFEASIBLE = {
    "forces": (spoilt("friction: 0.3", "friction: 0.3\nmax_normal_force: 1"), ()),
    "margin": (LINES, ("--algorithm", "torque", "--margin", "40")),
}


@pytest.mark.parametrize(("text", "options"), INFEASIBLE.values(), ids=INFEASIBLE)
def test_an_infeasible_document_says_so(tmp_path, text, options):
    result = solve_text(tmp_path, text, *options, "--json", "-")
    assert result.exit_code == 1 and result.stderr == ""
    document = strict(result.stdout)
    assert document["found"] is False
    assert document["status"] == "infeasible_forces"
    assert document["message"].startswith("infeasible: no contact forces inside the cones")
    assert document["margin"] is None and document["max_torque"] is None
    assert document["certificate"]["infeasibility"] > 0
    assert len(document["contacts"]) == 5
    for contact in document["contacts"]:
        assert [contact[key] for key in ("force", "selected", "signs")] == [None] * 3
        assert contact["position"] and contact["normal"]
    for joint in document["joints"]:
        assert joint["torque"] is None and joint["torque_contact"] is None
        assert isinstance(joint["torque_gravity"], float)


def test_the_papers_constrained_slide_is_infeasible_in_modes():
    file = PAPER / "cuboid_sliding_up.yaml"
    result = run("solve", file, "--sliding-rule", "constrained", "--json", "-")
    assert result.exit_code == 1
    document = strict(result.stdout)
    assert document["status"] == "infeasible_modes" and document["found"] is False
    assert document["rules"]["sliding_rule"] == "constrained"


def test_unbounded_limits_are_null(tmp_path):
    (tmp_path / "pad.urdf").write_text(
        '<robot name="pad"><link name="base"/><link name="pad"><collision><geometry>'
        '<sphere radius="0.01"/></geometry></collision></link><joint name="slide" '
        'type="prismatic"><parent link="base"/><child link="pad"/><axis xyz="0 1 0"/>'
        '<limit lower="-1" upper="1" effort="inf" velocity="1"/></joint></robot>'
    )
    hand = LINES[LINES.index("  robot") : LINES.index("object:")]
    text = spoilt(hand, "  urdf: pad.urdf\n  base_pose: {position: [0, -0.11, 0]}\n")
    result = solve_text(tmp_path, text, "--json", "-")
    assert result.exit_code == 0 and "warning: " in result.stderr
    joint = strict(result.stdout)["joints"][0]
    assert joint["lower"] is None and joint["upper"] is None
    assert isinstance(joint["torque"], float)
