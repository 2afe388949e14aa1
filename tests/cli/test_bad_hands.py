"""URDFs and meshes named by a scene: what is broken, missing or meant to do harm."""

import os

import pytest
import trimesh
from cli_tools import LINES, assert_refused, solve_text, spoilt

HIDDEN = "correct horse battery staple"
LINK = '<link name="base"/>'


def urdf(body, header=""):
    return f'<?xml version="1.0"?>{header}<robot name="test">{body}</robot>'


def with_urdf(folder, text, name="hand.urdf", **options):
    """Solve the scene with a URDF of its own."""
    if text is not None:
        (folder / name).write_text(text)
    hand = LINES[LINES.index("  robot") : LINES.index("object:")]
    extra = "".join(f"  {key}: {value}\n" for key, value in options.items())
    return solve_text(folder, spoilt(hand, f"  urdf: {name}\n{extra}"))


def meshed(name):
    return urdf(
        f'<link name="base"><collision><geometry><mesh filename="{name}"/></geometry></collision>'
        "</link>"
    )


def jointed(limit='lower="-1" upper="1" effort="2" velocity="1"', kind="revolute"):
    return urdf(
        '<link name="base"/><link name="tip"/>'
        f'<joint name="hinge" type="{kind}"><parent link="base"/><child link="tip"/>'
        f"<limit {limit}/></joint>"
    )


def test_missing_files(tmp_path):
    message = f"scene.yaml:4: hand.urdf: {tmp_path / 'hand.urdf'}: there is no such file"
    assert_refused(with_urdf(tmp_path, None), message)
    result = solve_text(tmp_path, spoilt("lever_100mm", "mine.yaml"))
    assert_refused(result, f":4: hand.robot: {tmp_path / 'mine.yaml'}: there is no such file")
    # Of files of one stem the one whose whole name is nearest is meant.
    for name in ("mine.stl", "mine.yaml", "mine.urdf", "mine.srdf"):
        (tmp_path / name).write_text("")
    result = solve_text(tmp_path, spoilt("lever_100mm", "mine.yml"))
    assert_refused(result, f"did you mean '{tmp_path / 'mine.yaml'}'")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (urdf(LINK) + "<", "hand.urdf: not well-formed XML"),
        ("", "hand.urdf: is empty; give the file that was meant"),
        (" \n", "hand.urdf: is empty; give the file that was meant"),
        ("\x01", "hand.urdf: not well-formed XML"),
        ("<sdf/>", "hand.urdf: is an SDF, which is not supported; convert it to URDF or MJCF"),
        (
            "<a/>",
            "a URDF starts with <robot> and an MJCF with <mujoco>, but this file with <a>",
        ),
        (jointed(limit='lower="a" upper="1"'), "hand.urdf: joint 'hinge'"),
        (meshed("palm.stl"), "palm.stl"),
        (meshed("package://nowhere/palm.stl"), "package://nowhere/palm.stl"),
    ],
)
def test_bad_urdf(tmp_path, text, message):
    result = with_urdf(tmp_path, text)
    assert_refused(result, "scene.yaml:4: hand.urdf: ")
    assert message in result.stderr


@pytest.mark.parametrize(
    "header",
    [
        '<!DOCTYPE robot [<!ENTITY leak SYSTEM "file://{}">]>',
        '<!DOCTYPE robot [<!ENTITY leak "{}">]>',
        '<!DOCTYPE robot [<!ENTITY % leak SYSTEM "file://{}"> %leak;]>',
        '<!DOCTYPE robot SYSTEM "file://{}">',
    ],
)
def test_xml_entities_stay_inert(tmp_path, header, capfd):
    secret = tmp_path / "secret"
    secret.write_text(HIDDEN)
    text = urdf('<link name="&leak;"/>', header.format(secret))
    result = with_urdf(tmp_path, text)
    assert_refused(result, "hand.urdf: the file declares a DOCTYPE or XML entities")
    seen = capfd.readouterr()
    assert HIDDEN not in result.output + result.stderr + seen.out + seen.err


def test_a_file_that_may_not_be_read(tmp_path, monkeypatch):
    """Root may read everything, so the refusal is played."""
    monkeypatch.setattr("graspless_pin.intake.files.os.fdopen", _refuse)
    monkeypatch.setattr(
        "graspless_pin.intake.yaml_source.read_text", lambda path, _: path.read_text()
    )
    result = with_urdf(tmp_path, jointed())
    message = f":4: hand.urdf: {tmp_path / 'hand.urdf'}: cannot be read (Permission denied)"
    assert_refused(result, message)


def _refuse(path, _):
    raise PermissionError(13, os.strerror(13), str(path))


def pressed_by_base(folder, shape):
    return with_urdf(
        folder,
        urdf(f'<link name="base"><collision><geometry>{shape}</geometry></collision></link>'),
        base_pose="{position: [0, -0.15, 0]}",
    )


def test_a_hand_of_a_urdf_works(tmp_path):
    result = pressed_by_base(tmp_path, '<box size="0.1 0.1 0.1"/>')
    assert result.exit_code in (0, 1) and "no force-controlled joint moves" in result.stderr
    assert "8 contacts, 0 joints" in result.stdout


def box_mesh(folder, edge, name="cup.stl"):
    trimesh.creation.box((edge, edge, edge)).export(folder / name)
    return f"{{type: mesh, path: {name}}}"


BOX = "{type: box, size: [0.2, 0.2, 0.2]}"


def test_an_object_from_a_mesh(tmp_path):
    result = solve_text(tmp_path, spoilt(BOX, box_mesh(tmp_path, 0.2)))
    same = solve_text(tmp_path, LINES)
    assert result.exit_code == 0 and result.stderr == ""
    one, other = (
        next(line for line in each.stdout.splitlines() if "margin e = " in line)
        for each in (result, same)
    )
    assert one == other  # the torque, too


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("cup.stl", None, "does not exist; check the path and the folder that it is relative to"),
        ("cup.stp", b"ISO-10303-21;", "has the unknown ending '.stp'; use one of .stl, .obj"),
        ("cup.stl", b"", "cup.stl'"),
        ("cup.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\n", "has no faces; export it as a triangle mesh"),
        ("cup.obj", b"v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", "encloses no volume: all of its"),
        (
            "cup.dae",
            b'<!DOCTYPE d [<!ENTITY x SYSTEM "file:///etc/hostname">]><COLLADA>&x;</COLLADA>',
            "declares XML entities; export it without a DOCTYPE",
        ),
    ],
)
def test_a_bad_mesh(tmp_path, name, content, message):
    if content is not None:
        (tmp_path / name).write_bytes(content)
    else:
        result = solve_text(tmp_path, spoilt("{type: half_space}", "{type: mesh, path: t.stl}"))
        assert_refused(result, ":14: supports[0].shape.path: mesh file '")
    result = solve_text(tmp_path, spoilt(BOX, f"{{type: mesh, path: {name}}}"))
    assert_refused(result, f":9: object.shape.path: mesh file '{tmp_path / name}'")
    assert message in result.stderr


def test_a_mesh_in_millimetres_warns(tmp_path):
    """A 200 m cup: the warning names the file and the scale, and the rest goes on."""
    result = solve_text(tmp_path, spoilt(BOX, box_mesh(tmp_path, 200.0)))
    warnings = [line for line in result.stderr.splitlines() if line.startswith("warning: ")]
    density = next(line for line in warnings if "kg/m^3" in line)
    mesh = next(line for line in warnings if line.startswith("warning: mesh"))
    assert "object 'box' has 1.25e-07 kg/m^3, which is less than air" in density
    assert mesh == (
        f"warning: mesh '{tmp_path / 'cup.stl'}' with scale 1.0 is 200 m large; lengths are "
        "metres: a file in millimetres needs scale 0.001 [mesh-scale]"
    )
    # With its scale it does not.
    shape = box_mesh(tmp_path, 200.0).replace("}", ", scale: 0.001}")
    result = solve_text(tmp_path, spoilt(BOX, shape))
    assert result.exit_code == 0 and result.stderr == ""


PLACEHOLDER = """
<link name="base"/>
<joint name="slide" type="prismatic"><parent link="base"/><child link="pad"/><axis xyz="0 1 0"/>
<limit lower="-1" upper="1" effort="{}" velocity="1"/></joint>
<link name="pad"><collision><geometry><sphere radius="0.01"/></geometry></collision></link>
"""


@pytest.mark.parametrize("effort", ["0", "1000", "inf"])
def test_placeholder_efforts_warn_on_standard_error(tmp_path, effort):
    text = urdf(PLACEHOLDER.format(effort))
    pose = "{position: [0, -0.11, 0]}"
    result = with_urdf(tmp_path, text, base_pose=pose)
    assert result.stderr.startswith("warning: effort limits that look like placeholders: 'slide' (")
    assert "give the motors' real limits in effort_limits" in result.stderr
    assert result.stderr.count("[placeholder-effort]") == 1
    assert result.exit_code == 0
    honest = with_urdf(tmp_path, text, base_pose=pose, effort_limits="{slide: 5}")
    assert honest.exit_code == 0 and honest.stderr == ""
