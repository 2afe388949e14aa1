"""The fields of a document, in one table for writers, readers and the checker.

Shapes are in M contacts, L joints, P passive coordinates and r corners of a cone; in some parts
also in n scaled accelerations, d small motions, c joints that carry touching links, k columns of an
objective, K members of an uncertain set, and D figures that forces are affine in.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from graspless_pin.report.verify.values import (
    MOST,
    array,
    enclosing_name,
    entry,
    items,
    number,
    short_text,
    sparse,
    text,
    truth,
    whole,
    word,
)

FORMAT = 2
"""Version of the documents."""
KNOWN_CONES = ("edges", "round")
"""Models of friction cones that are known by name; of others a document states the corners."""
FOUND_STATES = ("optimal", "optimal_in_mode", "limit_reached", "strong")
INFEASIBLE = ("infeasible_forces", "infeasible_modes", "infeasible_in_mode", "infeasible_mode")
OPEN = ("not_found_in_limit", "unverified", "load_too_large")
UNGUARANTEED = ("strong_not_found", "infeasible_strong")
IN_MODE = ("optimal_in_mode", "infeasible_in_mode", "infeasible_mode")
KEPT = ("balance", "faces", "normal_upper", "normal_lower", "torque")
"""Rows of the problem that an objective may keep."""
SIZED = {"normal_upper": "M", "normal_lower": "M", "torque_upper": "L", "torque_lower": "L",
         "share_upper": "L", "share_lower": "L"}  # fmt: skip
"""Multipliers with one entry for each contact or joint."""

WHOLE = "the document"
"""Name of the document in messages."""
Sizes = dict[str, int]


@dataclass(frozen=True)
class Field:
    """The type of a value that is not null.

    Attributes:
        what: The type in words.
        read: Returns the value from the stated one, its name in messages and the sizes of shapes.
    """

    what: str
    read: Callable[[object, str, Sizes], Any]


class Part:
    """A mapping of a document, whose fields are checked against the table when they are read.

    Attributes:
        kind: Its name in the table.
        stated: The mapping as stated.
        where: Its name in messages.
        sizes: Sizes of the dimensions of shapes, by letter.
    """

    def __init__(self, kind: str, stated: Any, where: str, sizes: Sizes) -> None:
        """Store the mapping; its fields are read later."""
        self.kind, self.stated, self.where, self.sizes = kind, stated, where, sizes

    def with_sizes(self, **sizes: int) -> Part:
        """Return this part with more sizes."""
        return Part(self.kind, self.stated, self.where, self.sizes | sizes)

    def __getitem__(self, key: str) -> Any:
        """Return the value under a key.

        Raises:
            ValueError: If it is missing, or not of the type that the table names.
        """
        where = key if self.where == WHOLE else f"{key} of {self.where}"
        return FIELDS[self.kind][key].read(entry(self.stated, key, self.where), where, self.sizes)

    def maybe(self, key: str) -> Any:
        """Return the value under a key; None where it is null."""
        return None if entry(self.stated, key, self.where) is None else self[key]

    def get(self, key: str) -> Any:
        """Return the value under a key; None where it is null or the key is missing."""
        return self.maybe(key) if isinstance(self.stated, dict) and key in self.stated else None


def stacked(parts: Sequence[Part], key: str) -> np.ndarray:
    """Return the array of the values under one key of several parts."""
    return np.array([part[key] for part in parts])


def _dimension(n: int | str, sizes: Sizes) -> int:
    """Return the size of a dimension: a number, or a sum of letters with factors and numbers."""
    if isinstance(n, int):
        return n
    if n in sizes:
        return sizes[n]
    terms = (re.fullmatch(r"(\d*)(\w*)", term) for term in str(n).split(" + "))
    return sum(int(one[1] or 1) * (sizes[one[2]] if one[2] else 1) for one in terms if one)


def _array(*shape: int | str, gaps: bool = False) -> Field:
    """Return the field of an array of numbers; with gaps, null is read as NaN."""
    what = f"({', '.join(map(str, shape))})" if shape else "number"
    return Field(
        f"{what}, null: none" if gaps else what,
        lambda value, where, sizes: array(
            value, tuple(_dimension(n, sizes) for n in shape), where, gaps=gaps
        ),
    )


def _sparse(**shape: int | str) -> Field:
    """Return the field of an array whose nonzero entries are listed, each with its indices."""
    return Field(
        f"[{', '.join(shape)}, value] each",
        lambda value, where, sizes: sparse(
            value, {f"a {name}": _dimension(n, sizes) for name, n in shape.items()}, where
        ),
    )


def _enum(*known: str) -> Field:
    what = " or ".join(f"`{one}`" for one in known)
    return Field(what, lambda value, where, _: word(value, where, known))


def _int(least: int, most: int | str) -> Field:
    return Field(
        f"{least} to {most}",
        lambda value, where, sizes: whole(value, where, least, _dimension(most, sizes)),
    )


def _index(size: str, least: int = 0) -> Field:
    return Field(
        f"{least} to {size} - 1",
        lambda value, where, sizes: whole(value, where, least, _dimension(size, sizes) - 1),
    )


def _part(kind: str) -> Field:
    return Field(f"see {kind}", lambda value, where, sizes: Part(kind, value, where, sizes))


def _list(one: Field, name: str, least: int | str = 0, most: int | str = MOST) -> Field:
    """Return the field of a list.

    Args:
        one: Field of each entry.
        name: Name of an entry: {0} is its number, {2} the name of the list, {1} that of the part
            around it.
        least: Smallest length.
        most: Largest length.
    """

    def read(value: object, where: str, sizes: Sizes) -> list[Any]:
        listed = items(value, where, _dimension(least, sizes), _dimension(most, sizes))
        return [
            one.read(value, name.format(number, enclosing_name(where), where), sizes)
            for number, value in enumerate(listed)
        ]

    return Field(f"list, each {one.what}", read)


def _tuple(**fields: Field) -> Field:
    """Return the field of a list with one named field for each entry."""

    def read(value: object, where: str, sizes: Sizes) -> list[Any]:
        listed = items(value, where, len(fields), len(fields))
        return [
            field.read(one, f"a {name} of {enclosing_name(where)}", sizes)
            for one, (name, field) in zip(listed, fields.items(), strict=True)
        ]

    return Field(f"[{', '.join(fields)}]", read)


_NUMBER = Field("number", lambda value, where, _: number(value, where))
_TRUTH = Field("true or false", lambda value, where, _: truth(value, where))
_TEXT = Field("text", lambda value, where, _: text(value, where))
_NAME = Field("name", lambda value, where, _: short_text(value, where))
_ANY = Field("unchecked", lambda value, *_: value)
_COUNT = Field("whole number", lambda value, where, _: whole(value, where, 0, 10**15))
_UNIT = _enum("N m", "N")
_LOADS = _list(_part("least load"), "a load of {1}")
_VERDICTS = _enum("strong", "weak", "none", "undecided")

FIELDS: dict[str, dict[str, Field]] = {
    "document": {
        "format": _ANY, "status": _enum(*FOUND_STATES, *INFEASIBLE, *OPEN, *UNGUARANTEED),
        "message": _TEXT, "found": _TRUTH,
        "algorithm": _enum("margin", "torque"), "required_margin": _NUMBER,
        "scale": _enum("absolute", "limits"), "regularization": _NUMBER, "rules": _part("rules"),
        "objective": _part("objective"), "margin": _NUMBER, "max_torque": _NUMBER,
        "max_torque_unit": _UNIT, "external_wrench": _array("P"), "cone": _NAME,
        "cone_edges": _int(3, MOST), "coulombs_law": _TRUTH,
        "wrench_matrix": _array("P", "3M"),
        "passive_units": _list(_UNIT, "an entry of {2}", "P", "P"),
        "scales": _part("scales"), "object_inertia": _array("P", "P"),
        "joint_inertia": _array("L", "L"), "scene": _NAME, "gravity": _array(3),
        "object": _part("object"), "loads": _list(_part("load"), "load {0}", 0, 100),
        "acceleration": _ANY, "hand": _ANY, "findings": _ANY,
        "contacts": _list(_part("contact"), "contact {0}", 1),
        "joints": _list(_part("joint"), "joint {0}"), "certificate": _part("certificate"),
        "multipliers": _part("multipliers"), "explanation": _TEXT, "proof": _part("proof"),
        "guarantee": _part("guarantee"), "stability": _part("stability"),
        "holding": _part("holding"), "disturbances": _part("disturbances"),
        "uncertainty": _part("uncertainty"), "provenance": _ANY,
    },
    "rules": {
        "sign_rule": _enum("strict", "exact", "nonzero"),
        "sliding_rule": _enum("exempt", "constrained"),
        "static_friction": _enum("virtual_sliding", "coulomb"),
    },
    "scales": {"force": _NUMBER, "length": _NUMBER},
    "object": {"name": _NAME, "mass": _NUMBER, "center_of_mass": _array(3), "pose": _ANY},
    "load": {"name": _ANY, "mass": _NUMBER},
    "contact": {
        "bodies": _ANY, "position": _array(3), "normal": _array(3), "tangents": _array(2, 3),
        "force": _array(3), "friction": _NUMBER, "max_normal_force": _NUMBER,
        "sliding": _array(3), "selected": _TRUTH,
        "signs": _list(_int(-1, 1), "a sign of {1}", 2, 2), "jacobian": _array(3, "L"),
        "cone_corners": _array("r", 2), "kinetic_friction": _array(2),
    },
    "joint": {
        "name": _NAME, "unit": _UNIT, "torque_contact": _NUMBER,
        "torque_gravity": _array(gaps=True), "torque": _NUMBER, "lower": _array(gaps=True),
        "upper": _array(gaps=True),
    },
    "certificate": {
        "primal_residual": _NUMBER, "duality_gap": _NUMBER, "bound": _NUMBER, "gap": _NUMBER,
        "infeasibility": _NUMBER, "modes_examined": _COUNT, "nodes": _COUNT,
        "force_programs": _COUNT, "kinematic_programs": _COUNT, "solver": _NAME,
        "force_reach": _NUMBER, "threshold_optima": _array(2, gaps=True),
    },
    "multipliers": {
        "balance": _array("P"), "faces": _sparse(contact="M", face="r"),
        "round_cones": _array("M", 3), **{key: _array(size) for key, size in SIZED.items()},
    },
    "proof": {
        "complete": _TRUTH, "missing": _TEXT, "motion": _part("virtual motion"),
        "nodes": _list(_part("node"), "node {0}", 1, 10_000), "forces": _array("M", 3),
        "columns": _array("k"), "mode_multipliers": _part("multipliers"),
    },
    "virtual motion": {"object": _array("P"), "joints": _array("L")},
    "node": {
        "kind": _enum("bound", "kinematic", "conflict", "contact"), "objective": _TRUTH,
        "multipliers": _part("multipliers"), "combination": _sparse(contact="M", direction=3),
        "items": _list(
            _tuple(contact=_index("M"), component=_int(0, 1), sign=_int(-1, 1)),
            "an item of {1}", 0, "3M",
        ),
        "open": _tuple(contact=_index("M"), component=_int(0, 1)),
        "combinations": _list(_sparse(contact="M", direction=3), "a combination of {1}", 1, 3),
        "contact": _index("M"),
    },
    "objective": {
        "name": _NAME, "maximizes": _TRUTH, "unit": _NUMBER, "value": _NUMBER,
        "keeps": _list(_enum(*KEPT), "an entry of {2}", 2, len(KEPT)),
        "columns": _list(_part("column"), "column {0} of {1}"), "terms": _part("terms"),
        "face_margins": _array("M"), "normal_range": _array("M", 2, gaps=True),
        "force_curvature": _array("M", 3), "rows": _list(_part("block"), "block {0} of {1}"),
    },
    "column": {
        "name": _NAME, "unit": _array("k"), "cost": _array("k"), "curvature": _array("k"),
        "bounds": _array(2, "k", gaps=True), "box": _array(2, "k"),
        "whole_box": _array(2, "k"), "values": _array("k"),
    },
    "terms": {
        "balance": _sparse(row="P", column="k"),
        **{name: _sparse(contact="M", column="k") for name in KEPT[1:4]},
        "torque": _ANY,
    },
    "block": {
        "name": _NAME, "sign": _enum("any", "upper", "either"),
        "shape": _list(_int(0, MOST), "an entry of {1}", 1, 3),
        "unit": _array("q", gaps=True), "low": _array("q", gaps=True),
        "high": _array("q", gaps=True), "forces": _sparse(row="q", contact="M", direction=3),
        "columns": _sparse(row="q", column="k"),
    },
    "guarantee": {"best_case": _NUMBER, "gap": _NUMBER, "tried": _COUNT},
    "stability": {
        "status": _VERDICTS, "message": _TEXT, "acceleration_resolution": _NUMBER,
        "acceleration_limit": _NUMBER, "rest_forces": _array("M", 3),
        "motion": _part("outcome"), "no_rest": _array("P + L"), "programs": _ANY, "nodes": _ANY,
        "free_motions": _ANY, "moves": _ANY, "joints_held": _ANY, "proof": _part("rest proof"),
    },
    "outcome": {
        "object_acceleration": _array("P"), "joint_accelerations": _array("L"),
        "contact_forces": _array("M", 3),
        "states": _list(
            _enum("open", "closed", "sticking", "slipping"), "a state of {1}", "M", "M"
        ),
        "point_acceleration": _NUMBER,
    },
    "rest proof": {
        "loads": _LOADS, "forces": _array("M", 3), "force_limit": _NUMBER,
        "nodes": _list(_part("rest node"), "node {0} of {1}", 1, 100_000),
    },
    "least load": {
        "contact": _index("M"), "force": _NUMBER, "multipliers": _part("rest multipliers"),
    },
    "rest multipliers": {
        "motion": _array("n"), "normal": _array("M"), "tangential": _array("M", 2)
    },
    "rest node": {
        "contact": _index("M", -1),
        "state": _enum("free", "open", "closed", "sticking", "slipping"), "slip": _array(2),
        "multipliers": _part("rest multipliers"),
        "forced": _list(_part("rest multipliers"), "{1}", 0, 2), "loads": _LOADS,
        "sides": _list(_part("side"), "a side of {1}", 0, "2P + 1"), "children": _int(0, 100_000),
        "patch": _part("patch"),
    },
    "patch": {
        "contacts": _list(_index("M"), "a contact of {1}", 2, "M"), "images": _array("k", 2, 3),
        "arcs": _array("k", 2), "cone": _part("motion cone"),
    },
    "motion cone": {
        "axes": _array(3, 3), "axis": _int(0, 2), "sign": _int(-1, 1), "low": _array(2),
        "high": _array(2),
    },
    "side": {"goal": _index("2P + 1"), "multipliers": _part("rest multipliers")},
    "holding": {
        "status": _enum(
            "holds", "needs_feedback", "may_fail", "fails", "finger_moves", "undecided"
        ),
        "controller": _TEXT, "stiffness_needed": _NUMBER,
        "stable_stiffness": _list(_array(2, gaps=True), "a range of {1}", 0, 1000),
        "growth_rate": _NUMBER, "least_growth_rate": _NUMBER, "unstable_motion": _array("P + L"),
        "assumed_contacts": _list(_index("M"), "an entry of {2}", 0, "M"),
        "acceleration": _part("first instant"),
        "proofs": Field("see growth proof, by model of the surfaces", lambda value, *_: value),
    },
    "first instant": {"status": _VERDICTS},
    "growth proof": {
        "velocities": _array("P + L", "d"), "forces": _array("M", 3),
        "geometric_stiffness": _array("d", "d"),
        "joints": _list(_index("L"), "a joint of {1}", 0, "L"),
        **dict.fromkeys(("gains", "damping", "rotors"), _array("c")), "rate": _NUMBER,
        "lyapunov": _array("2d", "2d"),
    },
    "disturbances": {
        "characteristic_length": _NUMBER, "largest": _NUMBER,
        "directions": _list(_part("direction"), "disturbance {0}"),
    },
    "direction": {
        "direction": _array("P"), "guaranteed": _NUMBER, "failing": _NUMBER, "possible": _NUMBER,
        "spans": _list(_list(_part("end"), "{2}", 2, 2), "span {0} of {1}", 0, 100),
        "failure": _part("stability"), "forces": _array("M", 3), "no_rest": _array("P + L"),
    },
    "end": {"magnitude": _NUMBER, "rest_forces": _array("M", 3), "proof": _part("rest proof")},
    "uncertainty": {
        "stated": _ANY, "status": _TEXT, "message": _TEXT, "words": _ANY, "found": _TRUTH,
        "coverage": _enum("whole_set", "corners", "sampled"), "samples": _part("samples"),
        "margin": _NUMBER, "max_torque": _NUMBER, "max_torque_unit": _UNIT, "bound": _NUMBER,
        "torques": _ANY, "feedback": _ANY, "largest_deflection": _ANY,
        "members": _list(_part("member"), "member {0}", 1), "policy": _part("policy"),
        "bounding": _list(_part("member"), "bounding member {0}", 1), "conflict": _ANY,
        "served_share": _ANY, "unserved_share": _ANY, "at_corners": _ANY, "with_feedback": _ANY,
        "nominal": _ANY,
        "proof": Field("the document of the joined problem", lambda value, *_: value),
    },
    "samples": {
        **dict.fromkeys(("count", "served", "solved"), _int(0, MOST)),
        "where_meant": _enum("whole_set", "corners"),
    },
    "member": {
        "words": _TEXT, "external_wrench": _array("P"), "friction": _array("M"),
        **dict.fromkeys(("gravity_torques", "torque_factors", "torque_offsets"), _array("L")),
        "moved": _array("M", 3), "jacobian": _array("M", 3, "L"), "forces": _array("M", 3),
    },
    "policy": {
        "words": _ANY, "loads": _array("K", "P", "D"),
        "balls": _list(_int(0, "D"), "a ball of {1}", "D", "D"),
        "joints": _list(_index("L", -1), "a joint of {1}", "D", "D"), "shares": _array("L"),
        "offsets": _array("L"), "forces": _array("K", "M", 3),
        "slopes": _array("K", "M", 3, "D"), "errors": _array("L", "D"),
        "directions": _array("L", "w"),
    },
}  # fmt: skip
"""By part. Values that no check reads are not checked."""


def record_data(kind: str, record: object, **others: Any) -> dict[str, Any]:
    """Return the data of a record for a document: the attributes that the table names.

    Args:
        kind: Name of the part in the table.
        record: The record.
        others: Fields that are no attributes of it, or that replace these.
    """
    return {key: others[key] if key in others else getattr(record, key) for key in FIELDS[kind]}
