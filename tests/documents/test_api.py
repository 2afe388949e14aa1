"""The index, the pages and `__all__` of the public packages promise the same names."""

import ast
import doctest
import inspect
import json
import re
import subprocess
import sys
from collections import Counter
from dataclasses import is_dataclass
from enum import Enum
from functools import cache
from importlib import import_module

import griffe
import pytest
from api import listed, with_names
from page_blocks import MISSING, PAGES, ROOT, blocks_of
from shown_output import difference

from graspless_pin import bounds
from graspless_pin.algorithms.solution_proof import MOST_LEAVES
from graspless_pin.report.verdict_data import MOST_SPAN_LEAVES

INDEX = ROOT / "docs" / "api.md"
OTHER_HOMES = ("errors", "planning", "scene", "studies")
"""Packages that hold some names of `graspless_pin`, too."""
LOADED_LATE = ("numpy", "pinocchio", "coal", "pandas", "matplotlib", "scipy")


def index() -> list[tuple[str, str]]:
    """Page and full name of each line of the index."""
    found = listed(INDEX.read_text(encoding="utf-8"))
    assert all(f"graspless_pin.{shown}" == name for shown, _, name in found)
    return [(page, name) for _, page, name in found]


PROMISED = [name for _, name in index()]


def exports(package: str) -> set[str]:
    return set(import_module(package).__all__)


def home_of(name: str) -> str:
    return name.rpartition(".")[0]


LOADED = [name for name in PROMISED if home_of(name) not in MISSING]
"""Names whose libraries are installed."""


def loaded(name: str):
    return getattr(import_module(home_of(name)), name.rpartition(".")[2])


def test_the_index_lists_each_name_once():
    assert Counter(PROMISED).most_common(1)[0][1] == 1
    # Adapters of alike libraries have alike names.
    short = [
        name.rpartition(".")[2]
        for name in PROMISED
        if name != "graspless_pin.interfaces.jax.optimum"
    ]
    assert Counter(short).most_common(1)[0][1] == 1


def is_shared_by_rule(kind: type) -> bool:
    """Whether a class is a record, a set of words or an error: threads may share these."""
    if is_dataclass(kind):
        return vars(kind)["__dataclass_params__"].frozen
    return issubclass(kind, Enum | Exception)


def test_the_promise_on_threads_names_each_class_that_no_rule_covers():
    page = (ROOT / "docs" / "threads.md").read_text(encoding="utf-8")
    rows = [line for line in page.splitlines() if line.startswith("| ")][1:]
    named = Counter(name for row in rows for name in re.findall(r"`([A-Z]\w+)`", row.split("|")[1]))
    classes = {name.rpartition(".")[2]: loaded(name) for name in LOADED}
    classes = {name: kind for name, kind in classes.items() if inspect.isclass(kind)}
    others = {name for name, kind in classes.items() if not is_shared_by_rule(kind)}
    assert {"Evaluator", "ProgramBuilder", "Viewer"} <= others
    assert others - set(named) == set()
    unknown = {name.rpartition(".")[2] for name in PROMISED if name not in LOADED}
    assert set(named) - set(classes) - unknown - {"Axes"} == set()
    assert max(named.values()) == 1


def test_the_page_of_limits_has_the_bounds_of_the_code():
    page = (ROOT / "docs" / "limits.md").read_text(encoding="utf-8")
    for row, expected in {
        "a name": (bounds.LONGEST_NAME,),
        "edges of a cone": (bounds.MOST_CONE_EDGES,),
        "a study's samples": (bounds.MOST_SAMPLES,),
        "`depth`": (bounds.DEEPEST_HALVINGS,),
        "`time_limit`": (bounds.LONGEST_TIME,),
        "contacts of a solution": (bounds.MOST_CONTACTS,),
        "coefficients": (bounds.MOST_COEFFICIENTS,),
        "a number in it": (bounds.LARGEST_STATED,),
        "leaves": (MOST_LEAVES, MOST_SPAN_LEAVES),
    }.items():
        (found,) = re.findall(rf"(?m)^\| {row}.*\| (.*) \|$", page)
        said = re.findall(r"\d+(?: \d{3})*(?:e\d+)?", found)[: len(expected)]
        assert tuple(float(one.replace(" ", "")) for one in said) == expected, row


def test_the_packages_export_what_the_index_lists():
    homes = {home_of(name) for name in LOADED}
    top = exports("graspless_pin")
    exported = {f"graspless_pin.{name}" for name in top}
    for home in homes - {"graspless_pin"}:
        twice = exports(home) & top
        assert not twice or home.rpartition(".")[2] in OTHER_HOMES, home
        for name in twice:
            assert loaded(f"{home}.{name}") is loaded(f"graspless_pin.{name}")
        exported |= {f"{home}.{name}" for name in exports(home) - top}
    assert exported == set(LOADED)


def test_each_page_documents_what_the_index_lists_for_it():
    """A page itself is an introduction: names are added where the site is built."""
    pages = {page.stem: page for page in (ROOT / "docs" / "api").glob("*.md")}
    assert set(pages) == {page for page, _ in index()}
    text = INDEX.read_text(encoding="utf-8")
    for stem, page in pages.items():
        introduction = page.read_text(encoding="utf-8")
        assert ":::" not in introduction
        built = with_names(introduction, stem, text)
        assert built.startswith(introduction.rstrip())
        names = re.findall(r"^::: (\S+)$", built, re.MULTILINE)
        assert names == [name for its_page, name in index() if its_page == stem]


def test_each_name_has_a_docstring():
    """With the arguments of a function, in Google's style."""
    sources = griffe.load("graspless_pin", search_paths=[ROOT / "src"], resolve_aliases=True)
    for name in PROMISED:
        found = sources[name.removeprefix("graspless_pin.")]
        assert found.docstring and found.docstring.value.strip(), name
        value = loaded(name) if name in LOADED else None
        if inspect.isfunction(value) and (arguments := inspect.signature(value).parameters):
            listed = {
                argument.name
                for section in found.docstring.parse("google")
                if isinstance(section, griffe.DocstringSectionParameters)
                for argument in section.value
            }
            # Of one or two, the summary may say all there is to say.
            assert listed == set(arguments) or (not listed and len(arguments) <= 2), name


def imported(code: str) -> set[str]:
    """Full names that a program imports from the package."""
    return {
        f"{node.module}.{alias.name}"
        for node in ast.walk(ast.parse(code))
        if isinstance(node, ast.ImportFrom) and (node.module or "").startswith("graspless_pin")
        for alias in node.names
    }


def code_for_readers() -> list[tuple[str, str]]:
    # CONTRIBUTING has a module of the package itself.
    pages = [page for page in PAGES if page.name != "CONTRIBUTING.md"]
    blocks = [block for page in pages for block in blocks_of(page) if block.kind == "python"]
    scripts = sorted((ROOT / "examples").rglob("*.py"))
    found = [(block.place, block.text) for block in blocks]
    found += [(file.name, file.read_text(encoding="utf-8")) for file in scripts]
    for file in sorted((ROOT / "examples").rglob("*.ipynb")):
        cells = json.loads(file.read_text(encoding="utf-8"))["cells"]
        code = "\n".join("".join(one["source"]) for one in cells if one["cell_type"] == "code")
        found.append((file.name, re.sub(r"^%.*$", "", code, flags=re.MULTILINE)))
    return found


def test_pages_and_examples_use_promised_names_only():
    used = {(place, name) for place, code in code_for_readers() for name in imported(code)}
    assert len(used) > 40
    assert {(place, name) for place, name in used if name not in PROMISED} == set()


def test_the_package_loads_nothing_before_it_is_needed():
    code = f"import graspless_pin, sys; print(*(set({LOADED_LATE}) & set(sys.modules)))"
    result = subprocess.run(  # noqa: S603 - our own interpreter and a fixed program
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert result.stdout.strip() == ""


class _AsShown(doctest.OutputChecker):
    """What differs between machines is no difference: see `shown_output`."""

    def check_output(self, want: str, got: str, optionflags: int) -> bool:
        return super().check_output(want, got, optionflags) or not difference(want, got)


@cache
def documented() -> dict[str, str]:
    """The docstrings of functions and classes by their full names."""
    values = {name: loaded(name) for name in LOADED}
    return {
        name: inspect.getdoc(value) or ""
        for name, value in values.items()
        if inspect.isfunction(value) or inspect.isclass(value)
    }


def test_each_name_has_an_example():
    """Of its own, or that of the name which it is used with."""
    texts = {name.rpartition(".")[2]: text for name, text in documented().items()}
    for name, text in documented().items():
        if ">>>" not in text:
            named = re.search(r"See the example\s+of\s+`(\w+)`", text)
            assert named, f"{name}: has no example"
            assert ">>>" in texts[named[1]], f"{name}: {named[1]} has no example"


@pytest.mark.sampled(2)
@pytest.mark.parametrize("part", range(20))
def test_examples_run(monkeypatch, part):
    monkeypatch.chdir(ROOT)
    monkeypatch.setenv("MPLBACKEND", "Agg")
    docs = documented().items()
    found = {text[text.index("Examples:") :]: name for name, text in docs if ">>>" in text}
    runner = doctest.DocTestRunner(_AsShown(), optionflags=doctest.NORMALIZE_WHITESPACE)
    for text, name in [*found.items()][part::20]:
        said: list[str] = []
        runner.run(doctest.DocTestParser().get_doctest(text, {}, name, name, 0), out=said.append)
        assert not said, "".join(said)
    assert runner.tries > 10
