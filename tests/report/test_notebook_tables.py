"""Results as notebooks show them."""

import re

import numpy as np
import pytest
from report_cases import (
    ALLEGRO,
    AT_REST,
    SLIDING,
    micro_block,
    pinched_block,
    read_html,
    solved,
    through_json,
)

from graspless_pin import (
    compare_rules,
    contact_force_bounds,
    maximize_margin,
    minimize_torque,
)
from graspless_pin.report.verify import verify_document


def test_a_solution_has_its_tables():
    _, solution = solved(SLIDING)
    joints, contacts = read_html(solution._repr_html_()).all("table")
    torques = [float(row[3]) for row in joints.rows()]
    np.testing.assert_allclose(torques, solution.torques, atol=5.1e-5)
    assert [row[3].endswith(" %") for row in contacts.rows()] == [True] * 2 + [False] * 4
    assert {row[3] for row in contacts.rows()[2:]} == {"sliding"}
    paragraphs = [item.text for item in read_html(solution._repr_html_()).all("p")]
    assert "margin e = 2.3000" in paragraphs[0] or "margin e = 2.3001" in paragraphs[0]
    assert paragraphs[-1].startswith("certificate: ")
    # Without joints there is no joint table.
    solution = maximize_margin(pinched_block(jacobian=None, torque_limits=(-1.0, 1.0)))
    assert len(read_html(solution._repr_html_()).all("table")) == 1


def test_an_infeasible_one_says_why():
    _, solution = solved(AT_REST, "torque", margin=40.0)
    shown = read_html(solution._repr_html_())
    assert not shown.all("table")
    for line in solution.explanation.splitlines():
        assert line in shown.text


def test_ranges_that_were_not_searched_for_are_no_figures():
    solution = solved(ALLEGRO, "torque", margin=0.4)[1]
    margins = contact_force_bounds(solution.problem, solution.torques, ranges=False)
    text = str(margins)
    assert text.count("not searched") == np.isnan(margins.lower).sum() and "nan" not in text


def test_zero_reads_as_zero():
    """Neither the rounding of zero nor a minus before it."""
    solution = minimize_torque(pinched_block(), margin=0.0)
    assert 0.0 < abs(solution.margin) < 1e-8
    assert "margin e = 0 N, max |torque| = " in str(solution)
    solution = solved(ALLEGRO, "torque", margin=0.4)[1]
    ranges = contact_force_bounds(solution.problem, solution.torques)
    assert abs(ranges.smallest_margin) < 1e-8 and "margin between 0 and 0.4 N" in str(ranges)
    shown = f"{solution}\n{verify_document(through_json(solution))}\n{ranges}"
    assert not re.search(r"-0(\.0+)?(e[+-]00)?(?![.\d])", shown)


def test_names_are_neither_markup_nor_mathematics():
    """Notebooks set what stands between dollar signs, unless it is marked."""
    solution = maximize_margin(pinched_block(joint_names=["$\\frac$<b>", "a$b$c & d"]))
    shown = read_html(solution._repr_html_())
    joints, contacts = shown.all("table")
    assert [row[0] for row in joints.rows()] == ["$\\frac$<b>", "a$b$c & d"]
    for element in (joints, contacts, *shown.all("p")):
        assert {"tex2jax_ignore", "mathjax_ignore"} <= set(str(element.attributes["class"]).split())


def test_rules_are_compared_with_digits_at_every_scale():
    """A millionth of the force on a thousandth of the length: figures, and no zeros."""
    compared = compare_rules(micro_block(), "torque", margin=1e-7)
    table = read_html(compared._repr_html_()).all("table")[0]
    for row, solution in zip(table.rows(), compared.solutions.values(), strict=True):
        assert float(row[1]) == pytest.approx(solution.margin, rel=1e-4)
        assert float(row[2]) == pytest.approx(solution.max_torque, rel=1e-4)
        assert row[1] in str(compared)
    everyday = compare_rules(pinched_block(), "torque")
    assert re.search(r"\b0\.1000\b", everyday._repr_html_())


def test_force_ranges():
    _, solution = solved(SLIDING)
    bounds = contact_force_bounds(solution.problem, solution.torques)
    shown = read_html(bounds._repr_html_())
    (table,) = shown.all("table")
    for row, lower, upper in zip(table.rows(), bounds.lower, bounds.upper, strict=True):
        for text, low, high in zip(row[1:], lower, upper, strict=True):
            ends = [float(part) for part in text.split(" .. ")]
            assert ends == pytest.approx([low, high], abs=5.1e-5)
    assert "margin between" in shown.all("p")[0].text
    nothing = contact_force_bounds(solution.problem, np.array([9.0, 9.0]))
    assert not nothing.found
    assert read_html(nothing._repr_html_()).text == str(nothing)


def test_rules_side_by_side():
    compared = compare_rules(solved(SLIDING)[1].problem)
    (table,) = read_html(compared._repr_html_()).all("table")
    rows = table.rows()
    assert len(rows) == 9 and rows[-1][0] == "coulomb"
    assert [row[0] for row in rows if row[-1] == "round cones"] == [row[0] for row in rows[6:8]]
    assert rows[0][1] == "2.3001"
    assert rows[1][1] == "-" and rows[1][3].startswith("infeasible")
