"""Round cones against CVXPY's model: `make round-cones`.

Each seeded scene is solved for both algorithms under Coulomb's law alone and over all modes; the
first has to agree with the model, the second with the model in the mode that was found, and with
the listing of all modes.
"""

from __future__ import annotations

import argparse
import sys
from collections import Counter
from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from tests.core.random_scenes import general_scene, slope_scene
from tests.oracles.conic_model import conic_optimum

from graspless_pin import QuasistaticProblem, maximize_margin, minimize_torque
from graspless_pin.solution import TorqueSolution

MARGIN = 0.05
AGREE = 1e-6
CONTACTS = (3, 4, 5, 6)


class Comparison(NamedTuple):
    """One optimum beside the model's.

    Attributes:
        scene: Number of the scene.
        what: Which algorithm and rule.
        ours: The package's optimum; None: nothing is feasible.
        theirs: The model's; NaN: SCS did not come to its accuracy.
    """

    scene: int
    what: str
    ours: float | None
    theirs: float | None

    @property
    def error(self) -> float:
        """Relative distance of the two; inf where only one found something, NaN where unknown."""
        if self.theirs is not None and np.isnan(self.theirs):
            return np.nan
        if self.ours is None or self.theirs is None:
            return 0.0 if self.ours is self.theirs else np.inf
        return abs(self.ours - self.theirs) / max(abs(self.theirs), 1e-3)


def round_scene(number: int) -> QuasistaticProblem:
    """Return a seeded scene with round cones."""
    family = general_scene if number % 2 else slope_scene
    return family(number, CONTACTS[number % len(CONTACTS)]).with_changes(cone="round")


def comparisons(number: int) -> Iterator[Comparison]:
    """Solve one scene in all ways."""
    problem = round_scene(number)
    for algorithm, margin in (("margin", None), ("torque", MARGIN)):
        found = _solved(problem, margin, static_friction="coulomb")
        theirs = conic_optimum(problem, margin)
        if margin is None and theirs is not None and theirs < 0.0:
            theirs = None
        yield Comparison(number, f"{algorithm}, Coulomb", _value(found), theirs)
        found = _solved(problem, margin)
        if found.found:
            theirs = conic_optimum(problem, margin, found.mode)
            yield Comparison(number, f"{algorithm}, in its mode", _value(found), theirs)
        listed = _solved(problem, margin, search="enumerate")
        yield Comparison(number, f"{algorithm}, all modes", _value(found), _value(listed))


def _solved(problem: QuasistaticProblem, margin: float | None, **options: Any) -> TorqueSolution:
    if margin is None:
        return maximize_margin(problem, **options)
    return minimize_torque(problem, margin, **options)


def _value(solution: TorqueSolution) -> float | None:
    return solution.value if solution.found else None


def main() -> None:
    """Compare and print; exit code 1 where any two disagree."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--count", type=int, default=300)
    count = parser.parse_args().count
    tally: Counter[str] = Counter()
    worst, wrong, open_still = 0.0, [], 0
    for number in range(count):
        for one in comparisons(number):
            tally[one.what] += one.ours is not None
            if np.isnan(one.error):
                open_still += 1
            elif one.error > AGREE:
                wrong.append(one)
            else:
                worst = max(worst, one.error)
    print(f"{count} scenes; optima compared: {dict(tally)}")
    print(f"{len(wrong)} disagree by more than {AGREE:g}; worst of the others {worst:.1e}")
    print(f"{open_still} that SCS did not solve to its accuracy")
    for one in wrong:
        print(one)
    sys.exit(1 if wrong else 0)


if __name__ == "__main__":
    main()
