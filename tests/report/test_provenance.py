"""Hashes that tell problems apart, and a command that leads to the same answer."""

import hashlib
import json
import shlex

import numpy as np
import pytest
from report_cases import AT_REST, pinched_block, solved
from tests.cli.cli_tools import run

from graspless_pin import maximize_margin
from graspless_pin.report.provenance import (
    file_sha256,
    problem_sha256,
    same_problem,
    solve_command,
)

CHANGES = {
    "positions": [[0, -0.05, 0], [0, 0.05, 0], [0, 0.001, -0.05]],
    "normals": [[0, -1, 0], [0, -1, 0], [0, 0, 1]],
    "external_wrench": [0, 0, -4.9, 0, 0, 1],
    "jacobian": np.ones((9, 2)),
    "friction": 0.4,
    "sliding": [[0, 0, 0], [0, 0, 0], [0.1, 0, 0]],
    "torque_limits": (-2.0, 2.0),
    "max_normal_force": 20,
    "cone_edges": 8,
    "gravity_torques": [0, 0.1],
}


@pytest.mark.parametrize("name", CHANGES)
def test_every_array_counts(name):
    changed = pinched_block(**{name: CHANGES[name]})
    assert problem_sha256(changed) != problem_sha256(pinched_block())
    assert not same_problem(changed, pinched_block())


def test_the_same_problem_has_the_same_hash():
    assert problem_sha256(pinched_block()) == problem_sha256(pinched_block())
    negative = pinched_block(external_wrench=[-0.0, 0, -4.9, 0, -0.0, 0])
    assert problem_sha256(negative) == problem_sha256(pinched_block())
    moved = pinched_block(positions=np.asarray(pinched_block().positions) + 1e-13)
    assert same_problem(moved, pinched_block())
    assert problem_sha256(moved) != problem_sha256(pinched_block())


def test_files(tmp_path):
    file = tmp_path / "scene.yaml"
    file.write_bytes(b"friction: 0.3\n")
    assert file_sha256(file) == hashlib.sha256(b"friction: 0.3\n").hexdigest()
    assert file_sha256(tmp_path / "none.yaml") is None


@pytest.mark.parametrize(
    ("algorithm", "options"),
    [
        ("margin", {"static_friction": "coulomb"}),
        ("torque", {"margin": 0.3, "sign_rule": "exact"}),
        ("torque", {"margin": 1 / 3, "scale": "limits"}),
        ("torque", {"margin": 40.0}),
        ("margin", {"regularization": 0.01}),
        ("torque", {"margin": 0.3, "regularization": 0.02}),
    ],
)
def test_the_command_leads_to_the_same_answer(algorithm, options, tmp_path):
    _, solution = solved(AT_REST, algorithm, **options)
    command = solve_command(solution, AT_REST)
    assert command is not None
    program, *arguments = shlex.split(command)
    assert program == "graspless-pin"
    file = tmp_path / "again.json"
    result = run(*arguments, "--json", file)
    assert result.exit_code == (0 if solution.found else 1)
    again = json.loads(file.read_text(encoding="utf-8"))
    assert again["status"] == solution.status.name.lower()
    assert again["required_margin"] == solution.required_margin
    assert again["rules"]["sign_rule"] == str(solution.rules.sign)
    if solution.found:
        assert again["margin"] == pytest.approx(solution.margin, abs=1e-9)
        assert again["max_torque"] == pytest.approx(solution.max_torque, abs=1e-9)


def test_no_command_takes_a_given_mode():
    mode = maximize_margin(pinched_block()).mode
    _, solution = solved(AT_REST)
    given = maximize_margin(pinched_block(), mode=mode)
    assert given.found and solve_command(given, AT_REST) is None
    assert solve_command(solution, AT_REST) is not None
