"""Samples of a study: their scenes, what each leaves for the next, and what stands in a row.

A hand is placed where a place is found, or closed, before its sample is computed.
"""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import dataclass, field
from functools import lru_cache
from typing import Any, NamedTuple

from graspless_pin.algorithms.robust_solution import RobustSolution
from graspless_pin.caching import Bounded, is_alike
from graspless_pin.findings import Finding, Severity, gravest_first
from graspless_pin.planning.placing import HandPlacement, place_hand
from graspless_pin.problem.checks import JointUnit
from graspless_pin.scene.body_building import SceneParts
from graspless_pin.scene.keys import Tree
from graspless_pin.scene.load import FIELDS_BY_KEY
from graspless_pin.scene.poses import close_fingers
from graspless_pin.scene.scene import Scene
from graspless_pin.scene.yaml_source import YamlSource, validated
from graspless_pin.studies.keys import Variable
from graspless_pin.studies.study_schema import CloseEntry, PlaceEntry, PosingEntry

Sample = tuple[Any, ...]
"""The value of every variable."""
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
_MOST_FIELDS = 4096
_MOST_PLACEMENTS = 16


@dataclass(eq=False)
class SampleParts(SceneParts):
    """What the scenes of one study's samples leave for the next; it never changes a scene.

    Attributes:
        placements: Places of the hand by all that they depend on; the last few.
    """

    placements: Bounded[str, HandPlacement] = field(
        default_factory=lambda: Bounded(_MOST_PLACEMENTS)
    )
    _last: tuple[Sample, Scene] | None = None
    _fields: dict[tuple[int, str], tuple[str, Any]] = field(default_factory=dict)
    _names: tuple[str, ...] = ()

    def known(self, sample: Sample) -> Scene | None:
        """Return the scene of a sample whose values that differ from the last one's were seen.

        Args:
            sample: The values of all variables.

        Returns:
            The scene; None if it has to be built, and learned.
        """
        if self._last is None:
            return None
        fields, (before, scene) = {}, self._last
        for place, (value, last) in enumerate(zip(sample, before, strict=True)):
            if not is_alike(value, last):
                found = self._fields.get((place, repr(value)))
                if found is None:
                    return None
                fields[found[0]] = found[1]
        scene = scene._changed(fields)
        self._last = sample, scene
        return scene

    def learn(self, variables: Sequence[Variable], sample: Sample) -> None:
        """Keep the fields of the scene built last that one value alone has made.

        Args:
            variables: What varies.
            sample: The values of that scene.
        """
        if self.last is None:
            return
        entry, bodies, scene = self.last
        has_findings = scene.load_findings or (scene.hand is not None and scene.hand.findings)
        # What is found is told of each scene, and what is refused has to be looked for in each.
        self._last = None if has_findings or entry.warnings == "error" else (sample, scene)
        if bodies.names != self._names or len(self._fields) > _MOST_FIELDS:
            self._fields, self._names = {}, bodies.names
        keys = [{location[0] for location, *_ in one.targets} for one in variables]
        for place, own in enumerate(keys):
            others = set().union(*keys[:place], *keys[place + 1 :])
            key, *more = own or {""}
            name = FIELDS_BY_KEY.get(str(key))
            if name is not None and not more and key not in others:
                self._fields[place, repr(sample[place])] = name, vars(scene)[name]


NOT_PLACED = "not_placed"
"""Status of a sample whose hand has no place of the rank that is asked for."""


def scene_and_posing(tree: Tree) -> tuple[Tree, Tree]:
    """Return the content of a scene file, and what `PosingEntry` takes, of a sample's keys."""
    own = {name: tree[name] for name in PosingEntry.model_fields if name in tree}
    return {name: item for name, item in tree.items() if name not in own}, own


def posed(scene: Scene, tree: Tree, parts: SampleParts) -> tuple[Scene | None, Row]:
    """Return a sample's scene with its hand placed or closed, and what its row tells of that.

    Args:
        scene: The scene with the hand where the scene file has it.
        tree: The sample's keys.
        parts: What scenes of earlier samples left: all ranks of one search are searched for once.

    Returns:
        The scene, None where the hand has no such place; and the columns.

    Raises:
        GrasplessPinError: If the hand cannot be placed or closed with these options.
    """
    entry = _entry(scene, tree)
    if entry.place is not None:
        return _placed(scene, tree, entry.place, parts)
    return (scene, {}) if entry.close is None else _closed(scene, entry.close, parts)


def try_to_place(scene: Scene, tree: Tree) -> None:
    """Try one candidate, which meets all that could be wrong with the options of a place.

    Args:
        scene: See `posed`.
        tree: See `posed`.

    Raises:
        GrasplessPinError: See `posed`.
    """
    entry = _entry(scene, tree)
    if entry.place is not None:
        one = entry.place.model_copy(update={"candidates": 1, "verdict_nodes": 0})
        _placement(scene, one)


def _entry(scene: Scene, tree: Tree) -> PosingEntry:
    assert scene.path is not None  # noqa: S101 - the scene of a study comes from a file
    return validated(YamlSource(scene.path, scene_and_posing(tree)[1]), PosingEntry)


def _placement(scene: Scene, entry: PlaceEntry) -> HandPlacement:
    """Place the hand. It takes as long as it takes: time must not decide what a row says."""
    return place_hand(scene, time_limit=None, workers=1, **entry.model_dump(exclude={"rank"}))


def _placed(
    scene: Scene, tree: Tree, entry: PlaceEntry, parts: SampleParts
) -> tuple[Scene | None, Row]:
    search = {**tree, "place": entry.model_dump(exclude={"rank"})}
    key = json.dumps(search, sort_keys=True, default=str)
    if key not in parts.placements:
        parts.placements[key] = _placement(scene, entry)
    found = parts.placements[key]
    row: Row = {"place_rank": entry.rank, "places_found": found.found}
    if entry.rank <= found.found:
        return found.places[entry.rank - 1].scene, row
    if found.places:
        reason = f"there is no place of rank {entry.rank}: {found.found} were found"
    else:
        faults = [f"{count} x {fault.words}" for fault, count in found.faults.items()]
        reason = f"no place among {found.tried} candidates: {'; '.join(faults)}"
    return None, {"status": NOT_PLACED, "found": False, **row, "reason": reason}


def _closed(scene: Scene, entry: CloseEntry, parts: SampleParts) -> tuple[Scene | None, Row]:
    # What did not change keeps its hand, and with it the contacts.
    sources = scene.hand, scene.object, repr(entry)
    result = parts.latest.made(
        "closed fingers", sources, lambda: close_fingers(scene, **entry.model_dump()).closing
    )
    untouching = [one.finger for one in result.fingers if not one.touching]
    row: Row = {"open_fingers": "; ".join(untouching) or None}
    return scene.with_changes(hand=result.hand), row


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
