"""Which contacts keep just the margin and which joint is nearest its limit, by hand."""

import numpy as np
import pytest

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.solution.active_limits import (
    ContactLimit,
    contact_rooms,
    joint_limit_words,
    limiting_contacts,
    margin_limit_words,
)
from graspless_pin.solution.tables import friction_use


def pinch(**changes):
    """Two fingers of one joint each press a weightless ball from both sides along y."""
    values = {
        "positions": [[0, -0.05, 0], [0, 0.05, 0]],
        "normals": [[0, 1, 0], [0, -1, 0]],
        "external_wrench": [0, 0, 0, 0, 0, 0],
        "jacobian": [[0, 0], [-0.1, 0], [0, 0], [0, 0], [0, 0.1], [0, 0]],
        "friction": [0.5, 0.5],
        "max_normal_force": 10.0,
        "torque_limits": ([-2.0, -1.0], [2.0, np.inf]),
        "joint_names": ["left", "right"],
    } | changes
    return QuasistaticProblem(**values)


def test_what_limits_a_pinch():
    """Of f_n = 10 - e = slope f_n / sqrt(1 + slope^2) / ... the sides decide together."""
    solution = maximize_margin(pinch())
    rooms = contact_rooms(solution.problem, solution.contact_forces)
    assert rooms.min() == pytest.approx(solution.margin)
    slope = 0.5 * np.cos(np.pi / solution.problem.cone_edges)
    normal = solution.problem.normals[0] @ solution.contact_forces[0]
    expected = [normal, 10.0 - normal, slope * normal / np.sqrt(1.0 + slope**2)]
    np.testing.assert_allclose(rooms[0], expected, rtol=1e-6)
    assert limiting_contacts(solution) == {
        ContactLimit.PRESS: [0, 1],
        ContactLimit.SLIP: [0, 1],
    }
    assert margin_limit_words(solution, ["thumb", "index"]) == (
        "The margin is limited by the distance to its normal-force limit at contacts 0, 1 "
        "(thumb, index) and by available friction at contacts 0, 1 (thumb, index)."
    )


def test_slipping_is_told_where_friction_is_used():
    """A weight across the pinch: both fingers use friction to bear it."""
    solution = maximize_margin(pinch(external_wrench=[0, 0, -5, 0, 0, 0], max_normal_force=8.0))
    use = friction_use(solution.problem, solution.contact_forces)
    assert (use > 0.5).all()
    assert "by the distance to slipping at contacts 0, 1." in margin_limit_words(solution)
    assert "available" not in margin_limit_words(solution)


def test_a_contact_without_friction_is_lost_first():
    solution = minimize_torque(pinch(friction=[0.0, 0.5]), margin=0.1)
    assert ContactLimit.SLIP not in limiting_contacts(maximize_margin(pinch(friction=[0.0, 0.0])))
    (limit, contacts), *_ = limiting_contacts(solution).items()
    assert (limit, contacts) == (ContactLimit.SLIP, [1])
    assert margin_limit_words(solution) == (
        "The margin is limited by available friction at contact 1. At contact 0, without friction, "
        "it counts only the normal force."
    )


def test_of_many_at_the_margin_those_are_named_whose_room_counts():
    """Three legs of a table, two of which the load presses less."""
    corners = [[0.1, 0, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1]]
    for cone in ("edges", "round"):
        table = QuasistaticProblem(
            corners, [[0, 0, 1]] * 3, [0.3, 0, -5, 0, 0.1, 0], friction=0.5, cone=cone
        )
        solution = maximize_margin(table)
        named = limiting_contacts(solution)[ContactLimit.SLIP]
        more = table.with_changes(friction=[0.5 + 0.01 * (i in named) for i in range(3)])
        assert maximize_margin(more).margin > solution.margin


def test_the_joint_nearest_its_limit():
    solution = maximize_margin(pinch())
    share = np.abs(solution.torques[1])
    assert joint_limit_words(solution) == (
        f"Joint right is nearest its limit: {solution.torques[1]:+.4f} of -1 N m, "
        f"{100.0 * share:.1f} %."
    )
    full = maximize_margin(pinch(torque_limits=(-0.4, 0.4)))
    assert joint_limit_words(full).endswith(" N m, 100.0 %; nothing is left for feedback to add.")
    free = maximize_margin(pinch(torque_limits=([-np.inf] * 2, [np.inf] * 2)))
    assert (
        joint_limit_words(free)
        == "No joint has a finite limit other than zero on the side of its torque."
    )
    none = QuasistaticProblem([[0, 0, -1]], [[0, 0, 1]], [0, 0, -1, 0, 0, 0], friction=0.5)
    assert joint_limit_words(maximize_margin(none)) == ""
    # A table that bears the load: the fingers' torques are zero, and none is near a limit.
    far = QuasistaticProblem(
        [[0, 0, -1]], [[0, 0, 1]], [0, 0, -1, 0, 0, 0], np.zeros((3, 1)), friction=0.5,
        torque_limits=([-1.0], [1.0]),
    )  # fmt: skip
    assert joint_limit_words(maximize_margin(far)) == ""
