"""How far things may be off under given torques, against a linear program of its own."""

import re

import numpy as np
import pytest
from test_attainable_tolerances import changed
from tests.oracles.uncertain_members import BALANCED, imbalance, yielding

from graspless_pin import (
    QuasistaticProblem,
    Uncertainty,
    contact_force_bounds,
    disturbance_margin,
    load_scene,
    maximize_margin,
    minimize_torque,
    minimum_friction,
    served_share,
    tolerances,
)
from graspless_pin.algorithms.tolerance_tables import Tolerance, Tolerances
from graspless_pin.algorithms.uncertainty import Quantity
from graspless_pin.errors import ArgumentError, NoSolutionError
from graspless_pin.programs.objectives import Margin

COULOMB = "coulomb"
FEET = [(x, y, -0.05) for x in (-0.1, 0.1) for y in (-0.1, 0.1)]


def off_by(problem, torques, one, times):
    """Return a problem and torques of which a quantity is off by ``times`` what just fails."""
    less = one.quantity in (Quantity.MASS_LESS, Quantity.TORQUE_LESS)
    turned = one.quantity in (Quantity.CENTER, Quantity.PUSH, Quantity.MOMENT, Quantity.JOINT)
    way = one.direction if turned else -1.0 if less else 1.0
    off = times * one.failing * way
    mu, w, made, offset = changed(problem, one.quantity, off, len(torques))
    return problem.with_changes(friction=mu, external_wrench=w), made * torques + offset


@pytest.mark.parametrize(
    ("name", "feedback"),
    [("paper/cuboid_at_rest", None), ("allegro_sphere_on_slope", 1.0), ("trihand_push_box", 2.0)],
)
def test_each_is_borne_just_so_far(name, feedback):
    problem = load_scene(f"examples/{name}.yaml").problem()
    problem = problem.with_changes(gravity_torques=np.zeros(problem.joint_count), cone_edges=8)
    torques = minimize_torque(problem, 0.05, static_friction=COULOMB).torques
    off = tolerances(problem, torques, feedback=feedback, static_friction=COULOMB)
    added = None if feedback is None else yielding(problem)
    assert {one.quantity for one in off.each} >= set(Quantity) - {Quantity.TILT}
    springs = 0.0 if feedback is None else feedback
    for one in off.each:
        assert (one.deflection > 0.0) <= (springs > 0.0)
        assert one.balanced <= one.failing
        # Sets have a polygon around all tilts, what fails is tilted just so.
        least = 0.95 if one.quantity is Quantity.TILT else 0.985
        assert one.balanced >= least * one.failing or np.isinf(one.failing)
        if one.quantity is Quantity.TILT or np.isinf(one.failing):
            continue
        within, beyond = (
            imbalance(*off_by(problem, torques, one, times), added) for times in (0.98, 1.01)
        )
        assert within < BALANCED, one.quantity
        # Contacts that slide fail with more friction or less, and not all alike.
        if one.quantity is not Quantity.FRICTION or not problem.is_sliding.any():
            assert beyond > BALANCED, one.quantity


def test_what_is_a_micrometre_long_bears_the_same_shares():
    """Moments and torques are measured by the lengths of the object, not by one metre."""
    cuboid = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    torques = minimize_torque(cuboid, 0.05, static_friction=COULOMB).torques
    shorter = 1e-5
    small = cuboid.with_changes(
        positions=shorter * cuboid.positions,
        external_wrench=cuboid.external_wrench * np.repeat([1.0, shorter], 3),
        jacobian=shorter * cuboid.jacobian,
        torque_limits=(shorter * cuboid.lower_torque, shorter * cuboid.upper_torque),
        gravity_torques=shorter * cuboid.gravity_torques,
    )
    lengths = {Quantity.CENTER, Quantity.MOMENT, Quantity.JOINT}
    nominal = tolerances(cuboid, torques, static_friction=COULOMB)
    found = tolerances(small, shorter * torques, static_friction=COULOMB)
    for one, other in zip(nominal.each, found.each, strict=True):
        unit = shorter if one.quantity in lengths else 1.0
        assert other.balanced == pytest.approx(unit * one.balanced, rel=0.02), one.quantity
        assert other.failing == pytest.approx(unit * one.failing, rel=0.02), one.quantity


def test_stiffer_joints_give_way_less():
    problem = load_scene("examples/allegro_sphere_on_slope.yaml").problem()
    torques = minimize_torque(problem, 0.1, static_friction=COULOMB).torques
    soft, stiff = (
        tolerances(problem, torques, feedback=gain, static_friction=COULOMB).of("more mass")
        for gain in (1.0, 4.0)
    )
    assert soft.failing == pytest.approx(stiff.failing, rel=1e-4)
    assert soft.deflection == pytest.approx(4.0 * stiff.deflection, rel=1e-3)


def test_a_motor_makes_up_for_errors_as_far_as_its_limit_goes():
    """An object on one tip of a lever of 0.1 m, of a motor that bears 2 N m at most.

    It gives way until what it makes, and what that is off by, is 0.49 N m again.
    """
    jacobian = np.array([[0.0], [0.0], [-0.1]])
    lever = QuasistaticProblem([[0, 0, -0.03]], [[0, 0, 1]], [0, 0, -4.9, 0, 0, 0], jacobian,
                               friction=0.5, torque_limits=(-2.0, 2.0))  # fmt: skip
    given = {"feedback": 0.5, "static_friction": COULOMB}
    found = tolerances(lever, [-0.49], attainable=True, **given)
    more, one = found.of("all torques larger"), found.of("one joint's torque")
    assert (more.balanced, more.failing) == pytest.approx((2.49 / 0.49,) * 2, rel=0.01)
    assert more.deflection == pytest.approx(2.49 / 0.5, rel=0.01)
    assert more.joints == (0,)
    assert (one.balanced, one.failing) == pytest.approx((2.0 - 0.49,) * 2, rel=0.01)
    assert one.deflection == pytest.approx((2.0 - 0.49) / 0.5, rel=0.01)
    # Where nothing fails no forces are looked at: how far it gives way is not known.
    for name in ("all torques smaller", "friction"):
        assert (found.of(name).balanced, found.of(name).failing) == (1.0, np.inf)
        assert np.isnan(found.of(name).deflection)
    assert found.of("more mass").failing == pytest.approx(2.0 / 0.49 - 1.0)
    bare = tolerances(lever, [-0.49], static_friction=COULOMB)
    assert bare.of("one joint's torque").balanced == 0.0
    tireless = lever.with_changes(torque_limits=(-np.inf, np.inf))
    found = tolerances(tireless, [-0.49], **given)
    for name in ("all torques larger", "one joint's torque"):
        some = found.of(name)
        assert some.balanced == some.failing == some.deflection == np.inf
        assert f"{name}any" in re.sub(" {2,}", "", str(found))


@pytest.mark.parametrize("feedback", [0.0, 1.0])
def test_feedback_changes_nothing_where_nothing_gives_way(feedback):
    """Contacts that leave no motion: errors of motors near their limits are no feedback."""
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    torques = minimize_torque(problem, 0.1, static_friction=COULOMB).torques
    most = 1.05 * float(np.abs(torques).max())
    near = problem.with_changes(torque_limits=(-most, most))
    rigid = tolerances(near, torques, static_friction=COULOMB)
    soft = tolerances(near, torques, feedback=feedback, static_friction=COULOMB)
    assert rigid.of("all torques larger").balanced > 4.0
    for one, other in zip(rigid.each, soft.each, strict=True):
        assert other.balanced == pytest.approx(one.balanced, rel=0.01), one.quantity
        assert not other.deflection > 1e-9


def test_pushes_from_all_sides_are_borne():
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem().with_changes(cone_edges=8)
    torques = minimize_torque(problem, 0.1, static_friction=COULOMB).torques
    push = tolerances(problem, torques, static_friction=COULOMB).of("push")
    rng = np.random.default_rng(0)
    for _ in range(25):
        way = rng.normal(size=3)
        load = [*(push.balanced * way / np.linalg.norm(way)), 0.0, 0.0, 0.0]
        pushed = problem.with_changes(external_wrench=problem.external_wrench + load)
        assert imbalance(pushed, torques) < BALANCED
    assert push.boundary is not None
    assert np.linalg.norm(push.boundary, axis=1).min() == pytest.approx(push.failing)


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.5])
def test_a_block_slides_where_gravity_leans_by_its_friction_angle(friction):
    problem = QuasistaticProblem(
        FEET, [[0.0, 0.0, 1.0]] * 4, [0.0, 0.0, -10.0, 0.0, 0.0, 0.0], friction=friction,
        cone="round",
    )  # fmt: skip
    tilt = tolerances(problem, [], static_friction=COULOMB, quantities=[Quantity.TILT]).each[0]
    assert 0.95 * np.arctan(friction) < tilt.balanced < np.arctan(friction)
    assert tilt.failing == pytest.approx(np.arctan(friction), rel=0.006)
    assert tilt.direction is not None
    leaning = np.sin(tilt.failing) * tilt.direction - [0.0, 0.0, np.cos(tilt.failing)]
    failed = problem.with_changes(external_wrench=[*(10.0 * leaning), 0.0, 0.0, 0.0])
    assert not maximize_margin(failed, static_friction=COULOMB).found


@pytest.mark.parametrize(("units", "unit"), [("N m", "N m"), ("N", "N")])
def test_one_joints_torque_is_told_in_its_own_unit(units, unit):
    """A finger presses a weightless block to a wall with 5 of 10 N (N m)."""
    jacobian = np.zeros((6, 1))
    jacobian[0, 0] = 1.0
    problem = QuasistaticProblem(
        [(-0.05, 0.0, 0.0), (0.05, 0.0, 0.0)], [(1.0, 0.0, 0.0), (-1.0, 0.0, 0.0)],
        [0.0, 0.0, -1.0, 0.0, 0.0, 0.0], jacobian, friction=0.5, torque_limits=(-10.0, 10.0),
        joint_units=[units],
    )  # fmt: skip
    told = str(tolerances(problem, [5.0], static_friction=COULOMB, quantities=[Quantity.JOINT]))
    assert f"4 {unit}  " in told


def test_the_least_friction_that_keeps_a_box_from_tipping():
    """Its feet alone bear 1 N m; the walls' friction bears the rest, as `minimum_friction` says.

    With next to no friction, forces that pull were taken for a proof that none is needed.
    """
    walls = [(-0.1, 0.0, 0.0), (0.1, 0.0, 0.0)]
    problem = QuasistaticProblem(
        [*FEET, *walls], [[0.0, 0.0, 1.0]] * 4 + [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]],
        [0.0, 0.0, -10.0, 0.0, 1.2, 0.0], friction=0.5,
    )  # fmt: skip
    least = minimum_friction(problem, static_friction=COULOMB).factor
    off = tolerances(problem, [], static_friction=COULOMB, quantities=["friction"]).each[0]
    assert off.balanced <= 1.0 - least <= off.failing
    assert off.balanced == pytest.approx(1.0 - least, abs=0.006)
    nearly_none = Uncertainty(friction=1.0 - 1e-8)
    assert not maximize_margin(problem, uncertainty=nearly_none, static_friction=COULOMB).found
    assert served_share(problem, Margin(), nearly_none, static_friction=COULOMB) < 0.97


def test_a_block_on_a_slope_by_hand():
    """Three feet at friction 0.5: it slides where gravity leans by atan 0.5, inside a pyramid."""
    feet = [[0.1, 0.0, -0.05], [-0.05, 0.08, -0.05], [-0.05, -0.08, -0.05]]
    problem = QuasistaticProblem(
        feet, [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -9.8, 0.0, 0.0, 0.0], friction=0.5, cone_edges=64
    )
    off = tolerances(problem, np.zeros(0), static_friction=COULOMB)
    inside = 0.5 * np.cos(np.pi / 64)
    assert off.of("push").failing <= inside * 9.8
    assert off.of("friction").failing == np.inf  # on the level it needs none
    # The centre of mass may go to the nearest side of the feet's triangle, 5 cm away.
    assert off.of("centre of mass").balanced == pytest.approx(0.0467, rel=0.02)
    tilt = off.of(Quantity.TILT)
    assert 0.9 * np.arctan(inside) < tilt.balanced < np.arctan(0.5)
    assert "centre of mass" in str(off)


def test_the_table_has_no_powers_of_ten_and_the_unit_of_each_figure():
    """2050 % is read at once, 2.05e+03 % is not; a hinge gives way by rad, a slide by m."""
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    given = Tolerance(Quantity.MASS_MORE, 20.483, 100.0, deflection=0.291)
    for units, unit in ((("N m", "N m"), "rad"), (("N", "N"), "m"), (("N m", "N"), "rad or m")):
        of = problem.with_changes(joint_units=units)
        off = Tolerances(of, np.zeros(2), (given,), np.zeros(3), None, coulomb=False)
        (row,) = off.table()[1]
        assert row == ("more mass", "2050 %", "10000 %", "", "", f"0.29 {unit}")
        assert "the best that friction that opposes virtual sliding allows" in str(off)


@pytest.mark.parametrize("name", ["cuboid_at_rest", "sphere_on_slope"])
def test_tilt_of_a_scene_against_scenes_that_are_tilted(name):
    """The set around all tilts is little larger: what is balanced is near to what fails."""
    scene = load_scene(f"examples/paper/{name}.yaml")
    torques = scene.solve("torque", margin=0.3, static_friction=COULOMB).torques
    off = scene.tolerances(torques, static_friction=COULOMB).of("gravity's direction")
    assert 0.95 * off.failing <= off.balanced < off.failing
    size = float(np.linalg.norm(scene.gravity))
    rng = np.random.default_rng(2)
    for _ in range(10):
        across = np.cross(scene.gravity / size, rng.normal(size=3))
        across *= size * np.tan(off.balanced) / np.linalg.norm(across)
        tilted = scene.gravity + across
        gravity = size * tilted / np.linalg.norm(tilted)
        assert imbalance(scene.with_changes(gravity=gravity).problem(), torques) < BALANCED


def test_what_has_no_tolerances():
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    with pytest.raises(NoSolutionError, match="balance"):
        tolerances(problem, [0.0, 0.0])
    with pytest.raises(ArgumentError, match="torques"):
        tolerances(problem, [0.0])
    torques = minimize_torque(problem, 0.1).torques
    with pytest.raises(ArgumentError, match="quantity: is 'push'; it must be one of 'more mass'"):
        tolerances(problem, torques, quantities=["more mass"]).of(Quantity.PUSH)
    assert Uncertainty().scaled(0.5).mass == 0.0


def test_joints_that_have_no_torque_left_to_add_are_named():
    """Both fingers' motors give all that they have: feedback has nothing to add to a push."""
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    torques = minimize_torque(problem, 0.5, static_friction="coulomb").torques
    full = problem.with_changes(torque_limits=(-np.abs(torques).max(), np.abs(torques).max()))
    for of, joints in ((problem, ()), (full, (0, 1))):
        off = tolerances(of, torques, feedback=10.0, quantities=["push"], static_friction="coulomb")
        assert off.of("push").joints == joints
        assert ("finger_1/hinge, finger_6/hinge" in str(off)) == bool(joints)


def test_figures_that_joints_give_way_far_for_are_told_to_be_rough():
    problem = load_scene("examples/allegro_sphere_on_slope.yaml").problem()
    torques = minimize_torque(problem, 0.05, static_friction="coulomb").torques
    soft, stiff = (
        tolerances(
            problem, torques, feedback=k, quantities=["more mass"], static_friction="coulomb"
        )
        for k in (1.0, 1e4)
    )
    assert soft.remark and str(soft).endswith("less may be tolerated")
    assert not stiff.remark and "may be tolerated" not in str(stiff)


@pytest.mark.parametrize("lacking", [1e-13, 0.3])
def test_joints_that_move_no_contact_do_not_count(lacking):
    """No contact force depends on what carries the links of an idle finger."""
    problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
    torques = minimize_torque(problem, 0.05, static_friction=COULOMB).torques
    idle = problem.with_changes(
        jacobian=np.pad(problem.jacobian, ((0, 0), (0, 1))),
        torque_limits=[np.append(one, end) for one, end in zip(
            (problem.lower_torque, problem.upper_torque), (-1.0, 1.0), strict=True
        )],
        gravity_torques=np.append(problem.gravity_torques, 0.3),
        joint_names=(*problem.joint_names, "idle"),
        joint_units=(*problem.joint_units, problem.joint_units[0]),
    )  # fmt: skip
    along_x, given = [[1, 0, 0, 0, 0, 0]], np.append(torques, 0.3 - lacking)
    found = [
        [
            tolerances(one, made, quantities=["push"], static_friction=COULOMB).each[0].balanced,
            disturbance_margin(one, made, along_x, static_friction=COULOMB).magnitudes[0],
            contact_force_bounds(one, made, static_friction=COULOMB).smallest_margin,
        ]
        for one, made in ((problem, torques), (idle, given))
    ]
    assert found[1] == pytest.approx(found[0], rel=1e-6, abs=1e-6)
