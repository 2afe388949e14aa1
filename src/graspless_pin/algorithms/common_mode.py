"""The best mode of virtual sliding that all members of a set have in common.

Their forces are sets of forces that one mode rules: the search over modes of one member bounds the
program of all, and ends after about as many nodes as that of one member.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

from graspless_pin.algorithms.formulation import formulate
from graspless_pin.algorithms.options import Limits, SolveOptions
from graspless_pin.algorithms.search import SearchState
from graspless_pin.algorithms.searching import search_modes
from graspless_pin.modes.kinematics import THRESHOLD, VirtualKinematics
from graspless_pin.modes.rules import SlidingMode
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.members import Member
from graspless_pin.programs.objectives import Objective

_CLEAR = 1.001
"""Of the threshold: slower motions may be refused to all members together."""


def common_mode(
    together: QuasistaticProblem,
    members: Sequence[Member],
    objective: Objective,
    options: SolveOptions,
) -> SlidingMode | None:
    """Return the mode in which all members together have the best optimum.

    Args:
        together: Their joined problem.
        members: They differ in loads, coefficients of friction and what motors make of commands,
            and so have the same virtual motions.
        objective: What is optimised.
        options: How, with signs.

    Returns:
        The best mode, of one member; None: there is none, or it was not found within the limits.
    """
    whole, own = formulate(together, objective), formulate(members[0].problem, objective)
    size, count = own.coordinates.layout.size, len(members)
    layered = replace(
        own,
        kinematics=common_motions(own.problem, count),
        program=whole.program,
        unit=whole.unit,
        layers=tuple(size * number for number in range(count)),
    )
    state = SearchState(layered, options.rules, options.solver)
    return search_modes(state, options, Limits.of(options)).state.mode


def common_motions(problem: QuasistaticProblem, count: int) -> VirtualKinematics:
    """Return the virtual motions that a mode of so many members may have in common.

    All of them move at once behind a mode of their joined problem: their velocities add up.
    """
    return VirtualKinematics(problem, _CLEAR * THRESHOLD * math.sqrt(count))


def tiled(mode: SlidingMode, count: int) -> SlidingMode:
    """Return the mode of the joined problem of so many members that all have one mode."""
    selection = mode.selection.tolist() * count
    signs = mode.signs.tolist() * count
    return SlidingMode(selection, signs)
