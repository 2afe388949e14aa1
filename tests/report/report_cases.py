"""Scenes and solutions that the tests of reports share, and a reader of HTML."""

from __future__ import annotations

import json
from dataclasses import dataclass, field
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from graspless_pin import QuasistaticProblem, Scene, TorqueSolution, load_scene
from graspless_pin.report import solution_document

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
ALLEGRO = EXAMPLES / "allegro_box_on_slope.yaml"
SLIDING = EXAMPLES / "paper" / "cuboid_sliding_up.yaml"
WALLS = EXAMPLES / "box_between_walls.yaml"
AT_REST = EXAMPLES / "paper" / "cuboid_at_rest.yaml"
BALL = EXAMPLES / "allegro_sphere_on_slope.yaml"
SPHERE = EXAMPLES / "paper" / "sphere_on_slope.yaml"
"""Three contacts: a page of it is soon written."""

_VOID = {"meta", "link", "br", "img", "input", "hr"}


def pinched_block(**changes: Any) -> QuasistaticProblem:
    """Two one-joint fingers pinch a block that stands on one point of the floor."""
    jacobian = [[0, 0], [-0.1, 0], [0, 0], [0, 0], [0, 0.1], [0, 0], [0, 0], [0, 0], [0, 0]]
    values: dict[str, Any] = {
        "positions": [[0, -0.05, 0], [0, 0.05, 0], [0, 0, -0.05]],
        "normals": [[0, 1, 0], [0, -1, 0], [0, 0, 1]],
        "external_wrench": [0, 0, -4.9, 0, 0, 0],
        "jacobian": jacobian,
        "friction": 0.5,
        "torque_limits": ([-2.0, -1.0], [2.0, float("inf")]),
    }
    return QuasistaticProblem(**{**values, **changes})


def micro_block() -> QuasistaticProblem:
    """Return the same, a thousand times smaller, with a millionth of the forces."""
    block = pinched_block()
    return pinched_block(
        positions=1e-3 * block.positions,
        external_wrench=1e-6 * block.external_wrench,
        jacobian=1e-3 * block.jacobian,
        torque_limits=(1e-9 * block.lower_torque, 1e-9 * block.upper_torque),
        max_normal_force=1e-6 * block.max_normal_force,
    )


def solved(path: Path, *arguments: str, **options: Any) -> tuple[Scene, TorqueSolution]:
    """Load a scene and solve it."""
    scene = load_scene(path)
    return scene, scene.solve(*arguments, **options)


def through_json(solution: TorqueSolution, scene: Scene | None = None) -> dict[str, Any]:
    """A document as it comes back from a file."""
    return json.loads(json.dumps(solution_document(solution, scene), allow_nan=False))


@dataclass
class Element:
    """An element of a page; `text` is that of all elements inside."""

    tag: str
    attributes: dict[str, str | None]
    children: list[Element] = field(default_factory=list)
    pieces: list[str] = field(default_factory=list)

    @property
    def text(self) -> str:
        return " ".join(" ".join(self.pieces).split())

    def all(self, tag: str) -> list[Element]:
        found = [self] if self.tag == tag else []
        return found + [hit for child in self.children for hit in child.all(tag)]

    def with_id(self, name: str) -> Element:
        (found,) = (item for item in self.everything() if item.attributes.get("id") == name)
        return found

    def everything(self) -> list[Element]:
        return [self] + [hit for child in self.children for hit in child.everything()]

    def section(self, name: str) -> Element:
        """The section that a heading labels."""
        (found,) = (
            item for item in self.all("section") if item.attributes.get("aria-labelledby") == name
        )
        return found

    def rows(self) -> list[list[str]]:
        """The cells of the body of the table inside."""
        (body,) = self.all("tbody")
        return [
            [cell.text for cell in row.everything() if cell.tag in ("th", "td")]
            for row in body.all("tr")
        ]


class _Reader(HTMLParser):
    def __init__(self) -> None:
        super().__init__()
        self.open = [Element("", {})]

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        element = Element(tag, dict(attrs))
        self.open[-1].children.append(element)
        if tag not in _VOID:
            self.open.append(element)

    def handle_startendtag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.open[-1].children.append(Element(tag, dict(attrs)))

    def handle_endtag(self, tag: str) -> None:
        closed = self.open.pop()
        assert closed.tag == tag, f"</{tag}> closes <{closed.tag}>"

    def handle_data(self, data: str) -> None:
        for element in self.open:
            element.pieces.append(data)


def read_html(text: str) -> Element:
    """Parse a page; every element that is opened must be closed in turn."""
    reader = _Reader()
    reader.feed(text)
    reader.close()
    assert len(reader.open) == 1, f"<{reader.open[-1].tag}> is never closed"
    return reader.open[0]
