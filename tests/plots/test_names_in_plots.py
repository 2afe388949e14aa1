"""Names come from files: what is drawn of them is their letters, whatever these mean elsewhere."""

import io
import warnings
import xml.etree.ElementTree as ET

import matplotlib as mpl
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from graspless_pin.plots import margin_heat_map, margin_plot, outcome_boundary
from graspless_pin.plots.canvas import legend_text, plain_text

NAMES = [
    "$\\frac$", "$x", "a$b$c", "_x^{", "two\nlines", "a\ttab", "bell\x07", "\\$", "a\\$b$c", "50 %",
    "😀", "x" * 200,
]  # fmt: skip


def drawn(axes: Axes) -> Axes:
    """Draw it as a file would be, without a word of matplotlib's."""
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        axes.figure.canvas.draw()
    return axes


def shown(text: str) -> str:
    """What a picture has of a text: mathematics would be in pieces, or fail."""
    figure, file = Figure(), io.StringIO()
    figure.text(0.5, 0.5, text)
    with mpl.rc_context({"svg.fonttype": "none"}):
        figure.savefig(file, format="svg")
    root = ET.fromstring(file.getvalue())  # noqa: S314 - matplotlib wrote it
    (found,) = root.iter("{http://www.w3.org/2000/svg}text")
    return found.text or ""


@pytest.mark.parametrize("name", NAMES[:-2])
def test_a_name_is_drawn_as_its_letters(name):
    letters = " ".join(name.split()).replace("\x07", "<U+0007>")
    assert shown(plain_text(name)) == letters


def test_a_long_name_is_cut_in_its_middle():
    text = plain_text("begin" + "x" * 200 + "end")
    assert len(text) == 40
    assert text.startswith("beginx")
    assert text.endswith("xend")
    assert "…" in text
    # A legend leaves out what begins with an underscore.
    assert legend_text("_x").strip() == "_x"
    assert not legend_text("_x").startswith("_")
    assert legend_text("x") == "x"


@pytest.mark.sampled(1)
@pytest.mark.parametrize("name", ["$\\frac$", "_x^{", "two\nlines", "x" * 200])
def test_columns_of_any_name(name):
    for text in (name, f"{name}_m", f"friction.{name}"):
        table = {text: [1.0, 2.0, 2.0, 3.0], "y": [0.0, 1.0, 0.0, 1.0], "e": [1.0, 2.0, 3.0, 4.0]}
        drawn(margin_plot(table, text, Figure().add_subplot(), value="e"))
        drawn(margin_plot(table | {text: [1.0, 2.0, np.nan, 3.0]}, "e", value=text))
        drawn(margin_heat_map(table, "y", text, value=text))
        drawn(outcome_boundary(table, text, "y", outcome="e"))


@pytest.mark.sampled(4)
@pytest.mark.parametrize("name", [name for name in NAMES if name != "😀"])
def test_outcomes_of_any_name_stand_in_the_legend(name):
    table = {"x": [0.0, 1.0, 0.0, 1.0], "y": [0.0, 0.0, 1.0, 1.0], "status": ["a", name, "a", name]}
    axes = drawn(outcome_boundary(table, "x", "y", outcome="status"))
    legend = axes.get_legend()
    assert legend is not None
    assert {text.get_text().strip() for text in legend.get_texts()} == {"a", plain_text(name)}
