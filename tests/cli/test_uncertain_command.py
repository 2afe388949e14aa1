"""Commands on scenes that say what is not known exactly of them, and the documents they write."""

from __future__ import annotations

import copy
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli_tools import EXAMPLES, PAPER, run, stating

from graspless_pin import Status, Uncertainty, load_scene, served_share
from graspless_pin.algorithms import uncertain_members
from graspless_pin.cli.solve import proven_answer
from graspless_pin.intake.yaml_source import plain
from graspless_pin.programs.objectives import Torque
from graspless_pin.report import read_document, solution_document
from graspless_pin.report.robust import robust_text
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.fields import FIELDS
from graspless_pin.scene import robust_answer as robust_answers
from graspless_pin.scene.robust_answer import robust_answer

CUBOID = PAPER / "cuboid_at_rest.yaml"
SPHERE = PAPER / "sphere_on_slope.yaml"
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
ASKED = ("--algorithm", "torque", "--margin", "0.1", "--static-friction", "coulomb")
SET = {"mass": 0.2, "center_of_mass": 0.01}


def words(text: str) -> str:
    """A text in one line."""
    return " ".join(text.split())


@pytest.fixture(scope="module")
def cuboid(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return stating(tmp_path_factory.mktemp("cuboid"), CUBOID, uncertainty=SET)


@pytest.fixture(scope="module")
def document(cuboid: Path) -> dict[str, Any]:
    target = cuboid.with_name("solution.json")
    assert run("solve", cuboid, *ASKED, "--no-verdict", "--json", target).exit_code == 0
    return read_document(target)


def test_the_answer_is_the_torques_for_the_whole_set(
    cuboid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(robust_answers, "CORNER_TIME", 1.0)
    result = run("solve", cuboid, *ASKED)
    scene = load_scene(cuboid)
    options: dict[str, Any] = {"margin": 0.1, "static_friction": "coulomb"}
    robust = scene.solve("torque", uncertainty=Uncertainty(**SET), **options)
    nominal = scene.solve("torque", **options)
    said = words(result.stdout)
    assert result.exit_code == 0
    assert "Not known exactly: mass ±20 %, centre of mass ±1 cm." in said
    assert f"max |torque| = {robust.max_torque:.6g} N m, proven for the whole set" in said
    alone = f"margin e = 0.1 N, max |torque| = {nominal.max_torque:.6g}"
    assert f"for the nominal scene alone {alone}" in said
    assert f"Smallest margin at: {robust.members[robust.worst].words}." in said
    # The verdict on these torques is not one on each member.
    assert "The nominal scene under these torques: holds" in said
    assert f"graspless-pin tolerances {cuboid}" in said
    answer = robust_answer(scene, "torque", **options)
    assert answer.at_torques is not None
    np.testing.assert_allclose(answer.at_torques.torques, robust.torques, atol=1e-8)
    for name, torque in robust.torques_by_joint.items():
        assert name in said and f"{torque:+.4f}" in said


def test_margins_are_the_largest_for_the_whole_set(cuboid: Path) -> None:
    said = words(run("solve", cuboid, "--no-verdict").stdout)
    scene = load_scene(cuboid)
    robust, nominal = scene.solve(uncertainty=True), scene.solve()
    assert f"Torques for the whole set: margin e = {robust.margin:.6g} N" in said
    assert f"for the nominal scene alone margin e = {nominal.margin:.6g} N" in said
    assert robust.margin < 0.96 * nominal.margin


def test_the_document_holds_set_members_and_proof(cuboid: Path, document: dict[str, Any]) -> None:
    robust = load_scene(cuboid).solve(
        "torque", uncertainty=True, margin=0.1, static_friction="coulomb"
    )
    stated = document["uncertainty"]
    assert stated["stated"] == SET
    assert stated["found"] and stated["status"] == "optimal" and stated["coverage"] == "whole_set"
    assert stated["max_torque"] == pytest.approx(robust.max_torque, rel=1e-9)
    assert stated["bound"] == pytest.approx(robust.max_torque, rel=1e-6)
    assert stated["torques"] == pytest.approx(dict(robust.torques_by_joint), rel=1e-9)
    assert [one["words"] for one in stated["members"]] == [one.words for one in robust.members]
    assert stated["conflict"] == [] and stated["served_share"] == 1.0
    assert stated["nominal"]["max_torque"] < 0.9 * stated["max_torque"]
    assert stated.keys() <= FIELDS["uncertainty"].keys()
    assert all(one.keys() <= FIELDS["member"].keys() for one in stated["members"])
    checked = verify_document(document)
    assert checked.proven
    names = [one.name for one in checked.checks]
    assert "all members: optimal over all friction" in names
    assert "the joined problem is made of the members" in names


def test_torques_that_are_stated_are_those_of_the_proof(tmp_path: Path) -> None:
    """To a millionth: where the joined problem holds all members nothing else tells it."""
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.1})
    target = tmp_path / "solution.json"
    run("solve", file, *ASKED, "--no-verdict", "--json", target)
    for off, passed in ((1e-8, True), (1e-5, False)):
        document = read_document(target)
        torques = document["uncertainty"]["torques"]
        torques[next(iter(torques))] *= 1.0 + off
        assert verify_document(document).passed is passed


def _spoilt(document: dict[str, Any], what: str) -> dict[str, Any]:
    spoilt = copy.deepcopy(document)
    stated = spoilt["uncertainty"]
    match what:
        case "a member's load":
            stated["members"][3]["external_wrench"][2] *= 1.01
        case "a member's friction":
            stated["members"][2]["friction"][0] *= 0.99
        case "torque errors":
            stated["members"][1]["torque_factors"][0] = 1.01
        case "a stated torque":
            stated["torques"][next(iter(stated["torques"]))] *= 1.001
        case "the largest torque":
            stated["max_torque"] *= 0.999
        case "fewer members":
            del stated["members"][0]
        case "the load of a member that was served without being solved for":
            stated["members"][-1]["external_wrench"][2] *= 1.01
        case "its forces":
            stated["members"][-1]["forces"][0][0] += 1e-4
        case "a member's own balance":
            stated["proof"]["wrench_matrix"][8][0] += 0.5
        case "shared torques":
            stated["proof"]["wrench_matrix"][-1] = [0.0] * len(stated["proof"]["wrench_matrix"][-1])
        case "other contacts":
            stated["proof"]["contacts"][8]["position"][0] += 1e-3
        case "wider limits":
            stated["proof"]["joints"][0]["upper"] *= 2.0
        case "a bound that these torques pass":
            stated["bound"] = 1.01 * stated["max_torque"]
        case "a force":
            stated["proof"]["contacts"][5]["force"][1] += 1e-3
        case "the torques themselves":
            spoilt["joints"][0]["torque"] += 1e-3
    return spoilt


@pytest.mark.parametrize(
    "what",
    [
        "a member's load", "a member's friction", "torque errors", "a stated torque",
        "the largest torque", "fewer members", "a member's own balance", "shared torques",
        "other contacts", "wider limits", "a force", "the torques themselves",
        "the load of a member that was served without being solved for", "its forces",
        "a bound that these torques pass",
    ],
)  # fmt: skip
def test_the_checker_sees_what_is_not_so(document: dict[str, Any], what: str) -> None:
    assert verify_document(document).passed
    assert not verify_document(_spoilt(document, what)).passed


def test_the_checker_tells_what_it_takes_as_given(document: dict[str, Any]) -> None:
    """No proof stands behind verdicts at corners, nominal figures or another bound."""
    weaker = copy.deepcopy(document)
    weaker["uncertainty"]["bound"] *= 0.9
    weaker["uncertainty"]["at_corners"] = {"holding": "holds"}
    before, after = (
        {one.name for one in verify_document(each).checks if one.given}
        for each in (document, weaker)
    )
    assert "the figures of the nominal scene" in before
    bound = "bound on all torques for all members"
    assert after - before == {bound, "verdicts on the corners"}


@pytest.mark.parametrize("key", ["members", "found", "proof", "feedback", "torques", "coverage"])
def test_the_checker_refuses_what_is_missing(document: dict[str, Any], key: str) -> None:
    spoilt = copy.deepcopy(document)
    del spoilt["uncertainty"][key]
    with pytest.raises(ValueError, match=key):
        verify_document(spoilt)
    nested = copy.deepcopy(document)
    nested["uncertainty"]["proof"]["uncertainty"] = document["uncertainty"]
    with pytest.raises(ValueError, match="must be the document of the joined problem"):
        verify_document(nested)


@pytest.fixture(scope="module")
def sampled(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Any]:
    """The document of a set whose contacts may be elsewhere, and what is said of it."""
    folder = tmp_path_factory.mktemp("sampled")
    file = stating(folder, CUBOID, uncertainty={"mass": 0.2, "contact_position": 0.002})
    target = folder / "solution.json"
    result = run("solve", file, *ASKED, "--no-verdict", "--json", target)
    assert result.exit_code == 0
    said = words(result.stdout)
    assert "Not known exactly: mass ±20 %, contact positions up to 2 mm." in said
    assert "proven for the whole set with contacts at their nominal positions; for" in said
    assert "Sampled, not proven: 200 of 200 random members with contacts moved keep" in said
    return read_document(target)


def test_what_is_sampled_is_told_apart_from_what_is_proven(sampled: dict[str, Any]) -> None:
    stated = sampled["uncertainty"]
    where = {"count": 200, "served": 200, "solved": 50, "where_meant": "whole_set"}
    assert stated["coverage"] == "sampled" and stated["samples"] == where
    moved = [one for one in stated["members"] if "moved" in one]
    assert len(moved) == 50 and len(stated["members"]) == 52
    checked = verify_document(sampled)
    assert checked.proven
    marks = {one.name: one.mark for one in checked.checks}
    assert marks["contacts are moved within their tangent planes"] == "ok"
    assert marks["members tried later"] == "taken as given"


@pytest.mark.parametrize("number", [2, -1])
@pytest.mark.parametrize("what", ["moved", "jacobian", "external_wrench", "solved", "stated"])
def test_the_checker_sees_what_is_not_so_of_moved_contacts(
    sampled: dict[str, Any], what: str, number: int
) -> None:
    """Of a member that was solved for, and of one that was served without."""
    document = copy.deepcopy(sampled)
    stated = document["uncertainty"]
    member = [one for one in stated["members"] if "moved" in one][0 if number == 2 else -1]
    match what:
        case "moved":  # a finger's contact, along its plane
            off = np.array(member["moved"])
            off[0] *= 0.9
            member["moved"] = off.tolist()
        case "jacobian":
            member["jacobian"] = (1.01 * np.array(member["jacobian"])).tolist()
        case "external_wrench":
            member["external_wrench"][2] *= 1.01
        case "solved":
            stated["samples"]["solved"] = 49
        case _:
            stated["stated"]["contact_position"] = 0.0019
    assert not verify_document(document).passed


@pytest.fixture(scope="module", params=[None, 1.0])
def of_ball(request: pytest.FixtureRequest) -> dict[str, Any]:
    """The document of a set with a ball and errors of torques: constant torques, and feedback."""
    scene = load_scene(CUBOID if request.param is None else BALL)
    given = {"mass": 0.1, "force_radius": 0.05, "torque": 0.02}
    known = scene.with_changes(uncertainty=Uncertainty(**given), controller=request.param or "any")
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(uncertain_members, "MOST_ERRORS", 0)
        answer = robust_answer(known, "torque", margin=0.05, static_friction="coulomb")
    answer = proven_answer(answer)
    document = solution_document(answer.solution.with_source(known), known, answer=answer)
    document = json.loads(json.dumps(plain(document)))
    robust, stated = answer.robust, document["uncertainty"]
    assert robust.policy is not None
    assert stated["max_torque"] == pytest.approx(robust.max_torque, rel=1e-9)
    assert stated["torques"] == pytest.approx(dict(robust.torques_by_joint), rel=1e-9)
    assert stated["bound"] == robust.bound <= robust.max_torque * (1.0 + 1e-7)
    said = words(robust_text(answer))
    assert f"max |torque| = {robust.max_torque:.6g} N m, proven for the whole set" in said
    if request.param is not None:
        assert f"deflect by up to {robust.largest_deflection:.2g} rad" in said
        assert robust.largest_deflection > abs(robust.deflections).max()
    return document


def test_the_document_of_a_ball_holds_affine_forces_and_the_bound(of_ball: dict[str, Any]) -> None:
    checked = verify_document(of_ball)
    assert checked.proven
    names = [one.name for one in checked.checks]
    assert "affine forces: balance" in names and "bound: optimal over all friction" in names


@pytest.mark.parametrize(
    "what",
    [
        ("members", 0, "external_wrench", 2), ("members", 0, "friction", 0),
        ("members", 0, "torque_offsets", 0), ("policy", "forces", 0, 0, 1),
        ("policy", "slopes", 0, 0, 1, 0), ("policy", "loads", 0, 0, 0), ("policy", "shares", 0),
        ("policy", "offsets", 0), ("policy", "errors", 0, 1), ("torques", None),
        ("max_torque",), ("margin",), ("bound",), ("bounding", 1, "external_wrench", 2),
    ],
)  # fmt: skip
def test_the_checker_sees_what_is_not_so_of_a_ball(of_ball: dict[str, Any], what: Any) -> None:
    part, last = copy.deepcopy(of_ball), what[-1]
    document, part = part, part["uncertainty"]
    for key in what[:-1]:
        part = part[key]
    key = next(iter(part)) if last is None else last
    part[key] = 1.01 * part[key] + 1e-3 if what != ("members", 0, "friction", 0) else 0.1
    assert not verify_document(document).passed


def test_the_checker_refuses_what_is_missing_of_a_ball(of_ball: dict[str, Any]) -> None:
    for key in ("balls", "forces", "directions"):
        document = copy.deepcopy(of_ball)
        del document["uncertainty"]["policy"][key]
        with pytest.raises(ValueError, match=key):
            verify_document(document)


@pytest.mark.parametrize(
    "asked",
    [
        ("--algorithm", "margin"),
        ("--algorithm", "torque", "--margin", "0.03"),
        ("--algorithm", "torque", "--margin", "0.03", "--scale", "limits"),
    ],
)
def test_the_optimum_of_a_ball_is_verified_in_the_unit_that_was_asked_for(
    tmp_path: Path, asked: tuple[str, ...]
) -> None:
    """Torques here are a hundredth of what the load makes at the joints, which is their unit."""
    walls = EXAMPLES / "box_between_walls.yaml"
    file = stating(tmp_path, walls, uncertainty={"mass": 0.1, "force_radius": 0.1})
    target = tmp_path / "solution.json"
    common = ("--static-friction", "coulomb", "--no-verdict", "--json", target)
    assert run("solve", file, *asked, *common).exit_code == 0
    document = read_document(target)
    assert document["uncertainty"]["status"] == "optimal"
    assert verify_document(document).proven


def test_what_is_not_strong_for_a_ball_is_told_of_the_members_that_were_asked(
    tmp_path: Path,
) -> None:
    walls = EXAMPLES / "box_between_walls.yaml"
    file = stating(tmp_path, walls, uncertainty={"mass": 0.1, "force_radius": 0.1})
    target = tmp_path / "solution.json"
    asked = ("--algorithm", "torque", "--margin", "0.03", "--static-friction", "coulomb")
    result = run("solve", file, *asked, "--stability", "strong", "--json", target)
    assert result.exit_code == 3
    assert "Rest is lost where mass -10 %: may fail" in words(result.stdout)
    document = read_document(target)
    assert document["uncertainty"]["status"] == "strong_not_found"
    assert verify_document(document).passed


def test_a_ball_whose_bound_the_limit_left_open_is_told(tmp_path: Path) -> None:
    """The members that bound the torques have forces, in modes that twelve nodes do not find."""
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.05, "force_radius": 0.05})
    target = tmp_path / "solution.json"
    asked = ("--algorithm", "torque", "--margin", "0.05", "--no-verdict", "--json", target)
    result = run("solve", file, *asked)
    assert result.exit_code == 0
    assert "N m, proven for the whole set" in words(result.stdout)
    document = read_document(target)
    assert not document["uncertainty"]["proof"]["found"]
    checked = verify_document(document)
    assert checked.passed and not checked.proven
    assert "bound: stated" in [one.name for one in checked.checks if one.passed is None]


def test_one_mode_is_what_covers_the_set_under_the_rules(tmp_path: Path) -> None:
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.1, "center_of_mass": 0.004})
    target = tmp_path / "solution.json"
    run("solve", file, "--algorithm", "torque", "--no-verdict", "--json", target)
    document = read_document(target)
    assert document["uncertainty"]["coverage"] == "whole_set"
    assert verify_document(document).proven
    contacts = document["uncertainty"]["proof"]["contacts"][6:]
    other = next(one for one in contacts if one["selected"])
    other["signs"] = [-sign for sign in other["signs"]]
    failed = [one.name for one in verify_document(document).checks if one.passed is False]
    assert "coverage: all members in one mode" in failed


def test_where_no_torques_serve_the_set(tmp_path: Path) -> None:
    """The largest share is that of `served_share`, and its set is served."""
    file = stating(tmp_path, SPHERE, uncertainty=SET)
    target = tmp_path / "solution.json"
    result = run("solve", file, *ASKED, "--no-verdict", "--json", target)
    said = words(result.stdout)
    assert result.exit_code == 1
    assert "No torques serve all these members together (without any one of them, some do):" in said
    document = read_document(target)
    assert not document["found"] and document["status"] == "infeasible_forces"
    stated = document["uncertainty"]
    assert verify_document(document).proven
    share = stated["served_share"]
    problem = load_scene(SPHERE).problem()
    expected = served_share(problem, Torque(0.1), Uncertainty(**SET), static_friction="coulomb")
    assert share == pytest.approx(expected, abs=2e-3)
    assert f"Up to {100.0 * share:.3g} % of the set is served: mass ±{20.0 * share:.3g} %" in said
    conflict = [stated["members"][number]["words"] for number in stated["conflict"]]
    assert said.count("- mass ") == len(conflict)
    assert all(one in said for one in conflict)
    assert 2 <= len(conflict) <= np.linalg.matrix_rank(problem.jacobian) + 1  # Helly
    nominal = load_scene(SPHERE).solve("torque", margin=0.1, static_friction="coulomb")
    assert (
        f"For the nominal scene alone: margin e = 0.1 N, max |torque| = {nominal.max_torque:.6g}"
        in said
    )
    run("solve", file, *ASKED, "--stability", "strong", "--no-verdict", "--json", target)
    assert read_document(target)["uncertainty"]["served_share"] == pytest.approx(share, abs=2e-3)
    stated["members"][0]["external_wrench"][2] *= 1.01
    assert not verify_document(document).passed


def test_feedback_serves_what_rolls(tmp_path: Path) -> None:
    data = {"uncertainty": {"mass": 0.2, "center_of_mass": 0.005}}
    file = stating(tmp_path, BALL, **data)
    target = tmp_path / "solution.json"
    result = run("solve", file, *ASKED, "--no-verdict", "--json", target)
    said = words(result.stdout)
    assert result.exit_code == 1 and "No part of the set is served, however small." in said
    told = read_document(target)["uncertainty"]["with_feedback"]
    assert told["found"] and told["stiffness"] == 1.0
    serves = (
        f"Position feedback at the joints serves the set: max |torque| {told['max_torque']:.4g}"
    )
    assert serves in said
    # Where there is no time for it, it is not said that it does not.
    scene = load_scene(file)
    short = robust_answer(scene, "torque", share_time=0.0, margin=0.1, static_friction="coulomb")
    open_text = words(robust_text(short))
    assert (
        "Whether position feedback at the joints serves the set was not decided in time."
        in open_text
    )
    held = run("solve", file, *ASKED, "--controller", "2", "--no-verdict", "--json", target)
    document = read_document(target)
    assert held.exit_code == 0 and verify_document(document).proven
    stated = document["uncertainty"]
    assert stated["max_torque"] == pytest.approx(told["max_torque"], rel=1e-5)
    # With twice the stiffness joints give way by half.
    assert stated["largest_deflection"] == pytest.approx(0.5 * told["largest_deflection"], rel=1e-3)
    assert set(stated["feedback"].values()) == {2.0}


def test_other_commands_take_the_same_torques(cuboid: Path) -> None:
    scene = load_scene(cuboid)
    torques = scene.solve("torque", uncertainty=True).torques
    off = scene.tolerances(torques, static_friction="coulomb")
    result = run("tolerances", cuboid, "--algorithm", "torque")
    assert result.exit_code == 0 and str(off).splitlines()[2] in result.stdout
    assert off.of("more mass").balanced >= 0.2 and off.of("centre of mass").balanced >= 0.01
    told = run("tolerances", cuboid, "--algorithm", "torque", "--json", "-")
    data = json.loads(told.stdout)
    assert data["torques"] == pytest.approx(
        dict(zip(scene.problem().joint_names, torques, strict=True)), rel=1e-7
    )
    stated = {one["quantity"]: one for one in data["tolerances"]}
    assert stated["more mass"]["balanced"] == pytest.approx(off.of("more mass").balanced, rel=1e-6)
    assert stated["less mass"]["failing"] is None or stated["less mass"]["failing"] <= 1.0
    assert np.linalg.norm(stated["push"]["direction"]) == pytest.approx(1.0)


def test_what_other_torques_would_bear_stands_beside(
    cuboid: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Here no time is left for it: what given torques bear is told all the same."""
    monkeypatch.setattr("graspless_pin.cli.tolerances.ATTAINABLE_TIME", 0.0)
    target = cuboid.with_name("off.json")
    result = run("tolerances", cuboid, *ASKED[:2], "--attainable", "--json", target)
    assert result.exit_code == 0 and "attainable" in result.stdout
    told = json.loads(target.read_text(encoding="utf-8"))["tolerances"]
    assert result.stdout.count("not decided in time") >= len(told) - 1  # no mass is the least
    for one in told:
        beside = one["attainable"]
        assert beside["balanced"] == one["balanced"] > 0.0
        assert len(beside["torques"]) == 2
        assert beside["complete"] is (one["balanced"] == 1.0)


def test_what_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.1, "frction": 0.1})
    result = run("solve", file)
    assert (
        result.exit_code == 2 and "uncertainty.frction: unknown key; did you mean" in result.stderr
    )
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.1})
    heavy = stating(tmp_path, CUBOID, uncertainty={"mass": 0.1}, max_normal_force=2.0)
    result = run("solve", heavy, *ASKED)
    assert result.exit_code == 1 and "For the nominal scene alone: infeasible" in words(
        result.stdout
    )
    monkeypatch.setattr(uncertain_members, "MOST_MEMBERS", 100)
    many = {"mass": 0.1, "center_of_mass": 0.1, "tilt": 0.1}
    result = run("solve", stating(tmp_path, CUBOID, uncertainty=many))
    assert result.exit_code == 2 and "scene.yaml: uncertainty: has " in result.stderr
    assert "corners" in result.stderr
    far = run("solve", stating(tmp_path, CUBOID, uncertainty={"center_of_mass": 3.0}))
    assert far.exit_code == 2 and "scene.yaml: uncertainty: center_of_mass" in far.stderr


def test_the_verdict_is_asked_at_the_corners(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What it says of the heavy and the light box is what scenes of these masses say."""
    scene = load_scene(EXAMPLES / "box_between_walls.yaml")
    file = stating(tmp_path, EXAMPLES / "box_between_walls.yaml", uncertainty={"mass": 0.1})
    target = tmp_path / "solution.json"
    result = run("solve", file, *ASKED, "--json", target)
    assert result.exit_code == 0
    told = read_document(target)["uncertainty"]["at_corners"]
    torques = list(read_document(target)["uncertainty"]["torques"].values())
    assert [one["words"] for one in told["corners"]] == ["mass -10 %", "mass +10 %"]
    for share, corner in zip((0.9, 1.1), told["corners"], strict=True):
        made = scene.object.with_mass(share * scene.object.mass)
        verdict = scene.with_changes(object=made).stability(torques)
        assert corner["holding"] == str(verdict.holding) == told["holding"]
    assert re.search(rf"mass \+10 % +{told['holding']}", result.stdout)
    assert "Between the corners nothing is proven about rest." in words(result.stdout)
    monkeypatch.setattr(robust_answers, "CORNER_TIME", 0.0)
    late = run("solve", file, *ASKED)
    assert late.exit_code == 0 and "2 corners more got no verdict within" in words(late.stdout)
    assert "at the corners" not in words(run("solve", file, *ASKED, "--no-verdict").stdout)


def test_torques_that_guarantee_rest_at_each_corner(tmp_path: Path) -> None:
    """The document leaves open what verdicts on members prove: it does not hold them."""
    file = stating(tmp_path, EXAMPLES / "box_between_walls.yaml", uncertainty={"mass": 0.1})
    target = tmp_path / "solution.json"
    result = run("solve", file, *ASKED, "--stability", "strong", "--json", target)
    assert result.exit_code == 0
    assert "Rest is the only outcome at each of 2 corners" in words(result.stdout)
    document = read_document(target)
    assert document["uncertainty"]["status"] == "strong"
    left = [one.name for one in verify_document(document).checks if one.passed is not True]
    assert "all members: the torques are guaranteed" in left
    assert verify_document(document).passed
    ball = stating(tmp_path, BALL, uncertainty={"mass": 0.2, "center_of_mass": 0.005})
    stiff = run(
        "solve", ball, *ASKED, "--controller", "2", "--stability", "strong", "--json", target
    )
    assert stiff.exit_code == 0  # the best torques keep rest themselves
    assert verify_document(read_document(target)).passed
    soft = run("solve", ball, *ASKED, "--controller", "0.2", "--stability", "strong")
    assert soft.exit_code == 3
    assert "none were found with rest as the only outcome" in words(soft.stdout)


def test_a_search_that_ends_at_a_limit_proves_nothing(tmp_path: Path) -> None:
    file = stating(tmp_path, CUBOID, uncertainty={"force": 0.1, "mass": 0.1, "moment": 0.01})
    answer = robust_answer(load_scene(file), "torque", time_limit=0.0)
    assert answer.robust.status is Status.NOT_FOUND_IN_LIMIT and np.isnan(answer.served_share)
    result = run("solve", file, "--algorithm", "torque", "--time-limit", "0", "--no-verdict")
    assert result.exit_code == 3 and "a node or time limit" in words(result.stdout)
    assert "Whether torques serve the whole set is not decided" in words(result.stdout)
    assert "No torques" not in result.stdout  # no word that there are none
    limited = stating(tmp_path, file, solve={"algorithm": "torque", "time_limit": 1e-9})
    assert run("tolerances", limited).exit_code == 3


@pytest.mark.parametrize(
    "command", [("tolerances",), ("plot", "--kind", "tolerances", "-o", "x.png")]
)
def test_commands_without_torques_for_the_set_say_so(
    tmp_path: Path, command: tuple[str, ...]
) -> None:
    """The nominal ball has torques, and constant ones serve no two masses."""
    scene = stating(
        tmp_path, BALL, uncertainty=SET, solve={"algorithm": "torque", "static_friction": "coulomb"}
    )
    result = run(command[0], scene, *command[1:])
    assert result.exit_code == 1
    assert result.stdout.startswith(
        "no torques were found that serve the scene's whole uncertainty"
    )
    assert f"graspless-pin solve {scene}" in result.stdout


def test_what_affine_forces_do_not_prove_is_left_open(tmp_path: Path) -> None:
    """Pushes that some members bear, each by itself, and affine forces not all together."""
    file = stating(tmp_path, CUBOID, uncertainty={"mass": 0.2, "force_radius": 9.5})
    said = run("solve", file, *ASKED, "--no-verdict")
    assert said.exit_code == 3
    assert "Not decided: no torques are proven for the whole set." in words(said.stdout)
    assert "% of the set is served" in words(said.stdout)


def test_the_largest_torque_is_that_of_all_members(tmp_path: Path) -> None:
    """With feedback each has its own commands, those that were not solved for, too."""
    ball = CUBOID.parents[1] / "allegro_sphere_on_slope.yaml"
    known = {"mass": 0.2, "center_of_mass": 0.005, "force": 0.05}
    file, target = stating(tmp_path, ball, uncertainty=known), tmp_path / "solution.json"
    asked = ("--algorithm", "margin", "--static-friction", "coulomb", "--controller", "2")
    assert run("solve", file, *asked, "--no-verdict", "--json", target).exit_code == 0
    document = read_document(target)
    assert any("forces" in one for one in document["uncertainty"]["members"])
    assert verify_document(document).proven
