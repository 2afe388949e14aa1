"""The inertia that actuators feel: kinetic energy, two links by hand, couplings, rotors."""

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
from hand_tools import joint, link, random_pose, random_q, write_urdf

from graspless_pin.errors import ArgumentError, RobotError
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.hand.reading import read_robot
from graspless_pin.geometry.hand.tree import build_tree
from graspless_pin.geometry.robots.files import describe_urdf

LENGTH, MASS, INERTIA = 0.3, 0.5, 2e-3
OUT = 0.1
"""Of a link's centre of mass from its joint, m."""


def arm(folder, extra="", second='<axis xyz="0 0 1"/>', kind="revolute"):
    """Two links in a plane, and what else the file says."""
    bodies = "".join(
        f'<link name="{name}"><inertial><origin xyz="{OUT} 0 0"/><mass value="{MASS}"/>'
        f'<inertia ixx="1e-3" ixy="0" ixz="0" iyy="1e-3" iyz="0" izz="{INERTIA}"/></inertial>'
        "</link>"
        for name in ("upper", "lower")
    )
    limit = '<limit lower="-3" upper="3" effort="2" velocity="1"/>'
    return write_urdf(
        folder,
        f'<link name="base"/>{bodies}'
        '<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/>'
        f'<axis xyz="0 0 1"/>{limit}</joint>'
        f'<joint name="elbow" type="{kind}"><parent link="upper"/><child link="lower"/>'
        f'<origin xyz="{LENGTH} 0 0"/>{second}{limit}</joint>{extra}',
    )


def by_hand(angle):
    """The textbook's inertia of two links in a plane."""
    last = INERTIA + MASS * OUT**2
    mixed = MASS * LENGTH * OUT * np.cos(angle)
    first = INERTIA + MASS * OUT**2 + MASS * LENGTH**2 + last + 2.0 * mixed
    return np.array([[first, last + mixed], [last + mixed, last]])


@pytest.mark.parametrize("angle", [0.0, 0.7, -2.1])
def test_two_links_have_the_inertia_of_the_textbook(tmp_path, angle):
    hand = Hand.from_urdf(arm(tmp_path), q={"shoulder": 0.4, "elbow": angle})
    np.testing.assert_allclose(hand.joint_inertia(), by_hand(angle), atol=1e-14)


def test_a_linear_joint_moves_a_mass(tmp_path):
    hand = Hand.from_urdf(arm(tmp_path, second='<axis xyz="0 1 0"/>', kind="prismatic"))
    first = 2 * INERTIA + MASS * OUT**2 + MASS * (LENGTH + OUT) ** 2
    across = MASS * (LENGTH + OUT)  # kg m
    np.testing.assert_allclose(hand.joint_inertia(), [[first, across], [across, MASS]], atol=1e-14)


def test_a_joint_under_position_control_stands_still(tmp_path):
    file = arm(tmp_path)
    still = Hand.from_urdf(file, q={"elbow": 0.7}, control={"elbow": "position"})
    np.testing.assert_allclose(still.joint_inertia(), by_hand(0.7)[:1, :1], atol=1e-14)
    held = Hand.from_urdf(file, control="position")
    assert held.joint_inertia().shape == (0, 0)


@pytest.mark.parametrize("factor", [1.0, -0.5])
def test_a_coupled_joint_is_felt_where_it_follows(tmp_path, factor):
    """q2 = k q1 + c: one joint with M11 + 2 k M12 + k^2 M22."""
    file = tmp_path / "robot.yaml"
    arm(tmp_path)
    file.write_text(
        "name: r\nurdf: robot.urdf\n"
        f"couplings:\n  elbow: {{follows: shoulder, multiplier: {factor}, offset: 0.1}}\n"
    )
    hand = Hand.assemble([Mount(file)], q={"shoulder": 0.6}, armature={"shoulder": 0.02})
    M = by_hand(0.6 * factor + 0.1)
    expected = M[0, 0] + 2 * factor * M[0, 1] + factor**2 * M[1, 1] + 0.02
    np.testing.assert_allclose(hand.joint_inertia(), [[expected]], atol=1e-14)


@pytest.mark.filterwarnings("ignore::graspless_pin.errors.GrasplessPinWarning")
@pytest.mark.parametrize("name", ["allegro_right", "psyonic_right", "panda", "trihand"])
def test_half_of_v_M_v_is_the_kinetic_energy(name):
    """Against Pinocchio's energy, and against differences of the links' own places."""
    rng = np.random.default_rng(3)
    hand = Hand.assemble([Mount(name, random_pose(rng))], armature=1e-4)
    for _ in range(3):
        hand = hand.with_configuration(random_q(hand, rng))
        rates = rng.normal(size=len(hand.actuated_joint_names))
        joints = hand.actuation.from_joints @ rates
        q, model = hand.tree.configuration(hand.positions), hand.tree.pinocchio_model
        rotors = 0.5e-4 * np.square(joints[list(hand.tree.coupling.leaders)]).sum()
        bare = model.copy()
        bare.armature = np.zeros(model.nv)  # of which Pinocchio's energy has only a part
        links = pin.computeKineticEnergy(bare, bare.createData(), q, joints)
        assert links == pytest.approx(energy_of_links(model, q, joints), rel=1e-6)
        energy = 0.5 * rates @ hand.joint_inertia() @ rates
        assert energy == pytest.approx(links + rotors, rel=1e-12)


def energy_of_links(model, q, rates, step=1e-5):
    """Kinetic energy from where each link's centre of mass and axes go in a moment."""
    data, places = model.createData(), []
    for side in (-step, step):
        pin.forwardKinematics(model, data, pin.integrate(model, q, side * rates))
        centers = [p.act(i.lever) for p, i in zip(data.oMi, model.inertias, strict=True)]
        places.append((np.array(centers), [p.rotation.copy() for p in data.oMi]))
    energy = 0.0
    for index, inertia in enumerate(model.inertias):
        velocity = (places[1][0][index] - places[0][0][index]) / (2 * step)
        before, after = places[0][1][index], places[1][1][index]
        turning = pin.log3(before.T @ after) / (2 * step)  # in the link's own axes
        energy += inertia.mass * velocity @ velocity + turning @ inertia.inertia @ turning
    return 0.5 * energy


ROTOR = (
    '<transmission name="t" xmlns:drake="http://drake.mit.edu"><type>SimpleTransmission</type>'
    '<joint name="elbow"><hardwareInterface>EffortJointInterface</hardwareInterface></joint>'
    '<actuator name="m">{}</actuator></transmission>'
)
STATED = '<drake:rotor_inertia value="{}"/>'


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        (STATED.format("2e-6") + '<drake:gear_ratio value="-50"/>', 5e-3),
        (STATED.format("2e-6") + "<mechanicalReduction>100</mechanicalReduction>", 2e-2),
        (STATED.format("2e-6"), 2e-6),
        ("<mechanicalReduction>100</mechanicalReduction>", 0.0),
    ],
)
def test_a_urdfs_rotors_count_with_the_gear_ratio_squared(tmp_path, text, expected):
    file = arm(tmp_path, ROTOR.format(text))
    hand = Hand.assemble([Mount(file, prefix="left_")], q={"left_elbow": 0.7})
    rotors = hand.joint_inertia() - by_hand(0.7)
    np.testing.assert_allclose(rotors, np.diag([0.0, expected]), atol=1e-14)
    given = Hand.assemble([Mount(file)], q={"elbow": 0.7}, armature={"elbow": 0.5})
    np.testing.assert_allclose(
        given.joint_inertia() - by_hand(0.7), np.diag([0.0, 0.5]), atol=1e-14
    )


@pytest.mark.parametrize(
    ("value", "message"),
    [("-1e-6", "has the negative rotor_inertia -1e-06 kg"), ("big", "has rotor_inertia='big'")],
)
def test_wrong_rotors_are_named(tmp_path, value, message):
    with pytest.raises(RobotError, match=rf"robot.urdf: transmission 't' {message}"):
        Hand.from_urdf(arm(tmp_path, ROTOR.format(STATED.format(value))))


def test_a_rotor_of_a_joint_that_is_not_there_is_left_out(tmp_path):
    file = arm(tmp_path, ROTOR.format(STATED.format(1.0)).replace("elbow", "knee"))
    tree = build_tree([(read_robot(describe_urdf(file)), np.eye(4))])
    assert not tree.pinocchio_model.armature.any()


def test_armatures_are_given_by_finger_or_joint(tmp_path):
    body = "".join(link(name, mass=0.1) for name in ("base", "a", "b", "c"))
    body += joint("one", "base", "a") + joint("two", "a", "b") + joint("three", "base", "c")
    mount = Mount(write_urdf(tmp_path, body))
    bare = Hand.assemble([mount])
    finger = bare.finger_of("a")
    for armature, rotors in (
        (0.1, [0.1, 0.1, 0.1]),
        ({"two": 0.3, finger: 0.2}, [0.2, 0.3, 0.0]),
        ({finger: 0.2, "two": 0.3}, [0.2, 0.3, 0.0]),
    ):
        made = Hand.assemble([mount], armature=armature)
        added = made.joint_inertia() - bare.joint_inertia()
        order = [made.actuated_joint_names.index(name) for name in ("one", "two", "three")]
        np.testing.assert_allclose(added[np.ix_(order, order)], np.diag(rotors), atol=1e-15)


@pytest.mark.parametrize(
    ("armature", "message"),
    [
        (-1.0, r"^armature: is -1\.0; it must be a finite number >= 0"),
        ({"elbow": np.inf}, r"^armature\['elbow'\]: is inf; it must be a finite number"),
        ({"elbow": True}, r"^armature\['elbow'\]: is True; it must be a finite number"),
        ({"knee": 1.0}, r"^armature: unknown finger or joint 'knee'; known: .*elbow"),
    ],
)
def test_wrong_armatures_are_named(tmp_path, armature, message):
    with pytest.raises(ArgumentError, match=message):
        Hand.assemble([Mount(arm(tmp_path))], armature=armature)


def test_a_mimic_joint_has_no_rotor_of_its_own(tmp_path):
    file = arm(tmp_path)
    start = 'name="elbow" type="revolute">'
    file.write_text(file.read_text().replace(start, f'{start}<mimic joint="shoulder"/>'))
    with pytest.raises(ArgumentError, match=r"^armature\['elbow'\]: this joint mimics another one"):
        Hand.assemble([Mount(file)], armature={"elbow": 1.0})
