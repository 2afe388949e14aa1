"""Verdicts against the full enumeration of contact states: `make outcomes`.

A verdict contradicts the enumeration where one of them says that rest is an outcome and the other
that it is none, where an exact outcome moves the object faster than a strong verdict allows, and
where the motion of a weak verdict breaks a condition or nothing in the enumeration moves like it.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
from tests.oracles.outcome_cases import random_rest_case
from tests.oracles.outcomes import CLOSE, Answer, enumerate_outcomes, least_imbalance
from tests.oracles.rest_cases import Outcome, RestCase, worst_violation

from graspless_pin import (
    QuasistaticProblem,
    Stability,
    StabilityVerdict,
    maximize_margin,
    stability,
)

SECTORS = {2: 16, 3: 16, 4: 8}
NEAR_BALANCE = 1e-4
"""Forces that miss a balance by less, in loads, tell nothing."""
EXACT_MOTION = 1e-6
"""What a verdict's motion may break of a condition, in scaled units."""


class Comparison(NamedTuple):
    """One verdict beside the enumeration.

    Attributes:
        contacts: Of the scene.
        number: Of the scene.
        verdict: Its status.
        answer: The enumeration's status.
        fault: What contradicts; empty if nothing.
        seconds: Of the verdict and of the enumeration.
    """

    contacts: int
    number: int
    verdict: str
    answer: str
    fault: str
    seconds: tuple[float, float]


def outcome_case(contacts: int, number: int) -> tuple[RestCase, QuasistaticProblem]:
    """Return a seeded scene; the torques of every third are those of the largest margin."""
    rng = np.random.default_rng([8, contacts, number])
    fingers, joints = int(rng.integers(0, contacts + 1)), int(rng.integers(0, 4))
    case = random_rest_case(rng, contacts, fingers, joints)
    problem = QuasistaticProblem(
        case.positions,
        case.normals,
        case.external_wrench,
        case.jacobian,
        friction=case.friction,
        max_normal_force=1e3,
        torque_limits=(-1e2, 1e2),
        cone="round",
        object_inertia=case.object_inertia,
        joint_inertia=case.joint_inertia,
    )
    if number % 3 == 0 and len(case.torques):
        solution = maximize_margin(problem)
        if solution.found:
            return replace(case, torques=np.array(solution.torques)), problem
    return case, problem


def compared(contacts: int, number: int, sectors: int | None = None) -> Comparison:
    """Decide one scene both ways."""
    case, problem = outcome_case(contacts, number)
    start = time.process_time()
    verdict = stability(problem, case.torques)
    middle = time.process_time()
    answer = enumerate_outcomes(case, sectors=sectors or SECTORS[contacts])
    spent = (middle - start, time.process_time() - middle)
    fault = contradiction(case, verdict, answer)
    return Comparison(contacts, number, verdict.status.value, answer.status, fault, spent)


def contradiction(case: RestCase, verdict: StabilityVerdict, answer: Answer) -> str:
    """Say what a verdict claims that is not so; empty where it agrees or claims nothing."""
    limit = 1e-3 * case.load_over_mass
    says_rest = verdict.status in (Stability.STRONG, Stability.WEAK)
    if says_rest and answer.rest is False and least_imbalance(case) > NEAR_BALANCE:
        return f"rest is no outcome: forces miss a balance by {least_imbalance(case):.2g}"
    if verdict.status is Stability.NONE and answer.rest:
        return "rest is an outcome"
    if verdict.status is Stability.STRONG and answer.outcome is not None:
        speed = case.object_motion(answer.outcome.acceleration)
        if speed > verdict.acceleration_limit:
            return f"an outcome moves the object at {speed:.3g} m/s^2, the limit is {limit:.3g}"
    if verdict.motion is None:
        return "a weak verdict without a motion" if verdict.status is Stability.WEAK else ""
    motion = verdict.motion
    acceleration = np.concatenate([motion.object_acceleration, motion.joint_accelerations])
    outcome = Outcome(acceleration, motion.contact_forces)
    speed = case.object_motion(acceleration)
    if worst_violation(case, outcome) > EXACT_MOTION:
        return f"its motion breaks a condition by {worst_violation(case, outcome):.2g}"
    if not np.isclose(speed, motion.point_acceleration, rtol=1e-6):
        return f"its motion is {speed:.3g} m/s^2, not {motion.point_acceleration:.3g}"
    if answer.moving is False and speed > CLOSE * limit:
        return f"its motion of {speed:.3g} m/s^2 is no outcome: {answer.bound:.3g} is the most"
    return ""


def report(lines: Iterable[Comparison]) -> bool:
    """Print what was seen; return whether nothing contradicts."""
    wrong, tally, spent, count = 0, Counter[tuple[str, str]](), np.zeros(2), 0
    for line in lines:
        count += 1
        tally[line.verdict, line.answer] += 1
        spent += line.seconds
        if line.fault or "undecided" in line or "between" in line:
            wrong += bool(line.fault)
            print(*line[:4], line.fault and f"CONTRADICTION: {line.fault}")
    undecided = sum(n for (verdict, _), n in tally.items() if verdict == "undecided")
    between = sum(n for (_, answer), n in tally.items() if answer == "between")
    for (verdict, answer), seen in sorted(tally.items()):
        print(f"verdict {verdict}, enumeration {answer}: {seen}")
    print(f"{count} scenes: {wrong} contradictions, {undecided} undecided, {between} between")
    print(f"verdicts {spent[0]:.0f} s, enumeration {spent[1]:.0f} s")
    return not wrong


def main() -> None:
    """Compare and print; exit code 1 at a contradiction."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--few", type=int, default=300, help="scenes of 2 and 3 contacts")
    parser.add_argument("--four", type=int, default=30, help="scenes of 4 contacts")
    parser.add_argument("--jobs", type=int, default=2)
    options = parser.parse_args()
    contacts = [2 + number % 2 for number in range(options.few)] + [4] * options.four
    numbers = [*range(options.few), *range(options.four)]
    with ProcessPoolExecutor(options.jobs) as pool:
        passes = report(pool.map(partial(compared), contacts, numbers))
    sys.exit(0 if passes else 1)


if __name__ == "__main__":
    main()
