"""The documentation site in a real browser: both modes, nothing cut off, nothing fetched."""

from __future__ import annotations

import re
from pathlib import Path

import pytest
from accessibility import serious_violations
from playwright.sync_api import Page

DOCS = Path(__file__).resolve().parents[2] / "docs"
WIDTH = 1280
BACKGROUND = "getComputedStyle(document.body).backgroundColor"


def test_the_site_follows_the_reader_into_the_dark_and_back(page: Page, site: Path):
    shades = []
    for scheme in ("light", "dark", "light"):
        page.emulate_media(color_scheme=scheme)
        page.goto((site / "index.html").as_uri())
        shades.append(page.evaluate(BACKGROUND))
    assert shades[0] == shades[2] == "rgb(255, 255, 255)"
    dark = [int(part) for part in shades[1].removeprefix("rgb(").removesuffix(")").split(",")]
    assert max(dark) < 60
    page.get_by_title("Switch to the light page").click()
    page.get_by_title("Switch to the dark page").click()
    assert page.evaluate(BACKGROUND) == shades[1]
    page.get_by_title("Follow the system").click()


@pytest.mark.parametrize("part", range(4))
def test_tables_and_pages_fit_the_screen(page: Page, site: Path, part: int):
    """Printed output and code may scroll in themselves."""
    page.set_viewport_size({"width": WIDTH, "height": 800})
    files = [file for file in sorted(site.rglob("*.html")) if file.name != "404.html"]
    assert len(files) > 35
    for file in files[part::4]:
        page.goto(file.as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= WIDTH, file
        wide = page.locator(".md-typeset__scrollwrap").evaluate_all(
            "items => items.filter((item) => item.scrollWidth > item.clientWidth + 1).length"
        )
        assert wide == 0, file
        smallest = page.locator("pre > code").evaluate_all(
            "items => Math.min(99, ...items.map((i) => parseFloat(getComputedStyle(i).fontSize)))"
        )
        assert smallest >= 12.0, file


@pytest.mark.parametrize("name", ["first_steps", "install", "viewer"])
def test_the_copy_buttons_copy_commands_and_nothing_else(page: Page, site: Path, name):
    source = (DOCS / f"{name}.md").read_text(encoding="utf-8")
    blocks = re.findall(r"^```console\n(.*?)^```$", source, re.DOTALL | re.MULTILINE)
    page.goto((site / name / "index.html").as_uri())
    page.evaluate("document.body.append(document.createElement('textarea'))")
    shown = page.locator("pre:has(.gp)")
    assert shown.count() == len(blocks) > 0
    for index, block in enumerate(blocks):
        # The button appears once its block is pointed at.
        shown.nth(index).hover()
        shown.nth(index).locator("xpath=..").get_by_title("Copy to clipboard").click()
        page.locator("textarea").last.fill("")
        page.locator("textarea").last.press("Control+V")
        lines = [line[2:] for line in block.splitlines() if line.startswith("$ ")]
        commands = [re.sub(r"\s+# .*", "", line) for line in lines]
        assert page.locator("textarea").last.input_value() == "\n".join(commands)


# In the light by all rules of axe-core; in the dark by that of contrast, which colours change.
LOOKED_AT = {
    "light": (".", "keys", "model", "notebook_paper_figures"),
    "dark": (".", "model", "notebook_paper_figures"),
}


@pytest.mark.parametrize("scheme", LOOKED_AT)
def test_pages_are_accessible_and_show_their_pictures(page: Page, site: Path, scheme):
    page.emulate_media(color_scheme=scheme)
    page.set_viewport_size({"width": 390, "height": 844})
    for name in LOOKED_AT[scheme]:
        page.goto((site / name / "index.html").as_uri())
        assert page.evaluate("document.documentElement.scrollWidth") <= 390, name
        assert serious_violations(page, *(["color-contrast"] * (scheme == "dark"))) == [], name
        shown = page.locator(".md-content img").evaluate_all(
            "items => items.filter((item) => getComputedStyle(item).display !== 'none')"
            ".map((item) => [item.getAttribute('src'), item.naturalWidth])"
        )
        assert all(width > 300 for _, width in shown), name
        other = "dark" if scheme == "light" else "light"
        assert not [source for source, _ in shown if source.endswith(f"only-{other}")], name
        assert shown or name == "keys"
