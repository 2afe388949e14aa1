"""The JSON document: what an outsider needs, and proven by its figures alone."""

import json

import numpy as np
import pytest
from cli_tools import EXAMPLES, LINES, PAPER, run, solve_text, spoilt

from graspless_pin.report.verify import verify_document

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


def test_what_it_states_is_proven(document):
    """Margin, friction, torques, gaps and optimum, from its figures alone."""
    assert verify_document(document).proven


def test_sliding_scenes_slide(document):
    moves = any(word in document["scene"] for word in (" slid ", " pushes "))
    expected = 4 if moves else 0
    assert sum(any(contact["sliding"]) for contact in document["contacts"]) == expected


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
    assert document["message"].startswith("infeasible: no contact forces inside the friction cones")
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
