"""The viewer's page in a real browser: figures, sliders, the drawing, legibility."""

from __future__ import annotations

import io
import re
import socket
import threading
from collections.abc import Callable, Iterator
from functools import partial
from http.server import SimpleHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import numpy as np
import pytest
import viser
from accessibility import serious_violations
from PIL import Image
from playwright.sync_api import Locator, Page, expect

from graspless_pin.scene import Scene, load_scene
from graspless_pin.viewer import Viewer, changed_scene, view
from graspless_pin.visualization import DARK, LIGHT, Role

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
PATIENCE = 120_000  # ms
WHOLE = slice(None), slice(None)

Opened = Callable[..., Page]


@pytest.fixture(scope="module")
def allegro() -> Scene:
    return load_scene(EXAMPLES / "allegro_box_on_slope.yaml")


@pytest.fixture(scope="module")
def viewers(allegro) -> Iterator[dict[bool, Viewer]]:
    """A light and a dark page of the scene for all tests: stopping waits for idle connections."""
    running = {dark: view(allegro, port=0, dark=dark or None) for dark in (False, True)}
    yield running
    for viewer in running.values():
        viewer.stop()


@pytest.fixture
def opened(page: Page, viewers: dict[bool, Viewer], allegro: Scene) -> Opened:
    """Open a page as it was at first."""

    def open_page(*, dark: bool = False) -> Page:
        page.goto(viewers[dark].url)
        page.wait_for_selector("#graspless-result", timeout=PATIENCE)
        # viser warns of drawing without a graphics card, over the middle of the page.
        page.get_by_role("alert").get_by_role("button").first.click()
        page.get_by_role("button", name="As loaded").click()
        settled(page, allegro.solve().margin)
        return page

    return open_page


def row(page: Page, label: str) -> Locator:
    """The slider and number of a control."""
    return page.locator(f"label:text-is('{label}') >> xpath=../../..")


def enter(page: Page, label: str, value: str) -> None:
    """Type a number and confirm it."""
    number = row(page, label).locator("input[inputmode]")
    number.fill(value)
    number.press("Enter")


def choose_colours(page: Page, before: str, after: str) -> None:
    page.locator(f"input[value='{before}']").first.click()
    page.get_by_role("option", name=after).click()


def margin(page: Page) -> float:
    return float(page.locator("#graspless-result").get_attribute("data-margin") or "nan")


def settled(page: Page, expected: float) -> None:
    """Wait for a margin, then compare all digits."""
    shown = page.locator("#graspless-result b").first
    expect(shown).to_have_text(f"{expected:.4f}", timeout=PATIENCE)
    assert margin(page) == pytest.approx(expected, rel=1e-12)


def drawing(page: Page, file: Path | None = None) -> np.ndarray:
    """(H, W, 3) pixels of the page."""
    png = page.screenshot(path=file, scale="css")
    return np.asarray(Image.open(io.BytesIO(png)).convert("RGB")).astype(float)


def looked_at(page: Page, area: tuple[slice, slice], good: Callable[[np.ndarray], bool]) -> bool:
    """Look at an area until it is good: the drawing has no sign of being finished."""
    for _ in range(PATIENCE // 500):
        if good(drawing(page)[area]):
            return True
        page.wait_for_timeout(500)
    return False


def middle(pixels: np.ndarray) -> np.ndarray:
    """What lies between the panels."""
    return pixels[:, 345:945]


def differing(pixels: np.ndarray, others: np.ndarray) -> float:
    """Share of the squares of 8 x 8 pixels that have another colour.

    Not of single pixels: a view may come to rest a part of a pixel from where it was.
    """
    high, wide, _ = pixels.shape
    squares = (pixels - others).reshape(high // 8, 8, wide // 8, 8, 3).mean(axis=(1, 3))
    return float((np.abs(squares).sum(axis=2) > 60.0).mean())


def still(page: Page) -> np.ndarray:
    """What lies between the panels when nothing has changed there for a while."""
    last, same = middle(drawing(page)), 0
    for _ in range(PATIENCE // 500):
        page.wait_for_timeout(500)
        last, before = middle(drawing(page)), last
        same = same + 1 if differing(last, before) == 0.0 else 0
        if same == 2:
            break
    return last


def moved_from(before: np.ndarray, shot: np.ndarray) -> bool:
    """Whether much of what lies between the panels is elsewhere."""
    return bool((np.abs(middle(shot) - before).sum(axis=2) > 60.0).mean() > 0.02)


def bluish(pixels: np.ndarray) -> int:
    """Pixels of saturated blue: the arrows of normal forces in a light page."""
    red, _, blue = np.moveaxis(middle(pixels), 2, 0)
    return int(((blue > 90.0) & (red < 0.35 * blue)).sum())


def test_the_page_shows_what_the_library_computes(allegro, opened):
    """At first, after a slider is moved and numbers are typed, and for the other algorithm."""
    page = opened()
    before = margin(page)
    text = page.locator("#graspless-torques").inner_text()
    figures = [float(line) for line in text.splitlines() if not re.search("[a-z]", line)]
    np.testing.assert_allclose(figures, allegro.solve().torques, atol=5.1e-5)
    as_loaded = page.get_by_role("button", name="As loaded")
    place = as_loaded.bounding_box()
    control = row(page, "friction, supports")
    thumb = control.get_by_role("slider")
    thumb.focus()
    for _ in range(3):
        page.keyboard.press("ArrowRight")
    expect(thumb).to_have_attribute("aria-valuenow", "0.38", timeout=PATIENCE)
    first = changed_scene(allegro, {"friction/supports": 0.38}).solve().margin
    assert first != pytest.approx(before, rel=1e-3)
    settled(page, first)
    enter(page, "friction, supports", "0.5")
    settled(page, changed_scene(allegro, {"friction/supports": 0.5}).solve().margin)
    enter(page, "angle of slope [°]", "25")
    both = {"friction/supports": 0.5, "slope": 25.0}
    settled(page, changed_scene(allegro, both).solve().margin)
    # A verdict that comes in must not move what somebody is about to click.
    expect(page.locator("#graspless-headline")).to_contain_text("needs joint", timeout=PATIENCE)
    assert as_loaded.bounding_box() == place
    as_loaded.click()
    settled(page, before)
    expect(thumb).to_have_attribute("aria-valuenow", "0.35")
    page.locator("input[value='1: largest margin']").first.click()
    page.get_by_role("option", name="2: smallest torque").click()
    settled(page, allegro.solve("torque", margin=0.1).margin)
    enter(page, "e0 [N]", "0.4")
    result = page.locator("#graspless-result")
    expect(result).to_contain_text("at margin 0.4 N", timeout=PATIENCE)
    expect(result).to_contain_text(f"{allegro.solve('torque', margin=0.4).max_torque:.4f}")
    enter(page, "e0 [N]", "12")  # a margin is at most half of max_normal_force
    expect(result).to_have_attribute("data-found", "false", timeout=PATIENCE)


def test_the_object_is_dragged_by_its_upper_arrow(allegro, opened):
    page = opened()
    page.get_by_text("Object", exact=True).first.click()
    before = still(page)
    row(page, "drag in the picture").get_by_role("checkbox").first.check(force=True)
    assert looked_at(page, WHOLE, lambda shot: differing(middle(shot), before) > 0.0)
    rows, columns = np.nonzero(np.abs(still(page) - before).max(axis=2) > 60.0)
    top = rows < rows.min() + 25
    tip = 345.0 + columns[top].mean(), rows[top].mean()
    page.mouse.move(*tip)
    page.mouse.down()
    for step in range(1, 6):
        page.mouse.move(tip[0], tip[1] - 8.0 * step)
        page.wait_for_timeout(100)
    page.mouse.up()
    up = row(page, "shift along z [mm]").locator("input[inputmode]").first
    expect(up).not_to_have_value("0", timeout=PATIENCE)
    assert float(up.input_value()) > 5.0
    for label in ("shift along x [mm]", "shift along y [mm]", "turn about z [°]"):
        expect(row(page, label).locator("input[inputmode]").first).to_have_value("0")
    # It left the slope: the page says which contacts are gone.
    expect(page.locator("#graspless-changes")).to_contain_text("7 contacts gone", timeout=PATIENCE)
    row(page, "drag in the picture").get_by_role("checkbox").first.uncheck(force=True)
    page.wait_for_timeout(500)  # let the next page have none


def test_the_scene_is_drawn_layers_can_be_hidden_and_the_page_can_turn_dark(opened, tmp_path):
    page = opened()
    assert looked_at(page, WHOLE, lambda shot: np.median(middle(shot)) > 200.0)
    assert looked_at(page, WHOLE, lambda shot: bluish(shot) > 500)
    still(page)
    shown = drawing(page, tmp_path / "light.png")
    arrows = bluish(shown)
    inside = middle(shown)
    drawn = np.abs(inside - 255.0).max(axis=2) > 12.0
    assert 0.05 < drawn.mean() < 0.9
    # Nothing reaches the top, the bottom or the panels.
    rim = np.concatenate([drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]])
    assert not rim.any(), "the scene is cut off"
    page.get_by_role("tab", name="Layers").click()
    page.get_by_label("normal force").click()
    # The scale's arrow and the object stay.
    gone = looked_at(page, WHOLE, lambda shot: bluish(shot) < 0.4 * arrows)
    page.get_by_label("normal force").click()  # as it was, for the next page
    assert gone
    legend = page.locator("#graspless-legend")
    assert all(LIGHT.roles[role] in legend.inner_html() for role in Role)
    choose_colours(page, "as the system", "dark")
    is_dark = looked_at(page, WHOLE, lambda shot: np.median(middle(shot)) < 60.0)
    assert all(DARK.roles[role] in legend.inner_html() for role in Role)
    drawing(page, tmp_path / "dark.png")
    # As it was, for the next page: closing this one at once might leave the server in the dark.
    choose_colours(page, "dark", "as the system")
    expect(page.locator("html")).to_have_attribute("data-mantine-color-scheme", "light")
    assert is_dark


LEGIBILITY = """(root) => {
  const rgb = (text) => text.match(/[\\d.]+/g).map(Number);
  const light = ([r, g, b]) => [r, g, b]
    .map((v) => v / 255)
    .map((v) => (v <= 0.04045 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4))
    .reduce((sum, v, i) => sum + v * [0.2126, 0.7152, 0.0722][i], 0);
  const opaque = (node) => {
    for (; node; node = node.parentElement) {
      const color = rgb(getComputedStyle(node).backgroundColor);
      if (color.length === 3 || color[3] === 1) return color;
    }
    return [255, 255, 255];
  };
  const through = (node) => {
    let share = 1;
    for (; node; node = node.parentElement) share *= Number(getComputedStyle(node).opacity);
    return share;
  };
  const found = [];
  for (const node of root.querySelectorAll("*")) {
    const own = [...node.childNodes].some((n) => n.nodeType === 3 && n.textContent.trim());
    if (!own) continue;
    const behind = opaque(node);
    const share = through(node);
    const ink = rgb(getComputedStyle(node).color).slice(0, 3)
      .map((v, i) => share * v + (1 - share) * behind[i]);
    const [low, high] = [light(ink), light(behind)].sort((a, b) => a - b);
    const box = node.getBoundingClientRect();
    found.push({
      text: node.textContent,
      contrast: (high + 0.05) / (low + 0.05),
      size: parseFloat(getComputedStyle(node).fontSize),
      left: box.left, right: box.right, bottom: box.bottom,
      cut: node.scrollWidth > node.clientWidth + 1 && getComputedStyle(node).display !== "inline",
    });
  }
  return found;
}"""


@pytest.mark.parametrize("dark", [False, True], ids=["light", "dark"])
def test_the_readings_are_legible(allegro, opened, dark):
    page = opened(dark=dark)
    verdict = page.locator("#graspless-verdict")
    expect(verdict).to_have_attribute("data-status", "strong", timeout=PATIENCE)
    found: list[dict[str, Any]] = []
    for reading in ("#graspless-result", "#graspless-torques"):
        found += page.locator(reading).evaluate(LEGIBILITY)
    assert len(found) > 2 * len(allegro.solve().torques)
    for item in found:
        assert item["contrast"] > 4.5, item
        assert item["size"] >= 12.0, item
        assert item["left"] >= 0.0, item
        assert item["right"] <= 335.0, item
        assert item["bottom"] <= 800.0, item
        assert not item["cut"], item


def test_what_is_drawn_is_numbered_and_seen_from_presets(opened):
    """Numbers, axes, gravity and scale as text; the keyboard reaches the views."""
    page = opened()
    for name in ("Top", "Front", "Fit"):
        before = middle(drawing(page))
        page.get_by_role("button", name=name, exact=True).press("Enter")
        assert looked_at(page, WHOLE, partial(moved_from, before)), name
        after = still(page)
        drawn = np.abs(after - 255.0).max(axis=2) > 12.0
        rim = np.concatenate([drawn[0], drawn[-1], drawn[:, 0], drawn[:, -1]])
        assert not rim.any(), f"{name}: the scene is cut off"
    page.locator("#graspless-contacts summary").click()
    told = page.locator("#graspless-contacts").inner_text()
    assert "slope" in told and "0.7437 N from slipping, which limits the margin" in told
    assert "Joint joint_1.0 is nearest its limit" in page.locator("#graspless-result").inner_text()


def test_a_phone_shows_the_margin_and_reaches_the_controls(page, viewers, allegro):
    """And follows its reader into the dark; axe finds nothing serious in the panels."""
    page.set_viewport_size({"width": 500, "height": 600})
    page.emulate_media(color_scheme="dark")
    page.goto(viewers[False].url)
    headline = page.locator("#graspless-headline")
    expect(headline).to_contain_text(f"{allegro.solve().margin:.4f} N", timeout=PATIENCE)
    page.get_by_role("alert").get_by_role("button").first.click()
    expect(headline).to_be_in_viewport()
    expect(page.locator("html")).to_have_attribute("data-mantine-color-scheme", "dark")
    for name in ("Fit", "Undo", "Save as scene file"):
        button = page.get_by_role("button", name=name, exact=True)
        button.scroll_into_view_if_needed()
        expect(button).to_be_in_viewport()

    def shows_the_scene(pixels: np.ndarray) -> bool:
        ground = np.median(pixels.reshape(-1, 3), axis=0)
        differs = (np.abs(pixels - ground).max(axis=2) > 25.0).mean() > 0.1
        return bool(differs) and bool(ground.max() < 60.0)

    def hides_nothing(pixels: np.ndarray) -> bool:
        return bool((np.abs(pixels - np.median(pixels, axis=(0, 1))).max(axis=2) < 25.0).all())

    # At first sight, and when the page turns: what is free of the panel holds all of the scene.
    for wide, high in ((500, 600), (390, 844)):
        page.set_viewport_size({"width": wide, "height": high})
        free = round(0.4 * high)
        assert looked_at(page, np.s_[20 : free - 20, 10 : wide - 10], shows_the_scene)
        for outside in (
            np.s_[free + 10 : high - 10, 5:85],
            np.s_[20 : free - 20, :4],
            np.s_[20 : free - 20, wide - 4 :],
        ):
            assert looked_at(page, outside, hides_nothing), (wide, outside)
        panel = headline.locator("xpath=ancestor::*[contains(@class, 'mantine-Paper-root')]")
        box = panel.bounding_box()
        assert box is not None
        assert box["height"] <= 0.61 * high
    assert serious_violations(page) == []


KNOCK = """(url) => new Promise((resolve) => {
  const socket = new WebSocket(url, "viser-vVERSION");
  let seen = 0;
  socket.onmessage = () => { seen += 1; socket.close(); };
  socket.onclose = (event) => resolve([seen, event.code]);
  setTimeout(() => { socket.close(); }, 20000);
})"""


def test_a_page_of_another_site_is_not_answered(page, viewers, tmp_path):
    """Not even if it knows the address; our own page is, by the same means."""
    (tmp_path / "index.html").write_text("<html><body>another site</body></html>")
    handler = partial(SimpleHTTPRequestHandler, directory=str(tmp_path))
    address = urlsplit(viewers[False].url)
    own = f"ws://{address.netloc}{address.path}".rstrip("/")
    knock = KNOCK.replace("VERSION", viser.__version__)
    with ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        page.goto(f"http://127.0.0.1:{server.server_port}/")
        for url in (own, f"ws://{address.netloc}", own.replace("127.0.0.1", "localhost")):
            assert page.evaluate(knock, url) == [0, 1006]
        server.shutdown()
        thread.join()
    page.goto(viewers[False].url)
    seen, code = page.evaluate(knock, own)
    assert seen > 0 and code != 1006
    assert page.evaluate(knock, own.replace("127.0.0.1", "localhost")) == [0, 1006]


def answers(host: str, port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex((host, port)) == 0


def test_a_motion_is_shown_when_it_is_asked_for(page: Page):
    """The box between the walls goes down, and comes back; on this machine, until it is stopped."""
    walls = load_scene(EXAMPLES / "box_between_walls.yaml")
    viewer = view(walls, port=0)
    address = urlsplit(viewer.url)
    assert address.port is not None and address.hostname == "127.0.0.1"
    try:
        assert answers("127.0.0.1", address.port) and not answers("127.0.0.2", address.port)
        page.goto(viewer.url)
        said = page.locator("#graspless-verdict")
        expect(said).to_contain_text("May fail the object can slip down", timeout=PATIENCE)
        assert said.get_attribute("data-status") == "weak"
        page.get_by_role("alert").get_by_role("button").first.click()
        show = page.get_by_role("checkbox", name="show", exact=True)
        at_rest = still(page)
        show.check(force=True)
        assert looked_at(page, WHOLE, lambda shot: differing(middle(shot), at_rest) > 0.01)
        show.uncheck(force=True)
        # Not none at all: what a busy machine draws late was not there before.
        assert looked_at(page, WHOLE, lambda shot: differing(middle(shot), at_rest) < 0.005)
        page.get_by_role("checkbox", name="play", exact=True).check(force=True)
        expect(show).to_be_checked()
        first = middle(drawing(page))
        assert looked_at(page, WHOLE, lambda shot: differing(middle(shot), first) > 0.0)
    finally:
        viewer.stop()
    viewer.stop()
    viewer.wait()
    assert not answers("127.0.0.1", address.port)
