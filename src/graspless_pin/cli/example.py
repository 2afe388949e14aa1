"""``graspless-pin example``: copies of the scenes and studies that come with the package."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator
from pathlib import Path
from typing import Annotated

import typer

from graspless_pin.cli.outcome import plain_errors
from graspless_pin.errors import ArgumentError
from graspless_pin.intake.yaml_text import all_texts, parse_yaml
from graspless_pin.suggestions import names_in_words

_PACKAGE = Path(__file__).resolve().parents[1] / "examples"
_SOURCE = Path(__file__).resolve().parents[3] / "examples"


def example(
    name: Annotated[
        str | None, typer.Argument(help="Example to copy; without a name all are listed.")
    ] = None,
) -> None:
    """Copy an example scene or study with its files to the current folder, or list all.

    Existing files are not replaced.

    Examples:
        graspless-pin example
        graspless-pin example allegro_box_on_slope
    """
    with plain_errors():
        files = example_files()
        if name is None:
            width = max(map(len, files))
            for stem, file in files.items():
                typer.echo(f"{stem:{width}}  {parse_yaml(file.read_text()).data['name']}")
            return
        if name not in files:
            raise ArgumentError(
                "name", f"there is no example {name!r}; {names_in_words(name, files)}"
            )
        copied = copy_example(files[name], Path.cwd())
        for file in copied:
            typer.echo(f"wrote {file}")
        command = "study" if files[name].parent.name == "studies" else "solve"
        output = " -o results.parquet" if command == "study" else ""
        typer.echo(f"next: graspless-pin {command} {copied[0]}{output}")


def example_files() -> dict[str, Path]:
    """Return the files of the examples by name."""
    root = _PACKAGE if _PACKAGE.is_dir() else _SOURCE
    files = [*root.glob("*.yaml"), *root.glob("paper/*.yaml"), *root.glob("studies/*.yaml")]
    return {file.stem: file for file in sorted(files)}


def copy_example(file: Path, folder: Path) -> list[Path]:
    """Copy an example and the files that it refers to into a folder.

    Args:
        file: A scene or study.
        folder: The folder; subfolders of the examples are kept.

    Returns:
        The copies, relative to the folder, the example itself first.

    Raises:
        ArgumentError: If one of them exists already; then nothing is copied.
    """
    sources = list(dict.fromkeys(_referenced_files(file)))
    root = Path(os.path.commonpath([source.parent for source in sources]))
    copies = [source.relative_to(root) for source in sources]
    taken = [str(copy) for copy in copies if (folder / copy).exists()]
    if taken:
        raise ArgumentError(
            "name",
            f"{', '.join(taken)} {'is' if len(taken) == 1 else 'are'} in this folder already; "
            "nothing was copied: run the command in another folder",
        )
    for source, copy in zip(sources, copies, strict=True):
        (folder / copy).parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(source, folder / copy)
    return copies


def _referenced_files(file: Path) -> Iterator[Path]:
    """Yield a file and all files that it refers to, recursively."""
    yield file
    if file.suffix != ".yaml":
        return
    table = file.with_suffix(".csv")  # a plan that starts from the scene
    if table.is_file():
        yield table
    for text in all_texts(parse_yaml(file.read_text()).data):
        referenced = (file.parent / text).resolve()
        if referenced.is_file():
            yield from _referenced_files(referenced)
