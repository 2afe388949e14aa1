"""Pictures of the documentation, drawn by the package whenever the site is built."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Polygon
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import File, Files
from scipy.spatial import ConvexHull

from graspless_pin import load_scene
from graspless_pin.problem.checks import FloatArray
from graspless_pin.visualization import LIGHT, Mesh, Role
from graspless_pin.visualization.motion import draw_motion

_SCENE = Path(__file__).parent / "examples" / "box_between_walls.yaml"
_MARK = re.compile(r"<!-- picture (\S+): (.+?) -->")
_TIMES = 0, 15, 21, 26, 30
"""Looks at the motion, of 31: the object goes about as far from one to the next."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures to the site."""
    picture = motion_svg(_SCENE)
    files.append(File.generated(config, f"{_SCENE.stem}.svg", content=picture))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Show pictures where a page says so; read elsewhere, it shows none."""
    return _MARK.sub(r"![\2](\1)", markdown)


def motion_svg(file: Path) -> str:
    """Return what may happen in a scene as an SVG: the object at some times, its outline only."""
    scene = load_scene(file)
    solution = scene.solve()
    motion = scene.stability(solution.torques).motion
    if motion is None:
        raise ValueError(f"{file}: nothing moves")
    moving = draw_motion(solution.problem, motion, scene=scene)
    picture = moving.picture
    right = np.cross(picture.up, picture.view_from)
    right /= np.linalg.norm(right)
    screen = np.stack([right, np.cross(picture.view_from, right)])
    figure = Figure(figsize=(4.2, 4.2), facecolor="white")
    axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
    axes.set_axis_off()
    axes.set_aspect("equal")
    depths = [mesh.vertices.mean(axis=0) @ picture.view_from for mesh in picture.meshes]
    for mesh in (picture.meshes[index] for index in np.argsort(depths)):
        if mesh.role in (Role.TOTAL_FORCE, Role.CONE, Role.AXES, Role.GRAVITY, Role.FORCE_SCALE):
            continue
        path = moving.path_of.get(mesh.name)
        looks = _TIMES if mesh.role is Role.OBJECT else _TIMES[-1:]
        for number, look in enumerate(looks):
            pose = np.eye(4) if path is None else moving.paths[path][look]
            _outline(axes, mesh, pose, screen, (number + 1) / len(looks))
    axes.autoscale_view()
    buffer = io.StringIO()
    with rc_context({"svg.hashsalt": file.name}):
        figure.savefig(buffer, format="svg", metadata={"Date": None})
    return buffer.getvalue()


def _outline(axes: Axes, mesh: Mesh, pose: FloatArray, screen: FloatArray, share: float) -> None:
    """Draw the outline of a convex mesh, the fainter the smaller the share."""
    points = (mesh.vertices @ pose[:3, :3].T + pose[:3, 3]) @ screen.T
    color = LIGHT.roles[mesh.role]
    edge = "#1b1f24" if mesh.role in (Role.OBJECT, Role.SUPPORT) else color
    fill = Polygon(points[ConvexHull(points).vertices], facecolor=color, edgecolor=edge, lw=0.8)
    fill.set_alpha(share * (0.5 * mesh.opacity if mesh.opacity < 1.0 else 1.0))
    axes.add_patch(fill)
