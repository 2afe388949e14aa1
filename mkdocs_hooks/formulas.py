r"""Formulas of the documentation as MathML, which browsers set without a script.

Pages write them as GitHub reads them, too: ``$\mu f_n$`` in a line, ``$$ ... $$`` on lines of their
own.
"""

from __future__ import annotations

import html
import re

from latex2mathml.converter import convert
from mkdocs.exceptions import PluginError
from mkdocs.structure.pages import Page

_FORMULA = re.compile(
    r'<(?P<tag>span|div) class="arithmatex">\\(?P<open>[(\[])(?P<tex>.*?)\\[)\]]</(?P=tag)>', re.S
)


def on_page_content(content: str, page: Page, **_: object) -> str:
    """Set each formula of a page."""
    try:
        return _FORMULA.sub(_set, content)
    except Exception as error:
        raise PluginError(f"{page.file.src_uri}: a formula cannot be set: {error!r}") from error


def _set(found: re.Match[str]) -> str:
    tex = html.unescape(found["tex"]).strip()
    mathml = convert(tex, display="block" if found["open"] == "[" else "inline")
    if found["open"] == "(":
        return mathml
    return f'<div class="formula" tabindex="0" role="group" aria-label="formula">{mathml}</div>'
