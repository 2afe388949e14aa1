"""What other loops take of these."""

cimport numpy as cnp

from graspless_pin.compiled.carried_optima cimport Carrier
from graspless_pin.compiled.optimum_starts cimport Start

cdef class ColdCarrier(Carrier):
    cdef int guesses
    cdef tuple judged_by
    cdef Py_ssize_t count
    cdef cnp.npy_intp* one_sided
    cdef cnp.npy_intp* chosen
    cdef double* wanted
    cdef double* slide
    cdef double* guessed
    cdef double* rows
    cdef double* side_bounds
    cdef double* slack
    cdef double* z
    cdef double* ds
    cdef double* dz
    cdef double* primal_residual
    cdef double* target
    cdef double* at
    cdef double* y
    cdef double* dy
    cdef double* dx
    cdef double* q
    cdef double* H
    cdef double* solved_balance
    cdef double* schur

    cdef void row_values_at(self, const double* x, double* level) noexcept
    cdef void add_weighted_rows(self, const double* w, double* slope) noexcept
    cdef bint factor_normal_equations(self) noexcept
    cdef void step(self) noexcept
    cdef double step_length(self, const double* values, const double* steps) noexcept
    cdef bint solved(self) noexcept
    cdef Start read(self)
