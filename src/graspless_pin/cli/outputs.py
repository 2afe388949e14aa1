"""Which files commands may write: one rule for all of them.

A file that the command has read is never replaced. A file that another program may have written is
replaced only with ``--overwrite``. An earlier output of the same kind is replaced without asking.
"""

from __future__ import annotations

import os
import re
import stat
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from enum import Enum
from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.errors import ArgumentError
from graspless_pin.intake.files import FileIdentity, files_read, identity_of

_LOOKED_AT = 65536  # bytes, which contain all marks
MODEL_MARK = "<!-- written by graspless-pin simulate -->\n"
"""First line of written models, which distinguishes them from models of other programs."""


class OutputKind(Enum):
    """Kinds of outputs: name in messages, and pattern of the beginning of such a file.

    Pictures, videos and scenes have no mark. Pictures and videos are replaced; a scene may be a
    user's own work, and is replaced only with ``--overwrite``.
    """

    SOLUTION = "solution document", rb'\s*\{\s*"format": *\d+,\s*"status": *"'
    TOLERANCES = "table of tolerances", rb'\s*\{\s*"torques": *\{[^{}]*\},\s*"tolerances": *[\[{]'
    PAGE = (
        "page of graspless-pin",
        rb"(?s)<!DOCTYPE html>.*<title>[^<]* graspless_pin report<",
    )
    MODEL = "model of graspless-pin", re.escape(MODEL_MARK.encode())
    PICTURE = "picture", b""
    SCENE = "", b""

    def is_own(self, path: Path) -> bool:
        """Return whether an existing file looks like an output of this kind."""
        if self in (OutputKind.PICTURE, OutputKind.SCENE):
            return self is OutputKind.PICTURE
        with path.open("rb") as file:
            return re.match(self.value[1], file.read(_LOOKED_AT)) is not None


OverwriteOption = Annotated[
    bool,
    typer.Option(
        "--overwrite",
        help="Replace an existing file, of any kind. Files that the command reads are not "
        "replaced; only close, place and settle can replace their scene.",
    ),
]


@dataclass(frozen=True)
class _CommandFiles:
    """Files that a command has read, and its outputs: option, path, kind and identity of each."""

    read: Mapping[FileIdentity, Path]
    outputs: list[tuple[str, Path, OutputKind, FileIdentity]] = field(default_factory=list)


_FILES: ContextVar[_CommandFiles | None] = ContextVar("files", default=None)


@contextmanager
def files_of_command() -> Iterator[None]:
    """Record the files that are read and the outputs while a command runs."""
    with files_read() as read:
        token = _FILES.set(_CommandFiles(read))
        try:
            yield
        finally:
            _FILES.reset(token)


def check_output(
    option: str, file: str | Path | None, kind: OutputKind, *, overwrite: bool = False
) -> None:
    """Refuse an output that cannot be written, or that would replace a file of another kind.

    Call it before anything is computed, and `check_inputs_stay` once the input is read.

    Args:
        option: The option that names the file.
        file: The file to write; ``-`` or None: no file.
        kind: What is written.
        overwrite: Whether a file of any kind may be replaced.

    Raises:
        ArgumentError: If it cannot be written, or exists and is not of that kind.
    """
    if file is None or str(file) == "-":
        return
    path = Path(file)
    try:
        state = path.stat()
        if stat.S_ISDIR(state.st_mode):
            raise ArgumentError(option, f"{file} is a folder; name a file in it")
        if not stat.S_ISREG(state.st_mode):  # a pipe or a device is written to as it is
            return
        is_own = overwrite or kind.is_own(path)
    except FileNotFoundError:
        _check_folder(option, path)
        return
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) else error
        raise ArgumentError(
            option, f"{str(file)!r} cannot be written ({reason}); choose another name"
        ) from None
    if not is_own:
        kind_note = f" and is not a {kind.value[0]}" if kind.value[0] else ""
        raise ArgumentError(
            option,
            f"{file} exists already{kind_note}; choose another name, or replace it (--overwrite)",
        )
    if (files := _FILES.get()) is not None:
        files.outputs.append((option, path, kind, identity_of(state)))


def check_inputs_stay(scene: Path | None = None) -> None:
    """Refuse outputs that would replace a file which the command has read.

    Args:
        scene: The scene file, which an output of kind `SCENE` may replace.

    Raises:
        ArgumentError: If there is such an output.
    """
    if (files := _FILES.get()) is None:
        return
    for option, path, kind, identity in files.outputs:
        if kind is OutputKind.SCENE and scene is not None and path.samefile(scene):
            continue
        if identity in files.read:
            raise ArgumentError(
                option, f"{path} is an input of this command and would be lost; choose another name"
            )


def _check_folder(option: str, path: Path) -> None:
    """Refuse a file whose folder, or the nearest existing one above it, cannot be written to."""
    folder = path.absolute().parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise ArgumentError(
            option, f"{path} cannot be written ({folder} is not a folder); choose another name"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArgumentError(
            option, f"{path} cannot be written (no permission in {folder}); choose another name"
        )
