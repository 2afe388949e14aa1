"""One document for each waypoint of a path and for each sample of a study, and all are proven."""

import json
from concurrent.futures import ThreadPoolExecutor
from contextlib import nullcontext
from pathlib import Path

import pytest
import yaml
from tests.cli.cli_tools import run

from graspless_pin import load_scene
from graspless_pin.errors import SceneError
from graspless_pin.planning import Waypoint, evaluate_path
from graspless_pin.report import write_path_documents
from graspless_pin.report.verify import verify_document

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"
CUBOID = EXAMPLES / "paper" / "cuboid_at_rest.yaml"


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    """Documents of a path that lifts the object off in the end."""
    scene = load_scene(EXAMPLES / "trihand_push_box.yaml")
    away = scene.object.T_world_object.copy()
    away[2, 3] += 0.5
    profile = evaluate_path(scene, [Waypoint(), Waypoint(), Waypoint(T_world_object=away)])
    folder = tmp_path_factory.mktemp("path") / "documents"
    return write_path_documents(profile, folder), profile


def test_each_waypoint_with_contacts_has_a_proven_document(written):
    files, profile = written
    there = [k for k, state in enumerate(profile.evaluations) if state.has_contacts]
    assert [file.name for file in files if "arrival" not in file.name] == [
        f"waypoint_{k:04d}.json" for k in there
    ]
    assert 0 < len(there) < 3
    for file in files:
        assert verify_document(json.loads(file.read_text(encoding="utf-8"))).proven


def test_several_files_are_verified_in_one_go(written, tmp_path):
    files, _ = written
    result = run("verify", *files)
    assert result.exit_code == 0
    assert result.stdout == "".join(f"{file}: proven\n" for file in files)
    document = json.loads(files[0].read_text(encoding="utf-8"))
    document["margin"] *= 1.001
    false = tmp_path / "false.json"
    false.write_text(json.dumps(document), encoding="utf-8")
    result = run("verify", *files, false)
    assert result.exit_code == 1
    assert f"{false}: FAILED\n         FAILED  margin as stated: stated" in result.stdout
    document["margin"] /= 1.001
    document["proof"] |= {"complete": False, "missing": "too long"}
    false.write_text(json.dumps(document), encoding="utf-8")
    result = run("verify", files[0], false)
    assert result.exit_code == 3
    assert f"{false}: not all proven\nnot proven here  optimal over all modes: too long" in (
        result.stdout
    )


def test_a_folder_that_cannot_be_made_is_named(written, tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(SceneError, match="file/documents: the folder cannot be created"):
        write_path_documents(written[1], tmp_path / "file" / "documents")


@pytest.fixture
def study(tmp_path):
    """A study file: one sample is infeasible, one found, and two have no scene."""
    file = tmp_path / "study.yaml"
    content = {
        "scene": str(CUBOID),
        "vary": {
            "hand.q.finger_1/hinge": {"values": [0.0, 3.0]},
            "friction.default": {"from": 0.01, "to": 0.3, "steps": 2},
        },
        "compute": {"algorithm": "margin"},
    }
    file.write_text(yaml.safe_dump(content), encoding="utf-8")
    return file


@pytest.fixture
def here(monkeypatch):
    """The option that has samples computed in this process, as a scheduler in it would."""
    threads = nullcontext((ThreadPoolExecutor(1), 1))
    monkeypatch.setattr("graspless_pin.cli.study.dask_executor", lambda _: threads)
    return "--dask", "here"


def test_each_sample_of_a_study_has_a_proven_document(study, tmp_path, here):
    folder, output = tmp_path / "proofs", tmp_path / "out.csv"
    call = ("study", study, "-o", output, "--no-progress", "--proofs", folder)
    assert run(*call, "--workers", "1").exit_code == 0
    files = sorted(folder.iterdir())
    assert [file.name for file in files] == ["sample_000000.json", "sample_000002.json"]
    documents = [json.loads(file.read_text(encoding="utf-8")) for file in files]
    assert [document["found"] for document in documents] == [False, True]
    assert all(verify_document(document).proven for document in documents)
    table = output.read_bytes()
    # What is complete stays; a document that is missing is made again.
    files[1].unlink()
    kept = files[0].stat().st_mtime_ns
    assert run(*call, *here).exit_code == 0
    assert sorted(folder.iterdir()) == files and output.read_bytes() == table
    again = files[0].stat().st_mtime_ns
    assert run(*call, *here).exit_code == 0
    assert files[0].stat().st_mtime_ns == again >= kept


def test_documents_that_cannot_be_written_end_a_study(study, tmp_path, here):
    folder = tmp_path / "proofs"
    (folder / "sample_000000.json" / "inside").mkdir(parents=True)
    output = tmp_path / "out.csv"
    result = run("study", study, "-o", output, "--no-progress", "--proofs", folder, *here)
    assert result.exit_code == 2
    assert "sample_000000.json" in result.stderr
