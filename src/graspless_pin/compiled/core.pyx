# cython: boundscheck=False, wraparound=False, cdivision=True, initializedcheck=False
"""Short loops in C, where numpy would spend its time on calls rather than on numbers.

Each file has one subject and takes what stands before it.
"""

from libc.math cimport INFINITY, M_PI, atan2, cos, fabs, floor, fmax, fmin, isfinite, sin, sqrt
from libc.stdlib cimport free, malloc, realloc
from libc.string cimport memcmp, memcpy, memmove, memset

cimport numpy as cnp

import numpy as np

cnp.import_array()

include "shared.pxi"
include "contact_frames.pxi"
include "virtual_motions.pxi"
include "contact_search.pxi"
include "body_pairs.pxi"
include "kinematic_chains.pxi"
include "hand_states.pxi"
include "simplex_dictionary.pxi"
include "dense_simplex.pxi"
include "paper_programs.pxi"
include "optimum_starts.pxi"
include "warm_optima.pxi"
include "cold_optima.pxi"
include "loaded_states.pxi"
include "mode_programs.pxi"
include "outcome_search.pxi"
