"""Three fingertips push a box: from a poor start, slide them over its face to a better margin.

The margin is a smallest of many things and has kinks, so each step is a linear program within a
trust region: the gradient of the margin by the joints, from the multipliers of one solve, subject
to joint limits and to all fingertips staying in touch.
"""

from pathlib import Path

import numpy as np
from scipy.optimize import linprog

from graspless_pin import Evaluator, load_scene
from graspless_pin.geometry import place_fingertips
from graspless_pin.planning import configuration_gradient

scene = load_scene(Path(__file__).parent / "trihand_push_box.yaml")
rear = scene.object.T_world_object[0, 3] - 0.06  # m, the face that is pushed
start = {  # (y, z) of each fingertip, m: close to each other and high on one side
    "finger_1": (0.008, 0.079),
    "finger_2": (-0.010, 0.059),
    "finger_3": (0.051, 0.043),
}
goals = {name: (np.array([rear, y, z]), np.array([1, 0, 0])) for name, (y, z) in start.items()}
if scene.hand is None:
    raise SystemExit("the scene has no hand")
placement = place_fingertips(scene.hand, scene.object, goals)
print(placement)

evaluator = Evaluator(scene.with_changes(hand=placement.hand), algorithm="margin")
lower, upper = evaluator.joint_limits  # rad
q, state = evaluator.configuration(), evaluator.evaluate()
radius = 0.05  # rad, of the trust region
print(f"margin at the start {state.margin:.4f} N")
steps = 0
while radius > 1e-4:
    steps += 1
    gradient = configuration_gradient(state)
    move = linprog(
        -gradient.values,  # N per rad
        A_eq=gradient.gap_gradient,  # m per rad: gaps that opened before are closed again
        b_eq=-gradient.gaps,
        bounds=np.column_stack([np.maximum(lower - q, -radius), np.minimum(upper - q, radius)]),
    )
    trial = evaluator.evaluate(q + move.x) if move.success else state
    touches_alike = trial.found and trial.contacts.bodies == state.contacts.bodies
    if touches_alike and trial.margin > state.margin + 1e-5:
        q, state = q + move.x, trial
        radius = min(1.5 * radius, 0.2)
    else:
        radius *= 0.3
print(f"margin after {steps} steps {state.margin:.4f} N")
for point in state.contacts.points[:3]:
    _, y, z = 1e3 * point.position
    print(f"{point.body}: y {y:+6.1f} mm, z {z:5.1f} mm, gap {1e3 * point.distance:+.3f} mm")
