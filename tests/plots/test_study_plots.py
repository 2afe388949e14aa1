"""A study's table over one and two parameters."""

import numpy as np
import pandas as pd
import pytest
from matplotlib.collections import LineCollection, QuadMesh

from graspless_pin.errors import ArgumentError
from graspless_pin.plots import margin_heat_map, margin_plot, outcome_boundary


def line(axes, label: str) -> np.ndarray:
    (found,) = (item for item in axes.lines if item.get_label() == label)
    return np.asarray(found.get_xydata())


def test_one_parameter():
    table = pd.DataFrame({"friction": [0.5, 0.3, 0.4], "margin_N": [2.0, 1.0, 1.5]})
    axes = margin_plot(table, "friction")
    np.testing.assert_allclose(line(axes, "margin e"), [[0.3, 1.0], [0.4, 1.5], [0.5, 2.0]])
    assert axes.get_xlabel() == "friction coefficient" and axes.get_ylabel() == "margin e [N]"
    assert axes.get_legend() is None and not axes.collections


def test_what_was_not_found_breaks_the_line_and_is_marked():
    table = {"mass": [1.0, 2.0, 3.0], "margin_N": [1.0, np.nan, 0.5]}
    axes = margin_plot(table, "mass")
    np.testing.assert_array_equal(line(axes, "margin e")[:, 1], [1.0, np.nan, 0.5])
    assert line(axes, "nothing found")[:, 0].tolist() == [2.0]
    assert axes.get_legend() is not None
    table = pd.DataFrame({"mass": [1.0, 2.0]}).assign(nodes=pd.array([3, None], dtype="Int64"))
    axes = margin_plot(table, "mass", value="nodes")
    np.testing.assert_array_equal(line(axes, "nodes of the search"), [[1.0, 3.0], [2.0, np.nan]])
    assert axes.get_ylabel() == "nodes of the search"


def test_several_results_at_one_place_make_a_band():
    table = {"mass": [1.0, 1.0, 2.0, 2.0], "max_torque_Nm": [1.0, 3.0, 2.0, np.nan]}
    axes = margin_plot(table, "mass", value="max_torque_Nm")
    np.testing.assert_allclose(line(axes, "mean"), [[1.0, 2.0], [2.0, 2.0]])
    (band,) = axes.collections
    corners = np.asarray(band.get_paths()[0].vertices)
    assert corners[:, 1].min() == 1.0 and corners[:, 1].max() == 3.0
    assert line(axes, "nothing found")[:, 0].tolist() == [2.0]


@pytest.mark.parametrize(
    ("value", "label"),
    [
        ("max_torque_Nm", "largest |torque| [N m]"),
        ("max_torque_N", "largest |force of a prismatic joint| [N]"),
        ("disturbance_N", "largest balanced disturbance [N]"),
        ("palm_height_mm", "palm height [mm]"),
        ("object.mass_g", "object.mass [g]"),
        ("object.density_kg_per_m3", "object.density [kg/m³]"),
        ("conveyor_mm_per_s", "conveyor [mm/s]"),
        ("friction.supports", "friction coefficient, supports"),
        ("object.mass", "mass of the object [kg]"),
        ("my_own", "my_own"),
        ("hand.q.finger_1_proximal_deg", "hand.q.finger_1_proximal [°]"),
        ("torque_finger_1_proximal_Nm", "torque finger_1_proximal [N m]"),
    ],
)
def test_labels_say_the_unit(value, label):
    table = {"mass": [1.0, 2.0], value: [1.0, 3.0]}
    axes = margin_plot(table, "mass", value=value)
    assert axes.get_ylabel() == label
    assert axes.get_ylim()[0] == 0.0


def test_what_a_study_varies_on_a_log_scale_has_a_logarithmic_axis():
    table = pd.DataFrame(
        [(x, y, x < 1.0, x + y) for x in (0.01, 0.1, 1.0, 10.0) for y in (0.1, 0.2)],
        columns=["object.mass_kg", "friction", "found", "margin_N"],
    )
    ends = {"from": 0.01, "to": 10.0, "steps": 4}
    for scale in ("log", "linear"):
        vary = {"object.mass": {**ends, "scale": scale}, "friction": {"values": [0.1, 0.2]}}
        table.attrs["graspless_pin"] = {"entry": {"vary": vary}}
        assert margin_plot(table, "object.mass_kg").get_xscale() == scale
        for draw in (margin_heat_map, outcome_boundary):
            axes = draw(table, "friction", "object.mass_kg")
            assert (axes.get_xscale(), axes.get_yscale()) == ("linear", scale)


def test_two_parameters():
    table = pd.DataFrame(
        [(x, y, x + 10.0 * y) for x in (1.0, 2.0, 3.0) for y in (0.1, 0.2)],
        columns=["mass", "friction", "margin_N"],
    )
    table.loc[0, "margin_N"] = -np.inf
    axes = margin_heat_map(table, "mass", "friction")
    (mesh,) = (item for item in axes.collections if isinstance(item, QuadMesh))
    cells = mesh.get_array()
    assert isinstance(cells, np.ma.MaskedArray)
    assert cells.mask.tolist() == [[True, False, False], [False, False, False]]
    np.testing.assert_allclose(cells[1], [3.0, 4.0, 5.0])
    np.testing.assert_allclose(cells[0, 1:], [3.0, 4.0])
    assert (axes.get_xlabel(), axes.get_ylabel()) == (
        "mass of the object [kg]",
        "friction coefficient",
    )
    # Several samples of a cell are averaged.
    table = {"a": [0.0, 0.0, 1.0], "b": [0.0, 0.0, 0.0], "margin_N": [1.0, 4.0, 7.0]}
    axes = margin_heat_map(table, "a", "b")
    cells = np.asarray(axes.collections[0].get_array())
    np.testing.assert_allclose(cells, [[2.5, 7.0]])
    assert axes.figure.axes[-1].get_ylabel() == "mean margin e [N]"


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_map_of_equal_figures_shows_no_rounding(sign):
    """All cells have one colour, of a bar that begins or ends at zero."""
    table = {"a": [0.0, 0.0, 1.0, 1.0], "b": [0.0, 1.0, 0.0, 1.0],
             "margin_N": [sign * (0.02 + 1e-15 * one) for one in range(4)]}  # fmt: skip
    (mesh,) = margin_heat_map(table, "a", "b").collections
    assert isinstance(mesh, QuadMesh)
    assert sorted(map(abs, mesh.get_clim())) == pytest.approx([0.0, 0.02])
    assert len(np.unique(mesh.to_rgba(np.asarray(mesh.get_array()).ravel()), axis=0)) == 1


def test_scattered_samples_are_points():
    """Of 20 samples over two parameters no two share a place: neither a line nor cells join any."""
    rng = np.random.default_rng(0)
    mass, friction = rng.uniform(1.0, 2.0, 20), rng.uniform(0.2, 0.8, 20)
    margins = np.where(mass < 1.2, np.nan, mass * friction)
    table = {"sample": np.arange(20), "mass": mass, "friction": friction,
             "status": ["optimal"] * 20, "margin_N": margins}  # fmt: skip
    axes = margin_plot(table, "mass")
    assert {one.get_linestyle() for one in axes.lines} == {"None"}
    axes = margin_heat_map(table, "mass", "friction")
    (points,) = axes.collections
    found = np.isfinite(margins)
    np.testing.assert_allclose(
        np.asarray(points.get_offsets()), np.column_stack([mass, friction])[found]
    )
    np.testing.assert_allclose(np.asarray(points.get_array()), margins[found])
    np.testing.assert_allclose(
        line(axes, "nothing found"), np.column_stack([mass, friction])[~found]
    )
    # On a grid, and of one parameter alone, they are joined.
    alone = {name: column for name, column in table.items() if name != "friction"}
    assert "-" in {one.get_linestyle() for one in margin_plot(alone, "mass").lines}


def test_bad_columns_are_named():
    table = pd.DataFrame({"mass": [1.0], "robot": ["allegro"], "margin_N": [1.0]})
    with pytest.raises(ArgumentError, match=r"x: is 'weight'; the table has the columns mass, "):
        margin_plot(table, "weight")
    with pytest.raises(ArgumentError, match="y: is 'robot', a column that does not hold numbers"):
        margin_heat_map(table, "mass", "robot")
    with pytest.raises(ArgumentError, match="value: is 'max_torque_Nm'; the table has"):
        margin_plot(table, "mass", value="max_torque_Nm")


def segments_of(axes) -> np.ndarray:
    """(segments, 2 ends, 2) the lines of a boundary."""
    (lines,) = [one for one in axes.collections if isinstance(one, LineCollection)]
    return np.array([path.vertices for path in lines.get_paths()]).reshape(-1, 2, 2)


def test_a_boundary_goes_half_way_between_different_neighbours():
    """A straight border on a fine grid, its coordinates of quite different sizes."""
    xs, ys = np.linspace(0.0, 1000.0, 21), np.linspace(0.0, 1.0, 21)
    rows = [(x, y, bool(x / 1000.0 + y > 0.73)) for x in xs for y in ys]
    table = pd.DataFrame(rows, columns=["height_mm", "friction", "found"])
    axes = outcome_boundary(table, "height_mm", "friction")
    assert axes.get_xlabel() == "height [mm]" and axes.get_ylabel() == "friction coefficient"
    ends = segments_of(axes).reshape(-1, 2)
    assert np.abs(ends[:, 0] / 1000.0 + ends[:, 1] - 0.73).max() < 0.05 + 1e-9
    steps = np.diff(segments_of(axes) / [1000.0, 1.0], axis=1)
    length = np.linalg.norm(steps, axis=2).sum()
    assert 0.95 * 0.73 * 2**0.5 < length < 1.45 * 0.73 * 2**0.5
    legend = axes.get_legend()
    words = {text.get_text() for text in legend.get_texts()} if legend else set()
    assert words == {"found", "nothing found"}


def test_three_outcomes_meet_in_a_point():
    rows = [(0.0, 0.0, "a"), (1.0, 0.0, "b"), (0.0, 1.0, "c")]
    table = pd.DataFrame(rows, columns=["x", "y", "status"])
    found = segments_of(outcome_boundary(table, "x", "y", outcome="status"))
    assert len(found) == 3
    np.testing.assert_allclose(found[:, 1], 1.0 / 3.0)
    assert {tuple(end) for end in found[:, 0]} == {(0.5, 0.0), (0.5, 0.5), (0.0, 0.5)}


def test_where_there_is_no_boundary():
    table = pd.DataFrame({"x": [0.0, 1.0, 2.0], "y": [1.0, 2.0, 3.0], "found": [True, False, True]})
    with pytest.raises(ArgumentError, match="on one line; two parameters must vary"):
        outcome_boundary(table, "x", "y")
    with pytest.raises(ArgumentError, match=r"outcome: is 'mode'; the table has the columns x, y"):
        outcome_boundary(table, "x", "y", outcome="mode")
    twice = pd.concat([table, table.assign(found=True)])
    with pytest.raises(ArgumentError, match="but different 'found'; keep only rows"):
        outcome_boundary(twice, "x", "y")
    rows = [(x, y, True) for x in (0.0, 1.0) for y in (0.0, 1.0)]
    axes = outcome_boundary(pd.DataFrame(rows, columns=["x", "y", "found"]), "x", "y")
    assert len(segments_of(axes)) == 0
    legend = axes.get_legend()  # says which outcome it is that all have
    assert legend is not None and [text.get_text() for text in legend.get_texts()] == ["found"]
