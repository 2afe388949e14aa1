"""The journal of a study: damage is refused, what killed runs leave is taken up or removed."""

import json
import os
import subprocess
import sys
import zlib

import numpy as np
import pytest
from study_tools import FRICTION, Here, study

from graspless_pin.errors import StudyError
from graspless_pin.studies import run_study
from graspless_pin.studies.journal import JOURNAL_FORMAT, Journal

IDENTITY = {"format": JOURNAL_FORMAT, "fingerprint": "ab12", "versions": {"numpy": "2.4.0"}}
ROWS = [
    {"sample": 3, "status": "optimal", "found": True, "margin_N": 0.125, "contacts": 4},
    {"sample": 0, "status": "infeasible_forces", "found": False, "reason": "größer"},
    {"sample": 11, "status": "optimal", "found": True, "margin_N": 1e-3, "contacts": 2},
]


@pytest.fixture
def journal(tmp_path):
    """A journal with three rows."""
    file = tmp_path / "out.csv.journal"
    written = Journal(file, IDENTITY)
    for row in ROWS:
        written.append([row])
    written.close()
    return file


def rows_of(file, identity=IDENTITY, **options):
    opened = Journal(file, identity, **options)
    numbers = [number for number in range(12) if number in opened]
    assert len(numbers) == opened.count
    rows = {row["sample"]: row for row in opened.rows(numbers)}
    opened.close()
    return rows


@pytest.mark.parametrize(
    "columns",
    [
        *({}, {"sample": []}, {"sample": 4}, {"sample": [4], "a": []}),
        *({"sample": [4, n], "status": ["optimal"] * 2} for n in (-1, 10**7, 10**15, 4.0)),
    ],
)
def test_a_line_without_rows_or_of_a_sample_that_no_study_has_is_refused(journal, columns):
    """It would have memory for all samples before it; its checksum fits."""
    text = json.dumps(columns).encode()
    journal.write_bytes(journal.read_bytes() + b"%08x %s\n" % (zlib.crc32(text), text))
    with pytest.raises(StudyError, match=r"out\.csv\.journal:5: the line is damaged"):
        rows_of(journal)


def test_rows_that_come_together_share_lines(tmp_path):
    """One line for those with the same columns, of at most 64; a later row replaces an earlier."""
    file = tmp_path / "out.csv.journal"
    rng = np.random.default_rng(4)
    rows = [
        {"sample": n, "margin_N": float(rng.normal()), **({"reason": "none"} if n % 3 else {})}
        for n in rng.permutation(300).tolist()
    ]
    written = Journal(file, IDENTITY)
    written.append(rows)
    written.append([{"sample": 7, "margin_N": 2.0}])
    assert file.read_bytes().count(b"\n") == 1 + 2 + 4 + 1
    expected = {row["sample"]: row for row in rows} | {7: {"sample": 7, "margin_N": 2.0}}
    for journal in (written, None):
        journal = journal or Journal(file, IDENTITY)
        assert journal.count == 300
        order = rng.permutation(300).tolist()
        assert [*journal.rows(order)] == [expected[n] for n in order]
        assert {*journal.columns} == {"sample", "margin_N", "reason"}
        journal.close()


def test_no_flipped_bit_changes_a_row(journal):
    """One bit of every byte: the journal is refused, or the last row is computed again."""
    sound = journal.read_bytes()
    expected = rows_of(journal)
    refused = 0
    for place in range(len(sound)):
        damaged = bytearray(sound)
        damaged[place] ^= 1 << place % 8
        journal.write_bytes(damaged)
        try:
            rows = rows_of(journal)
        except StudyError as error:
            refused += 1
            assert str(error).startswith(f"{journal}:"), error
            assert "--fresh" in str(error) or "--overwrite" in str(error)
            assert journal.read_bytes() == damaged
        else:
            assert place == len(sound) - 1, place
            assert rows == {number: expected[number] for number in (3, 0)}
    assert refused == len(sound) - 1


def test_damage_is_told_with_its_line(journal):
    lines = journal.read_bytes().splitlines(keepends=True)
    damaged = lines[2].replace(b"false", b"true")
    assert damaged != lines[2]
    journal.write_bytes(b"".join([*lines[:2], damaged, lines[3]]))
    with pytest.raises(
        StudyError, match=r"out\.csv\.journal:3: the line is damaged: .* delete it to"
    ):
        rows_of(journal)
    journal.write_bytes(b"".join([*lines[:2], lines[3]]))
    assert sorted(rows_of(journal)) == [3, 11]
    journal.write_bytes(b"".join([*lines[:2], damaged, lines[3]]))
    assert rows_of(journal, fresh=True) == {}


@pytest.mark.parametrize("kept", [0, 1, 9, 40])
def test_a_journal_killed_as_it_began_is_begun_anew(journal, kept):
    journal.write_bytes(journal.read_bytes()[:kept])
    assert rows_of(journal) == {}


def test_notes_without_a_line_end_are_kept(journal):
    journal.write_bytes(b"notes")
    with pytest.raises(StudyError, match="is not the journal of a study"):
        rows_of(journal)
    assert journal.read_bytes() == b"notes"


@pytest.mark.parametrize("name", ["out.parquet", "out.csv"])
def test_drafts_of_killed_writes_are_removed(tmp_path, name):
    """Also beside a finished study; those of running processes and other files stay."""
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    made, file = study({"friction.default": FRICTION}), tmp_path / name
    stale = tmp_path / f".{name}.{gone.pid}.part"
    kept = {
        tmp_path / f".{name}.{os.getppid()}.part",
        tmp_path / f".{name}.x.part",
        tmp_path / f".other.{name}.{gone.pid}.part",
        tmp_path / f"{name}.{gone.pid}.part",
    }
    for draft in (stale, *kept):
        draft.touch()
    for _ in range(2):
        stale.touch()
        run_study(made, file, executor=Here(), workers=1, progress=False)
        assert set(tmp_path.iterdir()) == {file, *kept}
