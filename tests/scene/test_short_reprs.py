"""What a prompt shows of a hand, a scene or an answer is a line or two, not its arrays."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from graspless_pin import (
    Evaluator,
    contact_force_bounds,
    disturbance_margin,
    load_scene,
    margin_torque_curve,
    optimum_gradients,
    place_hand,
    robustness,
)
from graspless_pin.planning import configuration_gradient
from graspless_pin.records import Brief

EXAMPLES = Path(__file__).resolve().parents[2] / "examples"


@pytest.fixture(scope="module")
def shown() -> dict[str, object]:
    scene = load_scene(EXAMPLES / "allegro_box_on_slope.yaml")
    plain = load_scene(EXAMPLES / "paper" / "cuboid_at_rest.yaml")
    solution, problem = plain.solve("margin"), plain.problem()
    hand = scene.hand
    assert hand is not None
    return {
        "scene": scene, "hand": hand, "tree": hand.tree, "mounts": hand.mounts[0],
        "robot": hand.mounts[0].source, "actuation": hand.actuation, "object": scene.object,
        "contacts": scene.contacts, "problem": scene.problem(), "solution": solution,
        "proof": solution.proof, "evidence": solution.evidence, "mode": solution.mode,
        "certificate": solution.certificate, "verdict": plain.stability(solution.torques),
        "forces": contact_force_bounds(problem, solution.torques, time_limit=0.1),
        "disturbances": disturbance_margin(problem, solution.torques, directions=np.eye(6)),
        "curve": margin_torque_curve(problem), "gradients": optimum_gradients(solution),
        "robustness": robustness(problem, solution.torques, time_limit=0.0),
        "evaluation": Evaluator(plain).evaluate(),
        "slopes": configuration_gradient(Evaluator(plain).evaluate()),
        "places": place_hand(
            load_scene(EXAMPLES / "trihand_push_box.yaml"), candidates=1, verdict_nodes=0,
            workers=1,
        ),
    }  # fmt: skip


def test_no_repr_is_long(shown) -> None:
    for name, record in shown.items():
        text = repr(record)
        assert len(text.splitlines()) <= 8 and len(text) <= 700, f"{name}: {text}"
        assert " object at 0x" not in text


def test_they_tell_what_is_what(shown) -> None:
    assert repr(shown["hand"]) == (
        "<Hand allegro_right: 16 joints, 16 actuators; fingers: index, middle, ring, thumb>"
    )
    assert repr(shown["disturbances"]).startswith(
        "DisturbanceMargin(status=OPTIMAL, directions=<array (6, 6)>, magnitudes="
    )
    assert repr(shown["object"]).startswith(
        "ManipulatedObject(name='box', shape=Box(size=(0.12, 0.16, 0.1)), mass=1, "
    )


@dataclass(frozen=True, eq=False, repr=False)
class Made(Brief):
    """A record of everything."""

    text: str
    few: tuple[object, ...]
    many: dict[int, int]
    none: list[int]
    numbers: object
    _hidden: int = 0


def test_long_values_are_cut() -> None:
    made = Made("x" * 1000, (1, 2.5, "three"), dict.fromkeys(range(9), 0), [], np.zeros(2))
    assert repr(made) == (
        f"Made(text='{'x' * 75}...', few=(1, 2.5, 'three'), "
        "many=<9 entries>, none=(), numbers=[0.0, 0.0])"
    )
