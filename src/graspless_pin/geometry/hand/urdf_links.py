"""Check the links of a URDF: what Pinocchio's parser drops in silence is an error here."""

from __future__ import annotations

import xml.etree.ElementTree as ET
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from graspless_pin.bounds import LARGEST_LENGTH
from graspless_pin.errors import MeshError, RobotError
from graspless_pin.findings import Finding, FindingCode, emit
from graspless_pin.intake.files import is_file

_DIMENSIONS = {
    "box": (("size", 3),),
    "sphere": (("radius", 1),),
    "cylinder": (("radius", 1), ("length", 1)),
    "capsule": (("radius", 1), ("length", 1)),
}
_PLACES = 3
"""That a message names, of those where a mesh was looked for."""


@dataclass(frozen=True)
class LinkMesh:
    """A mesh among the collision shapes of a link.

    Attributes:
        link: The link.
        index: Its place among the link's collision shapes.
        file: The mesh file.
        scale: Metres per unit of the file along x, y, z.
    """

    link: str
    index: int
    file: Path
    scale: tuple[float, float, float]

    @property
    def name(self) -> str:
        """What Pinocchio calls the shape."""
        return shape_name(self.link, self.index)


def shape_name(link: str, index: int) -> str:
    """Return what Pinocchio calls a collision shape of a link."""
    return f"{link}_{index}"


def check_link(
    path: Path, link: ET.Element, package_dirs: Sequence[Path]
) -> tuple[list[LinkMesh], list[str]]:
    """Check one link's collision shapes and mass, and replace those that Pinocchio cannot read.

    Its reader of meshes opens what files name and crashes on some that are broken, and it drops
    capsules: it gets boxes and cylinders, which `link_shapes` replaces.

    Args:
        path: The URDF file.
        link: The ``<link>`` element, changed in place.
        package_dirs: Where ``package://`` addresses are looked up.

    Returns:
        The meshes among its collision shapes, and what Pinocchio calls the capsules.

    Raises:
        RobotError: If a shape, pose or mass is malformed.
        MeshError: If a mesh cannot be found.

    Warns:
        GrasplessPinWarning: A shape of size zero is left out.
    """
    where = f"{path}: link {link.get('name')!r}"
    name = link.get("name", "")
    meshes: list[LinkMesh] = []
    capsules: list[str] = []
    index = 0  # Pinocchio counts the shapes that are left
    for collision in link.findall("collision"):
        check_origin(where, collision)
        shape = collision.find("geometry/*")
        if shape is None:
            raise RobotError(f"{where} has a <collision> without a shape in its <geometry>")
        if shape.tag == "mesh":
            x, y, z = numbers(where, "mesh scale", shape.get("scale", "1 1 1"), 3)
            if not (x and y and z):
                raise RobotError(f"{where} has a mesh scale of {shape.get('scale')!r}")
            file = _resolve_mesh(path, where, shape, package_dirs)
            meshes.append(LinkMesh(name, index, file, (x, y, z)))
            shape.tag, shape.attrib = "box", {"size": "1 1 1"}
        elif shape.tag in _DIMENSIONS:
            if not _has_size(where, shape):
                link.remove(collision)
                continue
            if shape.tag == "capsule":
                shape.tag = "cylinder"
                capsules.append(shape_name(name, index))
        else:
            known = ", ".join((*_DIMENSIONS, "mesh"))
            raise RobotError(f"{where} has the unknown shape <{shape.tag}>; known: {known}")
        index += 1
    _check_mass(where, link)
    return meshes, capsules


def _has_size(where: str, shape: ET.Element) -> bool:
    """Check the dimensions of a primitive; return whether none of them is zero, which is told."""
    for key, count in _DIMENSIONS[shape.tag]:
        what = f"{shape.tag} {key}"
        least = min(numbers(where, what, shape.get(key, ""), count))
        if least < 0.0:
            raise RobotError(f"{where} has {what}={shape.get(key)!r}, which is negative")
        if least == 0.0:
            subject = where.partition(": ")[2]
            emit(
                Finding(
                    FindingCode.EMPTY_SHAPE,
                    subject.replace("'", ""),
                    f"{where} has a {shape.tag} of {key} {shape.get(key)}, which is left out: "
                    "nothing touches it",
                    "give it a size if the link may touch the object",
                    ("hand",),
                )
            )
            return False
    return True


def checked_number(where: str, what: str, text: str, *, unlimited: bool = False) -> float:
    """Parse one number; see `numbers`."""
    return numbers(where, what, text, 1, unlimited=unlimited)[0]


def numbers(
    where: str, what: str, text: str, count: int, *, unlimited: bool = False
) -> list[float]:
    """Parse ``count`` numbers, none of them NaN and, unless they are limits, all within ±1e12."""
    try:
        values = [float(word) for word in text.split()]
    except ValueError:
        values = []
    if len(values) != count or any(value != value for value in values):
        needed = "a number" if count == 1 else f"{count} numbers"
        raise RobotError(f"{where} has {what}={text!r}, which is not {needed}")
    if not unlimited and any(abs(value) > LARGEST_LENGTH for value in values):
        raise RobotError(f"{where} has {what}={text!r}; it must be within ±{LARGEST_LENGTH:g}")
    return values


def check_origin(where: str, element: ET.Element) -> None:
    """Check the ``<origin>`` of a shape or of a mass."""
    origin = element.find("origin")
    for key, text in ({} if origin is None else origin.attrib).items():
        if key in ("xyz", "rpy"):
            numbers(where, f"{element.tag} origin {key}", text, 3)


def _check_mass(where: str, link: ET.Element) -> None:
    """Check a link's mass; without an inertia, which statics does not need, write zeros."""
    inertial = link.find("inertial")
    if inertial is None:
        return
    check_origin(where, inertial)
    mass = inertial.find("mass")
    text = "" if mass is None else mass.get("value", "")
    if checked_number(where, "mass", text) < 0.0:
        raise RobotError(f"{where} has the negative mass {text} kg")
    inertia = inertial.find("inertia")
    if inertia is None:
        inertia = ET.SubElement(inertial, "inertia")
    for key in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"):
        checked_number(where, f"inertia {key}", inertia.attrib.setdefault(key, "0"))


def _resolve_mesh(path: Path, where: str, mesh: ET.Element, package_dirs: Sequence[Path]) -> Path:
    """Return the file of a mesh."""
    written = mesh.get("filename", "")
    found, candidates = find_mesh(path, written, package_dirs)
    if found is None:
        hint = (
            "; give package_dirs, the folder that holds the package"
            if written.startswith("package://")
            else ""
        )
        raise MeshError(
            f"{where} needs the collision mesh {written!r}, which is missing "
            f"(looked for {looked_for(candidates)}){hint}"
        )
    return found


def find_mesh(
    path: Path, written: str, package_dirs: Sequence[Path]
) -> tuple[Path | None, list[Path]]:
    """Find the file that a mesh's ``filename`` means.

    Args:
        path: The URDF file.
        written: The ``filename``: a path, or an address with ``file://`` or ``package://``.
        package_dirs: Where ``package://`` addresses are looked up.

    Returns:
        The file, None if it is missing, and where it was looked for.
    """
    candidates = list(_candidates(path, written, package_dirs))
    return next((file.resolve() for file in candidates if is_file(file)), None), candidates


def looked_for(candidates: Sequence[Path]) -> str:
    """Return where a mesh was looked for, in words: the likeliest places."""
    more = len(candidates) - _PLACES
    places = ", ".join(str(file) for file in candidates[:_PLACES]) or "nowhere"
    return places if more <= 0 else f"{places} and {more} more places"


def _candidates(path: Path, written: str, package_dirs: Sequence[Path]) -> Iterable[Path]:
    """Yield the files that a mesh's ``filename`` may mean, the likeliest first."""
    scheme, separator, address = written.partition("://")
    if not separator:
        if written:
            yield path.parent / written
    elif scheme == "file":
        yield Path(address)
    else:
        package, _, inside = address.partition("/")
        for folder in package_dirs:
            yield folder / package / inside
            if folder.name == package:
                yield folder / inside
        above = path.resolve().parents
        yield from (folder / inside for folder in above if folder.name == package)
        yield from (folder / package / inside for folder in above)
