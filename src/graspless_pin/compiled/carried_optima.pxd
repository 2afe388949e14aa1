"""What other loops take of these."""

from graspless_pin.compiled.optimum_starts cimport Start
from graspless_pin.compiled.paper_programs cimport PaperPrograms

cdef class Carrier(PaperPrograms):
    cdef double damping, exact, close, cutoff
    cdef int corrections
    cdef double* y
    cdef double* G
    cdef double* forces
    cdef double* map
    cdef double* scaled
    cdef double* scale
    cdef double* motion
    cdef double* signs

    cdef bint refined(self, Start near) noexcept
    cdef bint optimum(self, Start near, bint has_map) noexcept
    cdef bint tried(self, list starts, bint cold) except -1
    cdef void tell(self, double* figures, double* torques, Py_ssize_t rows) noexcept
    cdef tuple told(self)
    cdef Start begun(self)
