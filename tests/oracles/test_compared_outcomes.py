"""The comparison sees verdicts that are wrong, and motions that are none."""

from dataclasses import replace

import numpy as np
import pytest
from tests.oracles.compared_outcomes import compared, contradiction, outcome_case, report
from tests.oracles.outcomes import enumerate_outcomes
from tests.oracles.test_outcomes import slot

from graspless_pin import QuasistaticProblem, Stability, stability


def walls(friction):
    """A body between two walls: weak, or none where they are smooth."""
    case = slot(friction)
    problem = QuasistaticProblem(
        case.positions, case.normals, case.external_wrench, friction=case.friction, cone="round",
        object_inertia=case.object_inertia,
    )  # fmt: skip
    return case, stability(problem, []), enumerate_outcomes(case, sectors=8)


def test_right_verdicts_pass():
    for friction, status in ((0.5, Stability.WEAK), (0.0, Stability.NONE)):
        case, verdict, answer = walls(friction)
        assert verdict.status is status
        assert contradiction(case, verdict, answer) == ""


@pytest.mark.parametrize(
    ("friction", "claim", "fault"),
    [
        (0.5, Stability.STRONG, "an outcome moves the object"),
        (0.5, Stability.NONE, "rest is an outcome"),
        (0.0, Stability.STRONG, "rest is no outcome"),
        (0.0, Stability.WEAK, "rest is no outcome"),
    ],
)
def test_wrong_verdicts_are_seen(friction, claim, fault):
    case, verdict, answer = walls(friction)
    assert fault in contradiction(case, replace(verdict, status=claim), answer)


def test_motions_that_are_none_are_seen():
    case, verdict, answer = walls(0.5)
    motion = verdict.motion
    assert motion is not None
    faster = replace(motion, object_acceleration=1.01 * motion.object_acceleration)
    boasting = replace(motion, point_acceleration=2.0 * motion.point_acceleration)
    pressed = replace(motion, contact_forces=motion.contact_forces + case.normals)
    for forged, fault in (
        (faster, "breaks a condition"),
        (pressed, "breaks a condition"),
        (boasting, "m/s^2, not"),
        (None, "without a motion"),
    ):
        assert fault in contradiction(case, replace(verdict, motion=forged), answer)
    held = answer._replace(moving=False, outcome=None)
    assert "is no outcome" in contradiction(case, verdict, held)


def test_a_report_with_a_contradiction_does_not_pass(capsys):
    line = compared(2, 1)
    assert report([line])
    assert not report([line, line._replace(fault="rest is an outcome")])
    assert "1 contradictions" in capsys.readouterr().out


def test_scenes_are_the_same_each_time():
    first, second = outcome_case(3, 5)[0], outcome_case(3, 5)[0]
    np.testing.assert_array_equal(first.jacobian, second.jacobian)
    np.testing.assert_array_equal(first.torques, second.torques)
