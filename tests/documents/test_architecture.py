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


def test_no_package_that_runs_is_missing(layers):
    tables = modules_below("## How one solve runs") + modules_below("## How one batch runs")
    ran = {name.split(".")[0] for names in entered().values() for name in names}
    core = {name for name in ran if layers.get(name, layers["intake"]) < layers["intake"]}
    assert core == {name.split(".")[0] for name in tables}
