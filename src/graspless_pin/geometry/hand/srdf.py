"""Which links may be in each other, as the SRDF that stands beside a URDF says."""

from __future__ import annotations

from pathlib import Path

from graspless_pin.errors import RobotError
from graspless_pin.findings import Finding, FindingCode, tell
from graspless_pin.intake.files import FileKind, errors_of_text, is_file, read_bytes
from graspless_pin.intake.xml_text import parse_xml

_SRDF = FileKind("SRDF", 16, RobotError)


def disabled_pairs(urdf: Path, prefix: str = "") -> frozenset[frozenset[str]]:
    """Return the pairs of links between which an SRDF disables collisions.

    The SRDF has the URDF's name and stands beside it, or in the folder ``srdf`` beside its folder.
    None of the answers about a hand but its overlaps depends on it: one that cannot be read is
    told, and left out.

    Args:
        urdf: The URDF's file.
        prefix: Put before the name of every link.

    Warns:
        GrasplessPinWarning: If it cannot be read.
    """
    own = f"{urdf.stem}.srdf"
    for file in (urdf.with_name(own), urdf.parent.parent / "srdf" / own):
        if is_file(file):
            break
    else:
        return frozenset()
    try:
        with errors_of_text(file, _SRDF):
            root = parse_xml(read_bytes(file, _SRDF))
    except RobotError as error:
        tell(
            Finding(
                FindingCode.READER_REMARK,
                urdf.stem,
                str(error),
                "until it can be read, the pairs of links that it disables count as overlaps",
            )
        )
        return frozenset()
    return frozenset(
        frozenset((prefix + one.get("link1", ""), prefix + one.get("link2", "")))
        for one in root.findall("disable_collisions")
    )
