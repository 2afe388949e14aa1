"""The call of xacrodoc, alone in a module: the process that it is made in loads nothing else."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path


def run_xacro(path: str, packages: Mapping[str, str], arguments: Mapping[str, str]) -> str:
    """Return the URDF that a xacro file makes; change the current folder.

    Args:
        path: The file.
        packages: Folders by package name, for ``$(find NAME)``.
        arguments: Values of its ``<xacro:arg>``.

    Raises:
        ValueError: xacro cannot expand it.
    """
    from xacrodoc import XacroDoc
    from xacrodoc import packages as finder

    os.chdir(Path(path).parent)  # xacrodoc looks there for files that are included by their path
    finder.update_package_cache(dict(packages))
    try:
        document = XacroDoc.from_file(path, subargs=dict(arguments), resolve_packages=False)
    except Exception as error:  # whatever an expression in the file raises
        raise ValueError(f"{type(error).__name__}: {error}") from None
    return document.to_urdf_string()
