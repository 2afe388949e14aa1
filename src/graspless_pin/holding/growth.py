"""Records of what becomes of small motions about a rest, and of what proves that none grows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from math import nan

from graspless_pin.problem.checks import FloatArray


@dataclass(frozen=True, eq=False)
class GrowthProof:
    """Small motions z about a rest, and what proves that none grows faster than a rate.

    M_z z'' + D_z z' + (K_geo + N_q^T K N_q) z = 0 with M_z = N^T (M + rotors) N, D_z = N_q^T D N_q;
    see `holding.small_motions`.

    Attributes:
        velocities: (P + L, d) N: motions without slip at contacts that bear any load.
        forces: (M, 3) of a rest in which all contacts that can do so bear load, N, world axes.
        geometric_stiffness: (d, d) K_geo, under the worst admissible contact forces as found.
        joints: c columns of the joints that carry touching links: N_q is their rows of N.
        gains: (c,) K, N m/rad (N/m).
        damping: (c,) D, N m s/rad (N s/m).
        rotors: (c,) inertia of rotors that was added, kg m^2 (kg).
        rate: 1/s.
        lyapunov: (2d, 2d) P > 0 with A^T P + P A <= 2 rate P, in coordinates in which M_z is one
            and time counts in one over the fastest frequency; see `scaled_system`.
    """

    velocities: FloatArray
    forces: FloatArray
    geometric_stiffness: FloatArray
    joints: tuple[int, ...]
    gains: FloatArray
    damping: FloatArray
    rotors: FloatArray
    rate: float
    lyapunov: FloatArray


@dataclass(frozen=True, eq=False)
class SmallMotions:
    """What becomes of small motions about a rest under the controller, to second order.

    Slips and contacts that part are another question, which the verdict itself answers.

    Attributes:
        stiffness: The least feedback at each joint with which none grows, and with no larger one
            that is `stable`, N m/rad (N/m where all joints slide); 0: none grows without; inf: no
            feedback is enough; NaN: it is not known.
        growth: Rate of the one that grows fastest under the controller, 1/s; 0: none grows faster
            than `small_motions.GROWTH_LIMIT`; NaN as above.
        unit: Of the stiffness.
        moving: What that one does, such as "the fingers buckle"; empty: none grows.
        unknown: Why it is not known; empty: it is.
        growth_by_surface: See `MinimumStiffness`; empty where no mesh touches.
        motion: (P + L,) the velocity of the one that grows fastest; None: none grows.
        neutral: What motions do that nothing drives on or back.
        least_growth: Growth under those contact forces, of all that the torques leave open, that
            suit best, as found; NaN as above.
        stable: All feedback with which none grows, (low, high) each, ascending, in that unit; the
            last high is inf where none grows with any larger one.
        proofs: What proves that none grows, by model of the surfaces; empty: one does, or it is
            not known.
        assumed: See `MinimumStiffness`.
    """

    stiffness: float
    growth: float
    unit: str = ""
    moving: str = ""
    unknown: str = ""
    growth_by_surface: Mapping[str, float] = field(default_factory=dict)
    motion: FloatArray | None = None
    neutral: tuple[str, ...] = ()
    least_growth: float = nan
    stable: tuple[tuple[float, float], ...] = ()
    proofs: Mapping[str, GrowthProof] = field(default_factory=dict)
    assumed: tuple[int, ...] = ()

    @property
    def depends_on_forces(self) -> bool:
        """Whether some admissible contact forces let a motion grow, and others none."""
        return self.growth > 0.0 and self.least_growth == 0.0

    @classmethod
    def not_known(cls, why: str) -> SmallMotions:
        """Return that it is not known, and why."""
        return cls(nan, nan, unknown=why)
