"""Which files commands may write: one rule for all of them.

What a command has read is never replaced, and what another program may have written only with
``--overwrite``. What the same kind of command has written before is replaced: commands are run
again and again.
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

_LOOKED_AT = 65536  # bytes; all marks stand in them
MODEL_MARK = "<!-- written by graspless-pin simulate -->\n"
"""First line of the models that are written: it tells them from others' models."""


class OutputKind(Enum):
    """What commands write: what messages call it, and how files of it that are there begin.

    Nothing marks pictures, videos and scenes. The former are replaced; a scene may be a user's own
    work, and is replaced only with ``--overwrite``.
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
        """Return whether a file that is there may be taken for one that commands write as this."""
        if self in (OutputKind.PICTURE, OutputKind.SCENE):
            return self is OutputKind.PICTURE
        with path.open("rb") as file:
            return re.match(self.value[1], file.read(_LOOKED_AT)) is not None


OverwriteOption = Annotated[
    bool,
    typer.Option(
        "--overwrite", help="Replace a file of that name, whatever it is, but none that is read."
    ),
]


@dataclass(frozen=True)
class _Files:
    """What a command has read, and what it is to write."""

    read: Mapping[FileIdentity, Path]
    outputs: list[tuple[str, Path, OutputKind, FileIdentity]] = field(default_factory=list)


_FILES: ContextVar[_Files | None] = ContextVar("files", default=None)


@contextmanager
def files_of_command() -> Iterator[None]:
    """Keep in mind what is read and to be written as long as a command runs."""
    with files_read() as read:
        token = _FILES.set(_Files(read))
        try:
            yield
        finally:
            _FILES.reset(token)


def check_output(
    option: str, file: str | Path | None, kind: OutputKind, *, overwrite: bool = False
) -> None:
    """Refuse an output that cannot be written, or that would replace what may be another's.

    It is called before anything is computed, and `check_inputs_stay` once the input is read.

    Args:
        option: That names the file.
        file: The file to write; ``-`` or None: none.
        kind: What is written.
        overwrite: Whether any file of that name may be replaced.

    Raises:
        ArgumentError: If it cannot be written, or is there and not of that kind.
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
        why = error.strerror if isinstance(error, OSError) else error
        raise ArgumentError(
            option, f"{str(file)!r} cannot be written ({why}); choose another name"
        ) from None
    if not is_own:
        what = f" and no {kind.value[0]}" if kind.value[0] else ""
        raise ArgumentError(
            option,
            f"{file} is there already{what}; choose another name, or replace it (--overwrite)",
        )
    if (files := _FILES.get()) is not None:
        files.outputs.append((option, path, kind, identity_of(state)))


def check_inputs_stay(scene: Path | None = None) -> None:
    """Refuse outputs that would replace a file which the command has read.

    Args:
        scene: The scene file; a scene file that is written may replace it.

    Raises:
        ArgumentError: If there is one.
    """
    if (files := _FILES.get()) is None:
        return
    for option, path, kind, identity in files.outputs:
        if kind is OutputKind.SCENE and scene is not None and path.samefile(scene):
            continue
        if identity in files.read:
            raise ArgumentError(
                option, f"{path} is read by this command and would be lost; choose another name"
            )


def _check_folder(option: str, path: Path) -> None:
    """Refuse a file whose folder, or the one in which that is to be made, takes none."""
    folder = path.absolute().parent
    while not folder.exists():
        folder = folder.parent
    if not folder.is_dir():
        raise ArgumentError(
            option, f"{path} cannot be written ({folder} is no folder); choose another name"
        )
    if not os.access(folder, os.W_OK | os.X_OK):
        raise ArgumentError(
            option, f"{path} cannot be written (no permission in {folder}); choose another name"
        )
