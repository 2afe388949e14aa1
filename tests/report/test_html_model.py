"""The page's 3-D data holds the picture's meshes."""

import base64
import gzip

import numpy as np
from report_cases import SLIDING, solved

from graspless_pin.report.html.page import model_data
from graspless_pin.visualization import draw_scene


def test_the_data_are_the_meshes():
    scene, solution = solved(SLIDING)
    picture = draw_scene(scene, solution)
    points = solution.problem.positions + scene.object.center_of_mass_world
    model = model_data(picture)
    data = gzip.decompress(base64.b64decode(model["data"]))
    count = sum(mesh["vertices"] for mesh in model["meshes"])
    corners = np.frombuffer(data, "<u2", 3 * count).reshape(-1, 3)
    faces = np.frombuffer(data, "<u4", offset=4 * -(-6 * count // 4)).reshape(-1, 3)
    assert len(model["meshes"]) == len(picture.meshes)
    v = f = 0
    for entry, mesh in zip(model["meshes"], picture.meshes, strict=True):
        low, size = np.array(entry["low"]), np.array(entry["size"])
        unpacked = low + size * corners[v : v + entry["vertices"]] / 65535
        np.testing.assert_allclose(unpacked, mesh.vertices, atol=size.max() / 65535 + 1e-6)
        np.testing.assert_array_equal(faces[f : f + entry["faces"]], mesh.faces)
        assert (entry["role"], entry["opacity"]) == (str(mesh.role), mesh.opacity)
        v, f = v + entry["vertices"], f + entry["faces"]
    assert v == count and f == len(faces)
    numbers = [mark for mark in model["marks"] if mark["contact"] is not None]
    assert [mark["text"] for mark in numbers] == [str(index) for index in range(len(points))]
    np.testing.assert_allclose([mark["at"] for mark in numbers], points, atol=1e-6)
    np.testing.assert_allclose(model["center"], picture.center, atol=1e-6)
    first, second = (model_data(draw_scene(scene, solution)) for _ in range(2))
    assert first == second
