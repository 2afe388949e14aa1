"""Feedback that makes rest stable: closed forms, spheres by curvature, simulated rates."""

import functools

import numpy as np
import pytest
from scene_tools import EXAMPLES, loaded
from scipy.linalg import null_space

from graspless_pin import free_motions, load_scene, minimum_stiffness, stability
from graspless_pin.errors import ArgumentError
from graspless_pin.scene import Scene

G = 9.81
SIMULATED = {"margin": (14.0, 1.0), "torque": (9.0, 0.5)}
"""Growth in MuJoCo, 1/s, and the feedback that was tried and stopped it, N m/rad."""


def standing(folder, shape, height, support, mass=0.5, **more) -> Scene:
    """One body on top of another that is fixed."""
    return loaded(
        folder,
        {
            "gravity": [0, 0, -G],
            "friction": 0.8,
            "object": {"shape": shape, "mass": mass, "pose": {"position": [0, 0, height]}},
            "supports": [{"name": "below", **support}],
            **more,
        },
    )


def ball(radius):
    return {"type": "sphere", "radius": radius}


def test_a_ball_on_a_ball_rolls_off_at_the_textbooks_rate(tmp_path):
    scene = standing(tmp_path, ball(0.05), 0.25, {"shape": ball(0.2)})
    found = minimum_stiffness(scene, [])
    assert found.growth == pytest.approx(np.sqrt(5 * G / (7 * 0.25)), rel=1e-5)
    assert found.stiffness == np.inf
    assert found.motion is not None
    assert np.abs(found.motion).max() == 1.0
    rolled = np.cross(found.motion[3:6], [0, 0, 0.05])
    np.testing.assert_allclose(found.motion[:3], rolled, atol=1e-9)


def test_walls_that_bear_nothing_do_not_keep_a_ball_on_a_ball(tmp_path):
    """Three contacts leave no motion without slip, but two of them can bear no friction."""
    walls = [
        {
            "name": name,
            "shape": {"type": "box", "size": [0.02, 0.02, 0.02]},
            "pose": {"position": [*position, 0.25]},
        }
        for name, position in (("left", [-0.06, 0.0]), ("behind", [0.0, -0.06]))
    ]
    below = {"name": "below", "shape": ball(0.2)}
    scene = standing(
        tmp_path, ball(0.05), 0.25, below, supports=[below, *walls], friction=0.3
    )  # with more of it the ball can jam
    assert scene.problem().contact_count == 3 and len(free_motions(scene.problem())) == 0
    found = minimum_stiffness(scene, [])
    assert found.growth == pytest.approx(np.sqrt(5 * G / (7 * 0.25)), rel=1e-5)
    said = scene.stability([])
    assert said.status == "strong" and said.holding == "fails"
    alone = stability(scene.problem(), [])
    assert alone.status == "strong" and alone.holding == "undecided"
    assert "some contacts carry no load" in str(alone)


def board_on_cylinder(folder, half) -> Scene:
    """It falls if its centre is farther up than the cylinder's radius, 0.1 m."""
    board = {"type": "box", "size": [0.4, 0.2, 2 * half]}
    cylinder = {"type": "cylinder", "radius": 0.1, "length": 0.1}
    lying = {"shape": cylinder, "pose": {"rpy": [np.pi / 2, 0, 0]}}
    return standing(folder, board, 0.1 + half, lying)


@pytest.mark.parametrize("half", [0.05, 0.15])
def test_a_board_rocks_on_a_cylinder_that_is_thick_enough(tmp_path, half):
    found = minimum_stiffness(board_on_cylinder(tmp_path, half), [])
    turned = (0.4**2 + (2 * half) ** 2) / 12 + half**2
    expected = np.sqrt(max(half - 0.1, 0.0) * G / turned)
    assert found.growth == pytest.approx(expected, rel=1e-4)
    assert found.stiffness == (np.inf if half > 0.1 else 0.0)


def test_a_ball_on_a_table_stays_where_it_is_put(tmp_path):
    scene = standing(tmp_path, ball(0.05), 0.05, {"shape": {"type": "half_space"}})
    found = minimum_stiffness(scene, [])
    assert (found.growth, found.stiffness, found.motion) == (0.0, 0.0, None)


CART = """<robot name="cart"><link name="rail"/><link name="cart">
<inertial><mass value="{mass}"/><inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/>
</inertial><collision><geometry><sphere radius="0.2"/></geometry></collision></link>
<joint name="slide" type="prismatic"><parent link="rail"/><child link="cart"/><axis xyz="1 0 0"/>
<limit lower="-1" upper="1" effort="10" velocity="1"/></joint></robot>"""


@pytest.mark.parametrize("armature", [0.0, 0.4])
def test_a_cart_slips_away_below_a_ball(tmp_path, armature):
    """T = (m_c + m)/2 x'^2 + m x' s' + 7/10 m s'^2, V = -m g s^2 / (2 (R + r))."""
    (tmp_path / "cart.urdf").write_text(CART.format(mass=1.6))
    hand = {"urdf": "cart.urdf", "armature": 0.0}
    far = {"shape": {"type": "half_space"}, "pose": {"position": [0, 0, -1]}}
    scene = standing(tmp_path, ball(0.05), 0.25, far, mass=0.5, hand=hand)
    # What is per radian counts over (0.1 m)^2 at a joint that slides.
    found = minimum_stiffness(scene, [0.0], armature=0.01 * armature, damping=0.0)
    effective = 7 / 5 * 0.5 - 0.5**2 / (0.5 + 1.6 + armature)
    assert found.growth == pytest.approx(np.sqrt(0.5 * G / 0.25 / effective), rel=1e-4)
    assert found.stiffness == np.inf  # across the rail it falls all the same
    assert dict(found.per_joint) == {"slide": np.inf}
    assert (found.armature, found.damping) == (0.01 * armature, 0.0)


def of_spheres(scene, torques, armature, damping):
    """Growth under feedback at touching fingers, from the spheres' curvatures.

    A contact point moves by (w - w_tip) x n / (1/R + 1/r) on both surfaces; levers and the links'
    weight change as differences of Pinocchio's figures along the joints tell.
    """
    problem, hand = scene.problem(), scene.hand
    tree, found = hand.tree, scene.contacts.arrays
    count = found.hand_count
    joints = [index for index, name in enumerate(problem.joint_names)
              if hand.finger_of(f"link_{name.removeprefix('joint_')}") in TOUCHING]  # fmt: skip
    kept = np.r_[:6, 6 + np.array(joints)]
    G_map = np.hstack([problem.W.T, -problem.jacobian])[:, kept]
    load = np.r_[problem.external_wrench, torques - problem.gravity_torques][kept]
    N = np.linalg.svd(G_map)[2][len(G_map) :].T
    forces = np.linalg.lstsq(G_map.T, -load, rcond=None)[0].reshape(-1, 3)
    carriers = [tree.link_joints[link] for link in found.bodies[:count]]
    J = tree.kinematics(hand.positions).J

    def joint_load(q, points):
        rows = tree.point_jacobians(tree.kinematics(q).J, carriers, points)
        return np.einsum("kij,ki->j", rows, forces[:count]) + tree.gravity_torques(q, scene.gravity)

    curvatures = np.array([1 / 0.06 + 1 / 0.012] * count + [1 / 0.06])[:, None]
    change = np.zeros((len(kept), N.shape[1]))
    for column, motion in enumerate(N.T):
        rates = np.zeros(problem.joint_count)
        rates[joints] = motion[6:]
        tips = [J[3:] * tree.supports[one] @ rates for one in carriers]
        spins = np.vstack([*tips, np.zeros(3)])
        points = motion[:3] + np.cross(motion[3:6], problem.positions)
        points = points + np.cross(motion[3:6] - spins, problem.normals) / curvatures
        change[3:6, column] = np.cross(points - motion[:3], forces).sum(axis=0)
        sides = [
            joint_load(hand.positions + e * rates, found.positions[:count] + e * points[:count])
            for e in (-1e-6, 1e-6)
        ]
        change[6:, column] = -(sides[1] - sides[0])[joints] / 2e-6
    M = np.zeros((len(kept), len(kept)))
    M[:6, :6] = problem.object_inertia
    M[6:, 6:] = problem.joint_inertia[np.ix_(joints, joints)] + armature * np.eye(len(joints))
    inertia, P = N.T @ M @ N, N[6:].T @ N[6:]

    def growth(feedback):
        K = feedback * P - N.T @ change
        back = -np.linalg.solve(inertia, np.hstack([K, damping * P]))
        step = np.vstack([np.eye(len(K), 2 * len(K), len(K)), back])
        return np.linalg.eigvals(step).real.max()

    return growth


TOUCHING = ("index", "ring")


@functools.cache
def sphere(algorithm: str) -> tuple[Scene, np.ndarray]:
    """The example with the ball, and the torques of an answer."""
    scene = load_scene(EXAMPLES / "allegro_sphere_on_slope.yaml")
    return scene, scene.solve(algorithm).torques


@pytest.mark.parametrize("algorithm", ["margin", "torque"])
def test_the_ball_is_lost_as_its_curvatures_tell(algorithm):
    scene, torques = sphere(algorithm)
    found = minimum_stiffness(scene, torques)
    growth = of_spheres(scene, torques, 1e-4, 0.02)
    assert found.growth == pytest.approx(growth(0.0), rel=1e-4)
    assert growth(0.98 * found.stiffness) > 0.0 > growth(1.02 * found.stiffness)
    rate, stopped_by = SIMULATED[algorithm]
    assert found.growth == pytest.approx(rate, rel=0.2)
    assert found.stiffness == pytest.approx(stopped_by, rel=0.2)
    assert found.stiffness < stopped_by


def pressed_aside(folder, mode) -> Scene:
    """A ball on a ball, and a round tip that a joint pushes against its side."""
    (folder / "rod.urdf").write_text(
        '<robot name="rod"><link name="base"/><link name="tip"><inertial><mass value="0.1"/>'
        '<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>'
        '<collision><geometry><sphere radius="0.01"/></geometry></collision></link>'
        '<joint name="slide" type="prismatic"><parent link="base"/><child link="tip"/>'
        '<axis xyz="-1 0 0"/><limit lower="-1" upper="1" effort="50" velocity="1"/></joint></robot>'
    )
    return standing(
        folder, ball(0.05), 0.25, {"shape": ball(0.2)}, friction=1.5,
        hand={
            "urdf": "rod.urdf", "control": {"rod": mode},
            "fingers": {"rod": {"joints": ["slide"], "tip": "tip"}},
            "base_pose": {"position": [0.06, 0, 0.25]},
        },
    )  # fmt: skip


@pytest.mark.parametrize("force", [0.5, 2.0])
def test_a_hybrid_finger_follows_as_a_joint_along_the_normal_does(force, tmp_path):
    """The one motion rolls across the normal: the joint stands still, and only its force counts."""
    scene, given = pressed_aside(tmp_path, "force"), {}
    for mode in ("force", "hybrid"):
        scene = pressed_aside(tmp_path, mode)
        given[mode] = minimum_stiffness(scene, [force])
        assert scene.stability([force]).holding == "fails"
    by_joint, hybrid = given["force"], given["hybrid"]
    assert hybrid.growth == pytest.approx(by_joint.growth, rel=1e-6) and hybrid.growth > 1.0
    assert by_joint.motion is not None and hybrid.motion is not None
    np.testing.assert_allclose(np.abs(hybrid.motion), np.abs(by_joint.motion), atol=1e-6)
    np.testing.assert_allclose(hybrid.forces, by_joint.forces, atol=1e-6)


ARM = """<link name="{name}"><inertial><origin xyz="0.05 0 0"/><mass value="0.1"/>
<inertia ixx="1e-4" iyy="1e-4" izz="1e-4" ixy="0" ixz="0" iyz="0"/></inertial>{shape}</link>
<joint name="j{name}" type="revolute"><parent link="{parent}"/><child link="{name}"/>
<origin xyz="{at} 0 0"/><axis xyz="0 0 1"/>
<limit lower="-3" upper="3" effort="5" velocity="1"/></joint>"""
TIP = (
    """<collision><origin xyz="0.1 0 0"/><geometry><sphere radius="0.01"/></geometry></collision>"""
)
BENT = np.array([0.5, -0.9, 0.6])


def pressing_arm(folder, radius=0.01, **more) -> Scene:
    """Three links of 0.1 m press a box against a wall, and may buckle.

    They press with a round tip, or with the end of the last where it has no shape.
    """
    body = '<link name="base"/>'
    for name, parent, at in zip("abc", ("base", "a", "b"), (0.0, 0.1, 0.1), strict=True):
        shape = TIP if name == "c" and radius else ""
        body += ARM.format(name=name, parent=parent, at=at, shape=shape)
    (folder / "arm.urdf").write_text(f'<robot name="arm">{body}</robot>')
    x, y = end_of(BENT).tolist()
    return loaded(
        folder,
        {
            "gravity": [0, 0, -G],
            "friction": 0.8,
            "hand": {
                "urdf": "arm.urdf",
                "q": dict(zip(("ja", "jb", "jc"), BENT.tolist(), strict=True)),
                "count_own_weight": False,
                "base_pose": {"position": [-x - radius, -y, 0.0]},
            },
            "object": {
                "shape": {"type": "box", "size": [0.1, 0.1, 0.1]},
                "mass": 0.5,
                "pose": {"position": [0.05, 0, 0]},
            },
            "supports": [{
                "name": "wall",
                "shape": {"type": "half_space"},
                "pose": {"position": [0.1, 0, 0], "rpy": [0, -np.pi / 2, 0]},
            }],
            **more,
        },
    )  # fmt: skip


def end_of(q):
    """Where the last link ends."""
    angles = np.cumsum(q)
    return 0.1 * np.array([np.cos(angles).sum(), np.sin(angles).sum()])


def rolled_end_of(q):
    """How far the tip's centre is from the box, and how far a point of the tip has rolled on it."""
    x, y = end_of(q)
    return np.array([x, y + 0.01 * np.sum(q)])


def assert_buckles(scene, torques, kept):
    """One motion is left: U = -tau q along the curve on which some function of q keeps its value.

    Returns what is found of it, its stiffness and its tangent.
    """
    problem = scene.problem()
    found = minimum_stiffness(scene, torques, armature=0.0, damping=0.0)
    slope = np.array([(kept(BENT + e) - kept(BENT - e)) / 2e-6 for e in 1e-6 * np.eye(3)]).T
    tangent = null_space(slope)[:, 0]

    def energy(s):
        q = BENT + s * tangent
        for _ in range(20):  # back to the curve, across it
            off = kept(q) - kept(BENT)
            q = q - np.linalg.solve(np.vstack([slope, tangent]), [*off, 0.0])
        return -torques @ q

    step = 1e-3
    K = (energy(step) - 2.0 * energy(0.0) + energy(-step)) / step**2
    assert K < 0.0
    inertia = tangent @ problem.joint_inertia @ tangent
    assert found.growth == pytest.approx(np.sqrt(-K / inertia), rel=1e-4)
    assert found.stiffness == pytest.approx(-K, rel=1e-4)
    return found, K, tangent


def test_a_pressing_arm_buckles_as_its_energy_tells(tmp_path):
    scene = pressing_arm(tmp_path)
    torques = scene.problem().jacobian[:3].T @ [20.0, 0.0, 0.0]
    found, K, tangent = assert_buckles(scene, torques, rolled_end_of)
    for name, share in zip(("ja", "jb", "jc"), tangent, strict=True):
        assert found.per_joint[name] == pytest.approx(-K / share**2, rel=1e-4)
    assert found.motion is not None
    np.testing.assert_allclose(found.motion[:6], 0.0, atol=1e-9)
    slower = minimum_stiffness(scene, torques, armature=1e-3, damping=0.05)
    assert slower.growth < 0.8 * found.growth
    assert slower.stiffness == pytest.approx(found.stiffness, rel=5e-3)


def test_what_it_cannot_tell_is_refused(tmp_path):
    scene, torques = sphere("torque")
    with pytest.raises(ArgumentError, match=r"^torques: cannot be balanced by contact forces"):
        minimum_stiffness(scene, 0.9 * torques)
    with pytest.raises(ArgumentError, match=r"^torques: has shape \(2,\); expected \(16,\)"):
        minimum_stiffness(scene, [0.0, 1.0])
    with pytest.raises(ArgumentError, match=r"^damping: is -1"):
        minimum_stiffness(scene, torques, damping=-1)
