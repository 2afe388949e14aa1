"""XML with bounds: no declarations, few levels, not too many elements."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

from graspless_pin.errors import TextError

DEEPEST_XML = 100
"""More levels than any file has; further ones cost stack in whatever reads them."""
MOST_ELEMENTS = 200_000
"""More elements than any file has."""


def check_xml(content: bytes) -> None:
    """Check XML without expanding anything.

    Raises:
        TextError: It is not well-formed, declares a DOCTYPE or entities, is nested more than 100
            levels deep or has more than 200 000 elements.
    """
    depth = count = 0

    def refuse(*_: object) -> None:
        raise TextError(
            "the file declares a DOCTYPE or XML entities; it needs neither, remove the declaration"
        )

    def begin(*_: object) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > DEEPEST_XML:
            raise TextError(f"is nested too deeply; at most {DEEPEST_XML} levels are possible")
        if count > MOST_ELEMENTS:
            raise TextError(f"has more than {MOST_ELEMENTS} elements, the most that is possible")

    def end(_: object) -> None:
        nonlocal depth
        depth -= 1

    scanner = expat.ParserCreate()
    scanner.StartDoctypeDeclHandler = refuse
    scanner.EntityDeclHandler = refuse
    scanner.StartElementHandler = begin
    scanner.EndElementHandler = end
    try:
        scanner.Parse(content, True)  # noqa: FBT003 - final, a positional-only flag
    except (expat.ExpatError, ValueError, LookupError) as error:
        # An encoding that Python does not know, or not as one for XML, is no ExpatError.
        raise TextError(f"not well-formed XML ({error})") from error


def parse_xml(content: bytes) -> ET.Element:
    """Return the root element of XML that `check_xml` passes.

    Raises:
        TextError: See `check_xml`.
    """
    check_xml(content)
    try:
        return ET.fromstring(content)  # noqa: S314 - declarations were refused above
    except (ET.ParseError, ValueError, LookupError) as error:
        raise TextError(f"not well-formed XML ({error})") from error
