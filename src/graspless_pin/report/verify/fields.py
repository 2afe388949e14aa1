"""The fields of a document: one table for who writes them, who reads them and who checks them.

Shapes are in M contacts, L joints, P passive coordinates and r corners of a cone; in parts of their
own n scaled accelerations, d small motions, c joints that carry touching links, k columns of an
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
    entry,
    items,
    number,
    short_text,
    sparse,
    text,
    truth,
    whole,
    whose,
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
"""Multipliers that stand by contact or joint."""

WHOLE = "the document"
"""What a document is called in messages."""
Sizes = dict[str, int]


@dataclass(frozen=True)
class Field:
    """What stands under a key, where it is not null.

    Attributes:
        what: In words.
        read: From what stands there, what it is called and the sizes of shapes.
    """

    what: str
    read: Callable[[object, str, Sizes], Any]


class Part:
    """A mapping of a document: its fields are read, or refused, as the table says.

    Attributes:
        kind: Its name in the table.
        stated: As it stands there.
        where: What it is called in messages.
        sizes: Of shapes, by letter.
    """

    def __init__(self, kind: str, stated: Any, where: str, sizes: Sizes) -> None:
        """Read nothing yet."""
        self.kind, self.stated, self.where, self.sizes = kind, stated, where, sizes

    def sized(self, **sizes: int) -> Part:
        """Return this part with more sizes."""
        return Part(self.kind, self.stated, self.where, self.sizes | sizes)

    def __getitem__(self, key: str) -> Any:
        """Return what stands under a key.

        Raises:
            ValueError: If it is missing, or not what the table says.
        """
        where = key if self.where == WHOLE else f"{key} of {self.where}"
        return FIELDS[self.kind][key].read(entry(self.stated, key, self.where), where, self.sizes)

    def maybe(self, key: str) -> Any:
        """Return what stands under a key; None where that is null."""
        return None if entry(self.stated, key, self.where) is None else self[key]

    def get(self, key: str) -> Any:
        """Return what stands under a key; None where that is null or the key is missing."""
        return self.maybe(key) if isinstance(self.stated, dict) and key in self.stated else None


def stacked(parts: Sequence[Part], key: str) -> np.ndarray:
    """Return the arrays, or numbers, that stand under a key of each of some parts."""
    return np.array([part[key] for part in parts])


def _size(n: int | str, sizes: Sizes) -> int:
    """Return an entry of a shape: a number, or a sum of letters with factors and numbers."""
    if isinstance(n, int):
        return n
    if n in sizes:
        return sizes[n]
    terms = (re.fullmatch(r"(\d*)(\w*)", term) for term in str(n).split(" + "))
    return sum(int(one[1] or 1) * (sizes[one[2]] if one[2] else 1) for one in terms if one)


def _shaped(*shape: int | str, gaps: bool = False) -> Field:
    """Return an array of numbers; where there may be gaps, null is read as NaN."""
    what = f"({', '.join(map(str, shape))})" if shape else "number"
    return Field(
        f"{what}, null: none" if gaps else what,
        lambda value, where, sizes: array(
            value, tuple(_size(n, sizes) for n in shape), where, gaps=gaps
        ),
    )


def _sparse(**shape: int | str) -> Field:
    """Return an array of which the entries other than zero are listed, each with its indices."""
    return Field(
        f"[{', '.join(shape)}, value] each",
        lambda value, where, sizes: sparse(
            value, {f"a {name}": _size(n, sizes) for name, n in shape.items()}, where
        ),
    )


def _words(*known: str) -> Field:
    what = " or ".join(f"`{one}`" for one in known)
    return Field(what, lambda value, where, _: word(value, where, known))


def _whole(least: int, most: int | str) -> Field:
    return Field(
        f"{least} to {most}",
        lambda value, where, sizes: whole(value, where, least, _size(most, sizes)),
    )


def _index(size: str, least: int = 0) -> Field:
    return Field(
        f"{least} to {size} - 1",
        lambda value, where, sizes: whole(value, where, least, _size(size, sizes) - 1),
    )


def _part(kind: str) -> Field:
    return Field(f"see {kind}", lambda value, where, sizes: Part(kind, value, where, sizes))


def _list(one: Field, name: str, least: int | str = 0, most: int | str = MOST) -> Field:
    """Return a list of so many values.

    Args:
        one: What each is.
        name: Of each: {0} is its number, {2} what the list is called, {1} whose it is.
        least: So many at least.
        most: And at most.
    """

    def read(value: object, where: str, sizes: Sizes) -> list[Any]:
        listed = items(value, where, _size(least, sizes), _size(most, sizes))
        return [
            one.read(value, name.format(number, whose(where), where), sizes)
            for number, value in enumerate(listed)
        ]

    return Field(f"list, each {one.what}", read)


def _tuple(**fields: Field) -> Field:
    """Return a list of values of different kinds, each with its name."""

    def read(value: object, where: str, sizes: Sizes) -> list[Any]:
        listed = items(value, where, len(fields), len(fields))
        return [
            field.read(one, f"a {name} of {whose(where)}", sizes)
            for one, (name, field) in zip(listed, fields.items(), strict=True)
        ]

    return Field(f"[{', '.join(fields)}]", read)


_NUMBER = Field("number", lambda value, where, _: number(value, where))
_TRUTH = Field("true or false", lambda value, where, _: truth(value, where))
_TEXT = Field("text", lambda value, where, _: text(value, where))
_NAME = Field("name", lambda value, where, _: short_text(value, where))
_ANY = Field("unchecked", lambda value, *_: value)
_COUNT = Field("whole number", lambda value, where, _: whole(value, where, 0, 10**15))
_UNIT = _words("N m", "N")
_LOADS = _list(_part("least load"), "a load of {1}")
_VERDICTS = _words("strong", "weak", "none", "undecided")

FIELDS: dict[str, dict[str, Field]] = {
    "document": {
        "format": _ANY, "status": _words(*FOUND_STATES, *INFEASIBLE, *OPEN, *UNGUARANTEED),
        "message": _TEXT, "found": _TRUTH,
        "algorithm": _words("margin", "torque"), "required_margin": _NUMBER,
        "scale": _words("absolute", "limits"), "regularization": _NUMBER, "rules": _part("rules"),
        "objective": _part("objective"), "margin": _NUMBER, "max_torque": _NUMBER,
        "max_torque_unit": _UNIT, "external_wrench": _shaped("P"), "cone": _NAME,
        "cone_edges": _whole(3, MOST), "coulombs_law": _TRUTH,
        "wrench_matrix": _shaped("P", "3M"),
        "passive_units": _list(_UNIT, "one of passive_units", "P", "P"),
        "scales": _part("scales"), "object_inertia": _shaped("P", "P"),
        "joint_inertia": _shaped("L", "L"), "scene": _NAME, "gravity": _shaped(3),
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
        "sign_rule": _words("strict", "exact", "nonzero"),
        "sliding_rule": _words("exempt", "constrained"),
        "static_friction": _words("virtual_sliding", "coulomb"),
    },
    "scales": {"force": _NUMBER, "length": _NUMBER},
    "object": {"name": _NAME, "mass": _NUMBER, "center_of_mass": _shaped(3), "pose": _ANY},
    "load": {"name": _ANY, "mass": _NUMBER},
    "contact": {
        "bodies": _ANY, "position": _shaped(3), "normal": _shaped(3), "tangents": _shaped(2, 3),
        "force": _shaped(3), "friction": _NUMBER, "max_normal_force": _NUMBER,
        "sliding": _shaped(3), "selected": _TRUTH,
        "signs": _list(_whole(-1, 1), "a sign of {1}", 2, 2), "jacobian": _shaped(3, "L"),
        "cone_corners": _shaped("r", 2), "kinetic_friction": _shaped(2),
    },
    "joint": {
        "name": _NAME, "unit": _UNIT, "torque_contact": _NUMBER,
        "torque_gravity": _shaped(gaps=True), "torque": _NUMBER, "lower": _shaped(gaps=True),
        "upper": _shaped(gaps=True),
    },
    "certificate": {
        "primal_residual": _NUMBER, "duality_gap": _NUMBER, "bound": _NUMBER, "gap": _NUMBER,
        "infeasibility": _NUMBER, "modes_examined": _COUNT, "nodes": _COUNT,
        "force_programs": _COUNT, "kinematic_programs": _COUNT, "solver": _NAME,
        "force_reach": _NUMBER, "threshold_optima": _shaped(2, gaps=True),
    },
    "multipliers": {
        "balance": _shaped("P"), "faces": _sparse(contact="M", face="r"),
        "round_cones": _shaped("M", 3), **{key: _shaped(size) for key, size in SIZED.items()},
    },
    "proof": {
        "complete": _TRUTH, "missing": _TEXT, "motion": _part("virtual motion"),
        "nodes": _list(_part("node"), "node {0}", 1, 10_000), "forces": _shaped("M", 3),
        "columns": _shaped("k"), "mode_multipliers": _part("multipliers"),
    },
    "virtual motion": {"object": _shaped("P"), "joints": _shaped("L")},
    "node": {
        "kind": _words("bound", "kinematic", "conflict", "contact"), "objective": _TRUTH,
        "multipliers": _part("multipliers"), "combination": _sparse(contact="M", direction=3),
        "items": _list(
            _tuple(contact=_index("M"), component=_whole(0, 1), sign=_whole(-1, 1)),
            "an item of {1}", 0, "3M",
        ),
        "open": _tuple(contact=_index("M"), component=_whole(0, 1)),
        "combinations": _list(_sparse(contact="M", direction=3), "a combination of {1}", 1, 3),
        "contact": _index("M"),
    },
    "objective": {
        "name": _NAME, "maximizes": _TRUTH, "unit": _NUMBER, "value": _NUMBER,
        "keeps": _list(_words(*KEPT), "what the objective keeps", 2, len(KEPT)),
        "columns": _list(_part("column"), "column {0} of {1}"), "terms": _part("terms"),
        "face_margins": _shaped("M"), "normal_range": _shaped("M", 2, gaps=True),
        "force_curvature": _shaped("M", 3), "rows": _list(_part("block"), "block {0} of {1}"),
    },
    "column": {
        "name": _NAME, "unit": _shaped("k"), "cost": _shaped("k"), "curvature": _shaped("k"),
        "bounds": _shaped(2, "k", gaps=True), "box": _shaped(2, "k"),
        "whole_box": _shaped(2, "k"), "values": _shaped("k"),
    },
    "terms": {
        "balance": _sparse(row="P", column="k"),
        **{name: _sparse(contact="M", column="k") for name in KEPT[1:4]},
        "torque": _ANY,
    },
    "block": {
        "name": _NAME, "sign": _words("any", "upper", "either"),
        "shape": _list(_whole(0, MOST), "an entry of {1}", 1, 3),
        "unit": _shaped("q", gaps=True), "low": _shaped("q", gaps=True),
        "high": _shaped("q", gaps=True), "forces": _sparse(row="q", contact="M", direction=3),
        "columns": _sparse(row="q", column="k"),
    },
    "guarantee": {"best_case": _NUMBER, "gap": _NUMBER, "tried": _COUNT},
    "stability": {
        "status": _VERDICTS, "message": _TEXT, "acceleration_resolution": _NUMBER,
        "acceleration_limit": _NUMBER, "rest_forces": _shaped("M", 3),
        "motion": _part("outcome"), "no_rest": _shaped("P + L"), "programs": _ANY, "nodes": _ANY,
        "free_motions": _ANY, "moves": _ANY, "joints_held": _ANY, "proof": _part("rest proof"),
    },
    "outcome": {
        "object_acceleration": _shaped("P"), "joint_accelerations": _shaped("L"),
        "contact_forces": _shaped("M", 3),
        "states": _list(
            _words("open", "closed", "sticking", "slipping"), "a state of {1}", "M", "M"
        ),
        "point_acceleration": _NUMBER,
    },
    "rest proof": {
        "loads": _LOADS, "forces": _shaped("M", 3), "force_limit": _NUMBER,
        "nodes": _list(_part("rest node"), "node {0} of {1}", 1, 100_000),
    },
    "least load": {
        "contact": _index("M"), "force": _NUMBER, "multipliers": _part("rest multipliers"),
    },
    "rest multipliers": {
        "motion": _shaped("n"), "normal": _shaped("M"), "tangential": _shaped("M", 2)
    },
    "rest node": {
        "contact": _index("M", -1),
        "state": _words("free", "open", "closed", "sticking", "slipping"), "slip": _shaped(2),
        "multipliers": _part("rest multipliers"),
        "forced": _list(_part("rest multipliers"), "{1}", 0, 2), "loads": _LOADS,
        "sides": _list(_part("side"), "a side of {1}", 0, "2P + 1"), "children": _whole(0, 100_000),
        "patch": _part("patch"),
    },
    "patch": {
        "contacts": _list(_index("M"), "a contact of {1}", 2, "M"), "images": _shaped("k", 2, 3),
        "arcs": _shaped("k", 2), "cone": _part("motion cone"),
    },
    "motion cone": {
        "axes": _shaped(3, 3), "axis": _whole(0, 2), "sign": _whole(-1, 1), "low": _shaped(2),
        "high": _shaped(2),
    },
    "side": {"goal": _index("2P + 1"), "multipliers": _part("rest multipliers")},
    "holding": {
        "status": _words(
            "holds", "needs_feedback", "may_fail", "fails", "finger_moves", "undecided"
        ),
        "controller": _TEXT, "stiffness_needed": _NUMBER,
        "stable_stiffness": _list(_shaped(2, gaps=True), "a range of {1}", 0, 1000),
        "growth_rate": _NUMBER, "least_growth_rate": _NUMBER, "unstable_motion": _shaped("P + L"),
        "assumed_contacts": _list(_index("M"), "an assumed contact", 0, "M"),
        "acceleration": _part("first instant"),
        "proofs": Field("see growth proof, by model of the surfaces", lambda value, *_: value),
    },
    "first instant": {"status": _VERDICTS},
    "growth proof": {
        "velocities": _shaped("P + L", "d"), "forces": _shaped("M", 3),
        "geometric_stiffness": _shaped("d", "d"),
        "joints": _list(_index("L"), "a joint of {1}", 0, "L"),
        **dict.fromkeys(("gains", "damping", "rotors"), _shaped("c")), "rate": _NUMBER,
        "lyapunov": _shaped("2d", "2d"),
    },
    "disturbances": {
        "characteristic_length": _NUMBER, "largest": _NUMBER,
        "directions": _list(_part("direction"), "disturbance {0}"),
    },
    "direction": {
        "direction": _shaped("P"), "guaranteed": _NUMBER, "failing": _NUMBER, "possible": _NUMBER,
        "spans": _list(_list(_part("end"), "{2}", 2, 2), "span {0} of {1}", 0, 100),
        "failure": _part("stability"), "forces": _shaped("M", 3), "no_rest": _shaped("P + L"),
    },
    "end": {"magnitude": _NUMBER, "rest_forces": _shaped("M", 3), "proof": _part("rest proof")},
    "uncertainty": {
        "stated": _ANY, "status": _TEXT, "message": _TEXT, "words": _ANY, "found": _TRUTH,
        "coverage": _words("whole_set", "corners", "sampled"), "samples": _part("samples"),
        "margin": _NUMBER, "max_torque": _NUMBER, "max_torque_unit": _UNIT, "bound": _NUMBER,
        "torques": _ANY, "feedback": _ANY, "largest_deflection": _ANY,
        "members": _list(_part("member"), "member {0}", 1), "policy": _part("policy"),
        "bounding": _list(_part("member"), "bounding member {0}", 1), "conflict": _ANY,
        "served_share": _ANY, "unserved_share": _ANY, "at_corners": _ANY, "with_feedback": _ANY,
        "nominal": _ANY,
        "proof": Field("the document of the joined problem", lambda value, *_: value),
    },
    "samples": {
        **dict.fromkeys(("count", "served", "solved"), _whole(0, MOST)),
        "where_meant": _words("whole_set", "corners"),
    },
    "member": {
        "words": _TEXT, "external_wrench": _shaped("P"), "friction": _shaped("M"),
        **dict.fromkeys(("gravity_torques", "torque_factors", "torque_offsets"), _shaped("L")),
        "moved": _shaped("M", 3), "jacobian": _shaped("M", 3, "L"), "forces": _shaped("M", 3),
    },
    "policy": {
        "words": _ANY, "loads": _shaped("K", "P", "D"),
        "balls": _list(_whole(0, "D"), "a ball of {1}", "D", "D"),
        "joints": _list(_index("L", -1), "a joint of {1}", "D", "D"), "shares": _shaped("L"),
        "offsets": _shaped("L"), "forces": _shaped("K", "M", 3),
        "slopes": _shaped("K", "M", 3, "D"), "errors": _shaped("L", "D"),
        "directions": _shaped("L", "w"),
    },
}  # fmt: skip
"""By part. What no check reads may be anything."""


def written(kind: str, record: object, **others: Any) -> dict[str, Any]:
    """Return what a document says of a record: its attributes that the table names.

    Args:
        kind: Name of the part in the table.
        record: What it is of.
        others: Fields that are no attributes of it, or others than these.
    """
    return {key: others[key] if key in others else getattr(record, key) for key in FIELDS[kind]}
