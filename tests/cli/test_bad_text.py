"""Files that are no plain YAML: named, with advice, and inert."""

import pytest
from cli_tools import LINES, assert_refused, run, solve_text, spoilt

# Texts that are no plain YAML scene, and the message after the file's name.
TEXTS = {
    "empty": (b"", ": the file is empty; a scene needs object and friction"),
    "only a comment": (b"# nothing yet\n", ": the file is empty"),
    "list": (b"- 1\n- 2\n", ":1: found [1, 2]; a scene is a mapping with the keys object,"),
    "number": (b"42\n", ":1: found 42; a scene is a mapping with the keys object,"),
    "binary": (b"\x80\x81\xff\x00", ": is a binary file, not a scene"),
    "Latin": (b"a: \xe4\n", ": is not UTF-8 text"),
    "tab": (b"object:\n\tname: x\n", ":2: is not plain YAML: column 1: found character '\\t' that"),
    "open bracket": (b"object: [1, 2\n", ":2: is not plain YAML: column 1: "),
    "a blank too many": (
        b"object:\n  name: x\n   mass: 1\n",
        ":3: is not plain YAML: column 8: a key",
    ),
    "a key further left": (
        b"object:\n    name: x\n  mass: 1\n",
        ":3: is not plain YAML: column 3: a line of another indentation; indent keys of",
    ),
    "no blank after the colon": (
        b"object:\n  mass:0.5\n  name: x\n",
        ":3: is not plain YAML: column 7: a key or a value too many; here or one line above, write "
        "'key: value'",
    ),
    "own tag": (b"object: !part {a: 1}\n", ":1: is not plain YAML: column 9: could not determine"),
    "two documents": (
        LINES.encode() + b"---\n{}\n",
        ":16: is not plain YAML: column 1: but found another document; a file must",
    ),
    "list as a key": (b"? [a, b]\n: 1\n", ":1: is not plain YAML: column 3: found unhashable key"),
    "date that does not exist": (b"name: 2020-13-45\n", ": is not plain YAML: month must be in"),
    "digits that are none": (b"name: 0b_\n", ": is not plain YAML: invalid literal for int()"),
    "anchor in itself": (b"object: &a {x: *a}\n", ":1: an anchor contains itself; write it out"),
    "duplicate key": (
        spoilt("  mass: 1.0\n", "  mass: 1.0\n  mass: 2.0\n").encode(),
        ":11: object.mass: duplicate key, first on line 10; keep one",
    ),
    "duplicate key in a list": (
        spoilt("- name: floor\n", "- name: floor\n    name: wall\n").encode(),
        ":14: supports.0.name: duplicate key, first on line 13; keep one",
    ),
}


@pytest.mark.parametrize(("text", "message"), TEXTS.values(), ids=TEXTS)
def test_a_text_that_is_no_scene(tmp_path, text, message):
    assert_refused(solve_text(tmp_path, text), f"{tmp_path / 'scene.yaml'}{message}")


def test_a_table_of_results_is_told_how_to_read(tmp_path):
    file = tmp_path / "results.parquet"
    file.write_bytes(b"PAR1")
    assert f"; read it with graspless_pin.read_results('{file}')" in run("solve", file).stderr


def test_tabs_and_tags_come_with_advice(tmp_path):
    assert "; indent with spaces" in solve_text(tmp_path, TEXTS["tab"][0]).stderr
    assert "; YAML tags are not supported" in solve_text(tmp_path, TEXTS["own tag"][0]).stderr
    proof = tmp_path / "executed"
    for call in ("os.system", "subprocess.call", "os.mkdir"):
        text = f"name: !!python/object/apply:{call} ['{proof}']\n{LINES}"
        assert_refused(solve_text(tmp_path, text), ":1: is not plain YAML: column 7: could not")
        assert not proof.exists()


def test_plain_anchors_are_fine(tmp_path):
    text = spoilt("size: [0.2, 0.2, 0.2]", "size: [&edge 0.2, *edge, *edge]")
    assert solve_text(tmp_path, text).exit_code == 0


def test_a_scene_that_is_not_there(tmp_path):
    file = tmp_path / "none.yaml"
    assert_refused(run("solve", file), f"{file}: there is no such file; check the path")
    assert_refused(
        run("solve", tmp_path), f"{tmp_path}: is a directory; a scene must be a regular file"
    )
