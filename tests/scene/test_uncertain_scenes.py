"""What scene files say that is not known exactly: the same as in Python, saved, and refused."""

from __future__ import annotations

import pickle
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scene_tools import EXAMPLES, PAPER, content, loaded

from graspless_pin import (
    Scene,
    Uncertainty,
    load_scene,
    maximize_margin,
    uncertainty_gradients,
)
from graspless_pin.algorithms.robust_torques import solve_robust
from graspless_pin.errors import ArgumentError, SceneError
from graspless_pin.interfaces.mujoco import scene_from_mjcf, scene_to_mjcf
from graspless_pin.scene.uncertain import weight_of

MUG = EXAMPLES / "allegro_mug_against_wall.yaml"
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
CUBOID = PAPER / "cuboid_at_rest.yaml"
OPTIONS: dict[str, Any] = {"margin": 0.05, "static_friction": "coulomb"}


def scene_with(folder: Path, uncertainty: Any, source: Path = MUG, **others: Any) -> Scene:
    """Load an example that says what is not known of it."""
    data = content(source) | {"uncertainty": uncertainty} | others
    for item in (data["object"]["shape"], data["hand"]):
        for key in item.keys() & {"path", "urdf"}:
            item[key] = str(source.parent / item[key])
    return loaded(folder, data)


def test_a_file_says_what_python_says(tmp_path: Path) -> None:
    scene = scene_with(tmp_path, {"mass": 0.2, "center_of_mass": 0.01, "friction": 0.1})
    stated = Uncertainty(mass=0.2, center_of_mass=(0.01, 0.01, 0.01), friction=0.1)
    ours = scene.solve("torque", uncertainty=True, **OPTIONS)
    theirs = load_scene(MUG).solve("torque", uncertainty=stated, **OPTIONS)
    assert ours.max_torque == pytest.approx(theirs.max_torque, rel=1e-9)
    assert [one.words for one in ours.members] == [one.words for one in theirs.members]
    nominal = scene.solve("torque", **OPTIONS)
    assert nominal.max_torque < 0.9 * ours.max_torque
    assert scene.solve("torque", uncertainty=False, **OPTIONS).max_torque == nominal.max_torque


def test_names_stand_for_contacts_and_joints(tmp_path: Path) -> None:
    """A body's own figure comes before its group's, a joint's before its finger's."""
    friction = {"hand": 0.2, "link_3.0_tip": 0.3, "default": 0.05}
    effort = {"index": 0.4, "joint_1.0": 0.2, "default": 0.1}
    scene = scene_with(tmp_path, {"friction": friction, "effort": effort, "mass": 0.1})
    problem, hand = scene.problem(), scene.hand
    assert hand is not None
    shares = [
        {"link_3.0_tip": 0.3}.get(body, 0.05 if body == "wall" else 0.2)
        for body in scene.contacts.bodies
    ]
    assert {*shares} == {0.3, 0.2, 0.05}
    of_index = [f"joint_{number}.0" for number in (0, 2, 3)]
    lacking = [
        0.4 if name in of_index else 0.2 if name == "joint_1.0" else 0.1
        for name in problem.joint_names
    ]
    arrays = Uncertainty(friction=shares, effort=lacking, mass=0.1)
    objective, how = scene.objective_and_options("torque", **OPTIONS)
    weight = weight_of(scene, problem.joint_count)
    expected = solve_robust(problem, objective, arrays, how, weight=weight)
    found = scene.solve("torque", uncertainty=True, **OPTIONS)
    assert found.max_torque == pytest.approx(expected.max_torque, rel=1e-9)
    for ours, theirs in zip(found.members, expected.members, strict=True):
        np.testing.assert_allclose(ours.problem.friction, theirs.problem.friction, rtol=1e-12)
        np.testing.assert_allclose(ours.problem.upper_torque, theirs.problem.upper_torque)
    half = scene.uncertainty.scaled(0.5) if scene.uncertainty is not None else None
    assert half is not None and half.friction == {name: 0.5 * x for name, x in friction.items()}
    assert half.mass == 0.05
    cuboid = load_scene(CUBOID)
    first, *_, last = cuboid.problem().joint_names
    named = Uncertainty(torque={"finger_1/finger": 0.1, last: 0.05}, torque_offset={first: 0.02})
    assert first.startswith("finger_1/")
    listed = Uncertainty(torque=[0.1, 0.05], torque_offset=[0.02, 0.0])
    robust = [
        cuboid.solve(uncertainty=one, static_friction="coulomb").margin for one in (named, listed)
    ]
    assert robust[0] == pytest.approx(robust[1], rel=1e-9)
    assert robust[0] < 0.5 * cuboid.solve(static_friction="coulomb").margin


def test_friction_is_uncertain_by_pair_of_materials(tmp_path: Path) -> None:
    """What a scene says of its contacts, as figures of each contact say it."""
    table = {"rubber": {"stoneware": 0.9, "wood": 0.6}, "stoneware": {"plaster": 0.3}}
    data = content(MUG)
    made = data["object"] | {"material": "stoneware"}
    own = data["hand"] | {"material": "rubber"}
    walls = [data["supports"][0] | {"material": "plaster"}]
    rubbing = {"object": made, "hand": own, "supports": walls, "materials": table}

    def shares(friction: Any, **others: Any) -> list[float]:
        scene = scene_with(tmp_path, {"friction": friction}, **{**rubbing, **others})
        (member,) = scene.solve(uncertainty=True, static_friction="coulomb").members
        least = member.problem.friction / scene.problem().friction
        by_body = dict(zip(scene.contacts.bodies, (1.0 - least).round(12).tolist(), strict=True))
        assert len({by_body[one] for one in by_body if one != "wall"}) == 1
        again = load_scene(scene.save(tmp_path / "again.yaml", overwrite=True))
        assert again.uncertainty is not None and again.uncertainty.friction == friction
        half = again.uncertainty.scaled(0.5)
        assert str(half.scaled(2.0)) == str(again.uncertainty)
        return [by_body["link_3.0_tip"], by_body["wall"]]

    pair = {"rubber": {"stoneware": 0.1, "wood": 0.4}}
    assert shares(pair) == [0.1, 0.0]
    assert shares({"stoneware": {"rubber": 0.1}, "default": 0.2}) == [0.1, 0.2]
    assert shares({"plaster": 0.3, "stoneware": 0.2}) == [0.2, 0.3]
    assert shares({"hand": 0.3, "rubber": 0.2}) == [0.2, 0.0]
    # The support's own coefficient is none of the table's.
    bare = [walls[0] | {"friction": 0.3}]
    assert shares({"plaster": 0.3, **pair}, supports=bare) == [0.1, 0.0]
    with pytest.raises(SceneError, match=r"friction.rubber.stone: is not a material; did you mean"):
        shares({"rubber": {"stone": 0.1}})
    with pytest.raises(SceneError, match=r"is 0.1, but the reversed pair has 0.2"):
        shares({"rubber": {"stoneware": 0.1}, "stoneware": {"rubber": 0.2}})
    line = "unknown   friction rubber on stoneware ±10, rubber on wood ±40 %"
    told = scene_with(tmp_path, {"friction": pair}, **rubbing)
    assert line in str(told).splitlines()


def test_kilograms_add_to_the_share(tmp_path: Path) -> None:
    """A mass of 0.255 kg ± 10 % ± 25.5 g is one of ± 20 %."""
    scene = scene_with(tmp_path, {"mass": 0.1, "mass_offset": 0.0255})
    both = scene.solve("torque", uncertainty=True, **OPTIONS)
    share = load_scene(MUG).solve("torque", uncertainty=Uncertainty(mass=0.2), **OPTIONS)
    assert both.max_torque == pytest.approx(share.max_torque, rel=1e-9)
    assert sorted(one.words for one in both.members) == [
        "mass +0.051 kg (+20 %)",
        "mass -0.051 kg (-20 %)",
    ]
    line = "unknown   mass ±10 %, mass ±0.0255 kg"
    assert line in str(scene).splitlines()
    by_figure = uncertainty_gradients(both).values
    per_share = uncertainty_gradients(share).values["mass"]
    assert by_figure["mass"] == pytest.approx(per_share, rel=1e-5)
    assert by_figure["mass_offset"] == pytest.approx(per_share / 0.255, rel=1e-5)


def test_a_stated_stiffness_is_the_feedback(tmp_path: Path) -> None:
    """A ball rolls away under constant torques: nothing serves two loads."""
    unknown = {"mass": 0.2, "center_of_mass": 0.005}
    scene = scene_with(tmp_path, unknown, BALL)
    assert not scene.solve("torque", uncertainty=True, **OPTIONS).found
    held = scene.with_changes(controller=1.0)
    found = held.solve("torque", uncertainty=True, **OPTIONS)
    given = scene.solve("torque", uncertainty=True, feedback=1.0, **OPTIONS)
    assert found.max_torque == pytest.approx(given.max_torque, rel=1e-9)
    assert not held.solve("torque", uncertainty=True, feedback=0.0, **OPTIONS).found
    still = scene.with_changes(controller="position")
    assert not still.solve("torque", uncertainty=True, **OPTIONS).found
    constant, stiff = (
        one.tolerances(found.torques, static_friction="coulomb").of("push").balanced
        for one in (scene, held)
    )
    assert constant == 0.0 < stiff


def test_what_may_be_off_is_told_of_what_does_not_turn():
    scene = load_scene(EXAMPLES / "panda_stop_with_board.yaml")
    with pytest.raises(ArgumentError, match=r"^scene: has an object that turns: uncertain mass"):
        scene.tolerances(scene.solve().torques)


@pytest.mark.parametrize(
    "stated",
    [
        {"mass": 0.2},
        {"mass": 0.0},
        {"mass": 0.1, "mass_offset": 0.03},
        {"center_of_mass": [0.01, 0.0, 0.02], "force": 0.5, "moment": [0.0, 0.0, 0.1]},
        {"contact_position": 0.002},
        {"contact_position": {"hand": 0.001, "wall": 0.002}},
        {"tilt": 0.1, "friction": {"hand": 0.2, "wall": 0.1}, "torque": {"index": 0.05}},
        {"torque_offset": 0.01, "effort": {"joint_1.0": 0.1, "default": 0.2}},
        {"center_of_mass_radius": 0.01, "force_radius": 0.2, "moment_radius": 0.003},
    ],
)
def test_saved_scenes_say_it_again(tmp_path: Path, stated: dict[str, Any]) -> None:
    scene = scene_with(tmp_path, stated)
    (tmp_path / "again").mkdir()
    copied = scene.save(tmp_path / "copy.yaml")
    made = scene.with_changes(path=None).save(tmp_path / "again" / "made.yaml")
    assert content(copied)["uncertainty"] == stated
    assert content(made)["uncertainty"] == {key: one for key, one in stated.items() if one}
    pickled = pickle.loads(pickle.dumps(scene))  # noqa: S301 - our own bytes
    for again in (pickled, load_scene(copied), load_scene(made)):
        for name, value in vars(scene.uncertainty).items():
            np.testing.assert_equal(getattr(again.uncertainty, name), value, err_msg=name)
    assert not pickled.uncertainty.force.flags.writeable
    other = scene.with_changes({"uncertainty.mass": 0.3}).with_changes(name="other")
    again = load_scene(other.save(tmp_path / "other.yaml"))
    assert again.uncertainty is not None and again.uncertainty.mass == 0.3
    none = scene.with_changes(uncertainty=None)
    assert "uncertainty" not in content(none.save(tmp_path / "none.yaml"))
    of_all = scene.with_changes(uncertainty=Uncertainty(friction={"default": 0.1}))
    saved = content(of_all.save(tmp_path / "of_all.yaml"))
    assert saved["uncertainty"] == {"friction": 0.1}


def test_an_mjcf_and_the_screen_say_it_too() -> None:
    mujoco: Any = pytest.importorskip("mujoco")
    stated = Uncertainty(mass=0.2, force=(0.1, 0.0, 0.2), friction={"hand": 0.1})
    scene = load_scene(CUBOID).with_changes(uncertainty=stated)
    again = scene_from_mjcf(mujoco.MjModel.from_xml_string(scene_to_mjcf(scene)))
    assert again.uncertainty is not None
    for name, value in vars(stated).items():
        np.testing.assert_equal(getattr(again.uncertainty, name), value, err_msg=name)
    line = "unknown   mass ±20 %; push ±0.1, ±0, ±0.2 N; friction hand ±10 %"
    assert line in str(scene).splitlines()


@pytest.mark.parametrize(
    ("stated", "message"),
    [
        ({"mass": "20 %"}, r"scene.yaml:\d+: uncertainty.mass: .*; write 0.2, without '%'"),
        ({"tilt": "10 deg"}, r"yaml:\d+: uncertainty.tilt: .*; write 0.17453\d+ \(rad\)"),
        ({"center_of_mass": "1 cm"}, r"uncertainty.center_of_mass: .*; write 0.01 \(m\)"),
        ({"torque_offset": "5 mNm"}, r"uncertainty.torque_offset: .*; write 0.005 \(Nm\)"),
        ({"force_radius": "1 N"}, r"uncertainty.force_radius: .*; write 1, without"),
        ({"center_of_mass_radius": "5 mm"}, r"center_of_mass_radius: .*; write 0.005 \(m\)"),
        ({"moment_radius": -1.0}, r"uncertainty.moment_radius: found -1.0; needs a finite number"),
        ({"torque": "5 %"}, r"uncertainty.torque: .*; write 0.05, without '%'"),
        ({"mass": 1.0}, r"yaml:\d+: .*found 1.0; needs .* >= 0, below 1; 1 % is 0.01"),
        ({"mass": "±20"}, r"uncertainty.mass: found '±20'; .* below 1; 20 % is 0.2"),
        ({"mass": "±20 %"}, r"uncertainty.mass: .*; write 0.2, without '%'"),
        ({"mass": "50 g"}, r"mass: .*; in kg, write mass_offset: 0.05 instead"),
        ({"torque": {"index": "5 mNm"}}, r"torque.index: .*; in Nm, write torque_offset: 0.005 in"),
        ({"contact_position": "2 mm"}, r"contact_position: .*; write 0.002 \(m\), without 'mm'"),
        ({"contact_position": {"hand": "2 mm"}}, r"contact_position.hand: .*; write 0.002 \(m\)"),
        ({"contact_position": {"hnd": 0.1}}, r"contact_position.hnd: is not a body; did you mean"),
        ({"mass_offset": "50 g"}, r"uncertainty.mass_offset: .*; write 0.05 \(kg\), without 'g'"),
        ({"tilt": 0.8}, r"yaml:\d+: uncertainty.tilt: is 0.8 rad; it must be below 45 degrees"),
        ({"friction": -0.1}, r"uncertainty.friction: found -0.1; needs a finite number >= 0"),
        ({"friction": {"hnd": 0.1}}, r"friction.hnd: is not a body; did you mean 'hand'\?"),
        ({"friction": {"mug": 0.1}}, r"friction.mug: is the object, .* use 'default' for all"),
        ({"friction": {"hand": {"x": 1}}}, r"friction.hand.x: found 1; needs .* below 1; 1 % is"),
        ({"friction": {"hand": {"x": 0.1}}}, r"friction.hand: is not a material; there is none"),
        (
            {"effort": {"indx": 0.1}},
            r"effort.indx: is not a joint or finger; did you mean 'index'\?",
        ),
        ({"torque": {"joint_1.0": 2}}, r"torque\['joint_1.0'\]: found 2; .* below 1; 2 % is 0.02"),
        ({"mas": 0.1}, r"yaml:\d+: uncertainty.mas: unknown key; did you mean 'mass'\?"),
        ({"feedback": 1.0}, r"uncertainty: found feedback; .* the scene's key 'controller'"),
        ({"force": [1, 2]}, r"uncertainty.force: found \[1, 2\]; needs .* or a list of 3"),
        ({"mass": True}, r"uncertainty.mass: found True; needs a finite number"),
        (0.2, r"yaml:\d+: uncertainty: found 0.2; needs a mapping with the keys mass, "),
    ],
)
def test_mistakes_in_files(tmp_path: Path, stated: Any, message: str) -> None:
    with pytest.raises(SceneError, match=message):
        scene_with(tmp_path, stated)


def test_figures_of_what_touches_nothing_are_found(tmp_path: Path) -> None:
    """A name that no contact goes by is told, since its figure does nothing; others are not."""
    stated = {"friction": {"hand": 0.1, "link_1.0": 0.2}, "contact_position": {"wall": 0.001}}
    found = {one.key: one for one in scene_with(tmp_path, stated).findings}
    assert ("uncertainty", "friction") in found
    assert ("uncertainty", "contact_position") not in found
    assert "'link_1.0'" in found["uncertainty", "friction"].message


def test_mistakes_in_python() -> None:
    scene = load_scene(CUBOID)
    with pytest.raises(
        ArgumentError, match=r"is True, but .*cuboid_at_rest.yaml has no uncertainty"
    ):
        scene.solve(uncertainty=True)
    with pytest.raises(
        ArgumentError, match=r"mass_offset is 2 kg together with a share of 0.1, but .* has 1 kg"
    ):
        scene.solve(uncertainty=Uncertainty(mass=0.1, mass_offset=2.0))
    with pytest.raises(
        ArgumentError, match=r"mass_offset: is in kg, but arrays do not state a mass"
    ):
        maximize_margin(scene.problem(), uncertainty=Uncertainty(mass_offset=0.1))
    with pytest.raises(ArgumentError, match=r"found 0.2; needs an Uncertainty or None, e.g."):
        scene.with_changes(uncertainty=0.2)
    with pytest.raises(
        ArgumentError, match=r"friction\['wal'\]: is not a body; did you mean 'wall'"
    ):
        load_scene(MUG).solve(uncertainty=Uncertainty(friction={"wal": 0.1}))
    objective, options = scene.objective_and_options()
    with pytest.raises(
        ArgumentError, match="friction: is given by name, which requires a scene; give one"
    ):
        solve_robust(scene.problem(), objective, Uncertainty(friction={"hand": 0.1}), options)
    with pytest.raises(ArgumentError, match=r"may be off by 5 m along x.*give metres"):
        scene.solve(uncertainty=Uncertainty(center_of_mass_radius=5.0))
    with pytest.raises(SceneError, match=r"uncertainty.mass: found 1.5; needs .* below 1"):
        scene.with_changes({"uncertainty.mass": 1.5})
