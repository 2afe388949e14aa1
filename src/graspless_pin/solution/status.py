"""What is known of a problem when a search has ended."""

from enum import Enum


class Status(Enum):
    """What is known of the problem; the value is the message.

    Examples:
        >>> from graspless_pin import Status, explain, load_scene, minimize_torque
        >>> problem = load_scene("examples/paper/cuboid_at_rest.yaml").problem()
        >>> solution = minimize_torque(problem, margin=30.0)
        >>> solution.status is Status.INFEASIBLE_FORCES
        True
        >>> print(explain(solution).suggestions[0].text)
        the required margin would have to be at most 1.6503 N
    """

    OPTIMAL = "optimal over all feasible virtual-sliding modes"
    OPTIMAL_IN_MODE = "optimal in the given virtual-sliding mode"
    LIMIT_REACHED = (
        "the best found; that nothing is better was not proven (a node or time limit, a program "
        "that no solver answered, or a proof that does not close)"
    )
    INFEASIBLE_FORCES = (
        "infeasible: no contact forces inside the cones, normal-force and torque limits balance "
        "the external wrench with the required margin"
    )
    INFEASIBLE_MODES = (
        "infeasible: forces that balance exist, but none whose friction opposes a kinematically "
        "feasible virtual sliding"
    )
    INFEASIBLE_IN_MODE = "infeasible in the given virtual-sliding mode"
    INFEASIBLE_MODE = "the given virtual-sliding mode has no virtual motion behind it"
    NOT_FOUND_IN_LIMIT = "nothing found when a node or time limit ended the search"
    UNVERIFIED = "no solver gave an answer that passes the check"
    LOAD_TOO_LARGE = (
        "the load is too large for the limits: what they leave to the joints is lost in the "
        "rounding of the balance"
    )
    STRONG = "the best found of the torques of which rest is the only outcome"
    STRONG_NOT_FOUND = (
        "no torques found of which rest is the only outcome; that there are none is not proven"
    )
    INFEASIBLE_STRONG = "infeasible: rest is the only outcome of no torques"

    @property
    def message(self) -> str:
        """The message in words."""
        return self.value


UNDECIDED = frozenset(
    {Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED, Status.LOAD_TOO_LARGE, Status.STRONG_NOT_FOUND}
)
"""What leaves open whether there is a solution."""
FOUND = frozenset({Status.OPTIMAL, Status.OPTIMAL_IN_MODE, Status.LIMIT_REACHED, Status.STRONG})
