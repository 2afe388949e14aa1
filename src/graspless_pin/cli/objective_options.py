"""Options of commands that ask for an objective by name: its choices, and its figures."""

from __future__ import annotations

import inspect
from collections.abc import Callable, Container, Iterator
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

import typer

from graspless_pin.algorithms.torque import OBJECTIVES, figure_types

_Command = TypeVar("_Command", bound=Callable[..., None])


def asking_by_name(command: _Command) -> _Command:
    """Give a command's option ``algorithm`` its choices, and its ``**figures``, if any, options.

    Args:
        command: What it has no argument of its own for is among its ``**figures``.
    """
    signature = inspect.signature(command, eval_str=True)
    options: list[inspect.Parameter] = []
    for one in signature.parameters.values():
        if one.name == "algorithm":
            names: Any = Literal[*OBJECTIVES]
            options.append(
                one.replace(annotation=Annotated[names | None, one.annotation.__metadata__[0]])
            )
        elif one.kind is inspect.Parameter.VAR_KEYWORD:
            options += _further_figures(signature.parameters)
        else:
            options.append(one)
    asked: Any = command
    asked.__signature__ = signature.replace(parameters=options)
    return command


def _further_figures(known: Container[str]) -> Iterator[inspect.Parameter]:
    """Yield an option for each other figure; what is no single value stands in scenes alone."""
    for key, annotated in figure_types().items():
        kind, *metadata = get_args(annotated) if get_origin(annotated) is Annotated else [annotated]
        plain = get_origin(kind) is Literal or (
            isinstance(kind, type) and issubclass(kind, int | float | str)
        )
        if key in known or not plain:
            continue
        descriptions = [one.description for one in metadata if getattr(one, "description", "")]
        option = typer.Option(help="".join(descriptions[-1:]))
        yield inspect.Parameter(
            key,
            inspect.Parameter.KEYWORD_ONLY,
            default=None,
            annotation=Annotated[kind | None, option],
        )
