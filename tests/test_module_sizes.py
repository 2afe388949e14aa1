"""Modules stay small enough to be read at once."""

from pathlib import Path

PACKAGE = Path(__file__).resolve().parents[1] / "src" / "graspless_pin"
MOST = 500


def test_no_module_is_long():
    lines = {
        path.relative_to(PACKAGE).as_posix(): len(path.read_text(encoding="utf-8").splitlines())
        for path in PACKAGE.rglob("*.py")
    }
    assert {name for name, count in lines.items() if count > MOST} == set()
