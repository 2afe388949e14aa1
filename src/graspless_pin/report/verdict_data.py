"""Verdicts on rest as they stand in documents: ``stability`` and ``disturbances``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from math import nan
from typing import Any

from graspless_pin.algorithms.disturbances import GuaranteedDisturbance
from graspless_pin.algorithms.robustness import LoadBracket
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.controller import CONSTANT_TORQUES
from graspless_pin.holding.verdict import (
    ContactState,
    DynamicOutcome,
    LoadProof,
    OutcomeSet,
    RestProof,
    SpanProof,
    StabilityVerdict,
)
from graspless_pin.problem.checks import FloatArray
from graspless_pin.report.verify.fields import FIELDS, WHOLE, Part
from graspless_pin.report.verify.values import entry

MOST_SPAN_LEAVES = 10_000
"""Of the proofs of all directions of disturbance: files stay below 32 MiB, which can be read."""


def verdict_data(verdict: StabilityVerdict) -> dict[str, Any]:
    """Return the data of a verdict, with its whole proof.

    Multipliers are scaled: with M = C C^T the inertia of object and joints, g the load on them,
    H = |C^-1 g| and alpha the longest row of G C^-T, accelerations count in H C^-T, forces in
    H / alpha.

    Returns:
        ``status``, ``message``, ``acceleration_resolution``, ``acceleration_limit`` (m/s^2),
        ``rest_forces`` (N), ``motion``, ``no_rest``, ``programs``, ``nodes``,
        ``free_motions``, ``moves``, ``joints_held`` and ``proof``.
    """
    return {
        "status": str(verdict.status),
        "message": verdict.message,
        "acceleration_resolution": verdict.acceleration_resolution,
        "acceleration_limit": verdict.acceleration_limit,
        "rest_forces": verdict.rest_forces,
        "motion": verdict.motion and vars(verdict.motion),
        "no_rest": verdict.no_rest,
        "programs": verdict.programs,
        "nodes": verdict.nodes,
        "free_motions": verdict.free_motions,
        "moves": None if verdict.moves is None else str(verdict.moves),
        "joints_held": verdict.joints_held,
        "proof": None if verdict.proof is None else _proof(verdict.proof),
    }


def holding_data(verdict: StabilityVerdict) -> dict[str, Any]:
    """Return whether the object stays under the controller that runs.

    Returns:
        ``status`` (see `Holding`), ``controller`` in words, ``stiffness_needed`` (N m/rad or N/m),
        ``stable_stiffness`` ([low, high] each; high infinite: with any larger one),
        ``growth_rate`` and ``least_growth_rate`` (1/s, under the contact forces that suit worst and
        best; all NaN where they are not known), ``unstable_motion`` (P + L; None where none grows),
        ``assumed_contacts`` (see `SmallMotions.assumed`),
        ``acceleration`` with the ``status`` of the first instant, and ``proofs`` that no small
        motion grows, by model of the surfaces (see `GrowthProof`).
    """
    small = verdict.small_motions
    return {
        "status": str(verdict.holding),
        "controller": verdict.controller or CONSTANT_TORQUES,
        "stiffness_needed": verdict.stiffness_needed,
        "stable_stiffness": [] if small is None else small.stable,
        "growth_rate": verdict.growth_rate,
        "least_growth_rate": nan if small is None else small.least_growth,
        "unstable_motion": None if small is None else small.motion,
        "assumed_contacts": [] if small is None else list(small.assumed),
        "acceleration": {"status": str(verdict.status)},
        "proofs": {} if small is None else {name: vars(one) for name, one in small.proofs.items()},
    }


def disturbance_data(found: GuaranteedDisturbance) -> dict[str, Any]:
    """Return the data of guaranteed disturbances, with their proofs.

    Returns:
        ``characteristic_length`` (m), ``largest`` (N) and ``directions``: of each its (P,)
        ``direction``, ``guaranteed``, ``failing``, ``possible`` (N), and what proves them:
        ``spans`` (None where all proofs together would be too long), ``failure`` (see
        `verdict_data`), ``forces`` (N) and ``no_rest``. A direction that was not reached before the
        time was over has ``guaranteed``, ``failing`` and ``possible`` NaN.
    """
    directions, leaves = [], 0
    for direction, bracket in zip(found.directions, found.brackets, strict=False):
        own = _leaf_count(bracket)
        fits = leaves + own <= MOST_SPAN_LEAVES
        leaves += own if fits else 0
        last = bracket.last_rest
        directions.append(
            {
                "direction": direction,
                "guaranteed": bracket.guaranteed,
                "failing": bracket.failing,
                "possible": bracket.possible,
                "spans": [_span(span) for span in bracket.spans] if fits else None,
                "failure": None if bracket.failure is None else verdict_data(bracket.failure),
                "forces": last and last.forces,
                "no_rest": last and last.no_rest,
            }
        )
    return {
        "characteristic_length": found.characteristic_length,
        "largest": found.largest,
        "directions": directions,
    }


def read_motion(document: dict[str, Any]) -> DynamicOutcome | None:
    """Return the motion of the verdict that a document holds, if it has one.

    Raises:
        ArgumentError: If it is no such document.
    """
    with _reading():
        verdict = _whole(document).get("stability")
        motion = verdict and verdict.get("motion")
        if not motion:
            return None
        found: dict[str, Any] = {key: motion[key] for key in FIELDS["outcome"]}
        found["states"] = tuple(map(ContactState, found["states"]))
        return DynamicOutcome(**found)


def read_small_motion(document: dict[str, Any]) -> tuple[FloatArray, float] | None:
    """Return the small motion (P + L,) that a document says grows, and its rate, 1/s.

    Raises:
        ArgumentError: If it is no such document.
    """
    with _reading():
        stated = _whole(document).get("holding")
        motion, growth = (stated and stated.get(key) for key in ("unstable_motion", "growth_rate"))
        return None if motion is None or not growth else (motion, growth)


@contextmanager
def _reading() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ArgumentError("document", f"holds a motion that is none: {error}") from None


def _whole(document: dict[str, Any]) -> Part:
    """Return a document with the sizes of the arrays in its verdict."""
    keys = {"M": "contacts", "L": "joints", "P": "external_wrench"}
    sizes = {letter: len(entry(document, key, WHOLE)) for letter, key in keys.items()}
    return Part("document", document, WHOLE, sizes)


def _leaf_count(bracket: LoadBracket) -> int:
    proofs = [proof for span in bracket.spans for proof in span.proofs]
    return sum(not node.children for proof in proofs for node in _depth_first(proof.tree))


def _span(span: SpanProof) -> list[dict[str, Any]]:
    """Return what proves a span at each of its two ends."""
    return [
        {"magnitude": magnitude, "rest_forces": forces, "proof": _proof(proof)}
        for magnitude, forces, proof in zip(
            span.multiples, span.rest_forces, span.proofs, strict=True
        )
    ]


def _proof(proof: RestProof) -> dict[str, Any]:
    """Return the proof; nodes of a tree depth first, each with the number of its children."""
    tree = proof.tree
    return {
        "loads": _loads(proof.loads),
        "forces": proof.forces,
        "force_limit": proof.force_limit,
        "nodes": None if tree is None else [_node(node) for node in _depth_first(tree)],
    }


def _loads(loads: tuple[LoadProof, ...]) -> list[dict[str, Any]]:
    return [
        {"contact": one.contact, "force": one.force, "multipliers": vars(one.dual)} for one in loads
    ]


def _depth_first(tree: OutcomeSet | None) -> Iterator[OutcomeSet]:
    waiting = [] if tree is None else [tree]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)


def _node(node: OutcomeSet) -> dict[str, Any]:
    return {
        "contact": node.contact,
        "state": str(node.state),
        "slip": None if node.slip is None else [node.slip.center, node.slip.half_width],
        "multipliers": None if node.dual is None else vars(node.dual),
        "forced": [vars(dual) for dual in node.forced],
        "loads": _loads(node.loads),
        "sides": [{"goal": goal, "multipliers": vars(dual)} for goal, dual in node.sides],
        "children": len(node.children),
    }
