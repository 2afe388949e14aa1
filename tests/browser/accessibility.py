"""What axe-core finds on a page."""

from axe_playwright_python.sync_playwright import Axe
from playwright.sync_api import Page


def serious_violations(page: Page, *rules: str) -> list[tuple[str, str]]:
    """The rule and the first element of each violation that is serious or critical.

    Of all rules that axe-core has, or of those that are named.
    """
    options = {"resultTypes": ["violations"]} | ({"runOnly": list(rules)} if rules else {})
    return [
        (item["id"], item["nodes"][0]["html"])
        for item in Axe().run(page, options=options).response["violations"]
        if item["impact"] in ("serious", "critical")
    ]
