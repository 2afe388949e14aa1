"""What other loops take of these."""

cimport numpy as cnp

from graspless_pin.compiled.paper_programs cimport PaperPrograms

cdef class Start:
    cdef Py_ssize_t R, D, S, s, n1, W, p, rubbed
    cdef list kept
    cdef cnp.npy_intp* rows
    cdef cnp.npy_intp* starts
    cdef cnp.npy_intp* columns
    cdef cnp.npy_intp* contacts
    cdef cnp.npy_bool* upper
    cdef double* values
    cdef double* gram
    cdef double* weights
    cdef double* x
    cdef double* signs
    cdef double* own_signs
    cdef double* motion
    cdef double* A
    cdef double* w
    cdef double* b
    cdef double* sides
    cdef double* room
    cdef double judged[4]

    cdef void fit(self, PaperPrograms programs) noexcept
    cdef double* real(self, cnp.ndarray array)
    cdef cnp.npy_intp* number(self, cnp.ndarray array)
