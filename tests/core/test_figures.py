"""How figures are printed: what is nothing is 0, and what is something has digits."""

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scenes import rescaled, scene

from graspless_pin import load_scene, maximize_margin, minimize_torque
from graspless_pin.algorithms.force_bounds import contact_force_bounds
from graspless_pin.report import scene_solution_text
from graspless_pin.solution.tables import decimals, figure


@pytest.mark.parametrize(
    ("value", "size", "sign", "text"),
    [
        (0.0, 1.0, "+", "0"),
        (-0.0, 1.0, "+", "0"),
        (-1e-8, 2.9, "", "0"),
        (0.7, 0.7, "+", "+0.7000"),
        (2e-5, 0.5, "+", "+2.0e-05"),
        (-2e-5, 0.5, "", "-2.0e-05"),
        (1e-9, 0.5, "+", "0"),
        (1e-9, 1e-9, "+", "+1e-09"),
        (123.456789, 1e8, "", "123.46"),
        (9.0, 1e8, "+", "0"),
    ],
)
def test_figures_beside_others(value, size, sign, text):
    assert decimals(value, size, sign) == text


@given(st.floats(-1e9, 1e9), st.floats(1e-9, 1e9), st.sampled_from(["", "+"]))
def test_a_figure_is_zero_or_has_digits(value, size, sign):
    for text in (decimals(value, size, sign), figure(value, size)):
        told = float(text)
        if abs(value) <= 1e-7 * size:
            assert text == "0"
        else:
            assert told * value > 0.0
            assert told == pytest.approx(value, rel=0.06 if abs(value) < 1e-3 else 0.5, abs=5e-5)


def test_the_margin_at_worst_prints_no_rounding(tmp_path):
    """The first scene of the README printed -1e-08 N."""
    readme = (Path(__file__).parents[2] / "README.md").read_text(encoding="utf-8")
    file = tmp_path / "block.yaml"
    file.write_text(readme.partition('title="block.yaml"')[2].partition("```")[0], encoding="utf-8")
    found = load_scene(file)
    problem = found.problem().with_changes(cone_edges=6)
    solution = minimize_torque(problem, 0.2)
    bounds = contact_force_bounds(problem, solution.torques)
    assert "enforce that margin: it may be as small as 0 N, " in scene_solution_text(
        found, solution, "", bounds
    )


@pytest.mark.parametrize("weight", [1e-6, 1.0, 1e6])
def test_tables_print_neither_signed_zeros_nor_rounding(weight):
    problem = rescaled(scene("rest"), weight)
    for solution in (maximize_margin(problem), minimize_torque(problem, 0.1 * weight)):
        cells = str(solution).partition("joint ")[2].partition("point [m]")[0].split()
        assert not {"+0", "-0", "+0.0000", "-0.0000"}.intersection(cells)
        row = next(line for line in str(solution).splitlines() if line.startswith("joint_1"))
        assert float(row.split()[3]) == pytest.approx(solution.torques[0], rel=1e-3)
        assert np.all([float(cell) != 0.0 or cell == "0" for cell in row.split()[1:6]])
