"""Print the oldest and the newest supported Python found here, a line each: version, program.

The supported versions are the classifiers in pyproject.toml. Each is looked for as ``pythonX.Y`` on
the path, then in pyenv's folder of versions. One that does not start or cannot make a virtual
environment is passed over: pyenv's shims, for one, stand on the path without starting.
"""

from __future__ import annotations

import os
import re
import subprocess
import sys
from collections.abc import Iterator, Sequence
from pathlib import Path

_PROJECT = Path(__file__).parents[1] / "pyproject.toml"
_PROBE = "import ensurepip, sys, venv; print('%d.%d' % sys.version_info[:2], sys.executable)"


def supported(project: str) -> list[str]:
    """Return the minor versions that the classifiers in a pyproject.toml name, oldest first."""
    named = re.findall(r'"Programming Language :: Python :: 3\.(\d+)"', project)
    return [f"3.{minor}" for minor in sorted(map(int, named))]


def candidates(version: str, path: Sequence[Path], pyenv: Path) -> Iterator[Path]:
    """Yield programs that may be this version: those on the path, then pyenv's, newest first."""
    for folder in path:
        yield folder / f"python{version}"
    releases = [
        (int(match[1]), folder)
        for folder in pyenv.glob(f"{version}.*")
        if (match := re.fullmatch(rf"{re.escape(version)}\.(\d+)", folder.name))
    ]
    for _, folder in sorted(releases, reverse=True):
        yield folder / "bin" / "python3"


def start(program: Path, version: str) -> str | None:
    """Return the interpreter behind a program if it is of this version and makes environments."""
    if not os.access(program, os.X_OK):
        return None
    try:
        answer = subprocess.run(  # noqa: S603 - a Python of this machine
            [program, "-c", _PROBE], capture_output=True, text=True, timeout=60, check=True
        ).stdout.split(maxsplit=1)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer[1].strip() if len(answer) == 2 and answer[0] == version else None


def find(version: str, path: Sequence[Path], pyenv: Path) -> str | None:
    """Return the first interpreter of this version that starts."""
    started = (start(program, version) for program in candidates(version, path, pyenv))
    return next((program for program in started if program), None)


def main() -> int:
    """Print the choice; return 1 if the newest supported version is not among it."""
    path = [Path(folder) for folder in os.get_exec_path()]
    pyenv = Path(os.environ.get("PYENV_ROOT") or Path.home() / ".pyenv") / "versions"
    versions = supported(_PROJECT.read_text(encoding="utf-8"))
    found = {version: find(version, path, pyenv) for version in versions}
    there = [version for version in versions if found[version]]
    for version in dict.fromkeys(there[:1] + there[-1:]):
        print(version, found[version])
    if there[-1:] == versions[-1:]:
        return 0
    print(
        f"Python {versions[-1]}, the newest supported one, was not found: there is no "
        f"python{versions[-1]} on the path that starts, and none under {pyenv}",
        file=sys.stderr,
    )
    return 1


if __name__ == "__main__":
    sys.exit(main())
