"""The options of an evaluator's solves: given ones first, then the scene's, then the defaults."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any

from graspless_pin.algorithms.torque import torque_objective
from graspless_pin.modes.rules import Rules, choice
from graspless_pin.problem.checks import real_number, whole_number
from graspless_pin.programs.objectives import Algorithm, Margin, Objective
from graspless_pin.solvers import check_solver

_RULES = ("sign_rule", "sliding_rule", "static_friction")


@dataclass(frozen=True)
class SolveOptions:
    """Checked options.

    Attributes:
        required_margin: Margin of Algorithm 2 and of feasibility, N.
        objective: What is optimised.
        rules: The reading of the virtual-sliding constraint.
        search: ``solver``, ``node_limit`` and ``time_limit`` of `solve_from`.
    """

    required_margin: float
    objective: Objective
    rules: Rules
    search: Mapping[str, Any]

    @classmethod
    def of(cls, own: Mapping[str, Any], given: Mapping[str, Any]) -> SolveOptions:
        """Check options.

        Args:
            own: The scene's.
            given: Those that replace them; None where nothing is given.

        Raises:
            ArgumentError: If an option is not known or a figure out of range.
            SolverUnavailableError: If the solver is not installed.
        """
        options = {**own, **{name: value for name, value in given.items() if value is not None}}
        margin = real_number("required_margin", options.get("margin", 0.1), 0.0)
        epsilon = options.get("regularization", 0.0)
        objective: Objective = Margin(epsilon)
        if choice(Algorithm, "algorithm", options.get("algorithm", "margin")) is Algorithm.TORQUE:
            objective = torque_objective(margin, options.get("scale", "absolute"), epsilon)
        nodes, seconds = options.get("node_limit"), options.get("time_limit")
        return cls(
            required_margin=margin,
            objective=objective,
            rules=Rules.parse(**{name: options[name] for name in _RULES if name in options}),
            search={
                "solver": check_solver(options.get("solver", "piqp")),
                "node_limit": None if nodes is None else whole_number("node_limit", nodes, 1),
                "time_limit": None
                if seconds is None
                else real_number("time_limit", seconds, 0.0, finite=False),
            },
        )

    def with_regularization(self, regularization: float) -> SolveOptions:
        """Return the same options with another regularisation.

        Raises:
            ArgumentError: If it is negative or not finite.
        """
        epsilon = real_number("regularization", regularization, 0.0)
        return replace(self, objective=self.objective.with_figure("regularization", epsilon))
