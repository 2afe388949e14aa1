"""Plots as inline SVG whose colours follow the page's."""

from __future__ import annotations

import html
import io
import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from graspless_pin.visualization import LIGHT

if TYPE_CHECKING:
    from matplotlib.axes import Axes

_STYLE: dict[Any, Any] = {
    "svg.fonttype": "none",
    "font.size": 9.0,
    "font.family": "sans-serif",
    "mathtext.fontset": "dejavusans",
    "figure.facecolor": "none",
    "axes.facecolor": "none",
    "legend.facecolor": "none",
    "legend.edgecolor": "none",
    "legend.framealpha": 1.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    **dict.fromkeys(
        ("text.color", "axes.edgecolor", "axes.labelcolor", "xtick.color", "ytick.color"),
        LIGHT.text,
    ),
}
_NO_METADATA = dict.fromkeys(("Creator", "Date", "Format", "Type"))


def inline_svg(
    name: str, alt: str, size: tuple[float, float], draw: Callable[[Axes], object]
) -> str:
    """Return a plot as an SVG element with a text in its stead for those who do not see it.

    Args:
        name: Prefix of all ids, unique in the page.
        alt: What the plot shows, in words.
        size: Width and height, inches; the page may shrink it.
        draw: Draws on the axes that it is given.
    """
    from matplotlib import rc_context
    from matplotlib.figure import Figure

    with rc_context(_STYLE):
        figure = Figure(figsize=size, layout="constrained")
        draw(figure.add_subplot())
        buffer = io.StringIO()
        figure.savefig(buffer, format="svg", metadata=_NO_METADATA)
    svg = buffer.getvalue()
    svg = svg[svg.index("<svg") :]
    svg = re.sub(r'\bid="', f'id="{name}-', svg)
    svg = re.sub(r'href="#', f'href="#{name}-', svg)
    svg = re.sub(r"url\(#", f"url(#{name}-", svg)
    for role, color in LIGHT.roles.items():
        if color != LIGHT.text:
            svg = svg.replace(color, f"var(--{role})")
    svg = svg.replace(LIGHT.text, "currentColor")
    width = f"{72.0 * size[0]:.0f}pt"
    box = re.search(r'viewBox="[^"]*"', svg)
    if box is None:  # pragma: no cover - matplotlib always writes one
        raise ValueError("an SVG without a viewBox")
    title = f'<title id="{name}-title">{html.escape(alt)}</title>'
    start = (
        f'<svg {box[0]} role="img" aria-labelledby="{name}-title" style="max-width: {width}" '
        f'xmlns="http://www.w3.org/2000/svg" xmlns:xlink="http://www.w3.org/1999/xlink">{title}'
    )
    return start + svg[svg.index(">") + 1 :]
