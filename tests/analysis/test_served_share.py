"""The largest part of a set that is served, against plain bisection and members of smaller sets."""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from analysis_scenes import contacts_alone

from graspless_pin import Uncertainty, load_scene, minimize_torque, served_share
from graspless_pin.algorithms import attainable_tolerances as module
from graspless_pin.algorithms.options import SolveOptions
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution
from graspless_pin.algorithms.robust_torques import solve_robust
from graspless_pin.algorithms.uncertain_members import members_of, weight_of_arrays
from graspless_pin.problem.members import join_members
from graspless_pin.programs.objectives import Torque
from graspless_pin.report.robust import robust_sentences
from graspless_pin.scene.robust_answer import robust_answer

COULOMB: dict[str, Any] = {"static_friction": "coulomb"}


@pytest.mark.parametrize(
    ("name", "given"),
    [
        ("allegro_box_on_slope", {"mass": 0.6, "center_of_mass": 0.06}),
        ("paper/sphere_on_slope", {"mass": 0.2, "center_of_mass": 0.01, "force_radius": 0.3}),
        ("paper/cuboid_sliding_up", {"mass": 0.3, "friction": 0.4, "effort": 0.7}),
    ],
)
def test_the_share_is_that_of_plain_bisection(name, given):
    problem, unknown = contacts_alone(name), Uncertainty(**given)
    objective, how = Torque(0.05), SolveOptions.parse(**COULOMB)

    def serves(share):
        return solve_robust(problem, objective, unknown.scaled(share), how).found

    low, high = 0.0, 1.0
    assert serves(low) and not serves(high)
    while high - low > 1e-3:
        middle = 0.5 * (low + high)
        low, high = (middle, high) if serves(middle) else (low, middle)
    share = served_share(problem, objective, unknown, **COULOMB)
    assert share == pytest.approx(low, abs=1.5e-3)
    assert serves(share) and not serves(share + 1.5e-3)


@pytest.mark.parametrize(
    "given",
    [
        {"mass": 0.2, "center_of_mass": 0.01, "torque": 0.1, "torque_offset": 0.02},
        {"mass": 0.2, "friction": 0.3, "effort": 0.2, "force": 0.5},
        {"tilt": 0.3, "moment": 0.1},
    ],
)
def test_members_of_smaller_sets_are_made_of_those_of_larger_ones(given):
    """Each is one of the corners that the smaller set has itself."""
    problem = contacts_alone("paper/cuboid_sliding_up")
    if "tilt" in given:
        problem = contacts_alone("paper/cuboid_at_rest")
    unknown, weight = Uncertainty(**given), weight_of_arrays(problem)
    members = members_of(problem, unknown, weight)
    nothing = minimize_torque(problem, 0.05, **COULOMB)
    failed = RobustSolution(
        nothing, Coverage.CORNERS, np.nan, members, problem.joint_names, (*range(len(members)),),
        uncertainty=unknown, weight=weight,
    )  # fmt: skip
    smaller = module.smaller_conflict(failed, 0.5)
    own = {_told(one).round(9).tobytes() for one in members_of(problem, unknown.scaled(0.5))}
    assert {_told(one).round(9).tobytes() for one in smaller} >= own
    assert len(smaller) == len(members)


def _told(member):
    problem = member.problem
    parts = (
        problem.external_wrench, problem.friction, problem.gravity_torques, problem.lower_torque,
        problem.upper_torque, member.factors, member.offsets,
    )  # fmt: skip
    return np.concatenate(parts) + 0.0


def test_members_in_conflict_at_the_failing_size_are_told():
    problem = contacts_alone("paper/sphere_on_slope")
    unknown, how = Uncertainty(mass=0.2, center_of_mass=0.01), SolveOptions.parse(**COULOMB)
    objective, sizes = Torque(0.1), []

    def solved(share):
        sizes.append(share)
        return solve_robust(problem, objective, unknown.scaled(share), how)

    found = module.largest_share(solved, solved(1.0))
    assert 0.0 < found.failing - found.served <= 1e-3
    assert len(found.conflict) >= 2
    assert not minimize_torque(join_members(found.conflict), 0.1, **COULOMB).found
    assert found.best is not None and found.best.found
    # No size was solved for twice.
    assert all(first < second for first, second in pairwise(sorted(sizes)))


def test_the_time_for_the_share_is_told():
    unknown = Uncertainty(mass=0.2, center_of_mass=0.01)
    scene = load_scene("examples/paper/sphere_on_slope.yaml").with_changes(uncertainty=unknown)
    answer = robust_answer(scene, "torque", share_time=0.0, margin=0.1, **COULOMB)
    assert (answer.served_share, answer.unserved_share) == (0.0, 1.0)
    said = " ".join(robust_sentences(answer))
    assert "Whether more is, up to 100 %, was not decided" in said
    assert "No part of the set" not in said
