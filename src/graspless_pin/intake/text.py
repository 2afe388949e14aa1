"""What may stand in a text that is printed: no control characters, no halves of characters."""

from __future__ import annotations

import re

_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


def bad_character(text: str) -> str | None:
    """Return the code of the first character that no text may have, such as ``U+D800``, or None.

    Terminals obey control characters, and no file takes half of a surrogate pair.
    """
    found = _UNPRINTABLE.search(text)
    return f"U+{ord(found[0]):04X}" if found else None


def printable(text: str) -> str:
    """Return the text with all such characters written as their codes."""
    return _UNPRINTABLE.sub(lambda found: f"<U+{ord(found[0]):04X}>", text)
