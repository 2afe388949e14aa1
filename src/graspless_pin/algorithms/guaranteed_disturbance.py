"""The largest disturbances up to which rest stays the only outcome, direction by direction."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from graspless_pin.algorithms.disturbances import unit_disturbances
from graspless_pin.algorithms.load_brackets import LoadBracket, bracket_limits, load_bracket
from graspless_pin.errors import NoSolutionError
from graspless_pin.holding.stability import stability
from graspless_pin.holding.verdict import Stability, StabilityVerdict
from graspless_pin.problem import QuasistaticProblem
from graspless_pin.problem.checks import FloatArray, read_only, real_number
from graspless_pin.problem.scales import passive_levers
from graspless_pin.problem.wrenches import load_words
from graspless_pin.records import Brief


@dataclass(frozen=True, eq=False, repr=False)
class GuaranteedDisturbance(Brief):
    """What disturbances certainly do no harm, which may, and which certainly do.

    Along direction d the disturbance of magnitude t is t [d_f; characteristic_length * d_m].

    See the example of `guaranteed_disturbance`.

    Attributes:
        verdict: On the torques without disturbance.
        directions: (K, P) unit directions [force; moment / characteristic length].
        brackets: K brackets of the magnitude with their proofs; none where rest is not the only
            outcome even without disturbance.
        characteristic_length: m; what makes a moment comparable to a force.
        largest: Magnitudes up to this were looked at, N.
    """

    verdict: StabilityVerdict
    directions: FloatArray
    brackets: tuple[LoadBracket, ...]
    characteristic_length: float
    largest: float

    @property
    def guaranteed(self) -> FloatArray:
        """(K,) N: rest is proven to be the only outcome of every magnitude from zero up to this.

        NaN where it is not even without disturbance, and where `reached` is False.
        """
        return self._each("guaranteed")

    @property
    def failing(self) -> FloatArray:
        """(K,) N: the smallest magnitude found at which the object may or must move.

        inf where none was found up to `largest`, NaN where `reached` is False. Between `guaranteed`
        and this it is open what happens.
        """
        return self._each("failing")

    @property
    def possible(self) -> FloatArray:
        """(K,) N: the largest magnitude that forces in round cones without limits balance.

        As far as was looked: the best case. Beyond it rest is no outcome.
        """
        return self._each("possible")

    @property
    def complete(self) -> NDArray[np.bool_]:
        """(K,) whether the search came to its end; False where `time_limit` ended it before.

        Then the other figures are what was proven and found by then.
        """
        decided = self.verdict.status is not Stability.UNDECIDED
        return self._each("complete", without=decided)

    @property
    def reached(self) -> NDArray[np.bool_]:
        """(K,) whether a direction was looked at; where not, its other figures are NaN."""
        return self._each("reached", without=False)

    @property
    def failures(self) -> tuple[StabilityVerdict | None, ...]:
        """K verdicts at `failing`; None where that is inf."""
        return tuple(one.failure for one in self.brackets) or (None,) * len(self.directions)

    def _each(self, name: str, *, without: float | bool = np.nan) -> NDArray[Any]:
        """Return (K,) an attribute of all brackets, or what it is where there are none."""
        found = [getattr(one, name) for one in self.brackets]
        return read_only(np.array(found or [without] * len(self.directions)))

    @property
    def found(self) -> bool:
        """Whether rest is the only outcome without disturbance."""
        return self.verdict.status is Stability.STRONG

    @property
    def worst(self) -> int:
        """Index of the direction, of those that were reached, in which the least is guaranteed.

        Raises:
            NoSolutionError: If nothing is, not even without disturbance, or none was reached.
        """
        if not self.found:
            raise NoSolutionError(f"No disturbance is guaranteed to be borne ({self.verdict}).")
        if not self.reached.any():
            raise NoSolutionError("No direction was reached before the time was over.")
        return int(np.nanargmin(self.guaranteed))

    def __str__(self) -> str:
        """Return one line: the direction in which the least is guaranteed."""
        if not self.found:
            return f"nothing guaranteed: {self.verdict}"
        if not self.reached.any():
            return (
                f"none of {len(self.directions)} directions was reached: the time was over before"
            )
        at = self.worst
        units = self.verdict.problem.passive_units
        wrench = self.directions[at] * passive_levers(units, self.characteristic_length)
        missed = int(np.sum(~self.reached))
        short = int(np.sum(~self.complete)) - missed
        ended = f"; the time was over before the end of {short} directions" if short else ""
        ended += f"; not reached: {missed}" if missed else ""
        return (
            f"least of {len(self.directions)} directions, per newton of "
            f"{load_words(wrench, units, joined=' and ')}: {self.brackets[at].words('N')}{ended}"
        )


def guaranteed_disturbance(
    problem: QuasistaticProblem,
    torques: ArrayLike,
    directions: ArrayLike | None = None,
    *,
    characteristic_length: float | None = None,
    largest: float | None = None,
    precision: float = 0.02,
    node_limit: int = 1000,
    acceleration_resolution: float = 1e-3,
    time_limit: float | None = None,
) -> GuaranteedDisturbance:
    """Bracket the largest disturbance up to which rest stays the only outcome, in each direction.

    `disturbance_margin` tells what can be borne if the contact forces are the best ones; this tells
    what is borne whichever they are. Each lower end is proven for all magnitudes up to it, not only
    for those that were tried; each upper end has a verdict that shows a motion, or that rest is no
    outcome.

    Args:
        problem: At rest, with `object_inertia` and `joint_inertia`.
        torques: (L,) the motors' torques, N m (N).
        directions: As of `disturbance_margin`; None: its 76, which may take minutes.
        characteristic_length: As of `disturbance_margin`, m.
        largest: Magnitudes up to this are looked at, N; None: ten loads.
        precision: Relative width of the brackets with which the search ends, where it gets so far.
        node_limit: Sets of outcomes that each tree of a proof may look at; a third of what one
            verdict alone may, since each direction takes several.
        acceleration_resolution: As of `stability`; of the load without disturbance.
        time_limit: Seconds in all; None: any time. What is proven by then is returned, and
            `complete` tells of which directions it is all that was asked for.

    Raises:
        ArgumentError: If an argument is wrong.

    Examples:
        >>> import numpy as np
        >>> from graspless_pin import QuasistaticProblem, guaranteed_disturbance
        >>> feet = [[0.1, 0.0, -0.05], [-0.1, 0.1, -0.05], [-0.1, -0.1, -0.05]]  # m
        >>> normals, weight = [[0.0, 0.0, 1.0]] * 3, [0.0, 0.0, -4.9, 0.0, 0.0, 0.0]
        >>> inertia = np.diag([0.5, 0.5, 0.5, 1e-3, 1e-3, 1e-3])
        >>> stool = QuasistaticProblem(feet, normals, weight, friction=0.5, object_inertia=inertia)
        >>> found = guaranteed_disturbance(stool, [], [[1, 0, 0, 0, 0, 0]], precision=0.1)
        >>> print(f"pushed along x it stays up to {found.guaranteed[0]:.1f} N at least")
        pushed along x it stays up to 2.4 N at least
    """
    limits = bracket_limits(problem, precision, node_limit, time_limit)
    units, length = unit_disturbances(problem, directions, characteristic_length)
    most = 10.0 * problem.scales.force if largest is None else real_number("largest", largest, 0.0)
    verdict = stability(
        problem, torques, acceleration_resolution=acceleration_resolution, time_limit=limits.left
    )
    brackets: tuple[LoadBracket, ...] = ()
    if verdict.status is Stability.STRONG:
        scale = passive_levers(problem.passive_units, length)
        still = np.zeros(problem.joint_count)
        brackets = tuple(
            load_bracket(verdict, np.concatenate([scale * unit, still]), most, precision, limits)
            for unit in units
        )
    return GuaranteedDisturbance(verdict, units, brackets, length, float(most))
