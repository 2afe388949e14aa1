"""Pictures of the documentation, drawn by the package whenever the site is built.

A page says which: ``<!-- picture KIND SCENE: what there is to see -->``, where SCENE is a scene of
the repository or one that the page itself tells the reader to write. Read elsewhere, the page shows
none. A mark that is misspelt, or a picture that cannot be drawn, ends the build.
"""

from __future__ import annotations

import hashlib
import io
import re
import tempfile
from collections.abc import Iterable
from dataclasses import replace
from pathlib import Path

import numpy as np
import rasterizer
from matplotlib import get_data_path
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.structure.files import File, Files
from PIL import Image, ImageDraw, ImageFont
from plots_of_pages import PLOTS, draw_boundary, draw_plot

from graspless_pin import close_fingers, load_scene, load_study, place_hand
from graspless_pin.errors import GrasplessPinError
from graspless_pin.scene import Scene
from graspless_pin.solution import TorqueSolution
from graspless_pin.visualization import DARK, LIGHT, Mesh, Palette, Picture, Role, draw_scene
from graspless_pin.visualization.motion import draw_motion
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST, Mark

ROOT = Path(__file__).resolve().parents[1]
SIZE = 880, 560
PALETTES = {"light": LIGHT, "dark": DARK}
_KEPT = ROOT / "out" / "pictures"
_MARK = re.compile(
    r"<!-- picture (?P<kind>[a-z]+)(?:=(?P<margin>[\d.]+))? "
    r"(?:(?P<fingers>closed|wrapped|placed) )?(?P<scene>\S+\.yaml): (?P<words>[^\n]+?) -->"
)
_ANY_MARK = "<!-- picture"
_FENCE = re.compile(r'^```\w* title="([^"]+)"\n(.*?)^```$', re.DOTALL | re.MULTILINE)
FONT_SIZE = 17
FONT = ImageFont.truetype(Path(get_data_path(), "fonts", "ttf", "DejaVuSans.ttf"), FONT_SIZE)
_ASIDE = 7  # pixels
_EDGE = 0.02  # of a picture's radius: a jump in depth that is drawn as an edge
_KEYS: dict[str, str] = {}
"""Of each picture that was drawn: what its colours mean, as HTML."""
_EXPLAINED = set(Role) - HIDDEN_AT_FIRST - {Role.HAND, Role.OBJECT, Role.SUPPORT, Role.AXES}
_TIMES = 0, 15, 21, 26, 30
"""Looks at a motion, of 31: the object goes about as far from one to the next."""


def on_files(files: Files, config: MkDocsConfig) -> Files:
    """Add the pictures that pages ask for to the site."""
    _KEYS.clear()
    for page in list(files.documentation_pages()):
        if _ANY_MARK not in (markdown := page.content_string):
            continue
        with tempfile.TemporaryDirectory() as folder:
            for name, text in _FENCE.findall(markdown):
                (Path(folder) / name).write_text(text, encoding="utf-8")
            for mark in _marks(page.src_uri, markdown):
                if _name(mark) in _KEYS:
                    continue
                for name, content in _contents(mark, Path(folder)).items():
                    files.append(File.generated(config, f"pictures/{name}.png", content=content))
    return files


def on_page_markdown(markdown: str, **_: object) -> str:
    """Show pictures where a page says so, with a key to their colours."""
    return _MARK.sub(_figure, markdown)


def solution_of(scene: Scene, margin: float | None = None) -> TorqueSolution:
    """Return the solution of Algorithm 2 with a required margin (N); None: of Algorithm 1."""
    solution = scene.solve("margin") if margin is None else scene.solve("torque", margin=margin)
    if not solution.found:
        raise PluginError(f"{scene.name}: not found: {solution.status}")
    return solution


def scene_picture(scene: Scene, kind: str = "forces", margin: float | None = None) -> Picture:
    """Return a scene as a picture.

    Args:
        scene: The scene.
        kind: ``scene``: contacts alone; ``forces``: with the forces of a solution; ``region``: with
            where the centre of mass may be under its torques; ``motion``: what else may happen.
        margin: Of Algorithm 2, N; None: Algorithm 1.
    """
    if kind == "scene":
        return draw_scene(scene)
    solution = solution_of(scene, margin)
    if kind == "forces":
        return draw_scene(scene, solution)
    if kind == "region":
        off = scene.tolerances(solution.torques, static_friction="coulomb")
        return draw_scene(scene, solution, tolerances=off)
    motion = scene.stability(solution.torques).motion
    if kind != "motion" or motion is None:
        raise PluginError(f"{scene.name}: there is no picture of its {kind}")
    moving = draw_motion(solution.problem, motion, scene=scene)
    meshes: list[Mesh] = []
    for mesh in moving.picture.meshes:
        path = moving.path_of.get(mesh.name)
        looks = () if path is None else _TIMES if mesh.role is Role.OBJECT else _TIMES[-1:]
        for number, look in enumerate(looks):
            pose = moving.paths[path or 0][look]
            there = mesh.vertices @ pose[:3, :3].T + pose[:3, 3]
            share = mesh.opacity if look == _TIMES[-1] else 0.12 * (number + 1) / len(looks)
            meshes.append(replace(mesh, name=f"{mesh.name}/{look}", vertices=there, opacity=share))
        if path is None and mesh.role is not Role.CONE:
            meshes.append(mesh)
    return replace(moving.picture, meshes=tuple(meshes))


def pixels_of(
    picture: Picture, palettes: Iterable[Palette], size: tuple[int, int] = SIZE
) -> list[np.ndarray]:
    """Return (H, W, 4) pixels of a picture in each palette, on no background."""
    camera = rasterizer.camera_of(picture, *size)
    shown = [mesh for mesh in picture.meshes if mesh.role not in HIDDEN_AT_FIRST]
    seen = rasterizer.look(shown, camera, _EDGE * picture.radius)
    roles = {mesh.role for mesh in shown}
    marks = [mark for mark in picture.marks if mark.role in roles]
    places = camera.pixels([mark.position for mark in marks])
    texts = list(zip(marks, places, strict=True))
    return [_written(rasterizer.paint(seen, palette), texts, palette) for palette in palettes]


def _written(
    pixels: np.ndarray, texts: list[tuple[Mark, tuple[float, float]]], palette: Palette
) -> np.ndarray:
    """Write short texts into a picture, numbers of contacts beside them."""
    image = Image.fromarray(pixels)
    draw = ImageDraw.Draw(image)
    rim = palette.background
    for mark, (x, y) in texts:
        place, anchor = ((x, y), "mm") if mark.contact is None else ((x + _ASIDE, y), "lm")
        draw.text(place, mark.text, palette.text, FONT, anchor, stroke_width=2, stroke_fill=rim)
    return np.asarray(image)


def png(pixels: np.ndarray) -> bytes:
    """Return (H, W, 4) pixels as a PNG."""
    buffer = io.BytesIO()
    Image.fromarray(pixels).save(buffer, "png")
    return buffer.getvalue()


def key_of(picture: Picture) -> dict[str, list[str]]:
    """Return what the colours of a picture's small parts mean: one a palette, by their words."""
    there = {mesh.role for mesh in picture.meshes} & _EXPLAINED
    key = {
        role.label: [palette.roles[role] for palette in PALETTES.values()]
        for role in Role
        if role in there
    }
    if Role.FORCE_SCALE.label in key:
        key[str(picture.force_scale)] = key.pop(Role.FORCE_SCALE.label)
    return key


def _marks(page: str, markdown: str) -> list[re.Match[str]]:
    marks = list(_MARK.finditer(markdown))
    if len(marks) != markdown.count(_ANY_MARK):
        raise PluginError(f"{page}: a picture's mark is not '{_MARK.pattern}'")
    return marks


def _name(mark: re.Match[str]) -> str:
    parts = [Path(mark["scene"]).stem, mark["kind"], mark["margin"], mark["fingers"]]
    return "-".join(part.replace(".", "_") for part in parts if part)


def _scene(mark: re.Match[str], folder: Path) -> Scene:
    own = folder / mark["scene"]
    scene = load_scene(own if own.is_file() else ROOT / mark["scene"])
    if mark["fingers"] == "placed":
        found = place_hand(scene, candidates=60, time_limit=None, verdict_nodes=0).scene
        if found is None:
            raise PluginError(f"{mark['scene']}: there is no place for the hand")
        return found
    if mark["fingers"]:
        scene = close_fingers(scene, wrap=mark["fingers"] == "wrapped").scene
    return scene


def _contents(mark: re.Match[str], folder: Path) -> dict[str, bytes]:
    """Return the PNGs of a mark by name, those of the last build where nothing has changed."""
    name = _name(mark)
    margin = None if mark["margin"] is None else float(mark["margin"])
    try:
        if mark["kind"] == "boundary":
            _KEYS[name] = ""
            return {name: draw_boundary(load_study(ROOT / mark["scene"]))}
        scene = _scene(mark, folder)
        if mark["kind"] in PLOTS:
            _KEYS[name] = ""
            return {name: draw_plot(mark["kind"], solution_of(scene, margin))}
        picture = scene_picture(scene, mark["kind"], margin)
    except GrasplessPinError as error:
        raise PluginError(f"{mark[0]}: {error}") from error
    _KEYS[name] = _key(picture)
    state = hashlib.sha256(Path(rasterizer.__file__).read_bytes())
    for mesh in picture.meshes:
        state.update(f"{mesh.name} {mesh.role} {mesh.opacity}".encode())
        state.update(np.ascontiguousarray(mesh.vertices).tobytes() + mesh.faces.tobytes())
    state.update(Path(__file__).read_bytes())
    state.update(
        f"{SIZE} {PALETTES} {[(m.text, *m.position) for m in picture.marks]}".encode()
        + picture.view_from.tobytes()
    )
    files = {f"{name}-{theme}": _KEPT / f"{state.hexdigest()}-{theme}.png" for theme in PALETTES}
    if not all(file.is_file() for file in files.values()):
        _KEPT.mkdir(parents=True, exist_ok=True)
        for file, drawn in zip(files.values(), pixels_of(picture, PALETTES.values()), strict=True):
            file.write_bytes(png(drawn))
    return {name: file.read_bytes() for name, file in files.items()}


def _key(picture: Picture) -> str:
    """Return what the colours of a picture's small parts mean."""
    return " ".join(
        f'<span class="color-key" style="--light:{light};--dark:{dark}">{words}</span>'
        for words, (light, dark) in key_of(picture).items()
    )


def _figure(mark: re.Match[str]) -> str:
    """Return a picture in both themes, of which the page shows one, or a plot."""
    name, words = _name(mark), mark["words"]
    is_plot = mark["kind"] in (*PLOTS, "boundary")
    ends = [""] if is_plot else [f"-{theme}" for theme in PALETTES]
    images = "\n".join(
        f"![{words}](pictures/{name}{end}.png{end and '#only'}{end})" for end in ends
    )
    kind = "plot" if is_plot else "picture"
    return (
        f'<figure class="{kind}" markdown="span">\n{images}\n'
        f"<figcaption>{words}{_KEYS[name] and '<br>'}{_KEYS[name]}</figcaption>\n</figure>"
    )
