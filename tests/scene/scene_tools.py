"""Scenes as text for the tests: where the examples are, and how to change one."""

from __future__ import annotations

from dataclasses import fields
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from tests.cli.cli_tools import LINES

from graspless_pin import Hand, QuasistaticProblem
from graspless_pin.scene import Scene, load_scene

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PAPER = EXAMPLES / "paper"
ALLEGRO = EXAMPLES / "allegro_box_on_slope.yaml"

# A 1 kg box of 0.2 m on the floor, touched on its -y face by the lever, mounted as in the paper.
BOX = LINES.replace("  q: {hinge: 0.0}\n", "").replace("  pose: {position: [0, 0, 0]}\n", "")


def content(source: Path | str) -> dict[str, Any]:
    """Return a scene, a file or text, as plain data that may be changed."""
    text = source.read_text(encoding="utf-8") if isinstance(source, Path) else source
    return yaml.safe_load(text)


def loaded(folder: Path, data: dict[str, Any] | str) -> Scene:
    """Write a scene and load it."""
    file = folder / "scene.yaml"
    file.write_text(data if isinstance(data, str) else yaml.safe_dump(data), encoding="utf-8")
    return load_scene(file)


def hand_of(scene: Scene) -> Hand:
    assert scene.hand is not None
    return scene.hand


def without_hand(folder: Path) -> Scene:
    """Load the box that nothing touches but the floor."""
    data = content(BOX)
    del data["hand"]
    return loaded(folder, data)


def bodies_at(scene: Scene) -> list[str]:
    return list(scene.contacts.bodies)


def assert_same(ours: QuasistaticProblem, theirs: QuasistaticProblem) -> None:
    """All arrays of two problems are equal and read-only, and so is all else."""
    for item in fields(QuasistaticProblem):
        mine, other = getattr(ours, item.name), getattr(theirs, item.name)
        np.testing.assert_array_equal(mine, other, err_msg=item.name)
        assert not isinstance(mine, np.ndarray) or not mine.flags.writeable, item.name


def unit(*values: float) -> np.ndarray:
    vector = np.array(values, dtype=float)
    return vector / np.linalg.norm(vector)
