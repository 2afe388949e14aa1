"""A DAE's unit and axes: one mesh, written in several frames, is one object and one link."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin  # pyright: ignore[reportMissingImports]
import pytest
import trimesh

from graspless_pin import Hand
from graspless_pin.errors import MeshError
from graspless_pin.findings import FindingCode, capture
from graspless_pin.geometry.bodies.mesh_files import parse_mesh
from graspless_pin.geometry.bodies.meshes import hull_points
from graspless_pin.geometry.bodies.shapes import MeshShape
from graspless_pin.geometry.inspection import audit_urdf
from graspless_pin.visualization.drawing import hand_triangles

DAE = """<?xml version="1.0" encoding="utf-8"?>
<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema" version="1.4.1">
<asset><created>2020-01-01T00:00:00</created><modified>2020-01-01T00:00:00</modified>{frame}</asset>
<library_geometries><geometry id="g" name="g"><mesh>
<source id="p"><float_array id="a" count="12">{points}</float_array><technique_common>
<accessor source="#a" count="4" stride="3"><param name="X" type="float"/>
<param name="Y" type="float"/><param name="Z" type="float"/></accessor></technique_common></source>
<vertices id="v"><input semantic="POSITION" source="#p"/></vertices>
<triangles count="4"><input semantic="VERTEX" source="#v" offset="0"/>
<p>0 2 1 0 1 3 0 3 2 1 2 3</p></triangles></mesh></geometry></library_geometries>
<library_visual_scenes><visual_scene id="s" name="s"><node id="n" name="n">
<instance_geometry url="#g"/></node></visual_scene></library_visual_scenes>
<scene><instance_visual_scene url="#s"/></scene></COLLADA>"""
CORNERS = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.2, 0.0], [0.0, 0.0, 0.3]])  # z is up

# Right, up and towards the reader are these axes of the file: the table of the COLLADA standard.
FRAMES = {"Z_UP": ("+x", "+z", "-y"), "Y_UP": ("+x", "+y", "+z"), "X_UP": ("-y", "+x", "+z")}


def written(folder: Path, up: str | None, meter: float | None = None) -> Path:
    """Write the mesh as a modeller with these axes and this unit would."""
    points = CORNERS / (meter or 1.0)
    if up is not None:
        file = np.zeros_like(points)
        in_world = (points[:, 0], points[:, 2], -points[:, 1])  # right, up, towards the reader
        for axis, values in zip(FRAMES[up], in_world, strict=True):
            file[:, "xyz".index(axis[1])] = values if axis[0] == "+" else -values
        points = file
    frame = "" if meter is None else f'<unit name="of its own" meter="{meter}"/>'
    frame += "" if up is None else f"<up_axis>{up}</up_axis>"
    path = folder / "part.dae"
    path.write_text(DAE.format(frame=frame, points=" ".join(map(str, points.ravel()))))
    return path


def in_order(points: np.ndarray) -> np.ndarray:
    return points[np.lexsort(points.round(9).T)]


@pytest.mark.parametrize("meter", [None, 0.01, 0.0254])
@pytest.mark.parametrize("up", [None, "Z_UP", "Y_UP", "X_UP"])
def test_an_object_is_the_same_whatever_the_frame(
    tmp_path: Path, up: str | None, meter: float | None
) -> None:
    shape = MeshShape(written(tmp_path, up, meter), 2.0)
    expected = in_order(2.0 * CORNERS)
    with capture() as told:
        corners = hull_points(shape.path, 2.0)
    np.testing.assert_allclose(in_order(corners), expected, atol=1e-12)
    turned = up in ("Y_UP", "X_UP")
    assert [one.code for one in told] == [FindingCode.MESH_AXES] * turned
    with capture():
        drawn, filled = shape.surface(), shape.filling()
    np.testing.assert_allclose(in_order(drawn.vertices), expected, atol=1e-12)
    np.testing.assert_allclose(filled.centroid, 2.0 * CORNERS.mean(axis=0), atol=1e-12)
    assert filled.volume == pytest.approx(8.0 * 0.1 * 0.2 * 0.3 / 6.0)


@pytest.mark.parametrize("up", ["Z_UP", "Y_UP", "X_UP"])
def test_a_link_has_the_unit_and_the_axes_of_urdf(tmp_path: Path, up: str) -> None:
    """Pinocchio leaves the axes as they are, and the unit, too; collision shape and looks agree."""
    mesh = written(tmp_path, up, 0.01)
    geometry = f'<geometry><mesh filename="{mesh}"/></geometry>'
    urdf = tmp_path / "part.urdf"
    urdf.write_text(
        f'<robot name="part"><link name="palm"><visual>{geometry}</visual>'
        f"<collision>{geometry}</collision></link></robot>"
    )
    hand = Hand.from_urdf(urdf)
    corners = in_order(np.array(hand.collision_bodies()[0].geometry.points()))
    model = pin.buildModelFromUrdf(str(urdf))
    (read,) = pin.buildGeomFromUrdf(model, str(urdf), pin.GeometryType.COLLISION).geometryObjects
    centimetres = np.unique(read.geometry.vertices(), axis=0)
    np.testing.assert_allclose(corners, in_order(0.01 * centimetres), atol=1e-7)
    ((_, drawn),) = hand_triangles(hand)
    np.testing.assert_allclose(in_order(drawn.vertices), corners, atol=1e-12)
    found = [one for one in audit_urdf(urdf).findings if one.code is FindingCode.MESH_AXES]
    assert len(found) == (up != "Z_UP")
    assert all("part.dae" in one.message and up in one.message for one in found)


def test_a_unit_that_is_none_is_refused(tmp_path: Path) -> None:
    path = written(tmp_path, "Z_UP", 0.01)
    path.write_text(path.read_text().replace('meter="0.01"', 'meter="inch"'))
    with pytest.raises(MeshError, match="states the unit 'inch'"):
        hull_points(path, 1.0)


def test_a_coordinate_beyond_all_whole_numbers_is_read_without_a_word(tmp_path):
    text: Any = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="dae")
    path = tmp_path / "far.dae"
    # The time of day, before the numbers, may have these digits, too.
    head, tag, numbers = text.partition(b"<float_array")
    path.write_bytes(head + tag + numbers.replace(b"0.5", b"1e19", 1))
    assert np.abs(parse_mesh(path, upright=False).vertices).max() == pytest.approx(1e19)


@pytest.mark.parametrize("far", ["1e100", "1e200"])
def test_coordinates_whose_products_overflow_are_read_without_a_word(tmp_path, far):
    text: Any = trimesh.creation.box((1.0, 1.0, 1.0)).export(file_type="stl_ascii")
    path = tmp_path / "far.stl"
    path.write_text(re.sub(r"vertex \S+", f"vertex {far}", text, count=1))
    assert np.abs(parse_mesh(path, upright=False).vertices).max() == float(far)
