"""A real Chromium for the pages: headless, an empty profile, nothing fetched from outside."""

from __future__ import annotations

import shutil
from collections.abc import Iterator
from pathlib import Path
from urllib.parse import urlsplit

import pytest
from playwright.sync_api import BrowserContext, Page, Route, expect, sync_playwright

CHROMIUM = Path("/usr/bin/chromium")
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
)
LOOPBACK = ("127.0.0.1", "localhost", "::1")
# Without a graphics card a page that draws sixty times a second takes all cores there are.
SLOWER_FRAMES = """
  window.requestAnimationFrame = (draw) => setTimeout(() => draw(performance.now()), 250);
  window.cancelAnimationFrame = clearTimeout;
"""
PATIENCE = 120_000  # ms; a busy machine is no defect
LOCAL_SCHEMES = ("file", "data", "blob", "about")


@pytest.fixture(scope="module")
def chromium(tmp_path_factory: pytest.TempPathFactory) -> Iterator[BrowserContext]:
    """One browser for the tests of a module, at 1280 x 800, of which every other pixel is drawn.

    Not longer: while playwright runs, its event loop counts as running for all other tests.
    """
    if not CHROMIUM.is_file():
        pytest.skip(
            f"NO CHROMIUM at {CHROMIUM}: THE PAGES ARE NOT TESTED. Run "
            "tests/browser/install_chromium.sh as root."
        )
    profile = tmp_path_factory.mktemp("chromium")
    with sync_playwright() as playwright:
        context = playwright.chromium.launch_persistent_context(
            profile,
            executable_path=CHROMIUM,
            args=FLAGS,
            viewport={"width": 1280, "height": 800},
            device_scale_factor=0.5,
        )
        context.set_default_timeout(PATIENCE)
        expect.set_options(timeout=PATIENCE)
        context.add_init_script(SLOWER_FRAMES)
        yield context
        context.close()
    shutil.rmtree(profile, ignore_errors=True)


@pytest.fixture
def page(chromium: BrowserContext) -> Iterator[Page]:
    """A new page that reaches this machine only; asking for anything else fails the test."""
    outside: list[str] = []
    faults: list[str] = []

    def guard(route: Route) -> None:
        address = urlsplit(route.request.url)
        if address.scheme in LOCAL_SCHEMES or address.hostname in LOOPBACK:
            route.continue_()
        else:
            outside.append(route.request.url)
            route.abort()

    opened = chromium.new_page()
    opened.route("**/*", guard)
    opened.on("pageerror", lambda error: faults.append(str(error)))
    yield opened
    opened.close()
    assert outside == [], "the page asked for something from outside"
    assert faults == [], "the page's own scripts failed"
