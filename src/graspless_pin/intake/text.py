"""What may stand in texts: no control characters, no halves of characters, no endless names."""

from __future__ import annotations

import re

from graspless_pin.bounds import LONGEST_NAME

_BEGINNING = 30  # characters of a name that a message shows
_UNPRINTABLE = re.compile("[\x00-\x08\x0b\x0c\x0e-\x1f\x7f-\x9f\ud800-\udfff]")


def bad_character(text: str) -> str | None:
    """Return the code of the first character that no text may have, such as ``U+D800``, or None.

    Terminals obey control characters, and no file takes half of a surrogate pair.
    """
    found = _UNPRINTABLE.search(text)
    return f"U+{ord(found[0]):04X}" if found else None


def fault_of_name(name: str) -> str:
    """Return what is wrong with a name that is too long, with its beginning; empty: nothing is."""
    if len(name) <= LONGEST_NAME:
        return ""
    return (
        f"has the name {name[:_BEGINNING]!r}... of {len(name)} characters; a name may have at most "
        f"{LONGEST_NAME}"
    )


def printable(text: str) -> str:
    """Return the text with all such characters written as their codes."""
    return _UNPRINTABLE.sub(lambda found: f"<U+{ord(found[0]):04X}>", text)
