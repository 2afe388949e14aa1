"""Wrenches of libraries that put moments first."""

import numpy as np
import pytest

from graspless_pin.errors import ArgumentError
from graspless_pin.problem.wrenches import force_first, moment_first

FORCE, MOMENT = [1.0, 2.0, 3.0], [-0.1, 0.2, 0.3]


def test_each_order_becomes_the_other():
    np.testing.assert_array_equal(moment_first([*FORCE, *MOMENT]), [*MOMENT, *FORCE])
    np.testing.assert_array_equal(force_first([*MOMENT, *FORCE]), [*FORCE, *MOMENT])


def test_several_wrenches_are_reordered_row_by_row():
    rows = np.arange(18.0).reshape(3, 6)
    expected = rows[:, [3, 4, 5, 0, 1, 2]]
    np.testing.assert_array_equal(moment_first(rows), expected)
    np.testing.assert_array_equal(force_first(expected), rows)


def test_the_argument_is_left_alone():
    wrench = np.array([*FORCE, *MOMENT])
    swapped = moment_first(wrench)
    swapped[0] = 7.0
    np.testing.assert_array_equal(wrench, [*FORCE, *MOMENT])


@pytest.mark.parametrize(
    ("wrench", "found"),
    [
        ([1.0, 2.0, 3.0], r"has shape \(3,\); expected \(6,\)"),
        (np.zeros((6, 5)), r"has shape \(6, 5\); expected \(any, 6\)"),
        (5.0, r"has shape \(\); expected"),
        ([[1.0] * 6, [1.0]], r".* it must be an array of real numbers"),
        ([0, 0, 0, 0, 0, float("nan")], r"is NaN at index \(5,\)"),
    ],
)
def test_what_is_no_wrench_is_refused(wrench, found):
    for convert in (moment_first, force_first):
        with pytest.raises(ArgumentError, match=f"wrench: {found}"):
            convert(wrench)
