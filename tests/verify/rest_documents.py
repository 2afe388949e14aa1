"""Bodies at rest and in declared motion, what their documents say, and ways to tamper with it."""

import json
from functools import cache, partial

import numpy as np
from tests.oracles.compared_outcomes import outcome_case
from tests.oracles.outcomes import enumerate_outcomes

from graspless_pin import QuasistaticProblem, maximize_margin, stability
from graspless_pin.report import solution_document
from graspless_pin.report.verify import verify_document
from graspless_pin.report.verify.reading import read_problem
from graspless_pin.report.verify.rest_bounds import (
    RestMultipliers,
    commanded_contacts,
    largest_goal,
    rest_dynamics,
)

G = 9.81
ONE_KILOGRAM = np.diag([1.0] * 3 + [1e-3] * 3)
FEET = [[0.05, 0.0, -0.02], [-0.05, 0.05, -0.02], [-0.05, -0.05, -0.02]]


def slope(angle=0.3, friction=0.5):
    """A block of 1 kg on three points; near its critical angle, atan(0.5), a tree proves it."""
    weight = [G * np.sin(angle), 0.0, -G * np.cos(angle), 0.0, 0.0, 0.0]
    return QuasistaticProblem(FEET, [[0, 0, 1]] * 3, weight, friction=friction, cone="round",
                              object_inertia=ONE_KILOGRAM)  # fmt: skip


def corners():
    """A block of 1 kg on a slope with a step: three corners that are closed close the fourth."""
    feet = [[x, y, 0.1 * y - 0.02] for x in (-0.05, 0.05) for y in (-0.05, 0.05)]
    return QuasistaticProblem(feet, [[0, 0, 1]] * 4, slope().external_wrench, friction=0.5,
                              cone="round", object_inertia=ONE_KILOGRAM)  # fmt: skip


def walls(friction=0.5):
    """A body between two walls that do not press."""
    sides, normals = [[-0.05, 0, 0], [0.05, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
    return QuasistaticProblem(sides, normals, [0, 0, -G, 0, 0, 0], friction=friction,
                              cone="round", object_inertia=ONE_KILOGRAM)  # fmt: skip


def gliding():
    """A block that glides down a gentle slope without friction, between two walls that rub."""
    sides, normals = [[0.0, -0.05, 0.0], [0.0, 0.05, 0.0]], [[0, 1, 0], [0, -1, 0]]
    return QuasistaticProblem(
        [*FEET, *sides], [[0, 0, 1]] * 3 + normals, slope(0.05).external_wrench,
        friction=[0.0] * 3 + [0.5] * 2, cone="round", object_inertia=ONE_KILOGRAM,
    )  # fmt: skip


def pressed():
    """A block on a steep slope under a lever, whose least load the proof needs."""
    block = slope(0.6)
    jacobian = np.zeros((12, 1))
    jacobian[11] = -0.1
    return QuasistaticProblem(
        [*FEET, [0.0, 0.0, 0.03]], [*block.normals, [0.0, 0.0, -1.0]], block.external_wrench,
        jacobian, friction=0.5, cone="round", torque_limits=(0.2, 0.2),
        object_inertia=ONE_KILOGRAM, joint_inertia=[[0.01]],
    )  # fmt: skip


def hybrid():
    """The same under a hybrid finger of 2 N."""
    jacobian = np.zeros((12, 1))
    jacobian[11] = -1.0
    return pressed().with_changes(jacobian=jacobian, torque_limits=(2.0, 2.0),
                                  joint_inertia=[[0.0]], joint_units=["N"])  # fmt: skip


def pushed():
    """A block of 1 kg that slides along x on three feet, pushed and carried by two joints."""
    jacobian = np.zeros((12, 2))
    jacobian[9, 0] = jacobian[11, 1] = 1.0
    return QuasistaticProblem(
        [*FEET, [-0.05, 0.0, 0.0]], [[0, 0, 1]] * 3 + [[1, 0, 0]], [0, 0, -G, 0, 0, 0], jacobian,
        friction=[0.5] * 3 + [0.4], sliding=[[0.1, 0, 0]] * 3 + [[0, 0, 0]], cone="round",
        torque_limits=(-100.0, 100.0), joint_units=["N", "N"],
        object_inertia=ONE_KILOGRAM, joint_inertia=np.diag([0.1, 0.1]),
    )  # fmt: skip


def stiff():
    """The same with a finger that may carry some of the weight."""
    whole = pushed()
    return whole.with_changes(jacobian=whole.jacobian[:, :1], joint_inertia=[[0.1]],
                              joint_units=["N"], joint_names=["push"], gravity_torques=[0.0],
                              torque_limits=(-100.0, 100.0))  # fmt: skip


CASES = {
    "slope": (partial(slope, 0.45), None), "walls": (walls, None), "pressed": (pressed, None),
    "hybrid": (hybrid, None), "corners": (corners, None), "smooth": (lambda: slope(0.0, 0.0), None),
    "gliding": (gliding, None), "unrest": (pressed, (0.1,)),
    "weightless": (lambda: slope().with_changes(external_wrench=np.zeros(6)), None),
    "kept": (pushed, (0.5 * G, 0.0)), "lost": (stiff, (0.5 * G,)), "slow": (stiff, (0.3 * G,)),
}  # fmt: skip
"""Problems, and torques that the verdict is on; None: those of the solution."""


@cache
def document(name):
    """A document as it comes back from a file, of the solution or of other torques."""
    make, torques = CASES[name]
    solution = maximize_margin(make(), static_friction="coulomb")
    if torques is None:
        torques = solution.torques
    made = solution_document(solution, verdict=stability(solution.problem, torques))
    for joint, own in zip(made["joints"], torques, strict=True):
        joint["torque"] = float(own)
    return json.loads(json.dumps(made))


def rest_lines(made):
    """What is said of the verdict: the checks after those of the solution."""
    lines = verify_document(made).checks
    return lines[[line.name for line in lines].index("inertias") :]


def failures(made):
    """Names of what is said of the verdict and is not so."""
    return {line.name for line in rest_lines(made) if line.passed is False}


def is_refused(made):
    """Whether something is said not to be so, or the document is none."""
    try:
        return bool(failures(made))
    except ValueError:
        return True


def leaves(nodes):
    """Index of each leaf, and of its parent."""
    waiting, found = [], []
    for index, node in enumerate(nodes):
        while waiting and waiting[-1][1] == 0:
            waiting.pop()
        parent = None
        if waiting:
            parent = waiting[-1][0]
            waiting[-1][1] -= 1
        if not node["children"]:
            found.append((index, parent))
        waiting.append([index, node["children"]])
    return found


def zeroed(multipliers):
    return json.loads(json.dumps(multipliers), parse_float=lambda _: 0.0)


def times(factor):
    return lambda value: (factor * np.array(value)).tolist()


class StatedBody:
    """A seeded body as the checker reads it: its dynamics under a load, and outcomes in them."""

    def __init__(self, case, problem, **options):
        document = solution_document(maximize_margin(problem, **options))
        self.problem = read_problem(json.loads(json.dumps(document)))
        self.load = np.concatenate([case.external_wrench, case.torques])
        self._inertia = np.zeros((len(self.load),) * 2)
        self._inertia[:6, :6], self._inertia[6:, 6:] = case.object_inertia, case.joint_inertia
        self._commanded = commanded_contacts(self.problem, case.joint_inertia)

    def dynamics(self, load):
        found = rest_dynamics(self.problem, load, self._inertia, self._commanded)
        assert found is not None
        return found

    def coordinates(self, dynamics, acceleration, forces):
        """The acceleration and the forces of an outcome, in the checker's own units."""
        y = np.linalg.lstsq(dynamics.accelerations, acceleration, rcond=None)[0]
        return y, np.einsum("lij,lj->li", self.problem.frames, forces) / dynamics.force_unit


def seeded(number):
    """A seeded body, and an outcome of its own load."""
    case, problem = outcome_case(3, number)
    outcome = enumerate_outcomes(case, sectors=8).outcome
    assert outcome is not None
    return StatedBody(case, problem), outcome


def slack_of(dynamics, states, y, f, rng, **options):
    """How far a random bound on what is known of an outcome lies above what the outcome reaches."""
    loads, multipliers, goal = random_bound(dynamics, f, rng, **options)
    bound = largest_goal(dynamics, states, loads, multipliers, goal, float(f[:, 0].max()))
    return bound - float(goal[0] @ y + (goal[1] * f).sum())


def random_bound(dynamics, f, rng, *, tangential=1.0):
    """Loads below an outcome's forces, multipliers, and a goal of which they leave little.

    So no term of the bound hides another.
    """
    loads = np.maximum(f[:, 0], 0.0) * rng.integers(0, 2, len(f))
    motion, normal = rng.normal(size=dynamics.rows.shape[2]), rng.normal(size=len(f))
    rubbing = tangential * rng.normal(size=(len(f), 2))
    rest, least = np.column_stack([normal, rubbing]), rng.choice([0.0, 1e-3, 1.0])
    goal = (
        motion - np.einsum("li,lin->n", rest, dynamics.rows) + least * rng.normal(size=len(motion)),
        least * rng.normal(size=f.shape) - dynamics.rows @ motion,
    )
    return loads, RestMultipliers(motion, normal, rubbing), goal
