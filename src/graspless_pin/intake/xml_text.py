"""XML with bounds: no declarations, few levels, not too many elements."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from xml.parsers import expat

from graspless_pin.errors import TextError

DEEPEST_XML = 100
"""More levels than any file has; further ones cost stack in whatever reads them."""
MOST_ELEMENTS = 200_000
"""More elements than any file has."""


def parse_xml(content: bytes) -> ET.Element:
    """Return the root element of XML without expanding anything.

    Prefixes stay part of the names (``drake:rotor_inertia``), whether they are declared or not:
    readers of URDFs do not look for their declaration, so that many files have none.

    Raises:
        TextError: It is empty, not well-formed, declares a DOCTYPE or entities, is nested more than
            100 levels deep or has more than 200 000 elements.
    """
    if not content.strip():
        raise TextError("is empty; give the file that was meant, or export it again")
    builder = ET.TreeBuilder()
    depth = count = 0

    def refuse(*_: object) -> None:
        raise TextError(
            "the file declares a DOCTYPE or XML entities; it needs neither, remove the declaration"
        )

    def begin(name: str, attributes: dict[str, str]) -> None:
        nonlocal depth, count
        depth, count = depth + 1, count + 1
        if depth > DEEPEST_XML:
            raise TextError(f"is nested too deeply; at most {DEEPEST_XML} levels are possible")
        if count > MOST_ELEMENTS:
            raise TextError(f"has more than {MOST_ELEMENTS} elements, the most that is possible")
        builder.start(name, attributes)

    def end(name: str) -> None:
        nonlocal depth
        depth -= 1
        builder.end(name)

    reader = expat.ParserCreate()
    reader.buffer_text = True
    reader.StartDoctypeDeclHandler = refuse
    reader.EntityDeclHandler = refuse
    reader.StartElementHandler = begin
    reader.EndElementHandler = end
    reader.CharacterDataHandler = builder.data
    try:
        reader.Parse(content, True)  # noqa: FBT003 - final, a positional-only flag
    except (expat.ExpatError, ValueError, LookupError) as error:
        # An encoding that Python does not know, or not as one for XML, is no ExpatError.
        raise TextError(f"not well-formed XML ({error})") from error
    return builder.close()
