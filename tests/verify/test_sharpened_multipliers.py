"""Large multipliers and far limits: rounding that a bound would lose is kept out of documents."""

from dataclasses import replace

import numpy as np
import pytest
from tests.oracles.judging import ask
from tests.oracles.scale_scenes import scale_case
from verified_documents import documented

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.solution_proof import written_multipliers
from graspless_pin.report.verify import verify_document


@pytest.mark.parametrize("seed", [296, 373, 1198, 1560])
def test_bounds_of_large_multipliers_are_proven_in_documents(seed):
    """In 1560 fixed torques cancel against the balance, in 296 a slope leans to a far limit.

    In 373 torques of nearly zero need none.
    """
    case = scale_case(seed)
    solution = ask(case.problem, case.question)
    assert solution.found
    verification = verify_document(documented(solution))
    assert verification.proven, str(verification)


@pytest.mark.parametrize("noise", [1e-16, -1e-15, 1e-14])
def test_a_proof_that_rounding_leaves_open_is_closed(noise):
    """In 1198 the margin may be 1e8 loads, and the last digits of multipliers count as many."""
    case = scale_case(1198)
    solution = ask(case.problem, case.question)
    assert solution.evidence.relaxation is not None
    y, z = solution.evidence.relaxation
    size = noise * max(np.abs(y).max(), np.abs(z).max())
    spoilt = y + size, z + np.where(z > 0.0, size, 0.0)
    evidence = replace(solution.evidence, relaxation=spoilt)
    verification = verify_document(documented(replace(solution, evidence=evidence)))
    assert verification.proven, str(verification)


def test_multipliers_that_rounding_leaves_alone_stay_as_they_are():
    case = scale_case(0)
    solution = ask(case.problem, case.question)
    for written, own in zip(
        written_multipliers(solution), solution.scaled_multipliers, strict=True
    ):
        np.testing.assert_array_equal(written, own)


def test_smaller_multipliers_prove_the_same_bound():
    case = scale_case(1560)
    solution = ask(case.problem, case.question)
    program = formulate(case.problem, solution.objective).program
    before, after = solution.scaled_multipliers, written_multipliers(solution)
    assert sum(np.abs(one).sum() for one in after) < sum(np.abs(one).sum() for one in before)
    assert program.dual_bound(*after) == pytest.approx(program.dual_bound(*before), abs=1e-7)
