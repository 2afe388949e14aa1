"""Robust torques against every choice of modes: one for all members, and one for each member.

Part of ``make uncertain``: 60 seeded scenes of 2 to 4 contacts and sets of 2 to 4 corners. Common
modes are tried one after the other, each by a linear program; the choices of a mode for each member
are all in one mixed-integer program with a binary for each. Programs and corners are made here
from the problem's arrays; of the package only the list of modes is used, which has tests of its
own.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass, field
from math import cos, hypot, pi, sin
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog
from tests.core.random_scenes import slope_scene

from graspless_pin import (
    QuasistaticProblem,
    Status,
    Uncertainty,
    enumerate_modes,
    minimize_torque,
)
from graspless_pin.algorithms.robust_solution import Coverage, RobustSolution

Array = NDArray[np.float64]

RULES: tuple[dict[str, Any], ...] = (
    {"sign_rule": "strict"}, {"sign_rule": "exact"}, {"sign_rule": "nonzero"},
    {"sliding_rule": "constrained"}, {"static_friction": "coulomb"},
)  # fmt: skip
MARGIN = 0.01  # N
EMPTY = 1.0 - 1e-13
"""Share by which a mass is less if hardly anything is left: wherever it is, that is one corner."""
SAME = 2e-5
"""Of a torque: what integers that are nearly integers leave of it."""


@dataclass
class Corners:
    """The linear program of all members: their forces along n, t1 and t2, and the largest torque.

    Attributes:
        problem: The nominal one.
        wrenches: (K, 6) of the members.
    """

    problem: QuasistaticProblem
    wrenches: Array
    above: Array = field(init=False)
    most: Array = field(init=False)
    equal: Array = field(init=False)
    sides: Array = field(init=False)
    bounds: Array = field(init=False)

    def __post_init__(self) -> None:
        """Make the rows."""
        made, count = self.problem, len(self.wrenches)
        M, L = made.contact_count, made.joint_count
        own, rooms = [], []
        self.bounds = np.tile([-np.inf, np.inf], (3 * M * count + 1, 1))
        self.bounds[-1, 0] = 0.0
        basis = np.zeros((3 * M, 3 * M))
        for c in range(M):
            n, (t1, t2), mu = made.normals[c], made.tangents[c].T, made.friction[c]
            three = slice(3 * c, 3 * c + 3)
            speed = np.linalg.norm(made.sliding[c])
            basis[three, three] = np.array([n, t1, t2]).T
            if speed > 0.0:
                basis[three, 3 * c] = n - mu * made.sliding[c] / speed
            columns = slice(3 * c, None, 3 * M)
            self.bounds[:-1][columns] = MARGIN, made.max_normal_force[c] - MARGIN
            if speed > 0.0 or mu == 0.0:
                for along in (1, 2):
                    self.bounds[:-1][slice(3 * c + along, None, 3 * M)] = 0.0, 0.0
                continue
            self.bounds[:-1][columns, 0] = -np.inf
            slope = mu * cos(pi / made.cone_edges)
            for edge in range(made.cone_edges):
                angle = 2.0 * pi * (edge + 0.5) / made.cone_edges
                row = np.zeros(3 * M)
                row[three] = -slope, np.cos(angle), np.sin(angle)
                own.append(row)
                rooms.append(-MARGIN * hypot(1.0, slope))
        W = np.vstack([np.tile(np.eye(3), M), np.hstack([_cross(at) for at in made.positions])])
        balance, made_torques = W @ basis, made.jacobian.T @ basis
        cones = np.kron(np.eye(count), np.array(own).reshape(len(own), 3 * M))
        first = np.hstack([made_torques, np.zeros((L, 3 * M * (count - 1)))])
        limits, carried, most = [], made.gravity_torques, -np.ones((L, 1))
        limits += [np.hstack([sign * first, most]) for sign in (1.0, -1.0)]
        limits += [np.hstack([sign * first, 0.0 * most]) for sign in (1.0, -1.0)]
        above = np.vstack([np.hstack([cones, np.zeros((len(cones), 1))]), *limits])
        self.above = np.asarray(above, dtype=np.float64)
        self.most = np.concatenate(
            [np.tile(rooms, count), -carried, carried, made.upper_torque - carried,
             carried - made.lower_torque]
        )  # fmt: skip
        same = np.zeros(((count - 1) * L, 3 * M * count))
        for k in range(1, count):
            rows = slice((k - 1) * L, k * L)
            same[rows, : 3 * M] = -made_torques
            same[rows, 3 * M * k : 3 * M * (k + 1)] = made_torques
        equal = np.vstack([np.kron(np.eye(count), balance), same])
        equal = np.hstack([equal, np.zeros((len(equal), 1))])
        self.equal = np.asarray(equal, dtype=np.float64)
        self.sides = np.concatenate([-self.wrenches.ravel(), np.zeros(len(same))])

    def in_modes(self, signs: list[Array]) -> float:
        """Return the least largest torque with (M, 2) signs of each member; inf: there is none."""
        bounds, M = self.bounds.copy(), self.problem.contact_count
        for k, own in enumerate(signs):
            for c, along in np.ndindex(M, 2):
                pair = bounds[3 * (M * k + c) + 1 + along]
                pair[0] = max(pair[0], 0.0) if own[c, along] <= 0 else pair[0]
                pair[1] = min(pair[1], 0.0) if own[c, along] >= 0 else pair[1]
        return self._least(bounds)

    def in_any_force(self) -> float:
        """Return the same without modes."""
        return self._least(self.bounds)

    def _least(self, bounds: Array) -> float:
        cost = np.eye(len(bounds))[-1]
        answer = linprog(cost, self.above, self.most, self.equal, self.sides, bounds)
        assert answer.status in (0, 2)
        return float(answer.fun) if answer.status == 0 else np.inf

    def in_best_modes(self, modes: list[Array]) -> float:
        """Return the same with the best choice of one of the modes for each member."""
        M, count, size = self.problem.contact_count, len(self.wrenches), len(self.bounds)
        binaries = len(modes) * count
        far = self.problem.friction * self.problem.max_normal_force
        rows = []
        for k in range(count):
            for c, along in np.ndindex(M, 2):
                if not self.problem.has_cone[c]:
                    continue
                for way in (1.0, -1.0):  # friction one way needs a mode that slides the other
                    row = np.zeros(size + binaries)
                    row[3 * (M * k + c) + 1 + along] = way
                    allowed = [far[c] * (way * mode[c, along] < 0) for mode in modes]
                    row[size + k * len(modes) : size + (k + 1) * len(modes)] = np.negative(allowed)
                    rows.append(row)
        one = np.hstack([np.zeros((count, size)), np.kron(np.eye(count), np.ones(len(modes)))])

        def wide(matrix: Array) -> Array:
            return np.hstack([matrix, np.zeros((len(matrix), binaries))])

        rows = np.array(rows).reshape(len(rows), size + binaries)
        answer = linprog(
            np.eye(size + binaries)[size - 1],
            np.vstack([wide(self.above), rows]),
            np.concatenate([self.most, np.zeros(len(rows))]),
            np.vstack([wide(self.equal), one]),
            np.concatenate([self.sides, np.ones(count)]),
            np.vstack([self.bounds, np.tile([0.0, 1.0], (binaries, 1))]),
            integrality=np.concatenate([np.zeros(size), np.ones(binaries)]),
            options={"mip_rel_gap": 1e-7},
        )
        assert answer.status in (0, 2)
        if answer.status == 2:
            return np.inf
        picked = answer.x[size:].reshape(count, -1).argmax(axis=1)
        return self.in_modes([modes[number] for number in picked])


def _cross(at: Array) -> Array:
    x, y, z = at
    return np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])


def corners_of(problem: QuasistaticProblem, mass: float, off: float) -> Array:
    """Return the wrenches of a load that is larger or smaller, and acts off along x."""
    force, moment = problem.external_wrench[:3], problem.external_wrench[3:]
    lever = np.cross(force, moment) / (force @ force)
    along = moment - np.cross(lever, force)
    found = []
    for share in (1.0 - mass, 1.0 + mass):
        for shift in sorted({-off, off}):
            at = lever + np.array([shift, 0.0, 0.0])
            found.append(np.concatenate([share * force, np.cross(at, share * force) + along]))
    return np.unique(np.array(found, dtype=np.float64).round(12), axis=0)


def scene(seed: int) -> tuple[QuasistaticProblem, dict[str, Any]]:
    """Return a problem of 2 to 4 contacts and what is not known of it.

    A wall and a finger of one or two joints press on both sides of a weight, and up to two contacts
    stand below it; every fifth is one of `slope_scene`, with contacts that slide.
    """
    rng = np.random.default_rng([7, seed])
    contacts = 2 + seed % 3
    given: dict[str, Any] = {"mass": 0.2}
    if seed % 4 >= 2 or seed >= 40:
        given["center_of_mass"] = (0.012 if seed < 40 else 0.02, 0.0, 0.0)
    if seed >= 50:
        given = {"mass": EMPTY, "center_of_mass": (0.006, 0.0, 0.0)}
    if contacts > 2 and seed % 5 == 0:
        return slope_scene(seed, contacts), given
    positions = np.array([[-0.04, 0.0, 0.0], [0.04, 0.0, 0.0], [0, 0, -0.03], [0, 0, -0.03]])
    positions[2:, :2] = rng.uniform(-0.03, 0.03, (2, 2))
    normals = np.array([[1.0, 0, 0], [-1.0, 0, 0], [0, 0, 1.0], [0, 0, 1.0]])
    joints = int(rng.integers(1, 3))
    jacobian = np.zeros((3 * contacts, joints))
    jacobian[3:6] = 0.05 * (np.array([[-1.0], [0.0], [0.0]]) + rng.normal(size=(3, joints)))
    jacobian[:3] = 0.05 * rng.normal(size=(3, joints)) * (rng.random() < 0.5)
    tangents = []
    for n, angle in zip(normals[:contacts], rng.uniform(0.0, pi, contacts), strict=True):
        first = np.array([0.0, 1.0, 0.0])
        second = np.cross(n, first)
        turned = cos(angle) * first + sin(angle) * second
        tangents.append(np.array([turned, np.cross(n, turned)]).T)
    made = QuasistaticProblem(
        positions[:contacts],
        normals[:contacts],
        [0.0, 0.0, -3.0, 0.0, rng.uniform(-0.02, 0.02), 0.0],
        jacobian,
        friction=rng.uniform(0.4, 0.9, contacts),
        tangents=tangents,
        cone_edges=8,
        max_normal_force=40.0,
    )
    return made, given


def objections(seed: int, rule: dict[str, Any], node_limit: int) -> tuple[str, list[str]]:
    """Return what was seen of a scene under a rule, and what contradicts it."""
    problem, given = scene(seed)
    found = minimize_torque(
        problem, MARGIN, uncertainty=Uncertainty(**given), node_limit=node_limit, **rule
    )
    off = given.get("center_of_mass", (0.0,))[0]
    corners = Corners(problem, corners_of(problem, given["mass"], off))
    if "static_friction" in rule:
        common = best = corners.in_any_force()
    else:
        listed = [mode.signs for mode in enumerate_modes(problem, maximal=True, **rule)]
        signs = [one.astype(float) for one in listed]
        common = min((corners.in_modes([s] * len(corners.wrenches)) for s in signs), default=np.inf)
        best = corners.in_best_modes(signs) if signs else np.inf
    told = f"common {common:.6f}, each its own {best:.6f}, {_told(found)}"
    return told, list(_wrong(found, common, best))


def _told(found: RobustSolution) -> str:
    return f"found {found.max_torque:.6f} ({found.bound:.6f}) {found.status} {found.coverage}"


def _wrong(found: RobustSolution, common: float, best: float) -> list[str]:
    wrong = []
    if not found.found:
        if found.status not in (Status.NOT_FOUND_IN_LIMIT, Status.UNVERIFIED) and np.isfinite(best):
            wrong.append("told that there is nothing")
        return wrong
    size = SAME * max(1e-3, abs(best) if np.isfinite(best) else 1.0)
    if not found.bound <= best + size:
        wrong.append("bound above the best")
    if not found.max_torque >= best - size:
        wrong.append("better than the best")
    if found.coverage is Coverage.WHOLE_SET and not abs(found.max_torque - common) <= size:
        wrong.append("not the best common mode")
    closed = found.max_torque - found.solution.certificate.bound <= size
    if found.coverage is Coverage.CORNERS and closed and abs(found.max_torque - best) > size:
        wrong.append("not the best of the corners")
    if np.isfinite(common) and found.coverage is Coverage.CORNERS:
        wrong.append("missed a common mode")
    return wrong


def main() -> int:
    """Print a row for each scene and rule; exit with 1 where something contradicts."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", type=int, default=60)
    parser.add_argument("--first", type=int, default=0)
    parser.add_argument("--nodes", type=int, default=2000)
    options = parser.parse_args()
    bad = 0
    for seed in range(options.first, options.first + options.scenes):
        for rule in RULES:
            told, wrong = objections(seed, rule, options.nodes)
            bad += bool(wrong)
            name = ", ".join(rule.values())
            print(f"{seed} {name}: {told} {'; '.join(wrong).upper()}", flush=True)
    print(f"{bad} contradictions")
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
