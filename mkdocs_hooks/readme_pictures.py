"""Draw the pictures of README, which is read without a build: ``make readme-pictures``."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from pictures import (
    FONT,
    FONT_SIZE,
    PALETTES,
    ROOT,
    key_of,
    pixels_of,
    png,
    scene_picture,
)
from PIL import Image, ImageDraw

from graspless_pin import load_scene
from graspless_pin.visualization import Palette, Role

SCENE = ROOT / "examples" / "allegro_box_on_slope.yaml"
FOLDER = ROOT / "docs" / "pictures"
SIZE = 1200, 600
_KEY, _GAP = 52, 28  # pixels: height of the key, and between its parts


def readme_pictures() -> dict[str, np.ndarray]:
    """Return (H, W, 4) pixels by theme: forces of the scene's answer, and a key to their colours.

    Virtual sliding is left out: who comes to the README has not read of it yet.
    """
    picture = scene_picture(load_scene(SCENE))
    shown = tuple(mesh for mesh in picture.meshes if mesh.role is not Role.VIRTUAL_SLIDING)
    picture = replace(picture, meshes=shown)
    key = key_of(picture)
    drawn = pixels_of(picture, PALETTES.values(), SIZE)
    return {
        theme: np.vstack([pixels, _key({words: key[words][number] for words in key}, palette)])
        for number, ((theme, palette), pixels) in enumerate(
            zip(PALETTES.items(), drawn, strict=True)
        )
    }


def _key(colors: dict[str, str], palette: Palette) -> np.ndarray:
    """Return what the colours mean, in one line of the picture's width."""
    image = Image.new("RGBA", (SIZE[0], _KEY), (*bytes.fromhex(palette.text[1:]), 0))
    draw = ImageDraw.Draw(image)
    widths = [draw.textlength(words, FONT) + 1.4 * FONT_SIZE for words in colors]
    left = 0.5 * (SIZE[0] - sum(widths) - _GAP * (len(colors) - 1))
    top = 0.5 * (_KEY - FONT_SIZE)
    for (words, color), width in zip(colors.items(), widths, strict=True):
        draw.rounded_rectangle((left, top, left + FONT_SIZE, top + FONT_SIZE), 4, color)
        middle = (left + 1.4 * FONT_SIZE, top + 0.5 * FONT_SIZE)
        draw.text(middle, words, palette.text, FONT, "lm")
        left += width + _GAP
    return np.asarray(image)


def main() -> None:
    """Write the pictures."""
    FOLDER.mkdir(exist_ok=True)
    for theme, pixels in readme_pictures().items():
        file = FOLDER / f"readme-{theme}.png"
        file.write_bytes(png(pixels))
        print(file.relative_to(ROOT))


if __name__ == "__main__":
    main()
