"""Collision meshes of links: hulls by default, convex pieces where a robot or scene asks for it."""

from __future__ import annotations

import pickle
from collections import Counter
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
import yaml
from cutting_faults import never
from cutting_here import cut_here
from hand_tools import joint, link, write_urdf
from planar_fingers import ball
from tests.geometry.contact_tools import find_contacts

from graspless_pin import load_scene
from graspless_pin.child_process import ChildProcess
from graspless_pin.errors import ArgumentError, RobotError, SceneError
from graspless_pin.geometry.bodies import decomposition
from graspless_pin.geometry.hand.assembly import Mount
from graspless_pin.geometry.hand.model import Hand
from graspless_pin.geometry.posing.closing import close_hand
from graspless_pin.geometry.robots.description import FingerSpec, LinkMeshes
from graspless_pin.geometry.robots.files import load_robot

BAR = 0.02  # m, thickness of the two bars of the hook, each 0.08 m long
RADIUS = 0.01
NOTCH = (BAR + RADIUS, 0.5 * BAR, BAR + RADIUS)  # where a ball touches both bars
CUT = 1e-5  # m: CoACD moves corners by some micrometres
FINGERS = {"finger": FingerSpec(("slide",))}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("cache")


@pytest.fixture(autouse=True)
def cache(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """A cache folder of these tests alone."""
    monkeypatch.setenv("XDG_CACHE_HOME", str(folder))
    cut_here(monkeypatch)


@pytest.fixture
def urdf(tmp_path: Path) -> Path:
    """A hook of two bars along x and z that slides along x, with a plate below it."""
    flat = trimesh.creation.box(bounds=[[0, 0, 0], [80, 20, 20]])
    tall = trimesh.creation.box(bounds=[[0, 0, 0], [20, 20, 80]])
    trimesh.boolean.union([flat, tall]).export(tmp_path / "hook.stl")
    limit, along = 'lower="-0.1" upper="0.1" effort="5"', {"origin": "", "axis": "1 0 0"}
    slide = joint("slide", "base", "hook", "prismatic", limit, **along)
    mesh = '<mesh filename="hook.stl" scale="0.001 0.001 0.001"/>'
    return write_urdf(tmp_path, link("base") + slide + link("hook", mesh))


def hook(urdf: Path, meshes: LinkMeshes | None = None, **q: float) -> Hand:
    return Hand.assemble([Mount(urdf, fingers=FINGERS, meshes=meshes)], q=q)


def contacts(hand: Hand):
    target = ball(RADIUS, NOTCH)
    return find_contacts(target.collision_bodies(), hand.collision_bodies(), ())


def names(hand: Hand) -> Counter[str]:
    return Counter(piece.name for piece in hand.collision_bodies())


def test_a_link_is_its_hull_unless_asked_otherwise(urdf, monkeypatch):
    def cut(*_: object) -> None:
        raise AssertionError("cut")

    monkeypatch.setattr(decomposition, "_cut_pieces", cut)
    assert names(hook(urdf)) == {"hook": 1}
    assert names(hook(urdf, LinkMeshes({"hook": "hull"}))) == {"hook": 1}
    (touch,) = find_contacts(
        ball(
            RADIUS, np.array([0.05, 0.01, 0.05]) + RADIUS / np.sqrt(2) * np.array([1, 0, 1])
        ).collision_bodies(),
        hook(urdf).collision_bodies(),
        (),
    )  # the face from bar to bar
    assert touch.normal == pytest.approx(np.array([1, 0, 1]) / np.sqrt(2))


@pytest.mark.parametrize("convex", ["decompose", {"hook": "decompose"}])
def test_a_cut_hook_holds_a_ball_in_its_notch(urdf, convex):
    hand = hook(urdf, LinkMeshes(convex))
    assert names(hand) == {"hook": 2}
    found = sorted(contacts(hand), key=lambda contact: contact.normal[0])
    assert [contact.body for contact in found] == ["hook", "hook"]
    for contact, normal in zip(found, np.eye(3)[[2, 0]], strict=True):
        assert contact.normal == pytest.approx(normal, abs=1e-3)
        assert contact.position == pytest.approx(NOTCH - RADIUS * normal, abs=CUT)
    J = hand.contact_jacobian([c.body for c in found], [c.position for c in found])
    assert J.ravel().tolist() == pytest.approx([1.0, 0.0, 0.0, 1.0, 0.0, 0.0])


def test_a_urdf_may_be_cut_without_a_mount(urdf):
    for meshes, pieces in ((None, 1), (LinkMeshes("decompose"), 2)):
        assert names(Hand.from_urdf(urdf, fingers=FINGERS, meshes=meshes)) == {"hook": pieces}


def test_a_model_by_name_may_be_cut_too():
    with pytest.raises(ArgumentError, match="convex: unknown link with a collision mesh 'palm'"):
        Hand.from_model_name("panda", meshes=LinkMeshes({"palm": "decompose"}))


@pytest.mark.parametrize("suffix", ["stl", "obj", "dae", "ply", "glb"])
def test_links_take_every_mesh_format(urdf, suffix):
    box = trimesh.creation.box(bounds=[[0.01, 0.02, 0.03], [0.05, 0.09, 0.2]])
    box.export(urdf.parent / f"box.{suffix}")
    text = (
        urdf.read_text().replace("hook.stl", f"box.{suffix}").replace("0.001 0.001 0.001", "1 1 1")
    )
    urdf.write_text(text)
    (body,) = Hand.from_urdf(urdf).collision_bodies()
    corners = np.array(body.geometry.points())
    assert len(corners) == 8
    assert corners.min(axis=0) == pytest.approx([0.01, 0.02, 0.03], abs=1e-6)
    assert corners.max(axis=0) == pytest.approx([0.05, 0.09, 0.2], abs=1e-6)


def test_a_cut_hook_closes_on_a_ball_between_its_bars(urdf):
    for meshes, way in ((LinkMeshes("decompose"), 0.04), (None, None)):
        hand = hook(urdf, meshes, slide=-0.04)
        target = ball(RADIUS, np.add(NOTCH, (0, 0, 0.001)))
        if way is None:  # the hull is in the way from the start on
            with pytest.raises(SceneError, match="'hook' overlaps object 'ball'"):
                close_hand(hand, target, rates={"slide": 1.0})
        else:
            result = close_hand(hand, target, rates={"slide": 1.0})
            assert result.hand.q["slide"] == pytest.approx(-0.04 + way, abs=2e-5)
            assert result.touching == ("hook",)


def test_a_mirrored_mesh_is_cut_as_well(urdf):
    urdf.write_text(urdf.read_text().replace('scale="0.001 ', 'scale="-0.001 '))
    corners = np.concatenate(
        [
            np.array(body.geometry.points())
            for body in hook(urdf, LinkMeshes("decompose")).collision_bodies()
        ]
    )
    assert corners.min(axis=0) == pytest.approx([-0.08, 0, 0], abs=CUT)
    assert corners.max(axis=0) == pytest.approx([0, 0.02, 0.08], abs=CUT)
    assert not (corners[:, [0, 2]] * [-1, 1] > 0.021).all(axis=1).any()


def test_a_robot_file_and_a_mount_may_choose(urdf, tmp_path):
    file = tmp_path / "robot.yaml"
    file.write_text(f"name: r\nurdf: {urdf.name}\nconvex: {{hook: decompose}}\nconcavity: 0.1\n")
    assert load_robot(file).meshes == LinkMeshes({"hook": "decompose"}, 0.1)
    assert names(Hand.assemble([Mount(file)])) == {"hook": 2}
    file.write_text(file.read_text() + "decompose_time_limit: 300\n")
    assert load_robot(file).meshes == LinkMeshes({"hook": "decompose"}, 0.1, 300.0)
    two = [Mount(file, prefix="a/"), Mount(file, prefix="b/", meshes=LinkMeshes("hull"))]
    hand = Hand.assemble(two)
    assert names(hand) == {"a/hook": 2, "b/hook": 1}
    again = pickle.loads(pickle.dumps(hand))  # noqa: S301 - our own bytes
    assert names(again) == names(hand)


def scene(urdf: Path, **hand: Any):
    more = {key: hand.pop(key) for key in ("object",) if key in hand}
    content = {
        "hand": {"urdf": urdf.name, "fingers": {"finger": {"joints": ["slide"]}}, **hand},
        "object": {
            "shape": {"type": "sphere", "radius": RADIUS},
            "mass": 0.1,
            "pose": {"position": list(NOTCH)},
        },
        "friction": 0.5,
        **more,
    }
    file = urdf.parent / "scene.yaml"
    file.write_text(yaml.safe_dump(content))
    return load_scene(file)


def test_a_scene_may_choose(urdf):
    for choice in ({"convex": "decompose"}, {"convex": {"hook": "decompose"}, "concavity": 0.1}):
        assert scene(urdf, **choice).contacts.bodies == ("hook", "hook")
    with pytest.raises(SceneError, match="'hook' and object 'object' overlap"):
        _ = scene(urdf).contacts


@pytest.mark.parametrize(
    ("choice", "message"),
    [
        ({"convex": "soup"}, r"scene.yaml:\d+: hand.convex: .*'hull' or 'decompose'"),
        ({"convex": {"hook": "soup"}}, r"hand.convex.*'hull' or 'decompose'"),
        ({"concavity": 2}, r"hand.concavity: found 2; needs a finite number >= 0.01, at most 1"),
        (
            {"convex": {"base": "decompose"}},
            r"scene.yaml:\d+: hand.convex: unknown link with a collision mesh 'base'; known: hook",
        ),
    ],
)
def test_bad_choices_in_a_scene_are_located(urdf, choice, message):
    with pytest.raises(SceneError, match=message):
        scene(urdf, **choice)


def test_a_scene_may_set_the_time_of_a_cut(urdf, monkeypatch):
    monkeypatch.setattr(decomposition, "ChildProcess", ChildProcess)
    monkeypatch.setattr(decomposition, "run_coacd", never)
    choice = {"convex": "decompose", "concavity": 0.03, "decompose_time_limit": 0.2}
    message = r"hook\.stl of link 'hook' is not cut into convex pieces after 0\.2 s; simplify"
    with pytest.raises(SceneError, match=rf"scene\.yaml:\d+: hand.*{message}"):
        scene(urdf, **choice)
    shape = {"type": "mesh", "path": "hook.stl", "scale": 0.001, **choice}
    body = {"shape": shape, "mass": 0.1}
    with pytest.raises(SceneError, match=r"scene\.yaml:\d+: object\.shape.*after 0\.2 s; simplify"):
        scene(urdf, convex="hull", object=body)
    for value in (0, -1, 1e7, True):
        with pytest.raises(
            SceneError, match=r"found .*; needs a finite number > 0, at most 1e\+06"
        ):
            scene(urdf, decompose_time_limit=value)


def test_bad_choices_are_named(urdf, tmp_path):
    with pytest.raises(ArgumentError, match=r"convex\['hook'\]: .*one of 'hull'"):
        LinkMeshes({"hook": "soup"})
    with pytest.raises(ArgumentError, match="convex: is 'soup'; it must be one of 'hull'"):
        LinkMeshes("soup")
    with pytest.raises(ArgumentError, match=r"concavity: needs 0\.01 to 1, got 0\.0"):
        LinkMeshes("decompose", 0.0)
    with pytest.raises(ArgumentError, match=r"convex: unknown link.* 'palm'; known: hook"):
        hook(urdf, LinkMeshes({"palm": "decompose"}))
    file = tmp_path / "robot.yaml"
    file.write_text(f"name: r\nurdf: {urdf.name}\nconvex: {{palm: decompose}}\n")
    with pytest.raises(RobotError, match=r"robot 'r': convex: unknown link.* 'palm'; known: hook"):
        Hand.assemble([Mount(file)])
