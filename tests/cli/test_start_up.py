"""What a command does not need is not loaded: modules are counted here, seconds in `make bench`."""

import subprocess
import sys
from importlib import import_module

import pytest
from cli_tools import PAPER, run

from graspless_pin.cli.commands import _COMMANDS, _load_command

SCRIPT = """
import sys
from graspless_pin.cli import main
sys.argv = ["graspless-pin", *sys.argv[1:]]
try:
    main(guarded=False)
finally:
    sys.stderr.write(" ".join(sys.modules))
"""
HEAVY = {
    "coacd", "example_robot_data", "highspy", "jinja2", "matplotlib", "mujoco", "networkx",
    "pandas", "proxsuite", "pyarrow", "qpsolvers", "rich", "scipy.optimize", "scipy.spatial",
    "scipy.stats", "trimesh", "viser", "yourdfpy",
}  # fmt: skip
PARTS = {
    "algorithms.guaranteed_torques", "holding.stability", "planning", "plots", "report.document",
    "report.html", "report.verify", "simulation", "studies", "viewer", "visualization",
}  # fmt: skip


def modules(*arguments: str) -> set[str]:
    """Run the command line in a process; return the modules that it has loaded."""
    result = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", SCRIPT, *arguments], capture_output=True, text=True, check=False
    )
    assert result.returncode == 0, result.stderr
    return set(result.stderr.split())


def test_the_list_of_commands_loads_none():
    loaded = modules("--help")
    own = {name for name in loaded if name.startswith("graspless_pin.") and ".cli" not in name}
    assert own == set()
    assert not loaded & (HEAVY - {"rich"} | {"numpy", "scipy", "pydantic", "yaml", "pinocchio"})


def test_a_solve_of_primitives_loads_what_it_needs():
    loaded = modules("solve", "--no-verdict", str(PAPER / "cuboid_at_rest.yaml"))
    assert {"pinocchio", "coal", "graspless_pin.scene.load"} <= loaded
    assert not loaded & HEAVY
    assert not loaded & {f"graspless_pin.{part}" for part in PARTS}


def test_the_list_has_the_first_line_of_each():
    """It is read from the sources: none of them is loaded."""
    listed = run("--help").stdout
    for name, place in _COMMANDS.items():
        module, function = place.split(".")
        called = getattr(import_module(f"graspless_pin.cli.{module}"), function)
        summary = called.__doc__.splitlines()[0]
        assert len(summary) > 20
        words = [word for line in listed.splitlines() for word in line.strip("│ ").split()]
        assert f" {name} {summary} " in f" {' '.join(words)} "


@pytest.mark.parametrize("name", _COMMANDS)
def test_a_command_says_how_it_is_called(name):
    shown = run(name, "--help")
    assert shown.exit_code == 0
    assert max(map(len, shown.stdout.splitlines())) <= 80
    _, title, below = shown.stdout.partition(" Examples:")
    examples = [line.strip() for line in below.splitlines() if line.strip()]
    assert title
    assert examples
    options = {option for one in _load_command(name).params for option in one.opts}
    for example in examples:
        assert example.startswith(f"graspless-pin {name}")
        used = {word for word in example.split() if word.startswith("-")}
        assert used <= options


def test_the_package_is_the_command_line():
    result = subprocess.run(
        [sys.executable, "-m", "graspless_pin", "--version"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert result.returncode == 0, result.stderr
    assert result.stdout == run("--version").stdout


@pytest.mark.parametrize("module", ["example", "robots", "verify"])
def test_commands_that_solve_nothing_load_no_scipy(module):
    code = f"import sys, graspless_pin.cli.{module}; sys.exit('scipy' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)  # noqa: S603 - a fixed program
