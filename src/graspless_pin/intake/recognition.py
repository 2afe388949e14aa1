"""What a file is that was given for another kind of file, and which command takes it."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

_WHAT_TO_DO = {
    "scene": "solve it with 'graspless-pin solve {path}'",
    "study": "run it with 'graspless-pin study {path} -o results.parquet'",
    "robot file": "look at it with 'graspless-pin inspect {path}', or name it in a scene as "
    "'hand: {{robot: {path}}}'",
    "URDF": "look at it with 'graspless-pin inspect {path}', or name it in a scene as "
    "'hand: {{urdf: {path}}}'",
    "JSON document": "check it with 'graspless-pin verify {path}', or show it with 'graspless-pin "
    "report {path}'",
    "mesh file": "name it in a scene as 'object: {{shape: {{type: mesh, path: {path}}}}}'",
    "xacro file": "look at it with 'graspless-pin inspect {path}', or name it in a scene as "
    "'hand: {{urdf: {path}}}'",
    "SDF file": "write it as a URDF or as an MJCF",
    "MuJoCo model": "look at it with 'graspless-pin inspect {path}', or name it in a scene as "
    "'hand: {{urdf: {path}}}'",
    "table of results": "read it with graspless_pin.read_results({path!r})",
    "Jupyter notebook": "open it with Jupyter",
    "Python program": "run it with 'python {path}'",
}
_LANGUAGES = {
    "scene": "YAML", "study": "YAML", "robot file": "YAML", "URDF": "XML", "JSON document": "JSON"
}  # fmt: skip
_ROOTS = {"robot": "URDF", "sdf": "SDF file", "mujoco": "MuJoCo model", "COLLADA": "mesh file"}
_BEGINNINGS = (
    (b"PAR1", "table of results"), (b"\x89PNG", "picture"), (b"\xff\xd8\xff", "picture"),
    (b"%PDF", "PDF"), (b"PK\x03\x04", "archive"), (b"\x1f\x8b", "compressed file"),
    (b"glTF", "mesh file"), (b"ply\n", "mesh file"), (b"ply\r", "mesh file"),
    (b"solid ", "mesh file"), (b"\x7fELF", "program"), (b"<!DOCTYPE html", "web page"),
)  # fmt: skip
_MESH_SUFFIXES = {".stl", ".obj", ".ply", ".glb", ".gltf", ".dae", ".off"}
_LINE_OF_OBJ = re.compile(rb"(?m)^v +-?[\d.]+(e-?\d+)? +-?[\d.]+")
_MARKS = {b"\xff\xfe": "utf-16", b"\xfe\xff": "utf-16"}
_VOWELS = ("SDF", "XML", "archive")
_LOOKED_AT = 65536  # bytes


def kind_of_file(path: Path, content: bytes) -> str | None:
    """Return what a file is by its first bytes and its suffix; None: any text, YAML perhaps."""
    head = content[:_LOOKED_AT].lstrip(b"\xef\xbb\xbf \t\r\n")
    for begin, kind in _BEGINNINGS:
        if head.startswith(begin):
            return kind
    if head.startswith(b"<"):
        root = re.search(rb"<([A-Za-z][\w.-]*)", re.sub(rb"(?s)<[?!].*?>", b"", head[:4096]))
        if path.suffix == ".xacro":  # URDFs that were made of one keep its marks
            return "xacro file"
        return _ROOTS.get(root[1].decode() if root else "", "XML file")
    if head.startswith(b"{") and (b'"nbformat"' in content or b'"certificate"' in content):
        return "Jupyter notebook" if b'"nbformat"' in content else "JSON document"
    if path.suffix.lower() in _MESH_SUFFIXES or _LINE_OF_OBJ.search(head):
        return "mesh file"
    if path.suffix == ".py":
        return "Python program"
    return "binary file" if b"\x00" in head and head[:2] not in _MARKS else None


def kind_of_data(data: Any) -> str | None:
    """Return what the content of a YAML or JSON file is, by its keys."""
    if not isinstance(data, dict):
        return None

    def has(*names: str) -> bool:
        return all(name in data for name in names)

    if has("status", "contacts", "certificate"):
        return "JSON document"
    if has("scene", "vary"):
        return "study"
    if has("object", "friction") or has("object", "hand") or has("object", "supports"):
        return "scene"
    if ("urdf" in data or "model" in data) and "object" not in data:
        return "robot file"
    return None


def other_kind(path: Path, wanted: str, found: str | None) -> str:
    """Return what to say where a file is of another kind than is wanted; empty: it is not.

    Args:
        path: The file.
        wanted: What it should be.
        found: What it is, as far as is known.
    """
    if found is None or found == wanted:
        return ""
    advice = _WHAT_TO_DO.get(found, "give a file of {language}")
    told = advice.format(path=path, language=_LANGUAGES.get(wanted, "text"))
    return f"{path}: is {_a(found)}, not {_a(wanted)}; {told}"


def encoding_in_words(content: bytes, start: int) -> str:
    """Return in which encoding text probably is that is not UTF-8.

    Args:
        content: The file.
        start: The first byte that is none of UTF-8.
    """
    mark = _MARKS.get(content[:2])
    if mark is not None:
        return f"it is {mark.upper()}: save it as UTF-8"
    line = content.count(b"\n", 0, start) + 1
    letter = content[start : start + 1].decode("cp1252", errors="ignore")
    if not letter:
        return f"line {line} has a byte that is no letter"
    return f"line {line} is in a Windows encoding ({letter!r} as one byte): save it as UTF-8"


def _a(kind: str) -> str:
    return f"{'an' if kind.startswith(_VOWELS) else 'a'} {kind}"
