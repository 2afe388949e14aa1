"""The page on troubleshooting has every finding, under its severity."""

import re

from page_blocks import ROOT

from graspless_pin import FindingCode, Severity

PAGE = (ROOT / "docs" / "troubleshooting.md").read_text(encoding="utf-8")
TITLES = {
    Severity.SERIOUS: "## Serious findings",
    Severity.WARNING: "## Warnings",
    Severity.NOTE: "## Notes",
}


def codes_below(title: str) -> list[str]:
    section = PAGE.partition(f"{title}\n")[2].partition("\n## ")[0]
    return re.findall(r"^\| `([\w-]+)` \|", section, re.MULTILINE)


def test_every_finding_has_symptom_cause_and_cure():
    stated = [(code, severity) for severity, title in TITLES.items() for code in codes_below(title)]
    assert len(stated) == len(set(stated))
    assert set(stated) == {(str(code), code.severity) for code in FindingCode}
    for code, _ in stated:
        line = next(line for line in PAGE.splitlines() if line.startswith(f"| `{code}` |"))
        assert len([cell for cell in line.split("|")[1:-1] if cell.strip()]) == 4, line
