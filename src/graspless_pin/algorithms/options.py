"""Options of a solve: an objective by name, rules, solver, search, limits of nodes and time.

Scenes, studies, evaluators and the command line name objectives. Their keys, choices and help are
derived from the list below. The figures of an objective are the arguments of its `make`;
``required_margin`` has the key ``margin``.
"""

from __future__ import annotations

import inspect
from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, field
from enum import StrEnum
from typing import Any, NamedTuple, Self, get_type_hints

from graspless_pin.errors import ArgumentError
from graspless_pin.holding.verdict import NODE_LIMIT
from graspless_pin.modes.rules import (
    RuleOptions,
    Rules,
    SignRule,
    SlidingRule,
    StaticFriction,
)
from graspless_pin.problem.checks import choice, one_of, real_number, whole_number
from graspless_pin.programs.objectives import Margin, Objective, Torque, TorqueShare, key_of
from graspless_pin.solvers import ANY_SOLVER, check_solver
from graspless_pin.suggestions import names_in_words


class Search(StrEnum):
    """How the modes are searched."""

    AUTO = "auto"
    """Branch and bound on conflicts from the relaxation."""
    ENUMERATE = "enumerate"
    """The relaxation, then every maximal mode."""


class RequiredStability(StrEnum):
    """The stability that rest under the torques must have."""

    WEAK = "weak"
    """An outcome: forces that statics leave open may balance."""
    STRONG = "strong"
    """The only outcome, proven by a verdict."""


class SolveKeywords(RuleOptions, total=False):
    """The options as keyword arguments; see `SolveOptions.parse`."""

    solver: str
    search: str
    node_limit: int | None
    time_limit: float | None
    direction_gap: float
    stability: str
    verdict_nodes: int


def refuse_unknown(names: Iterable[str], known: Collection[str]) -> None:
    """Refuse unknown options.

    Raises:
        ArgumentError: Naming the first, with what was probably meant.
    """
    for name in names:
        if name not in known:
            raise ArgumentError(name, f"is not an option; {names_in_words(name, known)}")


@dataclass(frozen=True)
class SolveOptions:
    """How problems are solved.

    Attributes:
        rules: The reading of the virtual-sliding constraint.
        solver: The solver to ask first; others are asked where its answer fails the check.
        search: How the modes are searched.
        node_limit: Nodes of each search over modes; None: any number.
        time_limit: Seconds for all searches of one call; None: no limit.
        direction_gap: Gap at which a search under the rule ``direction`` ends: over the optimum, or
            over a hundredth of the load where that is larger.
        stability: The stability that rest under the torques must have.
        verdict_nodes: Sets of outcomes that each verdict on torques may look at.

    Examples:
        >>> from graspless_pin import load_scene, SolveOptions, maximize_margin
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> maximize_margin(problem, static_friction="coulomb", node_limit=10).found
        True
    """

    rules: Rules = field(default_factory=Rules)
    solver: str = ANY_SOLVER
    search: Search = Search.AUTO
    node_limit: int | None = None
    time_limit: float | None = None
    direction_gap: float = 1e-4
    stability: RequiredStability = RequiredStability.WEAK
    verdict_nodes: int = NODE_LIMIT

    @classmethod
    def parse(
        cls,
        *,
        sign_rule: str = SignRule.STRICT,
        sliding_rule: str = SlidingRule.EXEMPT,
        static_friction: str = StaticFriction.VIRTUAL_SLIDING,
        solver: str = ANY_SOLVER,
        search: str = Search.AUTO,
        node_limit: int | None = None,
        time_limit: float | None = None,
        direction_gap: float = 1e-4,
        stability: str = RequiredStability.WEAK,
        verdict_nodes: int = NODE_LIMIT,
        **unknown: object,
    ) -> Self:
        """Return checked options.

        Args:
            sign_rule: ``strict``, ``exact``, ``nonzero`` or ``direction``: see `SignRule`.
            sliding_rule: ``exempt`` or ``constrained``: see `SlidingRule`.
            static_friction: ``virtual_sliding``, or ``coulomb`` to drop (22), (27) and (31).
            solver: Any of `available_solvers`; ``auto``: PIQP, and Clarabel for round cones.
            search: ``auto`` (branch and bound) or ``enumerate`` (all maximal modes).
            node_limit: Nodes after which each search ends with the best answer found and its gap;
                None: no limit.
            time_limit: Seconds in all after which it ends likewise; None: no limit.
            direction_gap: Relative gap, at least 1e-6, at which a search under ``direction`` ends.
            stability: ``weak``: rest is an outcome of the torques, or ``strong``: it is the only
                one, which the solution's `guarantee` proves.
            verdict_nodes: Sets of outcomes that each verdict on torques may look at, for
                ``strong``.
            unknown: Any other keyword is refused.

        Raises:
            ArgumentError: If an option is not known or a figure out of range.
            SolverUnavailableError: If the solver is not installed.
        """
        refuse_unknown(unknown, SolveKeywords.__annotations__)
        return cls(
            Rules.parse(sign_rule, sliding_rule, static_friction),
            check_solver(solver),
            choice(Search, "search", search),
            None if node_limit is None else whole_number("node_limit", node_limit, 1),
            None
            if time_limit is None
            else real_number("time_limit", time_limit, 0.0, finite=False),
            real_number("direction_gap", direction_gap, 1e-6),
            choice(RequiredStability, "stability", stability),
            whole_number("verdict_nodes", verdict_nodes, 0),
        )

    def for_analyses(self) -> SolveKeywords:
        """Return the options that analyses share with a solve, as keywords: rules and solver."""
        return {**self.rules.options(), "solver": self.solver}

    @property
    def strong(self) -> bool:
        """Whether rest has to be the only outcome."""
        return self.stability is RequiredStability.STRONG

    def need_weak(self, what: str, instead: str) -> Self:
        """Return the options; refuse ``stability="strong"`` where it has no meaning.

        Args:
            what: A clause that says why it has no meaning there.
            instead: What to do instead.

        Raises:
            ArgumentError: Naming it.
        """
        if self.strong:
            raise ArgumentError("stability", f"is 'strong', but {what}; {instead}")
        return self


DEFAULT_OPTIONS = SolveOptions()


def refuse_feedback_alone(feedback: object) -> None:
    """Refuse feedback without an uncertainty.

    Raises:
        ArgumentError: If there is some.
    """
    if feedback is not None:
        raise ArgumentError("feedback", "is only available with an uncertainty; give one, too")


class TorqueScale(StrEnum):
    """What Algorithm 2 minimises."""

    ABSOLUTE = "absolute"
    """The largest |torque|."""
    LIMITS = "limits"
    """The largest share of any joint's own limit."""


def torque_objective(
    margin: float = 0.1, scale: str = "absolute", regularization: float = 0.0
) -> Torque:
    """Return the objective of Algorithm 2; see `minimize_torque`.

    Raises:
        ArgumentError: If a figure is negative or the scale is not known.
    """
    by_limits = choice(TorqueScale, "scale", scale) is TorqueScale.LIMITS
    return (TorqueShare if by_limits else Torque)(margin, regularization)


class NamedObjective(NamedTuple):
    """An objective that has a name.

    Attributes:
        make: Class of the objective, or a function that returns it.
        aim: What is optimised, in a few words.
    """

    make: Callable[..., Objective]
    aim: str


OBJECTIVES = {
    "margin": NamedObjective(Margin, "Algorithm 1, largest margin"),
    "torque": NamedObjective(torque_objective, "Algorithm 2, smallest torque"),
}
"""All objectives by name: a new one is added to this list."""

AIMS = "; ".join(f"{name}: {one.aim}" for name, one in OBJECTIVES.items())
"""The aims of all objectives, as one text."""

_FIGURES = {
    name: {
        key_of(argument.name): argument
        for argument in inspect.signature(one.make).parameters.values()
    }
    for name, one in OBJECTIVES.items()
}
"""Arguments of each objective, by its name and their keys."""


def figure_types() -> dict[str, Any]:
    """Return the annotated type of each figure of all objectives, by its key."""
    hints = {
        name: get_type_hints(named.make, include_extras=True) for name, named in OBJECTIVES.items()
    }
    return {
        key: hints[name][argument.name]
        for name, figures in _FIGURES.items()
        for key, argument in figures.items()
    }


def objective_named(name: str, figures: Mapping[str, Any]) -> Objective:
    """Return the objective of a name.

    Args:
        name: Name of the objective.
        figures: Figures by key; None, and figures of other objectives, count as not given.

    Raises:
        ArgumentError: If the name is not known, or a figure is invalid or missing.
    """
    one_of(OBJECTIVES, "algorithm", name)
    given = {}
    for key, argument in _FIGURES[name].items():
        if figures.get(key) is not None:
            given[argument.name] = figures[key]
        elif argument.default is argument.empty:
            raise ArgumentError(key, f"is missing; algorithm {name!r} requires it")
    return OBJECTIVES[name].make(**given)


def objective_and_options(
    *, algorithm: str = "margin", **chosen: Any
) -> tuple[Objective, SolveOptions]:
    """Return the objective and the options that keyword arguments state.

    Args:
        algorithm: Name of the objective.
        chosen: Figures of objectives by key, and options of `SolveOptions.parse`.

    Raises:
        ArgumentError: See `objective_named` and `SolveOptions.parse`.
    """
    figures = list(dict.fromkeys(key for own in _FIGURES.values() for key in own))
    objective = objective_named(algorithm, chosen)
    refuse_unknown(chosen, [*figures, *SolveKeywords.__annotations__])
    return objective, SolveOptions.parse(
        **{key: value for key, value in chosen.items() if key not in figures}
    )


def refuse_useless(keys: Iterable[str], algorithm: str) -> None:
    """Refuse keys that have no effect under an algorithm.

    Raises:
        ArgumentError: See `why_without_effect`.
    """
    for key in keys:
        if why := why_without_effect(key, algorithm):
            raise ArgumentError(key, why)


def why_without_effect(key: str, algorithm: str) -> str:
    """Return why a key, of other algorithms, has no effect under one; empty if it has one."""
    others = other_algorithms_with(key, algorithm)
    if not others:
        return ""
    return (
        f"has no effect with algorithm {algorithm!r}; use algorithm "
        f"{' or '.join(map(repr, others))}, or leave it out"
    )


def other_algorithms_with(key: str, algorithm: str) -> list[str]:
    """Return the other algorithms that have a key; empty if the given one has it, too."""
    users = [name for name, figures in _FIGURES.items() if key in figures]
    return [] if algorithm in users else users


def name_and_figures(objective: Objective) -> tuple[str, dict[str, Any]] | None:
    """Return name and figures by which an objective can be requested; None: it has no name."""
    for name, named in OBJECTIVES.items():
        if type(objective) is named.make:
            figures = _FIGURES[name].items()
            return name, {key: getattr(objective, figure.name) for key, figure in figures}
    return None
