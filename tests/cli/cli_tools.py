"""Run the command line in this process, and a scene that can be spoilt line by line."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import yaml
from typer.testing import CliRunner, Result

from graspless_pin.cli.commands import app

ROOT = Path(__file__).resolve().parents[2]
EXAMPLES = ROOT / "examples"
PAPER = EXAMPLES / "paper"
ALLEGRO = EXAMPLES / "allegro_box_on_slope.yaml"

# A lever touches a box on the floor. Messages name these lines.
LINES = """\
gravity: [0, 0, -9.8]
friction: 0.3
hand:
  robot: lever_100mm
  base_pose: {position: [-0.1, -0.1, 0.0], rpy: [3.141592653589793, 0, 0]}
  q: {hinge: 0.0}
object:
  name: box
  shape: {type: box, size: [0.2, 0.2, 0.2]}
  mass: 1.0
  pose: {position: [0, 0, 0]}
supports:
  - name: floor
    shape: {type: half_space}
    pose: {position: [0, 0, -0.1]}
"""


def run(*arguments: str | Path) -> Result:
    """Run ``graspless-pin``; an error that it does not handle fails the test as it is."""
    return CliRunner().invoke(
        app, [str(argument) for argument in arguments], catch_exceptions=False
    )


def stating(folder: Path, source: Path, **keys: Any) -> Path:
    """Write an example with some keys more."""
    data = yaml.safe_load(source.read_text(encoding="utf-8")) | keys
    file = folder / "scene.yaml"
    file.write_text(yaml.safe_dump(data), encoding="utf-8")
    return file


def solve_text(folder: Path, text: str | bytes, *options: str | Path) -> Result:
    """Write ``scene.yaml`` and solve it, without the verdict, which takes longer."""
    file = folder / "scene.yaml"
    file.write_bytes(text if isinstance(text, bytes) else text.encode())
    return run("solve", file, "--no-verdict", *options)


def spoilt(old: str, new: str, text: str = LINES) -> str:
    """Return a text with one part of it replaced."""
    assert text.count(old) == 1, f"{old!r} stands {text.count(old)} times in the scene"
    return text.replace(old, new)


def assert_refused(result: Result, message: str, printed: str = "") -> None:
    """Exit code 2, one message on standard error, no traceback; if nothing is named, no more."""
    assert result.exit_code == 2, result.output
    assert printed in result.stdout if printed else result.stdout == ""
    assert result.stderr.startswith("error: ")
    assert "Traceback" not in result.stderr
    assert message in result.stderr
