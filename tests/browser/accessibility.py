"""What axe-core finds on a page."""

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page


def serious_violations(page: Page) -> list[tuple[str, str]]:
    """The rule and the first element of each violation that is serious or critical."""
    return [
        (item["id"], item["nodes"][0]["html"])
        for item in Axe().run(page).response["violations"]
        if item["impact"] in ("serious", "critical")
    ]
