"""A row of results: what stands in it of torques that were found."""

from __future__ import annotations

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.findings import Finding, Severity, gravest_first
from graspless_pin.problem.checks import JointUnit
from graspless_pin.scene.scene import Scene

Row = dict[str, Any]
"""Results by column."""

LARGEST_TORQUE = "max_torque_"
"""Begin of the names of columns with the largest |torque| of the joints of one unit."""
_SUFFIXES = {unit: unit.replace(" ", "") for unit in JointUnit}
"""What ends the name of a column, by unit."""


OBJECTIVE_VALUE = "objective_value"
"""Name of the column of the optimum of an objective that is none of Algorithms 1 and 2."""
ROBUST_COLUMNS = (
    "robust_status", "robust_found", "robust_coverage", "robust_margin_N",
    f"robust_{LARGEST_TORQUE}Nm", f"robust_{LARGEST_TORQUE}N", "robust_sampled_share",
)  # fmt: skip
"""Names of the columns of torques for all that is not known of a scene."""
FINDINGS = "findings"
"""Name of the column of serious findings; empty without any."""


def of_findings(scene: Scene, found: Sequence[Finding]) -> Row:
    """Return the codes of serious findings as they stand in a row: in the order of their gravity.

    Args:
        scene: The scene of the sample; what its files told counts, too.
        found: See `state_findings`.
    """
    loaded = (*scene.load_findings, *(() if scene.hand is None else scene.hand.findings))
    if not (loaded or found):
        return {}
    serious = [one for one in gravest_first([*loaded, *found]) if one.severity is Severity.SERIOUS]
    return {FINDINGS: "; ".join(dict.fromkeys(one.code for one in serious))} if serious else {}


class TorqueColumns(NamedTuple):
    """The columns of the torques of some joints.

    Attributes:
        largest: Of each unit that there is the column of its largest |torque|, and the joints.
        each: L columns.
    """

    largest: tuple[tuple[str, tuple[int, ...]], ...]
    each: tuple[str, ...]

    def values(self, margin: float, torques: Sequence[float]) -> Row:
        """Return margin (N) and L torques (N m or N) by column."""
        row: Row = {name: max([abs(torques[k]) for k in own], default=0.0)
                    for name, own in self.largest}  # fmt: skip
        row["margin_N"] = margin
        row.update(zip(self.each, torques, strict=True))
        return row


@lru_cache(maxsize=64)
def torque_columns(names: tuple[str, ...], units: tuple[JointUnit, ...]) -> TorqueColumns:
    """Return the columns of joints by their names and the units of their torques."""
    there = [unit for unit in JointUnit if unit in units] or [JointUnit.TORQUE]
    largest = tuple([
        (LARGEST_TORQUE + _SUFFIXES[one], tuple([k for k, unit in enumerate(units) if unit is one]))
        for one in there
    ])  # fmt: skip
    each = [f"torque_{name}_{_SUFFIXES[unit]}" for name, unit in zip(names, units, strict=True)]
    return TorqueColumns(largest, tuple(each))


def robust_values(found: RobustSolution) -> Row:
    """Return what stands in a row of torques for all that is not known of a scene."""
    row: Row = {
        "robust_status": found.status.name.lower(),
        "robust_found": found.found,
        "robust_coverage": found.coverage.name.lower(),
    }
    if not found.found:
        return row
    row["robust_margin_N"] = found.margin
    if found.samples is not None:
        row["robust_sampled_share"] = found.samples.served / found.samples.count
    units, largest = found.members[0].problem.joint_units, found.largest_commands
    columns = torque_columns(found.joint_names, units)
    for name, joints in columns.largest:
        row[f"robust_{name}"] = float(largest[list(joints)].max(initial=0.0))
    return row
