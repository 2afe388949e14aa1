"""Limits of motors that an MJCF states at their tendons, against MuJoCo's torques."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from graspless_pin import Hand
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.simulation.protocol import load_mujoco

mujoco = load_mujoco()

FINGER = """
<mujoco>
  <worldbody><body name="palm">
    <geom size="0.01"/>
    <body name="near" pos="0 0 0.1">
      <joint name="bend" axis="0 1 0"/><geom size="0.01"/>
      <body name="far" pos="0 0 0.1"><joint name="curl" axis="0 1 0"/><geom size="0.01"/></body>
    </body>
  </body></worldbody>
  <tendon><fixed name="belt" actuatorfrcrange="-5 4">ARMS</fixed></tendon>
  <actuator>MOTORS</actuator>
</mujoco>
"""
BEND, CURL = '<joint joint="bend" coef="0.01"/>', '<joint joint="curl" coef="0.02"/>'
PULL = '<motor name="pull" tendon="belt" gear="3" ctrlrange="-10 10"/>'


def most_torques(path: Path) -> np.ndarray:
    """Return MuJoCo's torques at the joints, all motors commanded to pull as much as they can."""
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.ctrl[:] = model.actuator_ctrlrange[:, 1]
    mujoco.mj_forward(model, data)
    return np.array(data.qfrc_actuator)


@pytest.mark.filterwarnings("ignore:effort limits that look like placeholders")
@pytest.mark.parametrize("motors", [PULL, PULL + PULL.replace('"pull"', '"other"')])
def test_a_tendon_bounds_what_its_motors_do_at_one_joint(tmp_path: Path, motors: str) -> None:
    path = tmp_path / "finger.xml"
    path.write_text(FINGER.replace("ARMS", BEND).replace("MOTORS", motors))
    hand = Hand.from_urdf(path)
    column = hand.actuated_joint_names.index("bend")
    assert hand.effort_limits[1][column] == pytest.approx(most_torques(path)[0])


def test_a_tendon_bounds_its_own_tension(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    path.write_text(FINGER.replace("ARMS", BEND + CURL).replace("MOTORS", PULL))
    hand = Hand.from_urdf(path)
    column = hand.actuated_joint_names.index("pull")
    lower, upper = (ends[column] for ends in hand.effort_limits)
    assert (lower, upper) == (-5.0, 4.0)
    np.testing.assert_allclose(most_torques(path), upper * 3 * np.array([0.01, 0.02]))


def test_the_range_of_a_joint_bounds_the_tendon_that_pulls_it(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    robot = FINGER.replace("ARMS", BEND + CURL).replace("MOTORS", PULL)
    path.write_text(robot.replace('name="curl"', 'name="curl" actuatorfrcrange="-0.06 0.12"'))
    hand = Hand.from_urdf(path)
    column = hand.actuated_joint_names.index("pull")
    assert [ends[column] for ends in hand.effort_limits] == pytest.approx([-1.0, 2.0])
    # What MuJoCo makes of more is cut at one joint alone, and no tension of the tendon.
    assert most_torques(path) == pytest.approx([4.0 * 3.0 * 0.01, 0.12])


def test_a_range_cuts_a_motor_beside_a_tendon_that_opposes_itself(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    tip = '<body><joint name="tip" axis="0 1 0"/><geom size="0.01"/></body>'
    follow = "".join(f'<joint joint1="{name}" joint2="bend"/>' for name in ("curl", "tip"))
    robot = FINGER.replace("ARMS", CURL + '<joint joint="tip" coef="-0.01"/>')
    robot = robot.replace("MOTORS", '<motor joint="bend" ctrlrange="-3 3"/>' + PULL)
    robot = robot.replace('"-5 4"', '"-4 4"').replace("</body>", f"{tip}</body>", 1)
    robot = robot.replace("<tendon", f"<equality>{follow}</equality><tendon")
    path.write_text(robot.replace('name="bend"', 'name="bend" actuatorfrcrange="-2 2"'))
    (limit,) = Hand.from_urdf(path).effort_limits[1]
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    reached = []
    for command in np.mgrid[-3:3:31j, -10:10:31j].reshape(2, -1).T:
        data.ctrl[:] = command
        mujoco.mj_forward(model, data)
        reached.append(data.qfrc_actuator.sum())
    assert limit == pytest.approx(max(reached))


@pytest.mark.parametrize("ends", ["-10 10", "0 10", "-10 0"])
def test_one_number_bounds_a_tendon_the_ways_that_its_motor_acts(tmp_path: Path, ends: str) -> None:
    path, own = tmp_path / "finger.xml", FINGER.replace('actuatorfrcrange="-5 4"', "")
    own = own.replace("ARMS", BEND + CURL)
    path.write_text(own.replace("MOTORS", PULL.replace("-10 10", ends)))
    hand = Hand.from_urdf(path, effort_limits={"pull": 2.0})
    column = hand.actuated_joint_names.index("pull")
    path.write_text(own.replace("MOTORS", PULL.replace("ctrl", 'forcerange="-2 2" ctrl')))
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    for limits, command in zip(hand.effort_limits, map(float, ends.split()), strict=True):
        data.ctrl[:] = command
        mujoco.mj_forward(model, data)
        assert limits[column] == pytest.approx(data.actuator_force[0])
    (tmp_path / "robot.yaml").write_text(
        "name: r\nurdf: finger.xml\neffort_limits: {pull: {limit: 2, source: me}}\n"
    )
    path.write_text(own.replace("MOTORS", PULL.replace("-10 10", ends)))
    said = Hand.assemble([Mount(tmp_path / "robot.yaml")])
    np.testing.assert_array_equal(said.effort_limits, hand.effort_limits)


def test_a_tendon_that_pulls_one_way_has_a_known_limit(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    pull = PULL.replace("-10 10", "-3 0")
    path.write_text(FINGER.replace("ARMS", BEND + CURL).replace("MOTORS", pull))
    assert not Hand.from_urdf(path).findings


def test_a_joint_that_follows_bounds_what_motors_do_at_itself_alone(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    follow = '<equality><joint joint1="curl" joint2="bend" polycoef="0 2 0 0 0"/></equality>'
    motors = "".join(
        f'<motor joint="{name}" ctrlrange="-3 3"/>' for name in ("bend", "curl", "curl")
    )
    robot = (
        FINGER.replace("ARMS", BEND)
        .replace("MOTORS", motors)
        .replace("<tendon", follow + "<tendon")
    )
    robot = robot.replace('name="bend" axis', 'name="bend" actuatorfrcrange="-2 2" axis')
    path.write_text(robot.replace('name="curl" axis', 'name="curl" actuatorfrcrange="-4 4" axis'))
    (limit,) = Hand.from_urdf(path).effort_limits[1]
    np.testing.assert_allclose(most_torques(path), [2.0, 4.0])
    assert limit == pytest.approx(most_torques(path) @ [1.0, 2.0])


@pytest.mark.filterwarnings("ignore:effort limits that look like placeholders")
@pytest.mark.parametrize(
    ("states", "most"),
    [('ctrlrange="-9 9" actrange="-3 4" dyntype="integrator"', 3.0 * 2.0),
     ('ctrlrange="-9 9" actrange="-3 4" dyntype="filter" dynprm="0.1"', 3.0 * 2.0),
     ('ctrlrange="-2 2" actrange="-3 4" dyntype="filter" dynprm="0.1"', 2.0 * 2.0),
     ('ctrlrange="-9 9" dyntype="integrator"', np.inf)],
)  # fmt: skip
def test_what_a_motor_integrates_is_bounded_by_its_activation(
    tmp_path: Path, states: str, most: float
) -> None:
    path = tmp_path / "finger.xml"
    motor = f'<general name="pull" joint="bend" gainprm="2" {states}/>'
    path.write_text(FINGER.replace("ARMS", CURL).replace("MOTORS", motor))
    hand = Hand.from_urdf(path, effort_limits={"curl": 0.0})
    assert hand.effort_limits[1][hand.actuated_joint_names.index("bend")] == most
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.ctrl[:] = model.actuator_ctrlrange[:, 0]
    mujoco.mj_step(model, data, 5000)
    mujoco.mj_forward(model, data)
    assert -data.qfrc_actuator[0] == pytest.approx(min(most, 2.0 * 9.0 * data.time), rel=1e-3)
