"""coal takes boxes at their size in every process, whatever it measured there first."""

import json
import subprocess
import sys

import pytest

MEASURED = """
import json
import sys
import coal
import numpy as np
from scipy.spatial.transform import Rotation
from graspless_pin.geometry.bodies.collision import CollisionBody
from graspless_pin.geometry.contact.distances import separation

def gap(turn):
    T = np.eye(4)
    T[:3, :3] = Rotation.from_rotvec(turn).as_matrix()
    T[:3, 3] = 0.0, 0.0, 0.6
    box = CollisionBody("box", coal.Box(0.3, 0.2, 0.1), T)
    return separation(CollisionBody("other", other, np.eye(4)), box).distance

other = {
    "plane": coal.Halfspace(np.array([0, 0, 1.0]), 0.0),
    "ellipsoid": coal.Ellipsoid(0.06, 0.05, 0.04),
}[sys.argv[1]]
turns = np.zeros(3), np.array([0.3, 0.5, 0.7])
gap(turns[int(sys.argv[2])])
print(json.dumps([gap(turn) for turn in turns]))
"""


@pytest.mark.parametrize(("other", "height"), [("plane", 0.0), ("ellipsoid", 0.04)])
def test_gaps_of_boxes_do_not_depend_on_what_a_process_measured_first(other, height) -> None:
    straight, turned = (
        json.loads(
            subprocess.run(  # noqa: S603 - this interpreter
                [sys.executable, "-c", MEASURED, other, first],
                check=True,
                stdout=subprocess.PIPE,
            ).stdout
        )
        for first in "01"
    )
    assert straight == turned
    assert straight[0] == pytest.approx(0.55 - height, abs=2e-12)
