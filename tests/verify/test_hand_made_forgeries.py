"""No forgery of an attacker's mind passes, and what they start from is what it seems."""

import json

import pytest
from forgeries import FORGERIES, REFUSED, Forgery, base, bases
from tests.cli.cli_tools import run
from verified_documents import changed

from graspless_pin.report.verify import verify_document


@pytest.mark.parametrize("name", bases())
def test_nothing_fails_of_what_forgeries_start_from(name):
    verification = verify_document(base(name))
    failed = {check.name for check in verification.checks if check.passed is False}
    assert failed == REFUSED.get(name, set())
    assert verification.proven or name in ("not guaranteed", *REFUSED)


@pytest.mark.parametrize("forgery", FORGERIES, ids=lambda one: one.name)
def test_a_forgery_is_refused(forgery: Forgery):
    assert repr(forgery.made()) != repr(base(forgery.base))
    assert forgery.is_refused()


def test_a_coarse_resolution_is_refused_for_what_it_is():
    """Whatever else of the proof it breaks."""
    (coarse,) = [one for one in FORGERIES if one.name == "resolution_just_too_coarse"]
    checks = {one.name: one.passed for one in verify_document(coarse.made()).checks}
    assert checks["the resolution is fine enough"] is False


def test_a_key_that_stands_twice_is_refused(tmp_path):
    """Readers differ in which of the two they take."""
    text = json.dumps(base("tree"))
    file = tmp_path / "twice.json"
    file.write_text(text.replace('"margin": ', '"margin": 7.0, "margin": ', 1))
    said = run("verify", file)
    assert said.exit_code == 2
    assert "'margin' twice" in said.output


def test_units_are_taken_as_given_and_said():
    """A joint that pushes instead of turning is another problem: no claim, but an assumption."""
    made = base("tree")
    for joint in range(2):
        made = changed(made, "joints", joint, "unit", to="N")
    made = changed(made, "max_torque_unit", to="N")
    (said,) = [one for one in verify_document(made).checks if one.name == "units"]
    assert said.given
    assert said.detail == "SI, world axes; N: 'joint_1', 'joint_2'"


def test_resolution_and_limits_are_taken_as_given_and_said():
    given = {one.name: one.detail for one in verify_document(base("pressed")).checks if one.given}
    assert given["resolution of accelerations"] == (
        "0.001 times load over mass: points that accelerate by up to 0.00981 m/s^2 count as at rest"
    )
    assert given["limits"] == "normal forces 50 N; joints 0.2 N m"
    assert given["load"] == "force 9.81 N, moment 0 N m"
    assert given["inertias"] == "as they are stated"
