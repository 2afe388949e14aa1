"""The report in a real browser, opened from disk with the network off."""

from __future__ import annotations

import io
import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from accessibility import serious_violations
from numpy.typing import NDArray
from PIL import Image
from playwright.sync_api import Page, expect

from graspless_pin import QuasistaticProblem, contact_force_bounds, load_scene, maximize_margin
from graspless_pin.report import solution_document
from graspless_pin.report.html import case_of_document, case_of_scene, report_html
from graspless_pin.visualization import DARK, LIGHT, Palette, Role
from graspless_pin.visualization.picture import HIDDEN_AT_FIRST

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
WIDTH, HEIGHT = 1280, 800
PATIENCE = 120_000  # ms

LONG_NAMES = """
name: Two manipulators pinch the left_hand_side_calibration_fixture_block_of_the_second_batch
friction: {hand: 0.8, supports: 0.4}
hand:
  mounts:
    - prefix: left_prototype_manipulator_with_force_torque_sensor/
      robot: lever_100mm
      base_pose: {position: [0, -0.03, 0.13], rpy: [3.1415927, 1.5707963, 0]}
    - prefix: right_prototype_manipulator_with_force_torque_sensor/
      robot: lever_100mm_mirrored
      base_pose: {position: [0, 0.03, 0.13], rpy: [0, 1.5707963, 0]}
object:
  name: left_hand_side_calibration_fixture_block_of_the_second_batch
  shape: {type: box, size: [0.06, 0.06, 0.06]}
  mass: 0.3
  pose: {position: [0, 0, 0.03]}
supports:
  - {name: laboratory_table_with_a_rubber_mat_and_a_camera, shape: {type: half_space}}
"""

Pixels = NDArray[np.int16]
Opened = Callable[..., Page]


@pytest.fixture(scope="module")
def reports(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Report files by name."""
    folder = tmp_path_factory.mktemp("reports")
    allegro = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    sliding = load_scene(EXAMPLES / "paper" / "cuboid_sliding_up.yaml")
    arrays = maximize_margin(
        QuasistaticProblem(
            [[0.1, 0, -0.1], [-0.1, 0.1, -0.1], [-0.1, -0.1, -0.1]],
            [[0, 0, 1]] * 3,
            [0, 0, -5, 0, 0, 0],
            friction=0.5,
        )
    )
    cases = {
        "allegro": case_of_scene(allegro, allegro.solve(), allegro.path),
        "infeasible": case_of_scene(sliding, sliding.solve(sliding_rule="constrained")),
        "arrays": case_of_document(json.loads(json.dumps(solution_document(arrays)))),
    }
    walls = load_scene(EXAMPLES / "box_between_walls.yaml")
    dropped = walls.solve()
    verdict = walls.stability(dropped.torques)
    cases["walls"] = case_of_scene(walls, dropped, walls.path, verdict)
    arm = load_scene(EXAMPLES / "panda_arm_drag_board.yaml")
    cases["arm"] = case_of_scene(arm, arm.solve(), arm.path)
    file = folder / "long_names.yaml"
    file.write_text(LONG_NAMES, encoding="utf-8")
    long = load_scene(file)
    cases["long names"] = case_of_scene(long, long.solve(), file)
    files = {name: folder / f"{name}.html" for name in cases}
    for name, case in cases.items():
        solution, bounds = case.solution, None
        with pytest.MonkeyPatch.context() as patch:
            # Their views alone are looked at; plots take most of a page's time.
            if name in ("arm", "walls"):
                patch.setattr("graspless_pin.report.html.sections._inline_svg", lambda *_, **__: "")
            elif solution.found and name != "long names":
                bounds = contact_force_bounds(solution.problem, solution.torques)
            files[name].write_text(report_html(case, bounds), encoding="utf-8")
    return files


@pytest.fixture
def opened(page: Page, reports: dict[str, Path]) -> Iterator[Opened]:
    """Open a report from disk, offline, and wait for its drawing."""
    asked: list[str] = []
    said: list[str] = []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: said.append(message.text))
    page.context.set_offline(True)

    def open_report(name: str, *, dark: bool = False, calm: bool = False) -> Page:
        page.set_viewport_size({"width": WIDTH, "height": HEIGHT})
        motion = "reduce" if calm else "no-preference"
        page.emulate_media(color_scheme="dark" if dark else "light", reduced_motion=motion)
        page.goto(reports[name].as_uri())
        page.wait_for_selector('#view[data-state="drawn"]', timeout=PATIENCE)
        return page

    yield open_report
    page.context.set_offline(False)
    assert all(url.startswith("file:") for url in asked), asked
    assert len(asked) == 1, "the page alone"
    # What a screenshot of a drawing costs is the driver's remark, not the page's.
    assert [text for text in said if "GPU stall due to ReadPixels" not in text] == []


def box_of(page: Page, what: str) -> Any:
    box = page.locator(what).bounding_box()
    assert box is not None
    return box


def drawing(page: Page) -> Pixels:
    """The pixels of the 3-D view, labels and all."""
    page.evaluate("() => new Promise((done) => requestAnimationFrame(() => setTimeout(done, 50)))")
    image = Image.open(io.BytesIO(page.locator("#view .stage").screenshot(scale="css")))
    return np.asarray(image.convert("RGB")).astype(np.int16)


def roles_of(page: Page) -> list[str]:
    """What can be switched off."""
    boxes = page.locator("#view input[type=checkbox]").all()
    return [box.get_attribute("value") or "" for box in boxes]


def show_only(page: Page, *roles: str) -> None:
    for box in page.locator("#view input[type=checkbox]").all():
        box.set_checked(box.get_attribute("value") in roles)


def rgb(color: str) -> NDArray[np.int16]:
    return np.array(list(bytes.fromhex(color.removeprefix("#"))), dtype=np.int16)


def of_hue(pixels: Pixels, color: str) -> NDArray[np.bool_]:
    """Pixels of a colour, lit anyhow."""
    wanted = rgb(color).astype(float)
    given = pixels.astype(float)
    lengths = np.linalg.norm(given, axis=2) * np.linalg.norm(wanted)
    cosine = np.divide(given @ wanted, lengths, out=np.zeros_like(lengths), where=lengths > 0.0)
    return (cosine > 0.995) & (np.linalg.norm(given, axis=2) > 0.4 * np.linalg.norm(wanted))


def label_points(page: Page) -> NDArray[np.float64]:
    """(M, 2) pixels of the contacts in the view, beside which their numbers stand."""
    transforms = page.locator("#view .labels button").evaluate_all(
        "all => all.map((one) => one.dataset.at.split(' ').map(Number))"
    )
    return np.array(transforms)


@pytest.mark.parametrize(("dark", "palette"), [(False, LIGHT), (True, DARK)])
def test_the_scene_is_drawn_in_its_colours(opened: Opened, dark: bool, palette: Palette):
    page = opened("allegro", dark=dark)
    background = page.evaluate("getComputedStyle(document.body).backgroundColor")
    assert background == f"rgb({', '.join(str(part) for part in rgb(palette.background))})"
    pixels = drawing(page)
    assert len(np.unique(pixels.reshape(-1, 3), axis=0)) > 200
    for role in (Role.HAND, Role.SUPPORT, Role.NORMAL_FORCE):
        assert of_hue(pixels, palette.roles[role]).sum() > 200, role


def test_every_role_can_be_switched_off(opened: Opened):
    page = opened("allegro")
    show_only(page)
    empty = drawing(page)
    assert len(np.unique(empty[5:-5, 5:-5].reshape(-1, 3), axis=0)) == 1
    values = roles_of(page)
    assert {str(role) for role in (Role.HAND, Role.CONE, Role.VIRTUAL_SLIDING)} <= set(values)
    for value in values:
        box = page.locator(f'#view input[value="{value}"]')
        box.check()
        assert (np.abs(drawing(page) - empty).sum(axis=2) > 30).sum() > 20, value
        box.uncheck()


def test_arrows_and_cones_start_at_the_contacts(opened: Opened):
    """Drawn alone, a ball, an arrow or a cone is there where the contact's label says."""
    page = opened("allegro")
    points = label_points(page)
    assert points.shape == (7, 2)
    for role in (Role.CONTACT, Role.NORMAL_FORCE, Role.CONE):
        show_only(page, role)
        pixels = drawing(page)
        drawn = np.abs(pixels - pixels[8, 8]).sum(axis=2) > 20
        for x, y in points:
            around = drawn[round(y) - 5 : round(y) + 6, round(x) - 5 : round(x) + 6]
            assert around.any(), f"{role} at ({x:.0f}, {y:.0f})"
        # The balls are at the contacts and nowhere else.
        if role is Role.CONTACT:
            rows, columns = np.nonzero(drawn[4:-4, 4:-4])
            places = np.column_stack([columns, rows]) + 4.0
            far = np.linalg.norm(places[:, None] - points, axis=2).min(axis=1)
            assert far.max() < 12.0


def whole_inside(page: Page) -> NDArray[np.bool_]:
    """What is drawn, of which nothing reaches the rim of the view."""
    pixels = drawing(page)
    inner = (np.abs(pixels - pixels[8, 8]).sum(axis=2) > 20)[4:-4, 4:-4]
    assert not inner[[0, -1]].any() and not inner[:, [0, -1]].any()
    return inner


def test_fit_shows_contacts_rather_than_the_arm(opened: Opened):
    """Object, table and forces are whole inside the view; most of the arm is not."""
    page = opened("arm")
    box = box_of(page, "#view .stage")
    points = label_points(page)
    assert np.ptp(points[:, 1]) > 0.33 * box["height"]
    show_only(page, Role.OBJECT, Role.SUPPORT, Role.NORMAL_FORCE, Role.FRICTION_FORCE)
    whole_inside(page)


def test_numbers_stand_apart_and_lines_lead_to_their_contacts(opened: Opened):
    """Also where eight contacts lie close together."""
    page = opened("arm")
    points = label_points(page)
    lines = np.array(
        page.locator("#view .leaders line").evaluate_all(
            "all => all.map((one) => ['x1', 'y1', 'x2', 'y2'].map((end) => one[end].baseVal.value))"
        )
    )
    np.testing.assert_allclose(lines[:, :2], points, atol=0.1)
    numbers = page.locator("#view .labels button").evaluate_all(
        "all => all.map((one) => { const box = one.getBoundingClientRect(), "
        "around = one.parentNode.getBoundingClientRect(); "
        "return [box.x + box.width / 2 - around.x, box.y + box.height / 2 - around.y, "
        "box.height]; })"
    )
    *middles, heights = np.array(numbers).T
    np.testing.assert_allclose(lines[:, 2:], np.transpose(middles), atol=1.0)
    apart = np.linalg.norm(lines[:, None, 2:] - lines[:, 2:], axis=2)
    assert apart[~np.eye(len(apart), dtype=bool)].min() >= heights.max()
    page.locator("#view").get_by_role("checkbox", name="contact numbers").uncheck()
    drawing(page)
    expect(page.locator("#view .leaders line").first).to_be_hidden()


def test_pointer_and_keys_turn_move_and_zoom(opened: Opened):
    page = opened("allegro")
    first = label_points(page)
    canvas, box = page.locator("#view canvas"), box_of(page, "#view canvas")
    x, y = box["x"] + 300, box["y"] + 60
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + 60, y + 20, steps=3)
    page.mouse.up()
    drawing(page)
    turned = label_points(page)
    assert np.abs(turned - first).max() > 20.0
    canvas.press("Home")
    drawing(page)
    np.testing.assert_allclose(label_points(page), first, atol=0.1)
    canvas.press("Shift+ArrowRight")
    drawing(page)
    shift = label_points(page) - first
    assert shift[:, 0].max() < -10.0 and np.abs(shift[:, 1]).max() < 3.0
    page.get_by_role("button", name="Fit").click()
    page.get_by_role("button", name="Closer").press("Enter")
    drawing(page)
    spread = np.ptp(label_points(page), axis=0) / np.ptp(first, axis=0)
    assert (spread > 1.15).all()
    canvas.focus()
    page.mouse.move(x, y)
    page.mouse.wheel(0, 200)
    drawing(page)
    assert (np.ptp(label_points(page), axis=0) < spread * np.ptp(first, axis=0)).all()


@pytest.mark.parametrize(
    ("name", "dark"),
    [
        ("allegro", False),
        ("infeasible", False),
        ("arrays", True),
        ("walls", True),
        ("long names", False),
    ],
)
def test_a_page_is_accessible_and_nothing_is_cut_off(opened: Opened, name: str, dark: bool):
    """At first sight hand, object, slope and arrows are whole inside the view, and fill it."""
    page = opened(name, dark=dark)
    assert serious_violations(page) == []
    if name in ("allegro", "infeasible", "long names"):
        hidden = ("labels", *HIDDEN_AT_FIRST)
        show_only(page, *(value for value in roles_of(page) if value not in hidden))
        drawn = whole_inside(page)
        assert np.ptp(np.flatnonzero(drawn.any(axis=1))) > 0.7 * len(drawn)
    for width in (WIDTH, 390):
        page.set_viewport_size({"width": width, "height": HEIGHT})
        assert_nothing_is_cut_off(page, name, width)


def assert_nothing_is_cut_off(page: Page, name: str, width: int) -> None:
    assert page.evaluate("document.documentElement.scrollWidth") <= width
    spilling = page.locator(".tiles > div, .tiles dd, .controls, .controls *").evaluate_all(
        "all => all.filter((one) => one.clientWidth && one.scrollWidth > one.clientWidth + 1)"
        ".map((one) => one.outerHTML.slice(0, 80))"
    )
    assert spilling == []
    # Wide tables scroll in themselves, but not at the width of a screen.
    if width == WIDTH and name != "long names":
        cut = page.locator(".scroll").evaluate_all(
            "items => items.filter((item) => item.scrollWidth > item.clientWidth).length"
        )
        assert cut == 0
    hidden = page.locator("svg text").evaluate_all(
        "texts => texts.filter((text) => { const t = text.getBoundingClientRect(), "
        "s = text.closest('figure').getBoundingClientRect(); "
        "return t.left < s.left - 1 || t.right > s.right + 1 || t.bottom > s.bottom + 1; })"
        ".map((text) => text.textContent)"
    )
    assert hidden == []


def test_all_is_reached_by_the_keyboard(opened: Opened):
    page = opened("allegro")
    reached = []
    for _ in range(60):
        page.keyboard.press("Tab")
        reached.append(
            page.evaluate(
                "[document.activeElement.tagName, document.activeElement.textContent.trim(), "
                "document.activeElement.getAttribute('aria-label')]"
            )
        )
    assert reached[0][1] == "Skip to the answer"
    tags = [tag for tag, _, _ in reached]
    assert {"A", "CANVAS", "INPUT", "BUTTON"} <= set(tags)
    labels = {label for _, _, label in reached}
    assert {"Contacts, table", "Force ranges, table", "Command"} <= labels


def test_what_matters_is_on_the_first_screen(opened: Opened):
    """The worst case is as large as the best, the torque has its unit, and limits are sentences."""
    page = opened("allegro")
    expect(page.get_by_text("margin e at best", exact=True)).to_be_in_viewport()
    box = box_of(page, "#view canvas")
    assert box["y"] < 0.5 * HEIGHT
    tiles = page.locator(".tiles > div")
    names = [tile.locator("dt").inner_text() for tile in tiles.all()[:3]]
    assert names == ["margin e at best", "margin e at worst", "largest |torque|"]
    figures = [tile.locator("dd") for tile in tiles.all()[:3]]
    words = [figure.inner_text().split("\n")[0] for figure in figures]
    assert words == ["0.7437 N", "0 N", "0.1489 N m"]
    sizes = {figure.evaluate("one => getComputedStyle(one).fontSize") for figure in figures}
    assert len(sizes) == 1
    for sentence in (
        "The margin is limited by available friction at contacts 3, 6 (slope).",
        "Joint joint_1.0 is nearest its limit: +0.1489 of +0.7 N m, 21.3 %.",
    ):
        expect(page.get_by_text(sentence)).to_be_in_viewport()
    # The wheel scrolls the page until the view is used.
    page.mouse.move(400, 600)
    page.mouse.wheel(0, 300)
    expect(page.get_by_role("heading", level=1)).not_to_be_in_viewport()


def test_the_view_says_what_it_shows(opened: Opened):
    """Axes, gravity, scale, fingers, and each contact's figures: pointed at and by the keyboard."""
    page = opened("allegro")
    stage = page.locator("#view .stage")
    letters = stage.locator(".labels span")
    texts = letters.all_inner_texts()
    assert texts == ["x", "y", "z", "g", "1.5 N"]
    for letter in letters.all():
        expect(letter).to_be_in_viewport()
    expect(stage.get_by_text("Forces: 1 cm = 0.3 N")).to_be_visible()
    fingers = page.locator("#view .fingers li").all_inner_texts()
    assert [text.strip() for text in fingers] == ["index", "middle", "ring", "thumb"]
    numbers = stage.get_by_role("button")
    rows = page.locator("section[aria-labelledby=contacts] tbody th").all_inner_texts()
    assert numbers.all_inner_texts() == rows == [str(index) for index in range(7)]
    tip = page.locator("#view .tip")
    expect(tip).to_be_hidden()
    box = box_of(page, "#view .stage")
    x, y = label_points(page)[3]
    page.mouse.move(box["x"] + x + 2, box["y"] + y + 2)
    expect(tip).to_be_visible()
    told = tip.inner_text().split("\n")
    assert told[0] == "contact 3: slope"
    assert told[1] == "normal force 2.2610 N"
    assert "of what μ = 0.35 allows (sticking)" in told[2]
    assert told[3] == "0.7437 N from slipping, which limits the margin"
    page.mouse.move(box["x"] + 3, box["y"] + 3)
    expect(tip).to_be_hidden()
    page.locator("#view canvas").focus()
    page.keyboard.press("Tab")
    expect(tip).to_contain_text("contact 0: link_3.0_tip")
    page.keyboard.press("ArrowLeft")
    expect(tip).to_contain_text("contact 6: slope")
    page.keyboard.press("Escape")
    expect(tip).to_be_hidden()


def test_no_view_loses_the_scene_nor_goes_below_the_slope(opened: Opened):
    """Presets and far drags: the forces stay in sight, and the slope hides none of them."""
    page = opened("allegro")
    box = box_of(page, "#view canvas")
    blue = LIGHT.roles[Role.NORMAL_FORCE]
    show_only(page, Role.SUPPORT, Role.NORMAL_FORCE)

    def in_sight() -> bool:
        points = label_points(page)
        inside = (points > 0.0) & (points < [box["width"], box["height"]])
        return bool(inside.all()) and of_hue(drawing(page), blue).sum() > 300

    for name in ("Front", "Side", "Top", "Fit"):
        page.get_by_role("button", name=name, exact=True).click()
        drawing(page)
        assert in_sight(), name
    for right in (150, 400, 400):
        page.mouse.move(box["x"] + 450, box["y"] + 200)
        page.mouse.down()
        page.mouse.move(box["x"] + 450 + right, box["y"] - 600, steps=4)
        page.mouse.up()
        drawing(page)
        assert in_sight(), right


@pytest.mark.parametrize("calm", [False, True])
def test_virtual_sliding_is_played_when_it_is_asked_for(opened: Opened, calm: bool):
    page = opened("allegro", calm=calm)
    view = page.locator("#view")
    before = label_points(page)
    page.wait_for_timeout(150)
    assert view.get_attribute("data-share") == "0.000"
    view.get_by_role("slider").fill("1")
    drawing(page)
    assert np.abs(label_points(page) - before).max() > 3.0
    view.get_by_role("slider").fill("0")
    view.get_by_role("button", name="Play").click()
    page.wait_for_function("() => document.getElementById('view').dataset.share > 0")


def share(page: Page) -> float:
    """How much of the motion the view shows."""
    return float(page.locator("#motion-view").get_attribute("data-share") or "nan")


def number_below(page: Page) -> float:
    """Where the lowest contact's number is in the view of the motion, px."""
    places = page.locator("#motion-view .labels button").evaluate_all(
        "all => all.map((one) => Number(one.dataset.at.split(' ')[1]))"
    )
    return max(places)


def test_a_motion_is_played_until_the_reader_stops_it(opened: Opened):
    page = opened("walls")
    button = page.locator("#motion-view").get_by_role("button", name="Pause")
    button.scroll_into_view_if_needed()
    before = share(page)
    page.wait_for_function(
        "(before) => document.getElementById('motion-view').dataset.share != before",
        arg=f"{before:.3f}",
        timeout=PATIENCE,
    )
    button.click()
    stopped = share(page)
    page.wait_for_timeout(200)
    assert share(page) == stopped
    slider = page.locator("#motion-view input[type=range]")
    slider.fill("0")
    drawing(page)
    first = number_below(page)
    slider.fill("1")
    drawing(page)
    assert share(page) == 1.0
    assert number_below(page) > first + 10.0, "the box goes down"
    assert page.locator("#view").get_attribute("data-share") == "0.000", "not asked for"
    page.locator("#motion-view").get_by_role("button", name="Play").click()
    page.wait_for_function(
        "() => document.getElementById('motion-view').dataset.share < 0.9", timeout=PATIENCE
    )


def test_who_wants_little_motion_sees_its_end_and_no_motion(opened: Opened):
    page = opened("walls", calm=True)
    page.wait_for_selector('#motion-view[data-state="drawn"]', timeout=PATIENCE)
    page.locator("#motion-view").scroll_into_view_if_needed()
    expect(page.locator("#motion-view").get_by_role("button", name="Play")).to_be_visible()
    page.wait_for_timeout(200)
    assert share(page) == 1.0


def test_without_webgl_the_page_says_so(page: Page, reports: dict[str, Path]):
    page.add_init_script("HTMLCanvasElement.prototype.getContext = () => null")
    page.goto(reports["allegro"].as_uri())
    page.wait_for_selector('#view[data-state="unavailable"]', timeout=PATIENCE)
    expect(page.get_by_text("offers no WebGL 2")).to_be_visible()
    expect(page.locator("#view canvas")).to_be_hidden()
