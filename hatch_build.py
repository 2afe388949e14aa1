"""Compiles `graspless_pin.compiled`, if there is a C compiler; without one, numpy does its work."""

from __future__ import annotations

import hashlib
import os
import sys
import sysconfig
import tempfile
from pathlib import Path
from typing import Any

import Cython
import numpy as np
from Cython.Build import cythonize
from hatchling.builders.hooks.plugin.interface import BuildHookInterface
from setuptools import Distribution, Extension
from setuptools.errors import BaseError, CCompilerError

_PACKAGE = "graspless_pin.compiled"
_FOLDER = "src/graspless_pin/compiled"
# Only this Python's: installations of others into the same tree keep theirs beside it.
_LIBRARIES = f"*{sysconfig.get_config_var('EXT_SUFFIX')}"
# Without fused rounding the results are the same on every processor; there, that is the default.
_STAMP = f".compiled{sysconfig.get_config_var('EXT_SUFFIX')}.stamp"
_FLAGS = [] if sys.platform == "win32" else ["-O3", "-g0", "-ffp-contract=off"]


class CompiledLoops(BuildHookInterface):
    """Builds the extension in place, unless it is there, and adds it to the wheel."""

    def initialize(self, version: str, build_data: dict[str, Any]) -> None:  # noqa: ARG002
        """Compile what has changed since the last time, or say that it was not possible."""
        package = Path(self.root, _FOLDER)
        stamp, libraries = package / _STAMP, list(package.glob(_LIBRARIES))
        made_of = _digest(sorted(package.glob("*.p*x*")))
        if not libraries or not stamp.is_file() or stamp.read_text() != made_of:
            for stale in (*libraries, *package.glob(_STAMP)):
                stale.unlink()
            try:
                _compile()
            except (BaseError, CCompilerError, OSError) as error:
                self.app.display_warning(f"graspless_pin goes without its compiled loops: {error}")
                return
            stamp.write_text(made_of)
        build_data["pure_python"] = False
        build_data["infer_tag"] = True
        build_data["artifacts"].append(f"{_FOLDER}/{_LIBRARIES}")


def _digest(sources: list[Path]) -> str:
    """Return what changes with anything that the compiled modules are made of."""
    made_of = hashlib.sha256(f"{Cython.__version__} {np.__version__}".encode())
    made_of.update(repr([os.environ.get(name) for name in ("CC", "CFLAGS", "LDFLAGS")]).encode())
    for source in (*sources, Path(__file__)):
        made_of.update(source.read_bytes())
    return made_of.hexdigest()


def _compile() -> None:
    """Compile the loops in place, from the project's folder.

    Raises:
        CCompilerError: There is no C compiler, or it fails.
        OSError: A file cannot be written.
    """
    with tempfile.TemporaryDirectory() as folder:
        extension = Extension(
            f"{_PACKAGE}.core",
            [f"{_FOLDER}/core.pyx"],
            include_dirs=[np.get_include()],
            extra_compile_args=_FLAGS,
            define_macros=[("NPY_NO_DEPRECATED_API", "NPY_2_0_API_VERSION")],
        )
        modules = cythonize([extension], build_dir=folder, language_level=3, quiet=True)
        distribution = Distribution({"ext_modules": modules, "package_dir": {"": "src"}})
        command = distribution.get_command_obj("build_ext")
        command.inplace = True
        command.build_lib = command.build_temp = folder
        command.ensure_finalized()
        command.run()
