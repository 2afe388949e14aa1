"""The documentation site builds without a warning, has no dead link and fetches nothing."""

import re
import tomllib
from functools import cache
from html.parser import HTMLParser
from pathlib import Path
from urllib.parse import unquote, urlsplit

import pytest
from api import listed
from markdown.extensions.toc import slugify
from page_blocks import PAGES, ROOT, prose_of

FETCHED = {"script": "src", "link": "href", "img": "src", "iframe": "src", "source": "src"}
LINK = re.compile(r"\]\(([^)\s]+)\)")
OUTSIDE = ("http", "https", "mailto")
DOCS = ROOT / "docs"
API = listed((DOCS / "api.md").read_text(encoding="utf-8"))
"""What is put into the pages of the API where the site is built."""


class Page(HTMLParser):
    """What one page of the site names, links to and fetches."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.anchors: set[str] = set()
        self.links: list[str] = []
        self.fetched: list[str] = []
        self.feed(text)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        values = {name: value or "" for name, value in attrs}
        self.anchors |= {values[name] for name in ("id", "name") if name in values}
        if tag == "a" and "href" in values:
            self.links.append(values["href"])
        if tag in FETCHED and FETCHED[tag] in values:
            self.fetched.append(values[FETCHED[tag]])


@cache
def page(file: Path) -> Page:
    return Page(file.read_text(encoding="utf-8"))


def dead_links(folder: Path) -> list[str]:
    """Links of a built site that lead to no page, file or anchor of it."""
    dead = []
    for file in sorted(folder.rglob("*.html")):
        for link in page(file).links + page(file).fetched:
            parts = urlsplit(link)
            if parts.scheme in OUTSIDE:
                continue
            start = folder if parts.path.startswith("/") else file.parent
            target = (start / unquote(parts.path).lstrip("/")) if parts.path else file
            if target.is_dir():
                target = target / "index.html"
            anchor = unquote(parts.fragment) if target.suffix == ".html" else ""
            if not target.is_file() or (anchor and anchor not in page(target).anchors):
                dead.append(f"{file.relative_to(folder)}: {link}")
    return dead


def test_no_link_of_the_site_is_dead(site):
    assert len(page(site / "index.html").links) > len(PAGES)
    assert dead_links(site) == []


def test_a_dead_link_would_be_found(tmp_path):
    (tmp_path / "index.html").write_text(
        '<h1 id="here"></h1><a href="#here"><a href="#gone"><a href="gone/"><a href="index.html">'
    )
    assert dead_links(tmp_path) == ["index.html: #gone", "index.html: gone/"]


def test_site_fetches_nothing_from_elsewhere(site):
    for file in sorted(site.rglob("*.html")):
        assert [url for url in page(file).fetched if urlsplit(url).netloc] == []
    for file in sorted(site.rglob("*.css")):
        found = re.findall(r"(?:url\(|@import)\s*[\"']?(?:https?:)?//", file.read_text("utf-8"))
        assert found == [], file


@pytest.mark.parametrize("file", PAGES, ids=lambda file: file.name)
def test_links_of_the_sources_exist(file):
    """The README is no part of the site, and pages are read in the repository, too."""
    for link in LINK.findall(prose_of(file)):
        parts = urlsplit(link)
        if parts.scheme in OUTSIDE:
            continue
        target = file.parent / parts.path if parts.path else file
        assert target.exists(), link
        if parts.fragment:
            headings = re.findall(r"^#+ (.+)$", prose_of(target), re.MULTILINE)
            names = {name for _, page_of_it, name in API if target == DOCS / f"api/{page_of_it}.md"}
            known = {slugify(heading, "-") for heading in headings} | names
            assert parts.fragment in known, link


def test_version_changelog_and_citation_are_of_one_version():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    citation = (ROOT / "CITATION.cff").read_text(encoding="utf-8")
    assert f"\nversion: {project['version']}\n" in citation
    newest = re.search(r"^## (\S+)", (ROOT / "CHANGELOG.md").read_text(encoding="utf-8"), re.M)
    assert newest is not None
    assert f"{project['version']}.".startswith(f"{newest[1]}.")
