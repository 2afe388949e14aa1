"""The pages of the API: each is its introduction, and the names that the index lists for it."""

from __future__ import annotations

import re
from pathlib import Path, PurePosixPath

from mkdocs.config.defaults import MkDocsConfig
from mkdocs.structure.files import Files
from mkdocs.structure.pages import Page

_ENTRY = re.compile(r"\[`([\w.]+)`\]\(api/(\w+)\.md#(graspless_pin\.[\w.]+)\)")


def listed(index: str) -> list[tuple[str, str, str]]:
    """Return the name as it is shown, the page and the full name of each entry of the index."""
    return _ENTRY.findall(index)


def with_names(introduction: str, page: str, index: str) -> str:
    """Return a page as Markdown: its introduction, and its names in the order of the index."""
    names = [name for _, its_page, name in listed(index) if its_page == page]
    return "\n\n".join([introduction.rstrip(), *(f"::: {name}" for name in names), ""])


def on_page_markdown(markdown: str, page: Page, config: MkDocsConfig, files: Files) -> str | None:
    """Add the names to a page of the API."""
    del files
    place = PurePosixPath(page.file.src_uri)
    if place.parent.name != "api":
        return None
    index = Path(config.docs_dir, "api.md").read_text(encoding="utf-8")
    return with_names(markdown, place.stem, index)
