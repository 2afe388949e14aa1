"""What was renamed says its successor when it is asked for, and the page of migration lists it."""

import re
from importlib import import_module
from pathlib import Path

import pytest

import graspless_pin
from graspless_pin import OptimumGradients, viewer
from graspless_pin.renamed import SUCCESSORS
from graspless_pin.report.html import case_of_document, report_html

MIGRATION = Path(__file__).resolve().parents[1] / "docs" / "migration.md"
OF_MODULES = {name: new for name, new in SUCCESSORS.items() if name.startswith("graspless_pin.")}


@pytest.mark.parametrize(("former", "successor"), OF_MODULES.items())
def test_a_former_name_of_a_module_tells_its_successor(former, successor):
    home, _, name = former.rpartition(".")
    with pytest.raises(ImportError, match=rf"^{former} was renamed to {successor}$"):
        exec(f"from {home} import {name}")  # noqa: S102 - our own text
    package, _, last = successor.rpartition(".")
    assert successor == "graspless_pin" or hasattr(import_module(package), last)


@pytest.mark.parametrize(("module", "name"), [(graspless_pin, "picture"), (viewer, "evaluate")])
def test_a_former_attribute_tells_its_successor(module, name):
    former = f"{module.__name__}.{name}"
    with pytest.raises(AttributeError, match=f"^{former} was renamed to {SUCCESSORS[former]}$"):
        getattr(module, name)


def test_a_module_below_a_former_one_tells_the_successor():
    with pytest.raises(ImportError, match=r"picture was renamed to graspless_pin\.visualization$"):
        import_module("graspless_pin.picture.records")


def test_a_former_field_tells_its_successor():
    gradients = object.__new__(OptimumGradients)
    with pytest.raises(AttributeError, match=r"marginals was renamed to OptimumGradients\.point$"):
        _ = gradients.marginals


def test_a_former_keyword_tells_its_successor():
    with pytest.raises(TypeError, match=r"folder\) was renamed to case_of_document\(scene_file\)$"):
        case_of_document({}, folder=Path())  # pyright: ignore[reportCallIssue]
    with pytest.raises(TypeError, match=r"ranges\) was renamed to report_html\(bounds\)$"):
        report_html(None, ranges=False)  # pyright: ignore[reportCallIssue]


@pytest.mark.parametrize("module", [graspless_pin, viewer])
def test_other_names_are_unknown(module):
    with pytest.raises(AttributeError, match="has no attribute 'nothing'"):
        _ = module.nothing
    with pytest.raises(ModuleNotFoundError, match=r"No module named .graspless_pin\.nothing"):
        import_module("graspless_pin.nothing")


def test_the_page_of_migration_lists_each():
    rows = re.findall(r"^\| `([^`]+)` \| `([^`]+)` \|$", MIGRATION.read_text("utf-8"), re.MULTILINE)
    assert dict(rows) == SUCCESSORS
