"""Check forces that are affine in what is not known: what they prove holds for the worst of it.

Forces of member k are f_k + F_k d, for all d in a product of unit balls. A linear function of d is
farthest from its value at d = 0 by the lengths of its coefficients in each ball. What d does to the
loads, and by how much torques may be off, is taken as given, as the members are.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from graspless_pin.report.verify import tolerances
from graspless_pin.report.verify.outcome import Check, agrees, given, holds, within
from graspless_pin.report.verify.problem import Problem
from graspless_pin.report.verify.values import MOST, array, entry, items, number, whole

_WHERE = "policy of uncertainty"


class AffineForces:
    """What a document says of affine forces, and what they prove.

    Attributes:
        commands: (K, L) N m (N) at d = 0.
        largest: (L,) the largest |command| in any member.
        margin: That all forces keep, N.
        value: Of the objective, in its unit.
    """

    def __init__(self, stated: Any, problem: Problem, members: list[dict[str, np.ndarray]]) -> None:
        """Read the arrays.

        Args:
            stated: What stands under ``policy``.
            problem: Contacts and joints.
            members: What is so of each.

        Raises:
            ValueError: If a key is missing, or a value of a wrong type or size.
        """
        K, M, L = len(members), problem.count, len(problem.units)
        balls = items(entry(stated, "balls", _WHERE), f"balls of {_WHERE}", 1, MOST)
        D = len(balls)
        joints = items(entry(stated, "joints", _WHERE), f"joints of {_WHERE}", D, D)

        def read(key: str, *shape: int) -> np.ndarray:
            return array(entry(stated, key, _WHERE), shape, f"{key} of {_WHERE}")

        self.balls = np.array([whole(one, "a ball", 0, D) for one in balls])
        self.joints = np.array([whole(one, "a joint", -1, L - 1) for one in joints])
        self.loads, self.errors = read("loads", K, len(problem.w), D), read("errors", L, D)
        self.forces, self.slopes = read("forces", K, M, 3), read("slopes", K, M, 3, D)
        self.shares, self.offsets = read("shares", L), read("offsets", L)
        rows, self.directions = entry(stated, "directions", _WHERE), None
        if rows is not None:
            width = len(items(rows, f"directions of {_WHERE}", L, L)[0]) if L else 0
            self.directions = read("directions", L, width)
        self.problem, self.members = problem, members
        factors = np.array([one["factors"] for one in members])
        carried = np.array([one["gravity"] - one["offsets"] for one in members])
        made = np.einsum("lij,kli->kj", problem.J, self.forces)
        self.commands = (made + carried) / factors
        turned = np.einsum("lij,klid->kjd", problem.J, self.slopes)
        self.added = turned / factors[..., None] - self.errors
        # Constant torques are those of the first member.
        driven = slice(None) if self.directions is not None else slice(1)
        self.room = self.most(self.added[driven]) if self.directions is not None else 0.0
        self.driven = self.commands[driven]
        self.largest = (np.abs(self.driven) + self.room).max(axis=0)
        self.margin = min(map(self._margin, range(K)))

    def most(self, parts: np.ndarray) -> np.ndarray:
        """Return (...,) the most that (..., D) coefficients add for any d."""
        return np.sum(
            [np.linalg.norm(parts[..., self.balls == one], axis=-1) for one in set(self.balls)],
            axis=0,
        )

    def _margin(self, k: int) -> float:
        own = replace(self.problem, mu=self.members[k]["friction"])
        local = np.einsum("lij,lj->li", own.frames, self.forces[k])
        slopes = np.einsum("lij,ljd->lid", own.frames, self.slopes[k])
        room, normal = self.most(slopes[:, 0]), local[:, 0]
        least = [float((normal - room).min()), float((own.limit - normal - room).min())]
        for c in np.flatnonzero(own.cone).tolist():
            rows = own.faces(c)
            least.append(-float((rows @ local[c] + self.most(rows @ slopes[c])).max()))
        return min(least)

    @property
    def value(self) -> float:
        """Of the objective, in its unit."""
        if self.problem.is_margin:
            return self.margin
        if not self.problem.by_limits:
            return float(self.largest.max(initial=0.0))
        up, down = self.problem.shared
        with np.errstate(divide="ignore", invalid="ignore"):
            shares = np.where(up > 0.0, (self.driven + self.room) / up, 0.0)
            shares = np.maximum(shares, np.where(down > 0.0, (self.room - self.driven) / down, 0.0))
        return float(shares.max(initial=0.0))

    def checks(self) -> list[Check]:
        """Return whether forces balance, friction can be so, and torques are those of all."""
        problem, scale = self.problem, self.problem.joint_scale
        passive = problem.passive.reshape(-1, len(problem.w)).T
        flat = self.slopes.reshape(*self.forces.shape[:1], -1, len(self.balls))
        wrenches = np.array([one["wrench"] for one in self.members])
        left = np.abs(self.forces.reshape(len(flat), -1) @ passive.T + wrenches)
        left += self.most(passive @ flat + self.loads)
        bare = max(map(self._bare, range(len(flat))))
        named, counts = np.unique(self.joints[self.joints >= 0], return_counts=True)
        alone = np.bincount(self.balls)[self.balls[self.joints >= 0]]
        own = np.arange(len(self.errors))[:, None] == self.joints
        proper = bool((counts == 1).all() and (alone == 1).all() and (self.errors >= 0.0).all())
        proper &= not (self.errors[~own].any() or self.loads[:, :, self.joints >= 0].any())
        lack = self.shares * self.largest + self.offsets - self.errors.sum(axis=1)
        low, high = tolerances.torque_limits(problem)
        beyond = np.maximum(self.driven + self.room - problem.upper - high,
                            problem.lower - low - self.driven + self.room)  # fmt: skip
        return [
            given("loads and errors", f"{len(self.balls)} of them, {len(named)} of joints"),
            within("balance", float((left / problem.passive_scale).max()), tolerances.SHARE,
                   "of the load"),
            within("forces without a cone", bare / problem.force, tolerances.SHARE, "of the load"),
            within("margin lacks", problem.e0 - self.margin, tolerances.force(problem), "N"),
            self._same_commands(),
            holds("errors are those of joints", proper, f"{len(named)} joints"),
            within("errors lack", float((lack / scale).max(initial=0.0)), tolerances.SHARE, ""),
            holds("torque limits", not (beyond > 0.0).any(), f"{beyond.max(initial=0.0):.2e}"),
        ]  # fmt: skip

    def _bare(self, k: int) -> float:
        """Return how far forces are from what contacts without a cone can bear, N."""
        own = replace(self.problem, mu=self.members[k]["friction"])
        along, off = own.directions, ~own.cone
        normals = own.frames[:, 0]
        apart = self.forces[k] - along * (normals * self.forces[k]).sum(axis=1)[:, None]
        turned = np.einsum("lj,ljd->ld", normals, self.slopes[k])
        slopes = self.slopes[k] - along[:, :, None] * turned[:, None]
        return float((np.abs(apart) + self.most(slopes))[off].max(initial=0.0))

    def _same_commands(self) -> Check:
        """Whether all members have the same commands, but for what feedback adds."""
        levers, note = np.abs(self.problem.J).max(axis=(0, 1), initial=0.0), ""
        shared = np.eye(len(levers))[levers > tolerances.IDLE * levers.max(initial=0.0)]
        if self.directions is not None:
            columns, sizes, _ = np.linalg.svd(self.directions)
            shared = columns[:, int((sizes > tolerances.SAME * sizes.max(initial=0.0)).sum()) :].T
            note = "; what feedback adds is given"
        off = np.abs((self.commands - self.commands[0]) @ shared.T)
        off = (off + self.most(shared @ self.added)) @ np.abs(shared)
        most = float((off / self.problem.joint_scale).max(initial=0.0))
        check = within("all members have the same commands", most, tolerances.SHARE, "")
        return replace(check, detail=check.detail + note)


def policy_checks(
    document: dict[str, Any],
    stated: dict[str, Any],
    problem: Problem,
    members: list[dict[str, np.ndarray]],
) -> list[Check]:
    """Return the checks of forces that are affine in what is unknown.

    Args:
        document: The document.
        stated: What stands under ``uncertainty``.
        problem: Contacts and joints.
        members: What is so of each corner.

    Raises:
        ValueError: If a key is missing, or a value of a wrong type or size.
    """
    affine = AffineForces(entry(stated, "policy", "uncertainty"), problem, members)
    own = [number(entry(one, "torque", "a joint"), "a torque") for one in document["joints"]]
    names = [entry(one, "name", "a joint") for one in document["joints"]]
    by_joint = entry(stated, "torques", "uncertainty")
    told = [number(entry(by_joint, name, "torques"), "a torque") for name in names]
    off = np.abs(affine.commands[0] - [own, told]) / problem.joint_scale
    checks = affine.checks()
    checks += [
        within("the torques are those for all members", float(off.max(initial=0.0)),
               tolerances.SHARE, "(scaled)"),
        agrees("margin", number(entry(stated, "margin", "uncertainty"), "margin"), affine.margin,
               tolerances.force(problem), "N"),
        agrees("max_torque", number(entry(stated, "max_torque", "uncertainty"), "max_torque"),
               float(affine.largest.max(initial=0.0)),
               float(tolerances.SHARE * problem.joint_scale.max(initial=0.0))),
    ]  # fmt: skip
    status, bound = stated["status"], number(entry(stated, "bound", "uncertainty"), "bound")
    closed = abs(affine.value - bound) <= 2.0 * tolerances.SHARE * abs(affine.value)
    known = status == "limit_reached" or (closed and status in ("optimal", "optimal_in_mode"))
    checks.append(holds("status", known, f"{status:.60}, {affine.value:.9g}, bound {bound:.9g}"))
    if not problem.coulomb:
        checks.append(Check("one mode", None, "that friction opposes a sliding is not in it"))
    return [replace(one, name=f"affine forces: {one.name}") for one in checks]
