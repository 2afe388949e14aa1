"""Pictures, formulas and keys of the documentation are there, and are those of today."""

import re
from pathlib import Path
from typing import cast

import keys
import numpy as np
import pictures
import pytest
import rasterizer
from latex2mathml.converter import convert
from mkdocs.config.defaults import MkDocsConfig
from mkdocs.exceptions import PluginError
from mkdocs.plugins import PluginCollection
from mkdocs.structure.files import File, Files
from page_blocks import ROOT, prose_of
from PIL import Image
from pydantic.json_schema import models_json_schema
from readme_pictures import FOLDER, SCENE, readme_pictures

from graspless_pin import load_scene
from graspless_pin.geometry.contact.contact_points import BodyKind
from graspless_pin.visualization import LIGHT, Mesh, Picture, Role

README = ROOT / "README.md"
TUTORIALS = [file.stem for file in (ROOT / "docs").glob("tutorial_*.md")]
FORMULA = re.compile(r"\$\$(.+?)\$\$|\$([^$\n]+)\$", re.DOTALL)
CODE = re.compile(r"<(pre|code|script|style)\b.*?</\1>", re.DOTALL)
PLAIN = {"integer", "number"}


@pytest.mark.parametrize("name", [*TUTORIALS, "first_steps", "own_hand", "holding", "model"])
def test_a_page_shows_its_pictures_in_both_themes(site, name):
    page = (site / name / "index.html").read_text(encoding="utf-8")
    for theme in ("light", "dark"):
        shown = re.findall(rf'<img alt="([^"]+)" src="([^"]+-{theme}\.png)#only-{theme}"', page)
        assert shown
        for words, source in shown:
            assert len(words) > 20
            with Image.open(site / name / source) as image:
                assert image.size == pictures.SIZE
                assert np.asarray(image)[..., 3].max() == 255


@pytest.mark.parametrize(
    ("mark", "words"),
    [
        ("<!-- picture forces: no scene -->", "mark"),
        ("<!-- picture forces examples/none.yaml: no such file -->", "none.yaml"),
        ("<!-- picture fores examples/from_scene.yaml: a misspelt kind -->", "from_scene.yaml"),
        ("<!-- picture fores examples/box_between_walls.yaml: a misspelt kind -->", "fores"),
        ("<!-- picture forces=50 examples/box_between_walls.yaml: too much -->", "not found"),
        ("<!-- picture motion examples/box_between_walls.yaml: it holds -->", "motion"),
    ],
)
def test_a_picture_that_cannot_be_drawn_ends_the_build(mark, words):
    config = cast("MkDocsConfig", MkDocsConfig())
    config.load_dict({"site_name": "a page", "site_dir": "site"})
    plugins = PluginCollection()
    plugins._current_plugin = "pictures"
    config["plugins"] = plugins
    page = File.generated(config, "page.md", content=f"# A page\n\n{mark}\n")
    with pytest.raises(PluginError, match=re.escape(words)):
        pictures.on_files(Files([page]), config)


def cube(name: str, middle: float, color: Role, opacity: float = 1.0) -> Mesh:
    """A cube of edge 0.2 m about a point of the x axis."""
    corners = np.array([[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)]) * 0.2 - 0.1
    quads = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    faces = np.array([[a, b, c] for a, b, c, _ in quads] + [[a, c, d] for a, _, c, d in quads])
    return Mesh(name, color, corners + np.array([middle, 0.0, 0.0]), faces, opacity)


def seen(*meshes: Mesh) -> tuple[rasterizer.Camera, rasterizer.Seen]:
    """What is seen along the x axis from the front."""
    toward, up = np.array([1.0, 0.0, 0.0]), np.array([0.0, 0.0, 1.0])
    camera = rasterizer.camera_of(Picture(meshes, np.zeros(3), 0.5, up, toward), 60, 40)
    return camera, rasterizer.look(meshes, camera, 0.01)


def test_the_nearest_surface_is_seen_at_its_distance():
    camera, there = seen(cube("far", -0.3, Role.HAND), cube("near", 0.3, Role.SUPPORT))
    (layer,) = there.layers
    row, column = camera.height // 2, camera.width // 2
    depth = np.full(there.shape, np.inf)
    depth[layer.window] = layer.depth
    assert depth[row, column] == pytest.approx(camera.place[0] - 0.4, rel=1e-9)
    assert set(np.unique(layer.mesh)) <= {-1, 1}  # the far one hides behind the near one
    edge = camera.focal * 0.2 / (camera.place[0] - 0.4)
    assert np.isfinite(depth).sum() == pytest.approx(edge**2, rel=0.03)


def test_glass_lets_through_what_is_behind():
    far, glass = cube("far", -0.3, Role.HAND), cube("near", 0.3, Role.OBJECT, 0.4)
    both = seen(far, glass)
    hidden = seen(cube("far", -0.3, Role.OBJECT, 0.4), cube("near", 0.3, Role.HAND))
    alone = (seen(far), seen(cube("near", 0.3, Role.OBJECT)), both)
    pixels = [rasterizer.paint(found, LIGHT)[20, 30].astype(float) for _, found in alone]
    assert np.abs(pixels[2] - 0.6 * pixels[0] - 0.4 * pixels[1]).max() <= 1.0
    assert not np.isfinite(hidden[1].layers[1].depth).any()
    assert rasterizer.paint(both[1], LIGHT)[0, 0, 3] == 0


def test_the_readme_shows_what_the_package_draws():
    for theme, pixels in readme_pictures().items():
        with Image.open(FOLDER / f"readme-{theme}.png") as image:
            kept = np.asarray(image.convert("RGBA")).astype(float)
        assert kept.shape == pixels.shape, "run: make readme-pictures"
        assert np.abs(kept - pixels).mean() < 0.5, "run: make readme-pictures"


def test_the_caption_of_the_readme_tells_the_answer():
    """Mass, slope and friction of the scene in the picture, its torques and its margin."""
    caption = README.read_text(encoding="utf-8").partition("</picture>")[2].split("```")[0]
    told = [float(word) for word in re.findall(r"\d+(?:\.\d+)?", caption)]
    scene = load_scene(SCENE)
    solution, problem = scene.solve("margin"), scene.problem()
    slope = [point.kind is not BodyKind.HAND for point in scene.contacts.points]
    steep = np.degrees(np.arccos(problem.normals[slope, 2]))
    rough = np.degrees(np.arctan(problem.friction[slope]))
    assert np.ptp(steep) < 1e-6 and np.ptp(rough) < 1e-6
    assert "torques" in caption and "margin" in caption
    answer = [scene.object.mass, steep[0], rough[0], solution.max_torque, solution.margin]
    assert [f"{value:g}" for value in told] == [f"{value:.2g}" for value in answer]


def test_the_readme_is_short_and_begins_with_what_one_sees():
    text = README.read_text(encoding="utf-8")
    assert len(text.split()) < 900
    screen = "\n".join(text.splitlines()[:32])
    assert "docs/pictures/readme-light.png" in screen
    assert "docs/pictures/readme-dark.png" in screen
    assert "$ make run" in screen
    assert "$ make test" in screen
    assert "margin e = 0.7437" in screen


def formulas(file: Path) -> list[str]:
    text = re.sub(r"`[^`\n]*`", "", prose_of(file))
    return [(long or short).strip() for long, short in FORMULA.findall(text)]


def test_formulas_are_set(site):
    """As MathML, with no TeX left over."""
    count = 0
    for file in sorted((ROOT / "docs").rglob("*.md")):
        for formula in formulas(file):
            count += 1
            text = re.sub(r"<[^>]+>", "", convert(formula))
            assert not re.search(r"\\|&amp;|&#x00026;|begin|end\b", text), formula
    shown = 0
    for file in sorted(site.rglob("*.html")):
        page = CODE.sub("", file.read_text(encoding="utf-8"))
        shown += page.count("<math ")
        assert "$" not in re.sub(r"<[^>]+>", "", page), file
        assert "arithmatex" not in page, file
    assert shown == count > 100


def entries():
    for model, _ in keys.FILES.values():
        _, document = models_json_schema([(model, "validation")])
        for name, entry in document["$defs"].items():
            if "properties" in entry:
                yield name, entry


def numbers(schema: object) -> bool:
    """Whether a value holds decimal numbers that are no part of another table."""
    if isinstance(schema, dict):
        return schema.get("type") == "number" or any(
            numbers(inner) for name, inner in schema.items() if name != "default"
        )
    return isinstance(schema, list) and any(map(numbers, schema))


def test_each_key_has_a_meaning_and_each_number_a_unit(site):
    page = (site / "keys" / "index.html").read_text(encoding="utf-8")
    told = 0
    for name, entry in entries():
        properties = entry["properties"].values()
        for schema, (key, kind, unit, _, words) in zip(
            properties, keys.rows_of(entry), strict=True
        ):
            told += 1
            assert words, f"{name}.{key} has no description"
            assert kind != "any", f"{name}.{key}"
            assert unit or not numbers(schema), f"{name}.{key}: in which unit? 1 is a plain number"
            assert f"<code>{key}</code>" in page, f"{name}.{key}"
    assert told > 120
