"""The rule of directions held against turned tangents and against listing: `make directions`.

Turned: the tangents of seeded random scenes are turned at random about the normals; no optimum may
change by more than 1e-6, relative, beyond the gap that its certificate states. Listed: the optima
of scenes of two and three contacts lie within what `SectorListing` leaves open.
"""

from __future__ import annotations

import argparse
import sys
from typing import Any, NamedTuple

import numpy as np
from tests.core.random_scenes import general_scene, slope_scene
from tests.core.scenes import random_problem
from tests.oracles.sector_listing import Enclosure, SectorListing

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.solution import Status, TorqueSolution

MARGIN = 0.05
SAME = 1e-6
NODES = 2000
_GAP = 1.001e-4
_FAMILIES = (general_scene, slope_scene, random_problem)


class Turned(NamedTuple):
    """One optimum and that with turned tangents.

    Attributes:
        scene: Number of the scene.
        one: As it was.
        other: With turned tangents.
    """

    scene: int
    one: TorqueSolution
    other: TorqueSolution

    @property
    def agrees(self) -> bool:
        """Whether the two differ by no more than their gaps and 1e-6."""
        if not (self.one.found and self.other.found):
            unknown = {Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED}
            open_still = {self.one.status, self.other.status} & unknown
            return self.one.found is self.other.found or bool(open_still)
        return self.distance <= 0.0

    @property
    def distance(self) -> float:
        """By how much they differ beyond their gaps and 1e-6."""
        one, other = self.one.value, self.other.value
        gap = max(self.one.certificate.gap, self.other.certificate.gap)
        size = max(abs(one), 0.01 * unit_of(self.one))
        return abs(one - other) - gap - SAME * size

    @property
    def closed(self) -> bool:
        """Whether both searches came to the gap of 1e-4."""
        return all(
            not one.found or one.certificate.gap <= _GAP * max(abs(one.value), 0.01 * unit_of(one))
            for one in (self.one, self.other)
        )


def unit_of(solution: TorqueSolution) -> float:
    """Return what one of the scaled objective is, N or N m."""
    _, _, unit = solution.program
    return unit


def scene(number: int) -> QuasistaticProblem:
    """Return a seeded scene of two to six contacts."""
    family = _FAMILIES[number % 3]
    contacts = 2 + number // 3 % 5
    return family(number, max(contacts, 3) if family is slope_scene else contacts)


def with_turned_tangents(problem: QuasistaticProblem, seed: int) -> QuasistaticProblem:
    """Return the problem with each pair of tangents turned about its normal by a random angle."""
    turn = np.random.default_rng([7, seed]).uniform(0.0, 2.0 * np.pi, problem.contact_count)
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]]).transpose(2, 0, 1)
    return problem.with_changes(tangents=problem.tangents @ rotation)


def solved(problem: QuasistaticProblem, margin: float | None, **options: Any) -> TorqueSolution:
    """Solve by the rule of directions: for the margin, or at a margin for the torque."""
    given: dict[str, Any] = {"sign_rule": "direction", "node_limit": NODES, **options}
    if margin is None:
        return maximize_margin(problem, **given)
    return minimize_torque(problem, margin, **given)


def turned(number: int) -> Turned:
    """Solve a scene as it is and turned; Algorithms 1 and 2 take turns."""
    problem, margin = scene(number), (None, MARGIN)[number // 15 % 2]
    other = with_turned_tangents(problem, number)
    return Turned(number, solved(problem, margin), solved(other, margin))


class Listed(NamedTuple):
    """One optimum and what the listing says of it.

    Attributes:
        scene: Number of the scene.
        solution: The package's answer.
        listing: The listing's.
    """

    scene: int
    solution: TorqueSolution
    listing: Enclosure

    @property
    def agrees(self) -> bool:
        """Whether each one's answer is no better than the other's bound."""
        (inner, outer), solution = self.listing, self.solution
        sign = -1.0 if solution.objective.maximizes else 1.0
        room = SAME * unit_of(solution)
        bound = solution.certificate.bound
        if not np.isnan(inner) and not (solution.found and sign * bound <= sign * inner + room):
            return False
        return not solution.found or sign * solution.value >= sign * outer - room


def listed(number: int) -> Listed:
    """Solve and list a scene of two or three contacts; rules and algorithms take turns."""
    contacts, margin = 2 + int(number % 4 > 0), (None, MARGIN)[number % 2]
    slides = int(number % 5 == 4)
    problem = random_problem(number, contacts, slides=slides)
    if number % 3 == 2 and contacts == 3:
        problem = slope_scene(number, contacts)
    constrained = bool(slides) and number % 2 == 0
    rule = "constrained" if constrained else "exempt"
    listing = SectorListing(problem, margin, constrained).enclosure()
    return Listed(number, solved(problem, margin, sliding_rule=rule), listing)


def main() -> None:
    """Compare and print; exit code 1 where any two disagree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--turned", type=int, default=1000)
    parser.add_argument("--listed", type=int, default=100)
    options = parser.parse_args()
    pairs, wrong = [], []
    for number in range(options.turned):
        pair = turned(number)
        pairs.append((pair.one.found, pair.closed, pair.one.certificate.nodes))
        if not pair.agrees:
            wrong.append(f"turned {number}: {pair.one!r}, {pair.other!r}")
    found, closed, nodes = np.array(pairs, dtype=int).reshape(-1, 3).T
    if len(nodes):
        print(
            f"turned: {len(nodes)} scenes, {found.sum()} found, {(nodes > 1).sum()} split, "
            f"{len(nodes) - closed.sum()} not within 1e-4 in {NODES} nodes; "
            f"nodes: 99 % at most {np.percentile(nodes, 99):.0f}"
        )
    gaps, none = [], 0
    for number in range(options.listed):
        one = listed(number)
        if not one.agrees:
            wrong.append(f"listed {number}: {one.solution!r}, {one.listing}")
        none += not one.solution.found
        gaps.append(abs(one.listing.inner - one.listing.outer) / (abs(one.listing.outer) or 1.0))
    if gaps:
        inner = np.array(gaps)[~np.isnan(gaps)]
        print(
            f"listed: {len(gaps)} scenes, {none} infeasible; {len(inner)} with an inner value, "
            f"whose own gap is {np.median(inner):.1%} at the median"
        )
    print(f"{len(wrong)} disagree", *wrong, sep="\n")
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
