"""Mistakes in a study: named with file, line, key and what would do, before anything runs."""

from typing import Any

import pytest
import yaml
from study_tools import CUBOID, HEIGHT, SLOPE, Here, study, study_file

from graspless_pin.errors import ArgumentError, SceneError, StudyError
from graspless_pin.studies import Study, load_study, run_study

LINES = """\
scene: SCENE
vary:
  friction.default: {from: 0.2, to: 0.6, steps: 3}
  slope:
    {values: [45], unit: deg, turn: {what: all, axis: [0, 1, 0], as_in_scene: 45}}
sampling: {method: grid}
compute: {algorithm: margin}
"""
RANGE = "{from: 0.2, to: 0.6, steps: 3}"
VALUES = "values: [45], unit: deg"
TURN = "{what: all, axis: [0, 1, 0], as_in_scene: 45}"
GRID = "{method: grid}"

# What is replaced, by what, and the message after the file's name.
LOADING = {
    "scene: SCENE\n": {"": ":1: scene: is missing; needs text"},
    "SCENE": {"cuboid.yaml": ":1: scene: there is no file"},
    "sampling:": {"samping:": ":6: samping: unknown key; did you mean 'sampling'? known: close,"},
    "steps: 3": {
        "step: 3": ":3: vary['friction.default'].step: unknown key; did you mean 'steps'?",
        "count: 3": (
            ":3: vary['friction.default']: found count; the key for the number of values of a "
            "range is 'steps'"
        ),
        "steps: 1": ":3: vary['friction.default']: one step gives",
        "steps: 10000000, scale: linear}\n  max_normal_force: {from: 10, to: 20, steps: 2": (
            ": gives 20000000 samples; at most 10000000 are possible"
        ),
    },
    "from: 0.2, to: 0.6": {
        "from: 0.6, to: 0.2": (
            ":3: vary['friction.default']: the range from 0.6 to 0.2 is empty; 'from' must be "
            "smaller"
        ),
    },
    ", steps: 3": {
        "": ":3: vary['friction.default']: a range on a grid needs 'steps', the number of",
    },
    "to: 0.6": {"to: 0.2": ": from 0.2 to 0.2 is one value; 'steps' must not be 3"},
    "algorithm: margin": {
        "sample_time_limit: 0": (
            ":7: compute.sample_time_limit: found 0; needs a finite number > 0, at most 1e+06"
        ),
        "algorithm: margin, margin: 0.2": (
            ":7: compute.margin: has no effect with algorithm 'margin'; use algorithm 'torque'"
        ),
    },
    "unit: deg": {
        "unit: degree": ":5: vary.slope.unit: 'degree' is not a unit of angle; use rad or deg",
        "unit: mm": ":5: vary.slope.unit: 'mm' is not a unit of angle; use rad or deg",
    },
    TURN: {TURN + ", key: friction": ":4: vary.slope: found key and turn; give only one"},
    "what: all": {
        "what: [all, wall]": (
            ":5: vary.slope.turn: what: no body of the scene is named 'wall'; "
            "did you mean 'all'? known:"
        ),
        "what: all, frame: moon": (
            ":5: vary.slope.turn: frame: no body of the scene is named 'moon'; "
            "known: object, cuboid, slope, hand,"
        ),
    },
    VALUES: {"values: [up]": "vary.slope.values: 'turn' needs numbers"},
    "values: [45], unit: deg, turn: " + TURN: {
        "values: [0.3], key: friction": (
            ":4: vary.slope: sets friction, which 'friction.default' sets already; keep one of them"
        ),
    },
    "friction.default: " + RANGE: {
        "solve.algorithm: {values: [torque]}": (
            ": sets solve.algorithm, which 'compute' sets already; keep one of them"
        ),
    },
    LINES: {
        "[]": ": a study is a mapping with the keys scene, vary",
        "": ": the file is empty; a study needs scene and vary",
    },
    "friction.default": {
        "supports.slop.friction": (
            ":3: vary['supports.slop.friction'].key: supports.slop.friction: has no item named "
            "'slop'; did you mean 'slope'? known: slope"
        ),
        "supports.1.friction": ": has no item 1; it has 1 items, counted from 0",
        "object.mass.kilo": ": object.mass is 1.0 and has no keys below it",
        "solve.margin": (
            ":3: vary['solve.margin']: has no effect with algorithm 'margin'; use algorithm"
        ),
        "materials.rubber.cardboard": (
            ":3: vary['materials.rubber.cardboard']: sets materials.rubber.cardboard, which has "
            "no effect: the object is of no material, hand and supports are of no material"
        ),
    },
    GRID: {
        "{samples: 3}": ":6: sampling: 'samples' has no effect on a grid",
        "{method: sobol}": ":6: sampling: sobol needs 'samples', the number",
        "{method: sobol, samples: true}": (
            ":6: sampling.samples: found True; needs a whole number >= 1"
        ),
        "{method: sobol, samples: 4}": (
            ":3: vary['friction.default'].steps: has an effect only on a grid; leave it out"
        ),
        "{method: random}": (
            ":6: sampling.method: found 'random'; needs 'grid', 'latin_hypercube', 'sobol' or "
            "'adaptive'"
        ),
    },
    RANGE: {
        "{values: [1], from: 0, to: 1}": ": found values and a range;",
        "{from: 0, to: 1, steps: 2, scale: log}": (
            ": a log scale needs positive values, but 'from' is 0"
        ),
        "{values: [a], unit: '1'}": ".unit: requires numbers",
        "{values: [1], unit: kg}": ": 'kg' is not a unit of plain numbers; use 1",
        "{values: [1], unit: g, key: object.mas}": (
            ".key: object.mas: unknown key; did you mean 'mass'?"
        ),
        "{values: [1], set: [{key: object.mass, factor: 2}, {key: solve.margin, factor: 2}]}": (
            ": solve.margin has no effect with algorithm 'margin'; use algorithm 'torque'"
        ),
        "{values: [1], set: [{key: object.mass}, {key: gravity.0}]}": (
            "set: its keys have different units: object.mass (mass), gravity.0 (acceleration)"
        ),
    },
}

# Refused by the scene: what is replaced, by what, and the message.
CHECKING = {
    "friction.default": {
        "object.mas": (
            ":3: vary['object.mas']: at 0.2: {scene}:24: object.mas: unknown key; did you mean "
            "'mass'?"
        ),
        "friction.hands": (
            ":3: vary['friction.hands']: at 0.2: {scene}:4: scene: friction['hands']: is not "
            "the name of a body; did you mean 'hand'?"
        ),
    },
    "from: 0.2": {
        "from: -0.2": (
            ":3: vary['friction.default']: at -0.2: {scene}:6: friction.default: found -0.2; needs "
            "a finite number >= 0"
        ),
    },
    "friction.default: " + RANGE: {
        "object.mass: {values: [1, true]}": (
            ":3: vary['object.mass']: at True: {scene}:27: object.mass: found True; needs a finite "
            "number > 0"
        ),
        "solve.sign_rule: {values: [strict, loose]}": (
            "vary['solve.sign_rule']: at 'loose': {scene}:33: solve.sign_rule: found 'loose'; needs"
        ),
        "object.pose: {values: {lying: {position: [0, 0, 0]}, standing: 3}}": (
            ":3: vary['object.pose']: at 'standing': {scene}:28: object.pose: found 3; needs a "
            "mapping"
        ),
        "hand.q.hinge: {values: [0.1]}": (
            ":3: vary['hand.q.hinge']: at 0.1: {scene}:10: hand: q: unknown joint 'hinge'; known: "
            "finger_1/hinge, finger_6/hinge"
        ),
        "status: {values: [0.1], key: friction}": (
            ":3: vary.status: its column 'status' would have the name of another column of the "
            "results;"
        ),
    },
    "algorithm: margin": {
        "algorithm: margin, solver: simplex": (
            ": compute.solver: 'simplex' is unknown or not installed; available: clarabel,"
        ),
    },
}


def cases(mistakes):
    return [(old, *case) for old, those in mistakes.items() for case in those.items()]


def changed(folder, old, new):
    assert LINES.count(old) == 1, old
    file = folder / "study.yaml"
    file.write_text(LINES.replace(old, new).replace("SCENE", str(CUBOID)), encoding="utf-8")
    return file


@pytest.mark.parametrize(("old", "new", "message"), cases(LOADING))
def test_a_mistake_is_named(tmp_path, old, new, message):
    file = changed(tmp_path, old, new)
    with pytest.raises(StudyError) as error:
        load_study(file)
    assert str(error.value).startswith(str(file)) and message in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(("old", "new", "message"), cases(CHECKING))
def test_what_no_scene_can_be_is_refused_before_anything_runs(tmp_path, old, new, message):
    loaded = load_study(changed(tmp_path, old, new))
    here = Here()
    with pytest.raises(StudyError) as error:
        run_study(loaded, tmp_path / "out.csv", executor=here, progress=False)
    assert message.replace("{scene}", str(CUBOID)) in str(error.value)
    assert here.samples == [] and [file.name for file in tmp_path.iterdir()] == ["study.yaml"]


def test_a_solver_that_the_scene_names_is_named_in_the_scene(tmp_path):
    scene = yaml.safe_load(CUBOID.read_text(encoding="utf-8")) | {"solve": {"solver": "simplex"}}
    (tmp_path / "scene.yaml").write_text(yaml.safe_dump(scene), encoding="utf-8")
    content = {"scene": "scene.yaml", "vary": {"friction": {"values": [0.3]}}}
    loaded = load_study(study_file(tmp_path, content))
    with pytest.raises(StudyError, match=r"scene\.yaml: solve\.solver: 'simplex' is unknown"):
        run_study(loaded, tmp_path / "out.csv", executor=Here(), progress=False)


def test_what_is_no_path_is_no_study():
    with pytest.raises(ArgumentError, match="path: is a dict; it must be a path of a study file"):
        load_study({"scene": "scene.yaml"})  # pyright: ignore[reportArgumentType]


def test_a_scene_that_never_touches_is_refused(tmp_path):
    away = {"values": [1, 2, 3], "move": {"what": ["cuboid"], "along": [0, 0, 1]}}
    with pytest.raises(
        StudyError,
        match=r"none of 9 samples can be computed; with .*lift_m = 1: .*"
        r"nothing touches object 'cuboid' within 0\.001 m",
    ):
        run_study(
            study({"friction": {"values": [0.2, 0.3, 0.4]}, "lift": away}),
            tmp_path / "out.csv", executor=Here(), progress=False,
        )  # fmt: skip
    assert list(tmp_path.iterdir()) == []
    away = {"values": [2, 1, 0], "move": {"what": ["cuboid"], "along": [0, 0, 1]}}
    table = run_study(study({"lift": away}), tmp_path / "out.csv", executor=Here(), progress=False)
    assert table["status"].tolist() == ["failed", "failed", "optimal"]


def test_given_contacts_do_not_move(tmp_path):
    scene = yaml.safe_load(CUBOID.read_text(encoding="utf-8"))
    scene["contacts"] = [{"body": "slope", "position": [0, 0, 0], "normal": [1, 0, 1]}]
    file = tmp_path / "scene.yaml"
    file.write_text(yaml.safe_dump(scene), encoding="utf-8")
    content = {"scene": "scene.yaml", "vary": {"slope": SLOPE}}
    with pytest.raises(
        StudyError, match="turn: the scene states its contacts, which would not move"
    ):
        load_study(study_file(tmp_path, content))


def test_the_content_of_a_study_is_a_mapping() -> None:
    wrong: Any = [1]
    with pytest.raises(StudyError, match=r"^study: found \[1\]; needs a mapping of keys"):
        Study.from_data(wrong)


def test_a_wrong_scene_is_the_scenes_error(tmp_path):
    (tmp_path / "scene.yaml").write_text("friction: 0.3\n", encoding="utf-8")
    content = {"scene": "scene.yaml", "vary": {"height": HEIGHT}}
    with pytest.raises(SceneError, match=r"scene\.yaml:1: object: is missing"):
        load_study(study_file(tmp_path, content))
    with pytest.raises(StudyError, match=r"^study: vary\.friction: needs either 'values'"):
        study({"friction": {}})


@pytest.mark.parametrize(
    ("name", "message"),
    [
        ("out.xlsx", "'.xlsx' is not a known format; the name must end with .parquet or .csv"),
        ("out", "'no ending' is not a known format"),
        ("missing/out.csv", "there is no folder"),
        ("study.yaml/out.csv", "there is no folder"),
        ("folder.csv", "is a folder; name a file in it"),
    ],
)
def test_an_output_that_cannot_be_written(tmp_path, name, message):
    (tmp_path / "folder.csv").mkdir()
    (tmp_path / "study.yaml").touch()
    here = Here()
    with pytest.raises(StudyError, match=message):
        run_study(study(), tmp_path / name, executor=here, progress=False)
    assert here.samples == []


@pytest.mark.parametrize("workers", [0, -1, 1.5])
def test_workers_are_counted(tmp_path, workers):
    with pytest.raises(ValueError, match="workers: "):
        run_study(study(), tmp_path / "out.csv", workers=workers, progress=False)
