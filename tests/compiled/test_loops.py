"""The compiled loops find the contacts that Python finds, and refuse what does not fit."""

from __future__ import annotations

import shutil
import sys
import sysconfig
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from graspless_pin import Scene, compiled, load_scene
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.scene.stated import Motion

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.yaml"))
ARRAYS = (
    "positions", "normals", "tangents", "external_wrench", "jacobian", "friction", "sliding",
    "gravity_torques", "lower_torque", "upper_torque",
)  # fmt: skip

needs_loops = pytest.mark.skipif(
    compiled.core is None, reason="the loops are not compiled: there is no C compiler"
)


def test_the_loops_are_compiled_where_there_is_a_compiler() -> None:
    headers = Path(sysconfig.get_path("include"), "Python.h")
    if not any(map(shutil.which, ("cc", "gcc", "clang"))) or not headers.exists():
        pytest.skip("there is no C compiler, or none of Python's headers")
    assert compiled.core.__file__.endswith((".so", ".pyd"))


def test_without_the_loops_no_module_has_them(without_loops: None) -> None:
    holders = [
        name
        for name, module in sys.modules.items()
        if name.startswith("graspless_pin.")
        and module is not compiled
        and getattr(module, "core", None) is not None
    ]
    assert not holders


@pytest.mark.sampled(4)
@needs_loops
@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_every_example_is_the_same_problem(path: Path, outcome, by_numpy) -> None:
    if "scene:" in path.read_text():
        pytest.skip("a study, not a scene")
    rng = np.random.default_rng(1)
    scene = load_scene(path)
    twist = np.concatenate([0.05 * scene.object.T_world_object[:3, 0], [0.0, 0.0, 0.3]])
    for moving in (None, Motion(twist), Motion(np.zeros(6))):
        for _ in range(10):
            posed = moved(scene, rng)
            if moving is not None:
                posed = posed.with_changes(motion=moving)
            fresh = posed.with_changes()
            ours, theirs = outcome(posed.problem), by_numpy(fresh.problem)
            if isinstance(theirs, tuple):
                assert ours == theirs
                continue
            assert isinstance(ours, QuasistaticProblem)
            assert posed.contacts.arrays.bodies == fresh.contacts.arrays.bodies
            for name in ARRAYS:
                assert not getattr(ours, name).flags.writeable
                np.testing.assert_allclose(
                    getattr(ours, name), getattr(theirs, name), rtol=0, atol=1e-12, err_msg=name
                )


def moved(scene: Scene, rng: np.random.Generator) -> Scene:
    """The scene with the hand and the object moved by up to 0.2 mm and mrad."""
    T = np.array(scene.object.T_world_object)
    T[:3, 3] += rng.uniform(-2e-4, 2e-4, 3)
    changes: dict[str, object] = {"object": scene.object.with_pose(T)}
    if scene.hand is not None:
        leaders = list(scene.hand.tree.coupling.leaders)
        lower, upper = scene.hand.tree.lower[leaders], scene.hand.tree.upper[leaders]
        q = scene.hand.positions[leaders] + rng.uniform(-2e-4, 2e-4, len(leaders))
        changes["hand"] = scene.hand.with_configuration(np.clip(q, lower, upper))
    return scene.with_changes(**changes)


ONES = np.ones((2, 3))
TWO = np.ones(2)
POSES = np.repeat(np.eye(4)[None], 2, axis=0)


def sets_arguments(**changes):
    values = {
        "kinds": [1], "bodies": [0], "centers": ONES[:1], "half_extents": ONES[:1],
        "reaches": [1], "planes": [[0] * 4], "starts": [0, 0], "faces": np.ones((0, 4)),
    }  # fmt: skip
    return tuple((values | changes).values())


@needs_loops
def test_one_pose_for_each_set() -> None:
    assert compiled.core is not None
    sets = compiled.core.ConvexSets(*sets_arguments(kinds=[compiled.core.BALL]))
    given: dict[str, Any] = {
        "coupling": np.empty((0, 0)), "offset": [], "lower": [], "upper": [], "gravity": np.ones(3),
        "carriers": [0], "shapes": POSES[:1], "links": sets, "pieces": sets, "poses": POSES[:1],
        "pairs": compiled.core.BodyPairs(sets, [0], [0]), "around": sets,
        "around_poses": POSES[:1], "tolerance": 1e-3, "max_penetration": 5e-3, "parents": [0],
        "placements": POSES[:1], "axes": np.empty((0, 6)), "masses": [1.0], "centers": ONES[:1],
    }  # fmt: skip
    make: Any = compiled.core.HandStates
    make(**given)
    for name in ("shapes", "poses", "around_poses", "placements"):
        with pytest.raises(ValueError, match="one pose for each set"):
            make(**(given | {name: POSES}))
    with pytest.raises(ValueError, match="sets that exist"):
        compiled.core.BodyPairs(sets, [0], [1])
    with pytest.raises(TypeError):
        make(**(given | {"around": None}))


def program_arguments(**changes):
    values = {
        "kind": 1, "required": 0.1, "turns": [True], "axes": [0, 3], "sides": np.ones((3, 2)),
        "face_count": 0, "reach": np.ones((2, 2)), "has_cone": np.ones(2, bool), "friction": TWO,
        "slopes": TWO, "directions": np.ones((2, 8)), "least_lever": 1e-12, "rounding": 1e-12,
        "farthest": 1e8, "least_limit": 1e-3, "most_strict": 1e6,
    }  # fmt: skip
    return tuple((values | changes).values())


def start_arguments(**changes):
    assert compiled.core is not None
    values = {
        "programs": compiled.core.PaperPrograms(*program_arguments()), "rows": [0, 8],
        "at_bounds": [1], "upper": np.ones(3, bool), "x": np.ones(3), "weights": np.ones(3),
        "count": 9, "signs": np.ones((2, 2)), "contacts": [1], "own_signs": TWO,
        "motion": np.ones(7), "judged_by": (0.0, 2, 1.0, 1.0),
    }  # fmt: skip
    return tuple((values | changes).values())


WRONG = {
    "ConvexSets": [
        {"bodies": [1]}, {"starts": [0, 1], "faces": np.ones((2, 4))},
        {"starts": [-1, 2], "faces": np.ones((2, 4))}, {"kinds": [3]}, {"centers": ONES},
    ],
    "PaperPrograms": [
        {"axes": [0, 6]}, {"axes": [-1, 3]}, {"axes": [0]}, {"face_count": 1}, {"face_count": -1},
        {"friction": np.ones(3)}, {"reach": np.ones((2, 3))},
    ],
    "Start": [
        {"rows": [9]}, {"rows": [-1, 8]}, {"at_bounds": [3]}, {"upper": np.ones(2, bool)},
        {"x": np.ones(2)}, {"weights": np.ones(2)}, {"count": 7}, {"count": 12},
        {"signs": np.ones((3, 2))}, {"contacts": [2]}, {"own_signs": np.ones(3)},
        {"motion": np.ones(6)},
    ],
}  # fmt: skip
FITTING = {
    "ConvexSets": sets_arguments, "PaperPrograms": program_arguments, "Start": start_arguments
}  # fmt: skip


@needs_loops
@pytest.mark.parametrize("kind", WRONG)
def test_what_does_not_fit_is_refused(kind) -> None:
    make = getattr(compiled.core, kind)
    make(*FITTING[kind]())
    for changes in WRONG[kind]:
        with pytest.raises(ValueError):
            make(*FITTING[kind](**changes))
