"""The page on architecture names what there is, and what runs in which order."""

import json
import re
import subprocess
import sys
import tomllib
from functools import cache

import pytest
from page_blocks import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "src" / "graspless_pin"
SCENE = str(ROOT / "examples" / "allegro_box_on_slope.yaml")
NAME = re.compile(r"`([\w.]+)`")

# A fresh process, and a fork of it for each run: what an earlier one has left in a cache would not
# be entered again. Calls while modules are loaded are no part of what runs.
TRACE = """
import json, os, sys
import coal, numpy as np, pinocchio, scipy.optimize
from graspless_pin import Evaluator, load_scene

entered = {}

def note(frame, event, argument):
    # By the module, not the file: constructors of dataclasses stand in none.
    name = frame.f_globals.get("__name__", "")
    if event != "call" or name in entered or not name.startswith("graspless_pin."):
        return
    caller = frame
    while caller is not None:
        if caller.f_code.co_filename.startswith("<frozen importlib"):
            return
        caller = caller.f_back
    entered[name] = name.removeprefix("graspless_pin.")

def one(file):
    sys.setprofile(note)
    load_scene(file).solve()

def batch(file):
    scene = load_scene(file)
    sys.setprofile(note)
    evaluator = Evaluator(scene)
    evaluator.evaluate_many(np.tile(evaluator.configuration(), (3, 1)))

for run in (one, batch):
    child = os.fork()
    if child == 0:
        run(sys.argv[1])
        sys.setprofile(None)
        print(json.dumps({run.__name__: list(entered.values())}), flush=True)
        os._exit(0)
    os.waitpid(child, 0)
"""

# Lambdas and comprehensions are no functions that one steps into, and not alike in all Pythons.
COMMAND = """
import inspect, json, os, sys
from graspless_pin.cli import main

inside = os.path.dirname(os.path.dirname(main.__code__.co_filename)) + os.sep
entered, most = set(), 0

def is_named(frame):
    code = frame.f_code
    is_function = code.co_flags & inspect.CO_NEWLOCALS and not code.co_name.startswith("<")
    return is_function and code.co_filename.startswith(inside)

def note(frame, event, argument):
    global most
    if event == "call" and is_named(frame):
        code, depth = frame.f_code, 0
        entered.add((code.co_filename, code.co_qualname, code.co_firstlineno))
        while frame is not None:
            depth += bool(is_named(frame))
            frame = frame.f_back
        most = max(most, depth)

output, *sys.argv = sys.argv[1:]
sys.setprofile(note)
try:
    main()
finally:
    sys.setprofile(None)
    if any(name == "solve_scene" for _, name, _ in entered):  # the other process only waits
        figures = len(entered), len({file for file, *_ in entered}), most
        with open(output, "w") as file:
            json.dump(figures, file)
"""
FIGURES = re.compile(r"enters (\d+) named functions in (\d+) modules, at most (\d+) of them deep")


def rows_below(heading: str) -> list[str]:
    """First cells of the table in a section."""
    section = PAGE.partition(f"{heading}\n")[2].partition("\n## ")[0]
    return [line.split("|")[1] for line in section.splitlines() if line.startswith("| `")]


def modules_below(heading: str) -> list[str]:
    return [name for row in rows_below(heading) for name in NAME.findall(row)]


@cache
def entered() -> dict[str, list[str]]:
    """Of one solve and of a batch the modules as functions of theirs are first called."""
    done = subprocess.run(  # noqa: S603 - our own text
        [sys.executable, "-c", TRACE, SCENE], capture_output=True, text=True, check=True
    )
    one, batch = map(json.loads, done.stdout.splitlines())
    return {**one, **batch}


@pytest.fixture(scope="module")
def layers() -> dict[str, int]:
    """Of each package the number of its layer, the lowest last."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    contract = project["tool"]["importlinter"]["contracts"][0]
    found = enumerate(contract["layers"])
    return {name.strip(" ()"): at for at, layer in found for name in layer.split("|")}


def test_the_table_has_each_package_once_and_the_lowest_first(layers):
    named = modules_below("# Architecture")
    found = {path.stem for path in PACKAGE.iterdir() if path.suffix in ("", ".py")}
    assert sorted(named) == sorted(
        name for name in found if not name.startswith("_") and name != "py"
    )
    numbers = [layers[name] for name in named]
    assert numbers == sorted(numbers, reverse=True)


@pytest.mark.parametrize(
    ("what", "heading"), [("one", "## How one solve runs"), ("batch", "## How one batch runs")]
)
def test_modules_run_in_the_order_of_the_page(what, heading):
    named, ran = modules_below(heading), entered()[what]
    assert len(named) > 10
    assert set(named) <= set(ran)
    assert named == sorted(named, key=ran.index)


def test_the_road_of_one_solve_is_as_short_as_the_page_says(tmp_path):
    """Whoever steps through it meets no more functions, modules and frames than that."""
    scene = str(ROOT / "examples" / "paper" / "cuboid_at_rest.yaml")
    words = ["graspless-pin", "solve", "--no-verdict", scene]
    command = [sys.executable, "-c", COMMAND, str(tmp_path / "figures"), *words]
    subprocess.run(command, capture_output=True, check=True)  # noqa: S603 - our own text
    ran = json.loads((tmp_path / "figures").read_text(encoding="utf-8"))
    told = FIGURES.search(PAGE.replace("\n", " "))
    assert told is not None
    for figure, most in zip(ran, map(int, told.groups()), strict=True):
        assert 0.9 * most <= figure <= 1.03 * most


def test_no_package_that_runs_is_missing(layers):
    tables = modules_below("## How one solve runs") + modules_below("## How one batch runs")
    ran = {name.split(".")[0] for names in entered().values() for name in names}
    core = {name for name in ran if layers.get(name, layers["intake"]) < layers["intake"]}
    assert core == {name.split(".")[0] for name in tables}
