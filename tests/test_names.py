"""No two public things of the package share a name, and no two files of the tests."""

import ast
from collections import Counter
from pathlib import Path

import pytest

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "graspless_pin"


def public_names(code: str) -> set[str]:
    """Functions, classes and constants that a module defines at its top, but for private ones."""
    found: set[str] = set()
    for node in ast.parse(code).body:
        if isinstance(node, ast.FunctionDef | ast.ClassDef):
            found.add(node.name)
        elif isinstance(node, ast.Assign | ast.AnnAssign):
            targets = node.targets if isinstance(node, ast.Assign) else [node.target]
            found |= {one.id for target in targets for one in ast.walk(target)
                      if isinstance(one, ast.Name)}  # fmt: skip
    return {name for name in found if not name.startswith("_")}


def shared_names(folder: Path) -> dict[str, list[str]]:
    """Names that several modules define, with these modules."""
    defined = {
        path.relative_to(folder).as_posix(): public_names(path.read_text(encoding="utf-8"))
        for path in sorted(folder.rglob("*.py"))
    }
    counts = Counter(name for names in defined.values() for name in names)
    return {
        name: [path for path, names in defined.items() if name in names]
        for name, count in counts.items()
        if count > 1
    }


def test_no_two_public_things_share_a_name():
    assert shared_names(PACKAGE) == {}


@pytest.mark.parametrize("again", ["def settle(): ...", "class settle: ...", "settle: int = 3"])
def test_a_shared_name_is_found(tmp_path, again):
    (tmp_path / "one.py").write_text("def settle(): ...\n_kept = 1\n", encoding="utf-8")
    (tmp_path / "two.py").write_text(f"{again}\n_kept = 2\nfrom one import settle\n", "utf-8")
    assert shared_names(tmp_path) == {"settle": ["one.py", "two.py"]}


def test_no_two_files_of_the_tests_share_a_name():
    """They are imported by their name alone: with two of one name none of either would run."""
    files = Counter(path.name for path in Path(__file__).parent.rglob("*.py"))
    assert {name for name, count in files.items() if count > 1} <= {"conftest.py", "__init__.py"}
