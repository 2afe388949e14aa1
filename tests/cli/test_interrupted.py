"""Ctrl-C at any time is one line and exit code 130, also while libraries are being loaded."""

import gc
import signal
import subprocess
import sys

import pytest

from graspless_pin.cli import INTERRUPTED, main, schema

# Ctrl-C arrives when the module with all commands is looked for.
SCRIPT = """
import os, signal, sys
{before}
from graspless_pin.cli import main

class Interrupting:
    def find_spec(self, name, path=None, target=None):
        if name == {module!r}:
            try:
                os.kill(os.getpid(), signal.SIGINT)
            except {caught}:
                pass
        return None

sys.meta_path.insert(0, Interrupting())
sys.argv = ["graspless-pin", {command!r}, "--help"]
main()
"""


def run(
    module: str,
    *,
    caught: str = "()",
    handler: str = "default_int_handler",
    command: str = "schema",
) -> subprocess.CompletedProcess[str]:
    # Where the tests run in the background, a child would inherit that Ctrl-C is ignored.
    before = f"signal.signal(signal.SIGINT, signal.{handler})"
    script = SCRIPT.format(module=module, caught=caught, before=before, command=command)
    return subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", script], capture_output=True, text=True, check=False
    )


@pytest.mark.parametrize(
    ("module", "caught"),
    [("graspless_pin.cli.commands", "()"), ("typer", "BaseException"), ("pydantic", "()")],
)
def test_while_libraries_are_loaded(module, caught):
    """Also where a library catches everything."""
    result = run(module, caught=caught)
    assert (result.returncode, result.stdout, result.stderr) == (130, "", "interrupted\n")


def test_a_process_that_was_told_to_ignore_it_does():
    result = run("typer", handler="SIG_IGN", command="--help")
    assert result.returncode == 0 and "Usage" in result.stdout


def test_when_a_command_has_begun(monkeypatch, capsys):
    seen = []

    def command() -> None:
        seen.append((signal.getsignal(signal.SIGINT), gc.isenabled()))
        raise KeyboardInterrupt

    monkeypatch.setattr(schema, "schema", command)
    monkeypatch.setattr(sys, "argv", ["graspless-pin", "schema"])
    outside = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(SystemExit) as error:
            main(guarded=False)
    finally:
        signal.signal(signal.SIGINT, outside)
    assert error.value.code == INTERRUPTED == 130
    assert capsys.readouterr().err == "interrupted\n"
    assert seen == [(signal.default_int_handler, True)]
