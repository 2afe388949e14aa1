"""Verdicts on rest as data of documents: ``stability``, ``holding`` and ``disturbances``."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from graspless_pin.algorithms.disturbances import GuaranteedDisturbance
from graspless_pin.algorithms.robustness import LoadBracket
from graspless_pin.errors import ArgumentError
from graspless_pin.holding.controller import CONSTANT_TORQUES, SmallMotions
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
from graspless_pin.report.verify.fields import FIELDS, WHOLE, Part, record_data
from graspless_pin.report.verify.values import entry

MOST_SPAN_LEAVES = 10_000
"""Leaves in the proofs of all directions together: files stay below the readable 32 MiB."""


def verdict_data(verdict: StabilityVerdict) -> dict[str, Any]:
    """Return the data of a verdict, with its complete proof.

    Multipliers are scaled: with M = C C^T the inertia of object and joints, g the load on them,
    H = |C^-1 g| and alpha the longest row of G C^-T, accelerations count in H C^-T, forces in
    H / alpha.

    Returns:
        ``status``, ``message``, ``acceleration_resolution``, ``acceleration_limit`` (m/s^2),
        ``rest_forces`` (N), ``motion``, ``no_rest``, ``programs``, ``nodes``,
        ``free_motions``, ``moves``, ``joints_held`` and ``proof``.
    """
    proof = None if verdict.proof is None else _rest_proof_data(verdict.proof)
    motion = verdict.motion and record_data("outcome", verdict.motion)
    return record_data("stability", verdict, motion=motion, proof=proof)


def holding_data(verdict: StabilityVerdict) -> dict[str, Any]:
    """Return the data of the verdict on whether the object stays under the controller.

    Returns:
        ``status`` (see `Holding`), ``controller`` in words, ``stiffness_needed`` (N m/rad or N/m),
        ``stable_stiffness`` ([low, high] each; high infinite: with any larger one),
        ``growth_rate`` and ``least_growth_rate`` (1/s, under the least and the most
        favourable contact forces; all NaN where they are not known), ``unstable_motion`` (P + L;
        None where none grows),
        ``assumed_contacts`` (see `SmallMotions.assumed`),
        ``acceleration`` with the ``status`` of the first instant, and ``proofs`` that no small
        motion grows, by model of the surfaces (see `GrowthProof`).
    """
    small = verdict.small_motions or SmallMotions.not_known("it was not asked")
    return record_data(
        "holding",
        verdict,
        status=verdict.holding,
        controller=verdict.controller or CONSTANT_TORQUES,
        stable_stiffness=small.stable,
        least_growth_rate=small.least_growth,
        unstable_motion=small.motion,
        assumed_contacts=small.assumed,
        acceleration=record_data("first instant", verdict),
        proofs={name: record_data("growth proof", one) for name, one in small.proofs.items()},
    )


def disturbance_data(disturbances: GuaranteedDisturbance) -> dict[str, Any]:
    """Return the data of guaranteed disturbances, with their proofs.

    Returns:
        ``characteristic_length`` (m), ``largest`` (N) and ``directions``: of each its (P,)
        ``direction``, ``guaranteed``, ``failing``, ``possible`` (N), and what proves them:
        ``spans`` (None where all proofs together would be too long), ``failure`` (see
        `verdict_data`), ``forces`` (N) and ``no_rest``. A direction that was not reached within
        the time limit has ``guaranteed``, ``failing`` and ``possible`` NaN.
    """
    directions, leaves = [], 0
    for direction, bracket in zip(disturbances.directions, disturbances.brackets, strict=False):
        leaf_count = _leaf_count(bracket)
        fits = leaves + leaf_count <= MOST_SPAN_LEAVES
        leaves += leaf_count if fits else 0
        last = bracket.last_rest
        spans = [_span_data(span) for span in bracket.spans] if fits else None
        failure = None if bracket.failure is None else verdict_data(bracket.failure)
        directions.append(
            record_data(
                "direction", bracket, direction=direction, spans=spans, failure=failure,
                forces=last and last.forces, no_rest=last and last.no_rest,
            )
        )  # fmt: skip
    return record_data("disturbances", disturbances, directions=directions)


def read_motion(document: dict[str, Any]) -> DynamicOutcome | None:
    """Return the motion that a document's verdict states; None: it states none.

    Raises:
        ArgumentError: If the stated motion is invalid.
    """
    with _refusing_invalid_motion():
        verdict = _sized_document(document).get("stability")
        motion = verdict and verdict.get("motion")
        if not motion:
            return None
        fields: dict[str, Any] = {key: motion[key] for key in FIELDS["outcome"]}
        fields["states"] = tuple(map(ContactState, fields["states"]))
        outcome = DynamicOutcome(**fields)
        if not (outcome.object_acceleration.any() or outcome.joint_accelerations.any()):
            raise ValueError("neither object nor joints accelerate")
        return outcome


def read_small_motion(document: dict[str, Any]) -> tuple[FloatArray, float] | None:
    """Return the growing small motion (P + L,) that a document states, and its rate, 1/s.

    Raises:
        ArgumentError: If the stated motion is invalid.
    """
    with _refusing_invalid_motion():
        stated = _sized_document(document).get("holding")
        motion, growth = (stated and stated.get(key) for key in ("unstable_motion", "growth_rate"))
        return None if motion is None or not growth else (motion, growth)


@contextmanager
def _refusing_invalid_motion() -> Iterator[None]:
    try:
        yield
    except ValueError as error:
        raise ArgumentError("document", f"states an invalid motion: {error}") from None


def _sized_document(document: dict[str, Any]) -> Part:
    """Return a document as a part, with the sizes of the arrays in its verdict."""
    keys = {"M": "contacts", "L": "joints", "P": "external_wrench"}
    sizes = {letter: len(entry(document, key, WHOLE)) for letter, key in keys.items()}
    return Part("document", document, WHOLE, sizes)


def _leaf_count(bracket: LoadBracket) -> int:
    proofs = [proof for span in bracket.spans for proof in span.proofs]
    return sum(not node.children for proof in proofs for node in _depth_first(proof.tree))


def _span_data(span: SpanProof) -> list[dict[str, Any]]:
    """Return magnitude, forces of rest and proof at each end of a span."""
    return [
        {"magnitude": magnitude, "rest_forces": forces, "proof": _rest_proof_data(proof)}
        for magnitude, forces, proof in zip(
            span.multiples, span.rest_forces, span.proofs, strict=True
        )
    ]


def _rest_proof_data(proof: RestProof) -> dict[str, Any]:
    """Return the data of a proof; nodes depth first, each with its number of children."""
    nodes = None if proof.tree is None else [_node_data(node) for node in _depth_first(proof.tree)]
    return record_data("rest proof", proof, loads=_least_load_data(proof.loads), nodes=nodes)


def _least_load_data(loads: tuple[LoadProof, ...]) -> list[dict[str, Any]]:
    return [
        record_data("least load", one, multipliers=record_data("rest multipliers", one.dual))
        for one in loads
    ]


def _depth_first(tree: OutcomeSet | None) -> Iterator[OutcomeSet]:
    waiting = [] if tree is None else [tree]
    while waiting:
        node = waiting.pop()
        yield node
        waiting += reversed(node.children)


def _node_data(node: OutcomeSet) -> dict[str, Any]:
    return record_data(
        "rest node",
        node,
        slip=node.slip and [node.slip.center, node.slip.half_width],
        multipliers=node.dual and record_data("rest multipliers", node.dual),
        forced=[record_data("rest multipliers", dual) for dual in node.forced],
        loads=_least_load_data(node.loads),
        sides=[
            {"goal": goal, "multipliers": record_data("rest multipliers", dual)}
            for goal, dual in node.sides
        ],
        children=len(node.children),
        patch=node.patch
        and record_data("patch", node.patch, cone=node.patch.cone and vars(node.patch.cone)),
    )
