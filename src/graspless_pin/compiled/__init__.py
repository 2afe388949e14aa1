"""Short loops in C, where numpy would spend its time on calls rather than on numbers.

They are compiled when the package is installed, if there is a C compiler. Each does what a few
lines of numpy beside its caller do; where it was not compiled those lines run, with the same
results to rounding.
"""

from __future__ import annotations

try:
    from graspless_pin.compiled import (
        body_pairs,
        carried_optima,
        cold_optima,
        contact_frames,
        contact_search,
        dense_simplex,
        hand_states,
        kinematic_chains,
        linear_programs,
        loaded_states,
        optimum_starts,
        outcome_search,
        paper_programs,
        rigid_bodies,
        simplex_dictionary,
        small_arrays,
        virtual_motions,
    )
except ImportError:  # installed without a C compiler
    body_pairs = contact_frames = contact_search = linear_programs = None
    rigid_bodies = small_arrays = None
    carried_optima = cold_optima = dense_simplex = hand_states = kinematic_chains = None
    loaded_states = optimum_starts = outcome_search = paper_programs = None
    simplex_dictionary = virtual_motions = None

__all__ = [
    "body_pairs",
    "carried_optima",
    "cold_optima",
    "contact_frames",
    "contact_search",
    "dense_simplex",
    "hand_states",
    "kinematic_chains",
    "linear_programs",
    "loaded_states",
    "optimum_starts",
    "outcome_search",
    "paper_programs",
    "rigid_bodies",
    "simplex_dictionary",
    "small_arrays",
    "virtual_motions",
]
