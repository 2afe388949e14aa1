"""Read a file within bounds: a regular file, of limited size and of the expected kind."""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from contextvars import ContextVar
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

from graspless_pin.errors import GrasplessPinError, TextError
from graspless_pin.suggestions import nearest_name

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
    "MuJoCo model": "look at it with 'graspless-pin inspect {path}', name it in a scene as "
    "'hand: {{urdf: {path}}}', or make a scene of the whole file with scene_from_mjcf of "
    "graspless_pin.interfaces.mujoco",
    "table of results": "read it with graspless_pin.read_results('{path}')",
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
    """Return the kind of a file by its first bytes and suffix; None: other text, such as YAML."""
    head = content[:_LOOKED_AT].lstrip(b"\xef\xbb\xbf \t\r\n")
    for start, kind in _BEGINNINGS:
        if head.startswith(start):
            return kind
    if head.startswith(b"<"):
        root = re.search(rb"<([A-Za-z][\w.-]*)", re.sub(rb"(?s)<[?!].*?>", b"", head[:4096]))
        if path.suffix.lower() == ".xacro":  # not by namespace: URDFs that xacro wrote keep it
            return "xacro file"
        return _ROOTS.get(root[1].decode() if root else "", "XML file")
    if head.startswith(b"{") and (b'"nbformat"' in content or b'"certificate"' in content):
        return "Jupyter notebook" if b'"nbformat"' in content else "JSON document"
    if path.suffix.lower() in _MESH_SUFFIXES or _LINE_OF_OBJ.search(head):
        return "mesh file"
    if path.suffix.lower() == ".py":
        return "Python program"
    return "binary file" if b"\x00" in head and head[:2] not in _MARKS else None


def kind_of_data(data: Any) -> str | None:
    """Return the kind of a YAML or JSON file by its top-level keys; None: unknown."""
    if not isinstance(data, dict):
        return None
    keys = data.keys()
    if keys >= {"status", "contacts", "certificate"}:
        return "JSON document"
    if keys >= {"scene", "vary"}:
        return "study"
    if "object" in keys and keys & {"friction", "hand", "supports"}:
        return "scene"
    if keys & {"urdf", "model"} and "object" not in keys:
        return "robot file"
    return None


def encoding_in_words(content: bytes, start: int) -> str:
    """Return, for messages, the probable encoding of a text that is not UTF-8.

    Args:
        content: The file.
        start: Index of the first byte that is invalid in UTF-8.
    """
    mark = _MARKS.get(content[:2])
    if mark is not None:
        return f"it is {mark.upper()}: save it as UTF-8"
    line = content.count(b"\n", 0, start) + 1
    letter = content[start : start + 1].decode("cp1252", errors="ignore")
    if not letter:
        return f"line {line} has a byte that is not text"
    return f"line {line} is in a Windows encoding ({letter!r} as one byte): save it as UTF-8"


def _with_article(kind: str) -> str:
    return f"{'an' if kind.startswith(_VOWELS) else 'a'} {kind}"


_MIB = 1 << 20
_MOST_NAMES = 1000
_TEXTS = (".yaml", ".yml", ".urdf", ".json")
_SPECIAL = (
    (stat.S_ISDIR, "directory"),
    (stat.S_ISFIFO, "pipe"),
    (stat.S_ISSOCK, "socket"),
    (stat.S_ISCHR, "device"),
    (stat.S_ISBLK, "device"),
)


FileIdentity = tuple[int, int]
"""Device and inode of a file, which do not depend on its path."""


def identity_of(state: os.stat_result) -> FileIdentity:
    """Return the identity of a file from its `os.stat` result."""
    return state.st_dev, state.st_ino


_READ: ContextVar[dict[FileIdentity, Path] | None] = ContextVar("read", default=None)


@contextmanager
def files_read() -> Iterator[dict[FileIdentity, Path]]:
    """Collect the files that `read_bytes` and its callers read within the block."""
    outer, read = _READ.get(), dict[FileIdentity, Path]()
    token = _READ.set(read)
    try:
        yield read
    finally:
        _READ.reset(token)
        if outer is not None:
            outer |= read


def note_read(path: Path, state: os.stat_result) -> None:
    """Report to `files_read` a file that is read now, or was read before and has not changed."""
    if (read := _READ.get()) is not None:
        read[identity_of(state)] = path


@dataclass(frozen=True)
class FileKind:
    """A kind of file: its name in messages, largest size and error class.

    Attributes:
        name: For messages, such as ``scene``.
        mebibytes: The largest size that is read.
        error: Makes the error from a message.
        advice: Returns advice on a text at a key that takes a number, such as a figure with a unit.
    """

    name: str
    mebibytes: int
    error: Callable[[str], GrasplessPinError]
    advice: Callable[[str, tuple[str | int, ...]], str] = lambda _found, _location: ""


def read_bytes(path: Path, kind: FileKind) -> bytes:
    """Return the content of a regular file.

    It never waits for a pipe, and never reads more than the kind's size whatever size is reported.

    Args:
        path: The file; a symbolic link is followed.
        kind: The expected kind.

    Raises:
        GrasplessPinError: The kind's error, if the file is missing, unreadable, too large or no
            regular file.
    """
    size_limit = kind.mebibytes * _MIB
    try:
        _check_regular(path, path.stat().st_mode, kind)
        # A pipe may have replaced the file since; opening it without O_NONBLOCK would block.
        handle = os.open(path, os.O_RDONLY | getattr(os, "O_NONBLOCK", 0))
        with os.fdopen(handle, "rb") as file:
            state = os.fstat(handle)
            _check_regular(path, state.st_mode, kind)
            content = file.read(size_limit + 1)
            note_read(path, state)
    except GrasplessPinError:
        raise
    except FileNotFoundError:
        names = _names_in_folder(path.parent)
        stem = nearest_name(path.stem, [Path(name).stem for name in names], alike=0.75)
        alike = [name for name in names if Path(name).stem == stem]
        nearest = nearest_name(path.name, alike, alike=0.0)  # such as x.yaml for x.yml, not x.stl
        advice = "check the path" if nearest is None else f"did you mean '{path.parent / nearest}'?"
        raise kind.error(f"{path}: there is no such file; {advice}") from None
    except OSError as error:
        raise kind.error(f"{path}: cannot be read ({error.strerror})") from None
    except ValueError:
        raise kind.error(f"{str(path)!r}: is not the path of a file") from None
    if len(content) > size_limit:
        raise kind.error(
            f"{path}: has more than {kind.mebibytes} MiB, the most that a {kind.name} may have"
        )
    return content


def read_text(path: Path, kind: FileKind) -> str:
    """Return the content of a regular file of UTF-8 text, without a byte-order mark.

    Raises:
        GrasplessPinError: See `read_bytes`; or the file is not UTF-8, or of another kind.
    """
    content = read_bytes(path, kind)
    refuse_other_kind(path, kind, kind_of_file(path, content))
    try:
        return content.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise kind.error(
            f"{path}: is not UTF-8 text ({error.reason} at byte {error.start}); a {kind.name} is "
            f"a text file, and {encoding_in_words(content, error.start)}"
        ) from None


def refuse_other_kind(path: Path, kind: FileKind, found: str | None) -> None:
    """Refuse a file of another kind, with advice on how to use it.

    Args:
        path: The file.
        kind: The expected kind.
        found: The actual kind, see `kind_of_file` and `kind_of_data`; None: unknown.

    Raises:
        GrasplessPinError: The kind's error.
    """
    if found is None or found == kind.name:
        return
    advice = _WHAT_TO_DO.get(found, "give a file of {language}")
    hint = advice.format(path=path, language=_LANGUAGES.get(kind.name, "text"))
    raise kind.error(f"{path}: is {_with_article(found)}, not {_with_article(kind.name)}; {hint}")


@contextmanager
def errors_of_text(path: Path, kind: FileKind) -> Iterator[None]:
    """Convert a `TextError` in the block to an error that names file and line.

    Raises:
        GrasplessPinError: The kind's error, for a `TextError`.
    """
    try:
        yield
    except TextError as error:
        line = f":{error.line}" if error.line else ""
        raise kind.error(f"{path}{line}: {error}") from None


is_file = os.path.isfile
"""Whether a path is that of a regular file; False for paths that no file can have."""


def _check_regular(path: Path, mode: int, kind: FileKind) -> None:
    if stat.S_ISREG(mode):
        return
    special_kind = next((name for test, name in _SPECIAL if test(mode)), "special file")
    candidates = _candidate_files(path) if stat.S_ISDIR(mode) else ""
    raise kind.error(
        f"{path}: is a {special_kind}; a {kind.name} must be a regular file{candidates}"
    )


def _candidate_files(folder: Path) -> str:
    """Return, for messages, some files of a folder that may have been meant."""
    names = sorted(name for name in _names_in_folder(folder) if name.endswith(_TEXTS))[:4]
    return f", such as {', '.join(names)} in this folder" if names else ""


def _names_in_folder(folder: Path) -> list[str]:
    """Return up to `_MOST_NAMES` names in a folder; none where it cannot be read."""
    with suppress(OSError):
        return [item.name for item in islice(os.scandir(folder), _MOST_NAMES)]
    return []
