"""Parts of all modes: whatever splits or closes them, no feasible mode is lost."""

from itertools import islice

import numpy as np
import pytest
from random_scenes import slope_scene
from scenes import scene

from graspless_pin import QuasistaticProblem, SlidingMode, enumerate_modes
from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.mode_oracle import ModeOracle
from graspless_pin.algorithms.mode_tree import ModePart, ModeTree
from graspless_pin.modes.rules import Rules
from graspless_pin.programs.objectives import Margin
from graspless_pin.solution.certificate import ConflictSplit


def stiff_cuboid() -> QuasistaticProblem:
    """The paper's cuboid at rest between fingers that cannot move."""
    return scene("rest").with_changes(
        jacobian=np.zeros((18, 0)), torque_limits=(-1, 1), joint_names=[], gravity_torques=[]
    )


def turning_about_a_corner() -> QuasistaticProblem:
    """A plate on four feet, the last of which two stops hold in place."""
    feet = [(-0.1, -0.1, 0.0), (0.1, -0.1, 0.0), (-0.1, 0.1, 0.0), (0.1, 0.1, 0.0)]
    stops = [(0.15, 0.1, 0.0), (0.1, 0.15, 0.0)]
    normals = np.array([(0, 0, 1)] * 4 + [(-1, 0, 0), (0, -1, 0)], dtype=float)
    first = np.array([(0.8, 0.6, 0)] * 4 + [(0, 0.8, 0.6), (0.8, 0, 0.6)])
    tangents = np.stack([first, np.cross(normals, first)], axis=2)
    return QuasistaticProblem(
        [*feet, *stops], normals, [0, 0, -10, 0, 0, 0], friction=0.5, tangents=tangents
    )


PROBLEMS = {
    "stiff": stiff_cuboid,
    "corner": turning_about_a_corner,
    "sliding": lambda: scene("up"),
    "slope-5": lambda: slope_scene(2, 5),
}


def holds(part: ModePart, mode: SlidingMode) -> bool:
    """Whether a mode belongs to a part."""
    chosen = mode.selection
    return bool(
        not (part.selected & ~chosen).any()
        and not (part.released & chosen).any()
        and all(
            part.allowed_signs[c, k, mode.signs[c, k] + 1]
            for c in np.flatnonzero(chosen)
            for k in range(2)
        )
    )


@pytest.mark.sampled(6)
@pytest.mark.parametrize("sign", ["strict", "nonzero", "exact"])
@pytest.mark.parametrize("name", PROBLEMS)
def test_no_split_and_no_exclusion_loses_a_mode(name, sign):
    """Down random ways through the tree: each mode of a part is in one child, and in one alone."""
    problem, rng = PROBLEMS[name](), np.random.default_rng(7)
    rules = Rules.parse(sign, "constrained" if name == "sliding" else "exempt")
    listed = enumerate_modes(problem, sign_rule=sign, sliding_rule=rules.sliding)
    modes = list(islice(listed, 0, 600, 3))
    formulation = formulate(problem, Margin())
    tree, oracle = ModeTree(formulation, rules), ModeOracle(formulation, rules)
    kinds = set()
    for _ in range(6):
        part, inside = ModePart.every_mode(problem, rules), modes
        while True:
            excluded = tree.exclusion(part)
            if excluded is not None:
                assert not inside
                kinds.add("excluded")
                break
            lb, ub = tree.bounds(part)
            x = np.clip(rng.normal(size=len(lb)), lb, ub)
            split = tree.split(part, x, oracle.conflict_for(x, part))
            if split is None:
                assert len(inside) <= 1
                break
            kinds.add(type(split[0]))
            for mode in inside:
                assert sum(holds(child, mode) for child in split[1]) == 1
            if not split[1]:
                break
            part = split[1][rng.integers(len(split[1]))]
            inside = [mode for mode in inside if holds(part, mode)]
    # Between fingers and stops that cannot move, most friction has no motion behind it.
    assert ConflictSplit in kinds or name not in ("stiff", "corner")
