"""Check a solution from its JSON document with numpy alone.

Nothing of the package's own algebra is used: balance, cones, limits and the proofs are worked out
again from the document's figures.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

_FORCE = 1e-6
_GAP = 1e-5
_MOTION = 1e-7


@dataclass(frozen=True)
class Check:
    """One line of a verification.

    Attributes:
        name: What was checked.
        passed: Whether it holds; None where the document holds no proof of it.
        detail: The figure that decided.
    """

    name: str
    passed: bool | None
    detail: str


@dataclass(frozen=True)
class Verification:
    """All checks of one document.

    Attributes:
        checks: In the order made.
    """

    checks: tuple[Check, ...]

    @property
    def passed(self) -> bool:
        """Whether no check failed."""
        return all(check.passed is not False for check in self.checks)

    def __str__(self) -> str:
        """Return a line a check."""
        mark = {True: "ok", False: "FAILED", None: "not proven here"}
        return "\n".join(
            f"{mark[check.passed]:>15}  {check.name}: {check.detail}" for check in self.checks
        )


def verify_document(document: dict[str, Any]) -> Verification:
    """Verify a found solution from its document (see `solution_document`).

    Args:
        document: The parsed JSON.

    Returns:
        Checks of frames, balance, cones, normal-force limits, torques, torque limits, margin,
        kinetic friction, the mode's signs and virtual motion, and the optimality proofs.

    Raises:
        ValueError: If the document holds no found solution, lacks a key or has a value of a wrong
            type or size.
    """
    if not isinstance(document, dict):
        raise ValueError("it is no solution document: not a JSON object")  # noqa: TRY004
    if document.get("found") is not True:
        raise ValueError("the document holds no found solution; there is nothing to verify")
    try:
        return _Checker(document).run()
    except KeyError as error:
        raise ValueError(f"the document lacks the key {error}") from None
    except (TypeError, ValueError, IndexError, AttributeError) as error:
        raise ValueError(f"the document has a value of a wrong type or size: {error}") from error


class _Checker:
    """The document's figures as arrays, and the checks."""

    def __init__(self, document: dict[str, Any]) -> None:
        contacts, joints = document["contacts"], document["joints"]
        self.document = document
        origin = np.array(document.get("object", {}).get("center_of_mass", [0.0, 0.0, 0.0]))
        self.p = np.array([c["position"] for c in contacts]) - origin
        self.n = np.array([c["normal"] for c in contacts])
        self.t = np.array([c["tangents"] for c in contacts])
        self.f = np.array([c["force"] for c in contacts])
        self.mu = np.array([c["friction"] for c in contacts])
        self.limit = np.array([c["max_normal_force"] for c in contacts])
        self.v = np.array([c["sliding"] for c in contacts])
        self.J = np.array([c["jacobian"] for c in contacts]).reshape(len(contacts), 3, -1)
        self.w = np.array(document["external_wrench"])
        self.edges = int(document["cone_edges"])
        self.slides = np.linalg.norm(self.v, axis=1) > 1e-12
        self.cone = ~self.slides & (self.mu > 0.0)
        self.tau = np.array([j["torque"] for j in joints])
        self.contact_tau = np.array([j["torque_contact"] for j in joints])
        self.gravity = np.array([j["torque_gravity"] for j in joints])
        self.lower = np.array([-np.inf if j["lower"] is None else j["lower"] for j in joints])
        self.upper = np.array([np.inf if j["upper"] is None else j["upper"] for j in joints])
        self.scale = float(self.limit.max())

    def run(self) -> Verification:
        checks = [self._frames(), self._balance(), self._cones(), self._normals(), self._kinetic()]
        checks += [self._torques(), self._torque_limits(), self._margin(), self._largest_torque()]
        if self.document["rules"]["static_friction"] == "virtual_sliding":
            checks += [self._rules(), self._mode(), self._motion()]
        checks.append(self._optimality("mode"))
        if self.document["status"] != "optimal_in_mode":
            checks.append(self._optimality("relaxation"))
        return Verification(tuple(checks))

    def _small(self, name: str, value: float, unit: str, tolerance: float) -> Check:
        return Check(name, bool(value <= tolerance), f"{value + 0.0:.2e} {unit}")

    def _frames(self) -> Check:
        frames = np.concatenate([self.n[:, None], self.t], axis=1)
        off = np.abs(frames @ frames.transpose(0, 2, 1) - np.eye(3)).max()
        along = np.abs(np.einsum("li,li->l", self.v, self.n))
        off = max(off, (along / np.maximum(np.linalg.norm(self.v, axis=1), 1e-12)).max())
        return self._small("orthonormal frames, tangential sliding", float(off), "", 1e-5)

    def _balance(self) -> Check:
        force = self.f.sum(axis=0) + self.w[:3]
        moment = np.cross(self.p, self.f).sum(axis=0) + self.w[3:]
        worst = float(max(np.abs(force).max(), np.abs(moment).max()))
        return self._small("balance W f = -w_ext", worst, "N, N m", _FORCE * self.scale)

    def _faces(self, contact: int | np.intp) -> np.ndarray:
        """(r, 3) unit outward face normals in (n, t1, t2) coordinates."""
        angles = 2.0 * np.pi * (np.arange(self.edges) + 0.5) / self.edges
        slope = self.mu[contact] * np.cos(np.pi / self.edges)
        rows = np.column_stack([np.full(self.edges, -slope), np.cos(angles), np.sin(angles)])
        return rows / np.sqrt(1.0 + slope**2)

    def _local(self) -> np.ndarray:
        """(M, 3) force components along n, t1, t2."""
        frames = np.concatenate([self.n[:, None], self.t], axis=1)
        return np.einsum("lij,lj->li", frames, self.f)

    def _cones(self) -> Check:
        local = self._local()
        outside = max(
            (float((self._faces(c) @ local[c]).max()) for c in np.flatnonzero(self.cone)),
            default=0.0,
        )
        return self._small("inside friction cones", outside, "N", _FORCE * self.scale)

    def _normals(self) -> Check:
        normal = self._local()[:, 0]
        outside = float(max((-normal).max(), (normal - self.limit).max()))
        return self._small("normal forces within 0 and limit", outside, "N", _FORCE * self.scale)

    def _kinetic(self) -> Check:
        normal = self._local()[:, 0]
        worst = 0.0
        for c in np.flatnonzero(~self.cone):
            direction = self.n[c].copy()
            if self.slides[c]:
                direction -= self.mu[c] * self.v[c] / np.linalg.norm(self.v[c])
            worst = max(worst, float(np.abs(self.f[c] - normal[c] * direction).max()))
        return self._small("kinetic friction against sliding", worst, "N", _FORCE * self.scale)

    def _torques(self) -> Check:
        made = np.einsum("lij,li->j", self.J, self.f)
        off = np.concatenate([made - self.contact_tau, made + self.gravity - self.tau, [0.0]])
        unit = max(1.0, float(np.abs(self.tau).max(initial=0.0)))
        return self._small("torques J^T f + g", float(np.abs(off).max()), "N m", _FORCE * unit)

    def _torque_limits(self) -> Check:
        over = np.concatenate([self.tau - self.upper, self.lower - self.tau, [0.0]])
        unit = max(1.0, float(np.abs(self.tau).max(initial=0.0)))
        return self._small("torques within limits", float(over.max()), "N m", _FORCE * unit)

    def _reached_margin(self) -> float:
        local = self._local()
        margin = min(local[:, 0].min(), (self.limit - local[:, 0]).min())
        for c in np.flatnonzero(self.cone):
            margin = min(margin, -(self._faces(c) @ local[c]).max())
        return float(margin)

    def _margin(self) -> Check:
        reached = self._reached_margin()
        off = abs(reached - self.document["margin"])
        off = max(off, self.document["required_margin"] - reached)
        return self._small("margin as stated", off, "N", _FORCE * self.scale)

    def _largest_torque(self) -> Check:
        off = abs(float(np.abs(self.tau).max(initial=0.0)) - self.document["max_torque"])
        return self._small("largest torque as stated", off, "N m", _FORCE * max(1.0, off))

    def _signs(self) -> tuple[np.ndarray, np.ndarray]:
        contacts = self.document["contacts"]
        return (
            np.array([c["selected"] for c in contacts], dtype=bool),
            np.array([c["signs"] for c in contacts], dtype=float),
        )

    def _rules(self) -> Check:
        """How many zeros a selected contact may have, and whether sliding ones are selected."""
        rules = self.document["rules"]
        selected, signs = self._signs()
        zeros = (signs == 0.0).sum(axis=1)
        ok = np.where(selected, zeros <= (rules["sign_rule"] == "exact"), zeros == 2)
        ok &= np.isin(signs, (-1.0, 0.0, 1.0)).all(axis=1)
        if rules["sliding_rule"] == "constrained":
            ok &= selected | ~self.slides
        detail = f"contacts that do not: {np.flatnonzero(~ok).tolist()}"
        return Check("signs obey the rules", bool(ok.all()), detail)

    def _mode(self) -> Check:
        selected, signs = self._signs()
        friction = self._local()[:, 1:] * self.cone[:, None]
        allowed = np.where(signs == 0.0, np.abs(friction), signs * friction)
        allowed[~selected] = np.abs(friction[~selected])
        worst = float(max(allowed.max(), 0.0))
        return self._small("friction opposes the mode (27), (31)", worst, "N", _FORCE * self.scale)

    def _motion(self) -> Check:
        name = "the mode has a virtual motion (22)"
        motion = self.document["certificate"].get("virtual_motion")
        if motion is None:
            return Check(name, None, "no motion in the document")
        V, rates = np.array(motion["object"]), np.array(motion["joints"])
        u = V[:3] + np.cross(V[3:], self.p) - self.J @ rates
        frames = np.concatenate([self.n[:, None], self.t], axis=1)
        local = np.einsum("lij,lj->li", frames, u)
        selected, signs = self._signs()
        size = max(float(np.abs(local).max()), 1e-300)
        leaving = float(np.abs(local[selected, 0]).max(initial=0.0)) / size
        along = (signs * local[:, 1:])[selected]
        if self.document["rules"]["sign_rule"] == "nonzero":
            ok = (along >= -_MOTION * size).all() and (along.sum(axis=1) > 0.0).all()
        else:
            zero = signs[selected] == 0.0
            still = np.abs(local[selected, 1:])[zero]
            ok = (along[~zero] > 0.0).all() and (still <= _MOTION * size).all()
        return Check(name, bool(ok and leaving <= _MOTION), f"normal velocity {leaving:.1e} of all")

    def _optimality(self, which: str) -> Check:
        name = "optimal within its mode" if which == "mode" else "optimal over all modes"
        given = self.document["certificate"].get(f"{which}_multipliers")
        if given is None:
            return Check(name, None, "no multipliers in the document")
        bound = self._dual_bound({key: np.array(value) for key, value in given.items()}, which)
        if self.document["algorithm"] == "margin":
            value, unit = -self.document["margin"], self.scale
        elif self.document["certificate"]["scale"] == "limits":
            sides = np.where(self.tau >= 0.0, self.upper, self.lower)
            shares = self.tau[sides != 0.0] / sides[sides != 0.0]
            value, unit = float(shares.max(initial=0.0)), 1.0
        else:
            value, unit = self.document["max_torque"], max(1.0, self.document["max_torque"])
        gap = value - bound
        if gap <= _GAP * unit:
            return Check(name, passed=True, detail=f"proven gap {gap:.1e}")
        if which == "relaxation":
            detail = f"the relaxation leaves {gap:.3g}; the search's own bound has to be believed"
            return Check(name, None, detail)
        return Check(name, passed=False, detail=f"gap {gap:.3g}")

    def _dual_bound(self, m: dict[str, np.ndarray], which: str) -> float:
        """Smallest value of the Lagrangian over the box of forces and the objective's variable."""
        is_margin = self.document["algorithm"] == "margin"
        by_limits = self.document["certificate"]["scale"] == "limits"
        for key in m:
            if key != "balance":
                m[key] = np.maximum(m[key], 0.0)
        finite_up, finite_low = np.isfinite(self.upper), np.isfinite(self.lower)
        m["torque_upper"] = np.where(finite_up, m["torque_upper"], 0.0)
        m["torque_lower"] = np.where(finite_low, m["torque_lower"], 0.0)
        # Only constraints that the program has may prove anything.
        for side, finite in (("share_upper", finite_up), ("share_lower", finite_low)):
            absent = ~finite if by_limits else np.full(len(finite), is_margin)
            m[side] = np.where(absent, 0.0, m[side])
        e0 = 0.0 if is_margin else self.document["required_margin"]
        torque = m["torque_upper"] - m["torque_lower"] + m["share_upper"] - m["share_lower"]
        constant = float(m["balance"] @ self.w) + float(torque @ self.gravity)
        constant -= float(m["torque_upper"] @ np.where(finite_up, self.upper, 0.0))
        constant += float(m["torque_lower"] @ np.where(finite_low, self.lower, 0.0))
        constant -= float(m["normal_upper"] @ self.limit)
        constant += e0 * float(m["faces"].sum())
        slopes = m["balance"][:3] + np.cross(m["balance"][3:], self.p) + self.J @ torque
        _, signs = self._signs()
        total, cone = constant, 0
        for c in range(len(self.p)):
            normal = m["normal_upper"][c] - m["normal_lower"][c]
            low, high = (0.0, self.limit[c]) if is_margin else (0.0, self.limit[c] - e0)
            if not self.cone[c]:
                direction = self.n[c].copy()
                if self.slides[c]:
                    direction -= self.mu[c] * self.v[c] / np.linalg.norm(self.v[c])
                slope = slopes[c] @ direction + normal
                total += min(slope * max(low, e0), slope * high)
                continue
            frame = np.vstack([self.n[c], self.t[c]])
            local = frame @ slopes[c] + m["faces"][cone] @ self._faces(c)
            local[0] += normal
            cone += 1
            total += min(local[0] * low, local[0] * high)
            reach = self.mu[c] * self.limit[c]
            for k in range(2):
                sign = signs[c, k] if which == "mode" else None
                left = 0.0 if sign is not None and sign <= 0.0 else -reach
                right = 0.0 if sign is not None and sign >= 0.0 else reach
                total += min(local[k + 1] * left, local[k + 1] * right)
        return total + self._variable(m, is_margin=is_margin, by_limits=by_limits)

    def _variable(self, m: dict[str, np.ndarray], *, is_margin: bool, by_limits: bool) -> float:
        """The objective variable's part: e in [0, limit / 2], or t >= 0 up to all torques."""
        if is_margin:
            slope = -1.0 + float(
                m["faces"].sum() + m["normal_upper"].sum() + m["normal_lower"].sum()
            )
            return min(0.0, slope * float(self.limit.min()) / 2.0)
        up, low = np.ones(len(self.tau)), np.ones(len(self.tau))
        if by_limits:
            up = np.where(np.isfinite(self.upper), np.maximum(self.upper, 0.0), 0.0)
            low = np.where(np.isfinite(self.lower), np.maximum(-self.lower, 0.0), 0.0)
        slope = 1.0 - float(m["share_upper"] @ up + m["share_lower"] @ low)
        reach = np.sqrt(1.0 + self.mu**2) * self.limit
        lever = np.einsum("lij,l->j", np.abs(self.J), reach) + np.abs(self.gravity)
        smallest = np.minimum(np.where(up > 0.0, up, np.inf), np.where(low > 0.0, low, np.inf))
        most = float((lever / smallest).max(initial=0.0)) + 1.0
        return min(0.0, slope * most)
