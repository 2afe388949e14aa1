"""Seeded random bodies under a declared motion, and their verdicts beside the enumeration.

`make kept-outcomes` compares many. Forces with the given sliding balance load and torques, or in a
third of the cases nearly so; every second case has three times the friction, up to 3: Painleve's
paradox is among them.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import partial

import numpy as np
from tests.oracles.kept_outcomes import KeptEnumeration
from tests.oracles.outcome_cases import random_rest_case
from tests.oracles.rest_cases import Array, RestCase

from graspless_pin import QuasistaticProblem, Stability, stability


def kept_problem(contacts: int, number: int) -> tuple[RestCase, Array, QuasistaticProblem]:
    """Return a case, the (M, 3) velocities of its sliding, and the problem.

    Args:
        contacts: M, from 2.
        number: Of the case.
    """
    rng = np.random.default_rng([number, contacts, 77])
    fingers = int(rng.integers(0, contacts))
    case = random_rest_case(rng, contacts, fingers, int(rng.integers(1, 4)))
    slides = np.arange(contacts) < rng.integers(1, contacts - fingers + 1)
    if number % 2:
        case = replace(case, friction=3.0 * case.friction)
    across = np.cross(case.normals, rng.normal(size=(contacts, 3)))
    across /= np.linalg.norm(across, axis=1)[:, None]
    sliding = np.where(slides[:, None], rng.uniform(0.01, 1.0, (contacts, 1)) * across, 0.0)
    share = np.where(slides, 1.0, rng.uniform(0.0, 1.0, contacts))
    press = rng.uniform(0.2, 2.0, (contacts, 1)) * case.load_over_mass
    forces = press * (case.normals - (case.friction * share)[:, None] * across)
    torques = case.jacobian.T @ forces.ravel()
    if rng.random() < 0.3:
        torques = torques * rng.uniform(0.5, 1.5)
    wrench = -case.point_motions[1:].reshape(-1, 6).T @ forces.ravel()
    case = replace(case, external_wrench=wrench, torques=torques)
    problem = QuasistaticProblem(
        case.positions, case.normals, case.external_wrench, case.jacobian, friction=case.friction,
        sliding=sliding, cone="round", object_inertia=case.object_inertia,
        joint_inertia=case.joint_inertia, torque_limits=(-np.inf, np.inf),
    )  # fmt: skip
    return case, sliding, problem


def compared(contacts: int, sectors: int, number: int) -> tuple[str, str]:
    """Return a verdict's status, and in what it contradicts the enumeration; empty: in nothing."""
    case, sliding, problem = kept_problem(contacts, number)
    said = stability(problem, case.torques)
    answer = KeptEnumeration(case, sliding, sectors, said.acceleration_limit).run()
    fault = ""
    if said.status is not Stability.UNDECIDED:
        if answer.kept is (said.status is Stability.NONE):
            fault = f"balance: {answer.kept}"
        elif said.status is not Stability.NONE and answer.moving is (said.motion is None):
            fault = f"motion: {answer.moving}"
        elif said.status is Stability.NONE and answer.moving is False and said.motion is not None:
            fault = "a motion that is none"
    return str(said.status), fault


def main() -> int:
    """Compare many cases on all processors."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--contacts", type=int, default=3)
    parser.add_argument("--sectors", type=int, default=8)
    parser.add_argument("--cases", type=int, default=100)
    parser.add_argument("--processes", type=int, default=2)
    given = parser.parse_args()
    with ProcessPoolExecutor(given.processes) as pool:
        compare = partial(compared, given.contacts, given.sectors)
        answers = list(pool.map(compare, range(given.cases)))
    faults = [(number, *answer) for number, answer in enumerate(answers) if answer[1]]
    for number, status, fault in faults:
        print(f"{given.contacts} contacts, case {number}: {status}, but {fault}")
    counts = Counter(status for status, _ in answers)
    print(f"{given.contacts} contacts: {len(faults)} faults in {dict(counts)}")
    return int(bool(faults))


if __name__ == "__main__":
    sys.exit(main())
