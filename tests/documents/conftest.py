"""The documentation site, built once for all tests of this folder."""

import os
import subprocess
import sys
from pathlib import Path

import pytest
from page_blocks import ROOT

sys.path.append(str(ROOT / "mkdocs_hooks"))


@pytest.fixture(scope="session")
def site(tmp_path_factory) -> Path:
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--quiet"]
    built = subprocess.run(  # noqa: S603 - our own command
        [*command, "--site-dir", str(folder)],
        cwd=ROOT,
        env=os.environ | {"NO_MKDOCS_2_WARNING": "1"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (built.returncode, built.stdout, built.stderr) == (0, "", "")
    return folder
