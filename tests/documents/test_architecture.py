"""The page on architecture names what there is."""

import re
from collections import Counter
from importlib import import_module

import pytest
from page_blocks import ROOT

PAGE = (ROOT / "docs" / "architecture.md").read_text(encoding="utf-8")
PACKAGE = ROOT / "src" / "graspless_pin"
ROW = re.compile(r"^\| `([\w.]+)` \|", re.MULTILINE)


def test_the_table_has_a_row_for_each_package():
    table = PAGE.split("| package |")[1].split("\n\n")[0]
    found = {path.stem for path in PACKAGE.iterdir() if path.suffix in ("", ".py")}
    assert set(ROW.findall(table)) == {name for name in found if not name.startswith("_")} - {"py"}


@pytest.mark.parametrize("table", PAGE.split("| module |")[1:], ids=["down", "back", "position"])
def test_a_datum_passes_each_module_once(table):
    modules = ROW.findall(table.split("\n\n")[0])
    assert Counter(modules).most_common(1)[0][1] == 1
    for name in modules:
        import_module(f"graspless_pin.{name}")
