"""Axes to draw on: the caller's, or those of a new figure."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from graspless_pin.errors import GrasplessPinError

if TYPE_CHECKING:
    from matplotlib.axes import Axes


def axes_for(ax: Axes | None, *, size: tuple[float, float] = (6.4, 4.0), **options: Any) -> Axes:
    """Return the caller's axes, or those of a new pyplot figure.

    Args:
        ax: The caller's axes; None: new ones.
        size: Width and height of a new figure, inches.
        options: Of the new axes, such as ``projection``.

    Raises:
        GrasplessPinError: If matplotlib is not installed.
    """
    if ax is not None:
        return ax
    try:
        from matplotlib import pyplot
    except ImportError as error:
        raise GrasplessPinError(
            f"plots need matplotlib ({error}); install it with pip install 'graspless-pin[plots]'"
        ) from None
    return pyplot.figure(figsize=size, layout="constrained").add_subplot(**options)
