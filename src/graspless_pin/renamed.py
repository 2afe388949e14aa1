"""Say the successor of what version 0.1 called otherwise; `docs/migration.md` lists the same."""

from __future__ import annotations

from collections.abc import Callable
from functools import wraps
from typing import Any, ParamSpec, TypeVar

_P = ParamSpec("_P")
_R = TypeVar("_R")

SUCCESSORS = {
    "graspless_pin.picture": "graspless_pin.visualization",
    "graspless_pin.algorithms.torque.margin_objective": "graspless_pin.Margin",
    "graspless_pin.geometry.bodies.records": "graspless_pin.geometry",
    "graspless_pin.geometry.contact.records": "graspless_pin.geometry",
    "graspless_pin.geometry.posing.closing.close_fingers": "graspless_pin.geometry.close_hand",
    "graspless_pin.geometry.posing.settling.TOLERANCE": (
        "graspless_pin.geometry.posing.settling.SETTLING_TOLERANCE"
    ),
    "graspless_pin.geometry.posing.settling.settle": "graspless_pin.geometry.settle_object",
    "graspless_pin.geometry.robots.audit": "graspless_pin.geometry",
    "graspless_pin.geometry.robots.listing": "graspless_pin.geometry",
    "graspless_pin.solution.records": "graspless_pin",
    "graspless_pin.viewer.Evaluation": "graspless_pin.viewer.SettingsAnswer",
    "graspless_pin.viewer.evaluate": "graspless_pin.viewer.answer_settings",
    "graspless_pin.viewer.evaluation": "graspless_pin.viewer",
    "OptimumGradients.marginals": "OptimumGradients.point",
    "case_of_document(folder)": "case_of_document(scene_file)",
    "report_html(ranges)": "report_html(bounds)",
    "report_html(ranges_time)": "report_html(bounds)",
}
"""The present name of each former one: of modules, of what is in them, of attributes, of keywords.
"""


def successor_message(former: str) -> str:
    """Return what to say where a name of `SUCCESSORS` is asked for."""
    return f"{former} was renamed to {SUCCESSORS[former]}"


def former_names(owner: str, error: type[Exception] = AttributeError) -> Callable[..., Any]:
    """Make a ``__getattr__`` for a module or a class some of whose names were others.

    Args:
        owner: Its own name, as it begins in `SUCCESSORS`.
        error: What to raise: ImportError where ``from owner import name`` would drop the message.
    """

    def successor(*arguments: Any) -> Any:
        """Raise an error for a name that does not exist; a class passes its object before it."""
        name = arguments[-1]
        if (former := f"{owner}.{name}") in SUCCESSORS:
            raise error(successor_message(former))
        raise AttributeError(f"{owner!r} has no attribute {name!r}")

    return successor


def refusing_former_keywords(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Let a function say the successors of keywords that it had."""

    @wraps(function)
    def refusing(*args: _P.args, **keywords: _P.kwargs) -> _R:
        for name in keywords:
            if (former := f"{function.__name__}({name})") in SUCCESSORS:
                raise TypeError(successor_message(former))
        return function(*args, **keywords)

    return refusing


class FormerModules:
    """A finder of modules, asked after all others, that raises for a former name."""

    @staticmethod
    def find_spec(name: str, *_: object) -> None:
        """Find nothing.

        Raises:
            ModuleNotFoundError: If the name was renamed; says the successor.
        """
        if name in SUCCESSORS:
            # Without `name`, or ``from package import name`` would drop the message.
            raise ModuleNotFoundError(successor_message(name))
