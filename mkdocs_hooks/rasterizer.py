"""A picture's meshes as pixels: perspective, hidden surfaces, soft light and ink at the edges.

Pages show pictures without a script, and the machine that builds them has no graphics card. So the
triangles are turned into pixels here, by numpy. What is visible is found once; each palette then
only colours it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import Mesh, Palette, Picture
from graspless_pin.visualization.picture import framing

_FIELD_OF_VIEW = 0.45  # rad
_FINE = 2  # samples of a pixel along each side
_CREASE = 0.75  # cosine of the angle up to which neighbouring triangles look like one surface
_FOLD = 0.6  # cosine of the angle from which on a fold is an edge
_AMBIENT, _SUN = 0.62, 0.44
_INK = 0.55  # what is left of a colour at an edge
_GLASS_EDGE = 0.75  # opacity of the edges of a translucent mesh


@dataclass(frozen=True, eq=False)
class Layer:
    """What is visible of some meshes, in the window of samples that they reach.

    Attributes:
        window: Its rows and columns.
        depth: (H, W) distance from the camera along its axis, m; infinite where nothing is.
        mesh: (H, W) index of the mesh.
        light: (H, W) 0 to 1.
        edge: (H, W) whether a mesh, a surface or a fold of it ends here.
        opacity: 0 to 1.
    """

    window: tuple[slice, slice]
    depth: FloatArray
    mesh: NDArray[np.int64]
    light: FloatArray
    edge: NDArray[np.bool_]
    opacity: float


@dataclass(frozen=True, eq=False)
class Seen:
    """What is visible of a picture: opaque meshes, then translucent ones from far to near."""

    meshes: tuple[Mesh, ...]
    shape: tuple[int, int]
    layers: tuple[Layer, ...]


@dataclass(frozen=True, eq=False)
class Camera:
    """Where a picture is looked at from, and how many samples it has."""

    axes: FloatArray
    place: FloatArray
    focal: float
    width: int
    height: int

    def project(self, points: FloatArray) -> FloatArray:
        """Return (N, 3): sample column, sample row, depth."""
        x, y, depth = ((points - self.place) @ self.axes.T * [1.0, 1.0, -1.0]).T
        scale = self.focal / depth
        return np.stack([0.5 * self.width + scale * x, 0.5 * self.height - scale * y, depth], 1)

    def pixels(self, points: Sequence[FloatArray]) -> list[tuple[float, float]]:
        """Return where points are in the finished picture, from its left and from its top."""
        seen = self.project(np.reshape(points, (-1, 3))) / _FINE
        return [(float(column), float(row)) for column, row, _ in seen]


def camera_of(picture: Picture, width: int, height: int) -> Camera:
    """Return the camera that sees all that matters of a picture, on so many pixels."""
    target, distance = framing(picture, _FIELD_OF_VIEW, width / height)
    toward, up = picture.view_from, picture.up
    right = np.cross(up, toward)
    right /= np.linalg.norm(right)
    axes = np.stack([right, np.cross(toward, right), toward])
    focal = 0.5 * height * _FINE / np.tan(0.5 * _FIELD_OF_VIEW)
    return Camera(axes, target + distance * toward, focal, width * _FINE, height * _FINE)


def look(meshes: Sequence[Mesh], camera: Camera, step: float) -> Seen:
    """Find what a camera sees of meshes.

    Args:
        meshes: The meshes.
        camera: The camera.
        step: A jump in depth that is an edge, m.
    """
    opaque = [index for index, mesh in enumerate(meshes) if mesh.opacity == 1.0]
    behind = np.full((camera.height, camera.width), np.inf)
    layers = []
    if opaque:
        layers.append(_layer(meshes, opaque, camera, step))
        behind[layers[0].window] = layers[0].depth
    glass = [index for index in range(len(meshes)) if index not in opaque]
    depths = {i: float(camera.project(meshes[i].vertices)[:, 2].mean()) for i in glass}
    for index in sorted(glass, key=lambda i: -depths[i]):
        layer = _layer(meshes, [index], camera, step)
        hidden = layer.depth >= behind[layer.window]
        layer.depth[hidden] = np.inf
        layer.edge[hidden] = False
        layers.append(layer)
    return Seen(tuple(meshes), behind.shape, tuple(layers))


def paint(seen: Seen, palette: Palette) -> NDArray[np.uint8]:
    """Return the (H, W, 4) pixels of what was seen, on no background.

    Args:
        seen: What is visible.
        palette: Its colours.
    """
    colors = np.array([palette.of_mesh(mesh) for mesh in seen.meshes], dtype=float)
    ink = np.array([int(palette.text[i : i + 2], 16) for i in (1, 3, 5)], dtype=float)
    paint, cover = np.zeros((*seen.shape, 3)), np.zeros(seen.shape)
    for layer in seen.layers:
        there = np.isfinite(layer.depth)
        color = colors[layer.mesh[there]] * layer.light[there, None]
        edge = layer.edge[there]
        alpha = np.full(len(color), layer.opacity)
        if layer.opacity == 1.0:
            color[edge] *= _INK
        else:
            color[edge] = 0.35 * color[edge] + 0.65 * ink
            alpha[edge] = _GLASS_EDGE
        on, over = paint[layer.window], cover[layer.window]
        on[there] = alpha[:, None] * color + (1.0 - alpha[:, None]) * on[there]
        over[there] = alpha + (1.0 - alpha) * over[there]
    return _averaged(paint, cover)


def _averaged(paint: FloatArray, cover: FloatArray) -> NDArray[np.uint8]:
    """Return pixels from samples whose colours are weighed by their cover."""
    color, alpha = _means(paint), _means(cover)
    color /= np.maximum(alpha, 1e-9)[..., None]
    pixels = np.dstack([np.clip(color, 0.0, 255.0), 255.0 * alpha])
    return np.round(pixels).astype(np.uint8)


def _means(samples: FloatArray) -> FloatArray:
    """Return the mean of the samples of each pixel."""
    parts = [samples[i::_FINE, j::_FINE] for i in range(_FINE) for j in range(_FINE)]
    return np.sum(parts, axis=0) / len(parts)


def _layer(meshes: Sequence[Mesh], chosen: Sequence[int], camera: Camera, step: float) -> Layer:
    """Return what is visible of some meshes, as if there were no others."""
    corners = np.vstack([meshes[i].vertices[meshes[i].faces] for i in chosen])
    owner = np.repeat(chosen, [len(meshes[i].faces) for i in chosen])
    seen = camera.project(corners.reshape(-1, 3)).reshape(-1, 3, 3)
    limit = np.array([camera.width, camera.height])
    low = np.floor(seen[:, :, :2].min(axis=(0, 1))).astype(int).clip(0, limit - 1)
    high = np.ceil(seen[:, :, :2].max(axis=(0, 1))).astype(int).clip(low + 1, limit)
    width, height = high - low
    seen[:, :, :2] -= low
    right, up, toward = camera.axes
    sun = -0.45 * right + 0.75 * up + 0.65 * toward
    normals = np.vstack([_corner_normals(meshes[i]) for i in chosen])
    shades = _AMBIENT + _SUN * np.clip(normals @ (sun / np.linalg.norm(sun)), 0.0, 1.0)
    inverse, light, face = _visible(seen, shades, width, height)
    with np.errstate(divide="ignore"):
        depth = 1.0 / inverse
    mesh = np.where(face >= 0, owner[face], -1)
    edge = _edges(depth, mesh, face, corners, step)
    window = slice(low[1], high[1]), slice(low[0], high[0])
    opacity = meshes[chosen[0]].opacity
    return Layer(window, depth, mesh, light, edge, opacity)


def _visible(
    seen: FloatArray, shades: FloatArray, width: int, height: int
) -> tuple[FloatArray, FloatArray, NDArray[np.int64]]:
    """Return the nearest triangle at each sample: inverse depth, light, index; 0, 0, -1 of none.

    Args:
        seen: (F, 3, 3) column, row and depth of the corners.
        shades: (F, 3) light at the corners, spread evenly over a triangle (Gouraud).
        width: Samples of a row.
        height: Samples of a column.
    """
    inverse, light = np.zeros((height, width)), np.zeros((height, width))
    nearest = np.full((height, width), -1)
    limit = np.array([width, height])
    low = np.ceil(seen[:, :, :2].min(axis=1) - 0.5).astype(int).clip(0, limit)
    high = np.floor(seen[:, :, :2].max(axis=1) + 0.5).astype(int).clip(0, limit)
    corner = seen[:, :, :2]
    across = np.roll(corner, -2, axis=1) - np.roll(corner, -1, axis=1)  # opposite each corner
    area = across[:, 0, 0] * across[:, 1, 1] - across[:, 0, 1] * across[:, 1, 0]
    ahead = seen[:, :, 2].min(axis=1) > 0.0
    columns, rows = np.arange(width) + 0.5, np.arange(height)[:, None] + 0.5
    for face in np.flatnonzero((high > low).all(axis=1) & (area < 0.0) & ahead).tolist():
        (left, top), (right, bottom) = low[face].tolist(), high[face].tolist()
        x, y = columns[left:right], rows[top:bottom]
        weights = []
        for i in range(3):  # affine in x and y
            (dx, dy), (x0, y0) = across[face, i], corner[face, i - 2]
            weights.append((dx * (y - y0) - dy * (x - x0)) / area[face])
        inside = np.minimum(np.minimum(weights[0], weights[1]), weights[2]) >= 0.0
        near = _mixed(weights, 1.0 / seen[face, :, 2])
        there = np.s_[top:bottom, left:right]
        wins = inside & (near > inverse[there])
        shade = _mixed(weights, shades[face])
        inverse[there][wins] = near[wins]
        light[there][wins] = shade[wins]
        nearest[there][wins] = face
    return inverse, light, nearest


def _mixed(weights: Sequence[FloatArray], values: FloatArray) -> FloatArray:
    a, b, c = values.tolist()
    return a * weights[0] + b * weights[1] + c * weights[2]


def _face_normals(corners: FloatArray) -> FloatArray:
    """(F, 3) unit normals of triangles."""
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    return normals / np.maximum(np.linalg.norm(normals, axis=1, keepdims=True), 1e-30)


def _corner_normals(mesh: Mesh) -> FloatArray:
    """(F, 3, 3) normals at the corners of triangles: smooth but across a crease."""
    corners = mesh.vertices[mesh.faces]
    areas = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    grain = 1e-5 * np.ptp(mesh.vertices)
    place = np.round(corners.reshape(-1, 3) / grain).astype(np.int64)
    _, same = np.unique(place, axis=0, return_inverse=True)
    sums = np.zeros((same.max() + 1, 3))
    np.add.at(sums, same.ravel(), np.repeat(areas, 3, axis=0))
    smooth = sums[same.ravel()]
    smooth /= np.maximum(np.linalg.norm(smooth, axis=1, keepdims=True), 1e-30)
    flat = np.repeat(_face_normals(corners), 3, axis=0)
    folded = np.einsum("ij,ij->i", smooth, flat) < _CREASE
    return np.where(folded[:, None], flat, smooth).reshape(-1, 3, 3)


def _edges(
    depth: FloatArray,
    mesh: NDArray[np.int64],
    face: NDArray[np.int64],
    corners: FloatArray,
    step: float,
) -> NDArray[np.bool_]:
    """Return where a mesh ends, folds, or hides a part that lies deeper."""
    normals = _face_normals(corners)
    edge = np.zeros(depth.shape, dtype=bool)
    for here, there in (
        (np.s_[:-1, :], np.s_[1:, :]),
        (np.s_[:, :-1], np.s_[:, 1:]),
    ):
        with np.errstate(invalid="ignore"):
            ends = (mesh[here] != mesh[there]) | (np.abs(depth[here] - depth[there]) > step)
        inner = np.nonzero(~ends & (face[here] != face[there]))
        pair = normals[face[here][inner]] * normals[face[there][inner]]
        ends[inner] |= pair.sum(axis=1) < _FOLD
        edge[here] |= ends & (depth[here] <= depth[there])
        edge[there] |= ends & (depth[there] <= depth[here])
    return edge & np.isfinite(depth)
