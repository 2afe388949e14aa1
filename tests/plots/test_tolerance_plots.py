"""What is borne by direction, against regions that are worked out by hand."""

import numpy as np
import pytest
from matplotlib.axes import Axes

from graspless_pin import QuasistaticProblem, TorqueSolution, tolerances
from graspless_pin.algorithms.tolerance_tables import Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.plots import tolerance_plot

FEET = np.array([[x, y, -0.05] for x in (-0.1, 0.1) for y in (-0.2, 0.2)])
CORNER = np.array([0.1, 0.2, 0.0])


def standing(gravity: tuple[float, float, float] = (0.0, 0.0, -1.0)) -> Tolerances:
    """What bears on four frictionless feet, under the middle of 20 cm by 40 cm, 10 N, up = z.

    Args:
        gravity: Where the turned scene has the feet: -z.
    """
    down = np.array(gravity)
    turn = np.eye(3) if down[2] < 0.0 else np.array([[0, 0, 1], [1, 0, 0], [0, 1, 0]])
    problem = QuasistaticProblem(
        FEET @ turn.T, np.tile(-down, (4, 1)), np.append(10.0 * down, np.zeros(3)), friction=0.0,
        max_normal_force=50.0,
    )  # fmt: skip
    return tolerances(problem, [], static_friction="coulomb")


def said(axes: Axes) -> str:
    """What the legend says."""
    legend = axes.get_legend()
    assert legend is not None
    (words,) = (text.get_text() for text in legend.get_texts())
    return words


def test_the_centre_of_mass_may_be_above_all_of_the_feet():
    """Each foot at a corner of the region, with the refinement that finds corners between rays."""
    found = standing()
    one = found.of("centre of mass")
    corner = np.array([CORNER, CORNER * [1, -1, 1]]) / np.hypot(0.1, 0.2)
    np.testing.assert_allclose(one.along(corner), np.hypot(0.1, 0.2), rtol=1e-4)
    axes = tolerance_plot(found)
    angles, radii = (np.asarray(one, dtype=float) for one in axes.lines[0].get_data())
    with np.errstate(divide="ignore"):
        expected = 100.0 * np.minimum(0.1 / abs(np.cos(angles)), 0.2 / abs(np.sin(angles)))
    np.testing.assert_allclose(radii, expected, rtol=1e-4)
    assert [text.get_text() for text in axes.get_xticklabels()] == ["+x", "+y", "−x", "−y"]
    words = said(axes)
    assert words.startswith("smallest: 10 cm\nfails at contacts ")
    (dot,) = (line for line in axes.lines if line.get_label() == words)
    assert np.ravel(dot.get_ydata())[0] == pytest.approx(10.0, rel=1e-4)


def test_directions_are_named_as_gravity_lies():
    """Gravity along -x: y and z are level."""
    axes = tolerance_plot(standing((-1.0, 0.0, 0.0)), "centre of mass")
    assert [text.get_text() for text in axes.get_xticklabels()] == ["+y", "+z", "−y", "−z"]
    angles, radii = (np.asarray(one, dtype=float) for one in axes.lines[0].get_data())
    assert radii[angles == 0.0] == pytest.approx(10.0, rel=1e-4)


def test_pushes_that_nothing_resists_are_not_borne():
    """A bead on a stiff wire along y: pushes along y are not borne, others up to the limits."""
    normals = np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1]], dtype=float)
    bead = QuasistaticProblem(
        -0.1 * normals, normals, [0, 0, -1, 0, 0, 0], friction=0.0, max_normal_force=[5, 3, 4, 2]
    )
    found = tolerances(bead, [], static_friction="coulomb")
    one = found.of(Quantity.PUSH)
    ways = np.array([[1, 0, 0], [-1, 0, 0], [0, 0, 1], [0, 0, -1], [0, 1, 0], [0.6, 0.8, 0]])
    np.testing.assert_allclose(one.along(ways), [3, 5, 3, 3, 0, 0], atol=1e-4)
    axes = tolerance_plot(found, "push")
    angles, radii = (np.asarray(one, dtype=float) for one in axes.lines[0].get_data())
    assert radii[angles == 0.0] == pytest.approx(3.0, rel=1e-4)
    assert (radii[abs(np.sin(angles)) > 0.1] < 1e-4).all()
    assert "along [" in said(axes)  # of many least ones, any


def test_what_has_no_directions_is_refused(sliding: TorqueSolution):
    found = standing()
    for name in ("more mass", "joint"):
        with pytest.raises(ArgumentError, match=r"quantity: .* for: centre of mass, push"):
            tolerance_plot(found, name)
    with pytest.raises(NoSolutionError, match="more mass has no boundary"):
        found.of("more mass").along(np.eye(3))
    few = tolerances(
        sliding.problem, sliding.torques, quantities=["more mass"], static_friction="coulomb"
    )
    assert [one.quantity for one in few.each] == ["more mass"]
    with pytest.raises(ArgumentError, match="depend on a direction for: nothing"):
        tolerance_plot(few)
    with pytest.raises(ArgumentError, match=r"quantities: is 'mas'.*must be one of"):
        tolerances(sliding.problem, sliding.torques, quantities=["mas"])
