"""Files are opened within bounds: pipes, devices and floods are refused at once."""

import os
from pathlib import Path
from typing import Any

import pytest
import trimesh

from graspless_pin import Hand, load_scene
from graspless_pin.errors import GrasplessPinError, MeshError, RobotError, SceneError
from graspless_pin.geometry.bodies.meshes import hull_points, load_mesh
from graspless_pin.geometry.hand.reading import read_robot
from graspless_pin.geometry.inspection import audit_urdf
from graspless_pin.geometry.robots.files import describe_urdf, load_robot
from graspless_pin.intake.files import FileKind, is_file, read_bytes, read_text
from graspless_pin.report.reading import read_document
from graspless_pin.studies import load_study

SMALL = FileKind("note", 1, SceneError)
READERS = {
    "scene.yaml": load_scene,
    "study.yaml": load_study,
    "robot.yaml": load_robot,
    "hand.urdf": lambda path: read_robot(describe_urdf(path)),
    "inspected.urdf": audit_urdf,
    "mesh.stl": load_mesh,
    "mesh.obj": load_mesh,
    "mesh.gltf": load_mesh,
    "mesh.dae": load_mesh,
    "solution.json": read_document,
}


def make_pipe(path: Path) -> None:
    os.mkfifo(path)


def make_endless(path: Path) -> None:
    path.symlink_to("/dev/zero")


def make_huge(path: Path) -> None:
    """More than any kind may have, on paper alone."""
    path.touch()
    os.truncate(path, 1 << 31)


MAKERS = {
    make_pipe: "is a pipe; a .* must be a regular file",
    make_endless: "is a device; a .* must be a regular file",
    make_huge: "has more than [0-9]+ MiB, the most that a .* may have",
    Path.mkdir: "is a directory; a .* must be a regular file",
}


@pytest.mark.parametrize("make", MAKERS)
@pytest.mark.parametrize("name", READERS)
def test_special_and_huge_files_are_refused_at_once(tmp_path, name, make):
    path = tmp_path / name
    make(path)
    with pytest.raises(GrasplessPinError, match=f"{name}: {MAKERS[make]}"):
        READERS[name](path)


@pytest.mark.parametrize("name", READERS)
def test_paths_that_no_file_can_have(name):
    for path in (Path("x" * 300 + name), Path("a\0" + name)):
        assert not is_file(path)
        with pytest.raises(GrasplessPinError):
            READERS[name](path)


def test_the_largest_file_is_read(tmp_path):
    file = tmp_path / "note"
    file.write_bytes(bytes(1 << 20))
    assert read_bytes(file, SMALL) == bytes(1 << 20)
    file.write_bytes(bytes((1 << 20) + 1))
    with pytest.raises(SceneError, match="note: has more than 1 MiB, the most that a note"):
        read_bytes(file, SMALL)


def test_a_file_that_grows_is_not_read_to_its_end(tmp_path, monkeypatch):
    """Files of /proc say that they are empty; what counts is what comes out of them."""
    file = tmp_path / "note"
    file.write_bytes(bytes((1 << 20) + 1))
    empty = os.stat_result((0o100644, *([0] * 9)))
    monkeypatch.setattr("os.fstat", lambda _: empty)
    monkeypatch.setattr(Path, "stat", lambda _: empty)
    with pytest.raises(SceneError, match="has more than 1 MiB"):
        read_bytes(file, SMALL)


def test_a_byte_order_mark_is_no_text(tmp_path):
    file = tmp_path / "note"
    file.write_bytes("\ufefftext".encode())
    assert read_text(file, SMALL) == "text"
    file.write_bytes(b"ab\xff")
    with pytest.raises(SceneError, match=r"is not UTF-8 text \(invalid start byte at byte 2\)"):
        read_text(file, SMALL)


OBJ = "mtllib {}\nv 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n"
GLTF = '{{"asset": {{"version": "2.0"}}, "buffers": [{{"byteLength": 4, "uri": "{}"}}]}}'
URDF = (
    '<robot name="r"><link name="l"><collision><geometry><mesh filename="{}"/></geometry>'
    "</collision></link></robot>"
)


def read_link(path: Path) -> Hand:
    """Read a mesh as a robot's link."""
    urdf = path.with_suffix(".urdf")
    urdf.write_text(URDF.format(path), encoding="utf-8")
    return Hand.from_urdf(urdf)


def test_colours_of_an_obj_are_not_looked_for(tmp_path):
    make_pipe(tmp_path / "pipe.mtl")
    file = tmp_path / "mesh.obj"
    for name in ("pipe.mtl", "/dev/zero", "missing.mtl"):
        file.write_text(OBJ.format(name), encoding="utf-8")
        assert len(load_mesh(file).faces) == 4
        assert len(read_link(file).collision_bodies()) == 1


def test_a_mesh_of_a_link_has_a_known_format(tmp_path):
    file = tmp_path / "mesh.blend"
    file.write_bytes(b"BLENDER")
    with pytest.raises(MeshError, match=r"unknown ending '.blend'; use one of \.stl"):
        read_link(file)


PLY = """\
ply
format ascii 1.0
element vertex 4
property float x
property float y
property float z
element face 4
property list uchar int vertex_indices
end_header
0 0 0
1 0 0
0 1 0
0 0 {}
3 0 2 1
3 0 1 3
3 0 3 2
3 1 2 {}
"""


@pytest.mark.parametrize(
    ("height", "corner", "message"),
    [
        (1, 4, "faces with vertices that do not exist"),
        (1, 2_000_000_000, "faces with vertices that do not exist|cannot be read"),
        (1, -1, "faces with vertices that do not exist"),
        ("nan", 3, "vertices that are not finite"),
        ("inf", 3, "vertices that are not finite"),
        (1e30, 3, r"vertices beyond ±1e\+12"),
        (0, 3, "lie in one plane|has no volume"),
    ],
)
def test_broken_meshes_are_named(tmp_path, height, corner, message):
    """Readers of meshes in C++ crash on some of these."""
    file = tmp_path / "mesh.ply"
    file.write_text(PLY.format(height, corner), encoding="utf-8")
    with pytest.raises(MeshError, match=message):
        hull_points(file, 1.0)
    with pytest.raises(MeshError, match=f"link 'l'.*({message})"):
        read_link(file)


@pytest.mark.parametrize("read", [load_mesh, read_link])
@pytest.mark.parametrize("name", ["pipe.bin", "/dev/zero", "../other.bin"])
def test_buffers_of_a_gltf(tmp_path, name, read):
    make_pipe(tmp_path / "pipe.bin")
    file = tmp_path / "mesh.gltf"
    file.write_text(GLTF.format(name), encoding="utf-8")
    with pytest.raises(MeshError, match=r"only files in its own folder|not a regular file"):
        read(file)


def test_a_gltf_of_several_files(tmp_path):
    files: Any = trimesh.creation.box((1, 2, 3)).scene().export(file_type="gltf")
    for name, content in files.items():
        (tmp_path / name).write_bytes(content)
    assert load_mesh(tmp_path / "model.gltf").volume == pytest.approx(6.0)


LAUGHS = "a: &a [x, x, x, x, x, x, x, x, x]\n" + "\n".join(
    f"{c}: &{c} [{', '.join(9 * ['*' + b])}]" for b, c in zip("abcdefgh", "bcdefghi", strict=True)
)
TEXTS = {
    "laughs": (LAUGHS, "has more than 30000 entries"),
    "laughs by merging": (LAUGHS.replace("[", "{<<: [").replace("]", "]}"), ""),
    "depth": ("a: " + 100_000 * "[", ":1: is nested too deeply; at most 50 levels are possible"),
    "depth of blocks": ("".join(i * " " + "- \n" for i in range(1000)), "is nested too deeply"),
    "depth on one line": (3000 * "- ", "is nested too deeply"),
    "depth of keys": (3000 * "? ", "is nested too deeply"),
    "a key twice": ("name: a\nurdf: b\nname: c\n", ":3: name: duplicate key, first on line 1"),
    "a tag": ("name: !!python/object/apply:os.getcwd []\n", ":1: is not plain YAML: column 7"),
    "half a character": ('name: "\\ud800"\n', ":1: name: has the character U\\+D800"),
    "control": ('name: "\\e[2J"\n', ":1: name: has the character U\\+001B"),
    "a character that no YAML has": ('urdf: b\nname: "a\x7f"\n', ":2: has the character U\\+007F"),
    "long number": (f"friction: 0x{5000 * 'f'}\n", ":1: friction: found a number of 5002 char"),
}


@pytest.mark.parametrize("name", ["scene.yaml", "study.yaml", "robot.yaml"])
@pytest.mark.parametrize("kind", TEXTS)
def test_all_yaml_has_the_same_bounds(tmp_path, name, kind):
    text, message = TEXTS[kind]
    file = tmp_path / name
    file.write_text(text, encoding="utf-8")
    with pytest.raises(GrasplessPinError, match=f"{name}.*{message}"):
        READERS[name](file)


DEEP = '<robot name="r">' + 10_000 * "<a>" + 10_000 * "</a>" + "</robot>"


@pytest.mark.parametrize(
    ("content", "message"),
    [
        (DEEP.encode(), "is nested too deeply; at most 100 levels are possible"),
        (b'<robot name="r">' + 200_000 * b"<a/>" + b"</robot>", "has more than 200000 elements"),
        (b'<robot name="r">' + 1001 * b"<link/>" + b"</robot>", "has more than 1000 links"),
        ('<?xml version="1.0"?><!DOCTYPE r><r/>'.encode("utf-16"), "declares a DOCTYPE"),
        (b'<?xml version="1.0" encoding="utf-7"?><robot/>', "not well-formed XML"),
        (b'<?xml version="1.0" encoding="rot13"?><robot/>', "not well-formed XML"),
    ],
)
def test_bounds_of_xml(tmp_path, content, message):
    file = tmp_path / "hand.urdf"
    file.write_bytes(content)
    with pytest.raises(RobotError, match=f"hand.urdf: .*{message}"):
        read_robot(describe_urdf(file))


def test_a_dae_cannot_hide_its_entities(tmp_path):
    file = tmp_path / "mesh.dae"
    file.write_bytes('<?xml version="1.0"?><!DOCTYPE r [<!ENTITY a "b">]><r/>'.encode("utf-16"))
    with pytest.raises(MeshError, match="declares XML entities; export it without a DOCTYPE"):
        load_mesh(file)


def chain(count: int) -> str:
    """A robot of links one behind the other."""
    links = "".join(f'<link name="l{i}"/>' for i in range(count + 1))
    joints = "".join(
        f'<joint name="j{i}" type="revolute"><parent link="l{i}"/><child link="l{i + 1}"/>'
        '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="1" velocity="1"/></joint>'
        for i in range(count)
    )
    return f'<robot name="chain">{links}{joints}</robot>'


@pytest.mark.parametrize("count", [200, 201, 999, 5000])
def test_a_chain_longer_than_any_robot(tmp_path, count):
    file = tmp_path / "chain.urdf"
    file.write_text(chain(count), encoding="utf-8")
    report = audit_urdf(file)
    assert report.loads == (count == 200)
    if report.loads:
        return
    (finding,) = (item for item in report.findings if item.code == "unreadable")
    assert "has more than 200 joints" in finding.message or "1000 links" in finding.message


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[" * 100_000, "is nested too deeply"),
        ("[" * 60 + "]" * 60, "is nested too deeply; at most 50 levels are possible"),
        ('{"a": 1' + 400 * "0" + "}", "has an integer of 401 digits; at most 1.8e308 is possible"),
        ('{"a": 1' + 9000 * "0" + "}", "has an integer of 9001 digits"),
        ('{"a": 1e999}', "has the number 1e999; at most 1.8e308 is possible"),
        ('{"a": NaN}', "has the word NaN; write null"),
        ('{"a": -Infinity}', "has the word -Infinity"),
        ('{"a": 1, "a": 2}', "has the key 'a' twice in one object"),
        ('{"a": ["\\ud800"]}', "has the character U\\+D800"),
        ('{"\\u001b": 1}', "has the character U\\+001B"),
        ("", "is not JSON: Expecting value"),
    ],
)
def test_bounds_of_json(tmp_path, text, message):
    file = tmp_path / "solution.json"
    file.write_text(text, encoding="utf-8")
    with pytest.raises(SceneError, match=f"solution.json: .*{message}"):
        read_document(file)


def test_normals_that_are_none_are_nothing_to_tell(tmp_path, caplog, capfd):
    """Trimesh logs them with a traceback and reads on; only vertices and faces count."""
    text = str(trimesh.creation.box((1, 2, 3)).export(file_type="stl_ascii"))
    file = tmp_path / "mesh.stl"
    file.write_text(text.replace("facet normal", "facet normal x", 1), encoding="utf-8")
    assert load_mesh(file).volume == pytest.approx(6.0)
    assert caplog.text == "" and capfd.readouterr().err == ""


def test_a_mesh_that_can_be_read_in_part_only(tmp_path, monkeypatch):
    def load_in_part(*_: object, **__: object) -> trimesh.Trimesh:
        trimesh.util.log.warning("PLY failed to populate: vertex")
        return trimesh.creation.box((1, 1, 1))

    monkeypatch.setattr(trimesh, "load_mesh", load_in_part)
    file = tmp_path / "mesh.ply"
    file.write_text("ply", encoding="utf-8")
    with pytest.raises(MeshError, match=r"only be read in part \(PLY failed to populate: vertex\)"):
        load_mesh(file)


def test_odd_looks_of_links_are_nothing_to_tell(tmp_path, capfd):
    """Pinocchio's reader would complain of them on standard error."""
    file = tmp_path / "hand.urdf"
    file.write_text(
        '<robot name="r"><link name="l"><visual><geometry><cloud/></geometry></visual>'
        "<visual/></link></robot>",
        encoding="utf-8",
    )
    assert audit_urdf(file).loads
    assert capfd.readouterr().err == ""
