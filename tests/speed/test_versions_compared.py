"""The statistics that say whether a version got slower, and the rows that they are about."""

from __future__ import annotations

import json
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from benchmarks import rows
from benchmarks.against import judged, main, run
from benchmarks.ratios import LEAST_ROUNDS, ratio_of, ratios_of

EVEN = [1.0, 1.02, 0.99, 1.01, 1.0, 0.98, 1.03]


def printed(seconds: dict[str, float], **others: Any) -> dict[str, Any]:
    """What `benchmarks.rows` prints."""
    return {"seconds": seconds, "missing": {}, "loops": True, "versions": {}, **others}


def test_the_ratio_is_that_of_the_medians() -> None:
    one = ratio_of([3.0, 2.0, 9.0, 4.0, 1.0, 5.0, 8.0], [1.0, 2.0, 9.0, 4.0, 1.0, 0.5, 1.5])
    assert (one.base, one.ratio) == (1.5, 4.0 / 1.5)
    assert (one.low, one.high) == (1.0, 10.0)


@pytest.mark.parametrize(("rounds", "left_out"), [(7, 0), (8, 0), (9, 1), (12, 2), (15, 3)])
def test_the_spread_leaves_out_what_the_sign_test_allows(rounds: int, left_out: int) -> None:
    one = ratio_of(range(1, rounds + 1), [1.0] * rounds)
    assert (one.low, one.high) == (1 + left_out, rounds - left_out)


def test_the_spread_holds_the_true_ratio_as_often_as_it_says() -> None:
    rng = np.random.default_rng(0)
    trials, truth = 1000, 1.1
    for rounds in (7, 9, 15):
        noise = rng.lognormal(sigma=0.2, size=(2, trials, rounds))
        held = [
            one.low <= truth <= one.high
            for one in (ratio_of(truth * a, b) for a, b in zip(*noise, strict=True))
        ]
        assert 0.95 - 0.015 <= np.mean(held) <= 0.99 + 0.01


@pytest.mark.parametrize(
    ("factor", "slower"), [(1.0, False), (0.5, False), (1.0499, False), (1.0501, True), (2.0, True)]
)
def test_what_is_clearly_above_the_allowance_is_slower(factor: float, slower: bool) -> None:
    assert ratio_of([factor * each for each in EVEN], EVEN).slower is slower


def test_what_lies_within_the_spread_is_not_slower() -> None:
    one = ratio_of([1.5, 1.5, 1.5, 1.5, 0.9, 1.5, 1.5], [1.0] * 7)
    assert one.ratio == 1.5 and not one.slower
    # Nine rounds see past one that was disturbed.
    disturbed = [1.0] * 8 + [5.0]
    assert ratio_of([1.2] * 9, disturbed).slower
    assert not ratio_of(disturbed, [1.0] * 9).slower


def test_equal_versions_are_rarely_called_slower() -> None:
    rng = np.random.default_rng(1)
    called = [ratio_of(a, b).slower for a, b in rng.lognormal(sigma=0.2, size=(2000, 2, 9))]
    assert np.mean(called) < 0.03


def test_rounds_must_be_enough_and_in_pairs() -> None:
    with pytest.raises(ValueError, match="6 rounds are too few; there must be 7"):
        ratio_of(EVEN[1:], EVEN[1:])
    with pytest.raises(ValueError, match="broadcast"):
        ratio_of(EVEN, EVEN[1:])


def test_only_rows_of_both_versions_and_all_rounds_are_compared() -> None:
    rounds = [({"a": 1.0, "new": 1.0}, {"a": 2.0, "old": 1.0})] * LEAST_ROUNDS
    assert {name: one.ratio for name, one in ratios_of(rounds).items()} == {"a": 0.5}


def test_the_verdict_marks_what_got_slower() -> None:
    rounds = [
        (printed({"same": each, "slow": 1.3 * each}), printed({"same": each, "slow": each}))
        for each in EVEN
    ]
    text, passed = judged(rounds)
    marked = [line for line in text.splitlines() if line.endswith("SLOWER |")]
    assert not passed
    assert [line.split("|")[1].strip() for line in marked] == ["slow"]
    assert "1.300 to 1.300" in marked[0]
    assert "1 of 2 rows got slower" in text


def test_the_verdict_says_what_the_base_lacks_and_what_differs() -> None:
    new = printed({"a": 1.0, "b": 1.0}, versions={"numpy": "2.4", "graspless-pin": "2"})
    old = {"missing": {"b": "no name b"}, "loops": False}
    base = printed({"a": 1.0}, **old, versions={"numpy": "2.3", "graspless-pin": "1"})
    text, passed = judged([(new, base)] * LEAST_ROUNDS)
    assert passed
    assert "not in the base: b: no name b" in text
    assert "compiled loops: False in the base, True here" in text
    assert "numpy 2.3 in the base, 2.4 here" in text
    assert "graspless-pin 1" not in text


def test_a_row_that_this_version_lost_fails_and_so_does_nothing_to_compare() -> None:
    new = printed({"a": 1.0}, missing={"b": "ValueError: broken"})
    text, passed = judged([(new, printed({"a": 1.0, "b": 1.0}))] * LEAST_ROUNDS)
    assert not passed
    assert not judged([(printed({"a": 1.0}), printed({"b": 1.0}))] * LEAST_ROUNDS)[1]
    assert "NOT MEASURED HERE: b: ValueError: broken" in text


def test_the_fastest_pass_counts_after_a_first_one() -> None:
    times = iter([9.0, 0.3, 0.1, 0.2, 0.05])
    assert rows.fastest(lambda: next(times), budget=0.5) == 0.1


@pytest.mark.parametrize("name", rows.GROUPS)
def test_every_row_can_be_measured(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(rows, "SIZES", (6, 12))
    monkeypatch.setattr(rows, "SEEDS", 1)
    monkeypatch.setattr(rows, "SAMPLES", (2, 2))
    measured = {row: measure() for row, measure in rows.GROUPS[name]()}
    assert measured
    assert all(seconds > 0.0 for seconds in measured.values())


def test_what_a_version_lacks_is_left_out_and_said(monkeypatch, capsys) -> None:
    def broken() -> float:
        raise AttributeError("no name b")

    def unknown() -> Iterator[tuple[str, rows.Pass]]:
        raise ImportError("no name c")

    groups = {"here": lambda: iter([("a", lambda: 0.5), ("b", broken)]), "gone": unknown}
    monkeypatch.setattr(rows, "GROUPS", groups)
    rows.main()
    told = json.loads(capsys.readouterr().out)
    assert told["seconds"] == {"a": 0.5}
    assert told["missing"] == {"b": "AttributeError: no name b", "gone": "ImportError: no name c"}


def test_a_version_is_not_imported_from_the_callers_path(monkeypatch, tmp_path: Path) -> None:
    (tmp_path / "graspless_pin.py").write_text("", encoding="utf-8")
    monkeypatch.setenv("PYTHONPATH", str(tmp_path))
    imported = "import graspless_pin; print(graspless_pin.__file__)"
    assert not Path(run([sys.executable, "-c", imported], tmp_path.parent)).is_relative_to(tmp_path)


def test_an_unknown_commit_or_too_few_rounds_is_wrong_usage(monkeypatch, capsys) -> None:
    for arguments, said in (
        (["no-such-commit"], "no commit 'no-such-commit' in this repository"),
        (["HEAD", "--rounds", "6"], "there must be at least 7"),
    ):
        monkeypatch.setattr("sys.argv", ["against", *arguments])
        with pytest.raises(SystemExit) as left:
            main()
        assert left.value.code == 2
        assert said in capsys.readouterr().err
