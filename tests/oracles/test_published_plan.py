"""What `make published-plan` reads, here with the example's plan in the layout of that folder."""

from pathlib import Path

import numpy as np
import yaml
from tests.oracles.published_plan import judged, read_plan

from graspless_pin.planning import StateStatus

PLAN = Path(__file__).resolve().parents[2] / "examples" / "pivot_against_wall.csv"
SETUP = {
    "box_object": {"shape": [0.2, 0.2, 0.1]},
    "environment": {
        "floor": {"dimension": [2, 2, 1], "location": [0, 0, -0.5]},
        "wall": {"dimension": [1, 2, 1], "location": [0.5, 0, 0.5]},
    },
    "robot_object_friction_coefficient": 0.4,
    "environment_object_friction_coefficient": 0.2,
    "object_weight": [0, 0, -9.81, 0, 0, 0],
}


def test_states_and_motions_of_the_examples_plan(tmp_path):
    rows = np.loadtxt(PLAN, delimiter=",", skiprows=1)
    # A second finger touches nothing.
    rows = np.hstack([rows[:, :6], np.full((13, 6), np.nan), rows[:, 6:]])
    (tmp_path / "setup.yaml").write_text(yaml.safe_dump(SETUP), encoding="utf-8")
    np.savetxt(tmp_path / "output.csv", rows, delimiter=", ")
    plan = read_plan(tmp_path)
    assert plan.q.shape == (13, 6) and plan.scene.object.mass == 1.0
    rest, moving = judged(tmp_path)
    assert rest.found.all() and set(rest.contact_counts[1:]) == {5}
    # At the first state the whole face lies at the wall, of which no motion leaves but one edge.
    assert moving.statuses[0] is not StateStatus.FOUND and moving.found[1:].all()
    heavier = SETUP | {"object_weight": [0, 0, -981.0, 0, 0, 0]}
    (tmp_path / "setup.yaml").write_text(yaml.safe_dump(heavier), encoding="utf-8")
    assert not judged(tmp_path)[0].found[1:].any()
