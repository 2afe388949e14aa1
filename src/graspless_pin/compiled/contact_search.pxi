"""Convex sets, which of them may touch, and the contacts of spheres over faces."""

cpdef enum:
    OTHER = 0
    BALL = 1
    PLANE = 2
    POLYTOPE = 3
    REVOLVED = 4

cdef double _ON_FACE = 1e-9  # m, as in `polytopes`


cdef class ConvexSets(KeptArrays):
    """K convex sets in the frames of their geometries, as `HandStates` takes them."""

    cdef Py_ssize_t count
    cdef cnp.npy_intp* kinds
    cdef cnp.npy_intp* bodies
    cdef cnp.npy_intp* starts
    cdef double* centers
    cdef double* halves
    cdef double* reaches
    cdef double* planes
    cdef double* faces

    def __init__(self, kinds, bodies, centers, half_extents, reaches, planes, starts, faces):
        """Take the sets.

        Args:
            kinds: (K,) `BALL`, `PLANE`, `POLYTOPE`, `REVOLVED` about the z axis, or 0 for others.
            bodies: (K,) number below K of the body that each is a piece of.
            centers: (K, 3) centres of boxes around them, m.
            half_extents: (K, 3) half the edge lengths of these boxes, m.
            reaches: (K,) radii of spheres around them about these centres, m; a ball's is its own,
                and its centre is the origin.
            planes: (K, 4) outward normal and offset of the half-spaces, anything for others.
            starts: (K + 1,) where the faces of each begin.
            faces: (F, 4) outward normals and offsets of the polytopes' faces.
        """
        cdef Py_ssize_t k
        self.count = len(kinds)
        self.kinds = self.numbers(as_integers(kinds, self.count))
        self.bodies = self.numbers(as_integers(bodies, self.count))
        self.centers = self.reals(as_shaped(centers, self.count, 3))
        self.halves = self.reals(as_shaped(half_extents, self.count, 3))
        self.reaches = self.reals(as_vector(reaches, self.count))
        self.planes = self.reals(as_shaped(planes, self.count, 4))
        self.starts = self.numbers(as_integers(starts, self.count + 1))
        self.faces = self.reals(as_shaped(faces, self.starts[self.count], 4))
        if self.starts[0] != 0:
            raise ValueError("needs faces from the first one on")
        for k in range(self.count):
            if not (0 <= self.bodies[k] < self.count and self.starts[k] <= self.starts[k + 1]):
                raise ValueError("needs bodies below K and starts that rise")
            if self.kinds[k] == POLYTOPE and self.starts[k] == self.starts[k + 1]:
                raise ValueError("needs faces of every polytope")


cdef bint _highest_face(
    ConvexSets ones, Py_ssize_t p, const double* x, double* height, const double** face
) noexcept nogil:
    """The face over which a point is highest; whether its foot is on it, or it is inside."""
    cdef const double* one
    cdef double over
    cdef double foot[3]
    cdef Py_ssize_t f
    cdef int i
    height[0], face[0] = 0.0, NULL
    for f in range(ones.starts[p], ones.starts[p + 1]):
        one = ones.faces + 4 * f
        over = dot(one, x) - one[3]
        if face[0] == NULL or over > height[0]:
            height[0], face[0] = over, one
    if height[0] <= 0.0:
        return True
    for i in range(3):
        foot[i] = x[i] - height[0] * face[0][i]
    for f in range(ones.starts[p], ones.starts[p + 1]):
        one = ones.faces + 4 * f
        if dot(one, foot) - one[3] > _ON_FACE:
            return False
    return True


cdef int ball_on_face(
    ConvexSets ones, Py_ssize_t p, const double* T, double radius, const double* T_ball,
    double tolerance, double max_penetration, double* row, double* gap
) noexcept nogil:
    """Put position and normal (6,) of a sphere's contact with a face, and its gap, into places.

    1: there is one; 0: the sphere is far off; -1: it is in too deep or at an edge.
    """
    cdef double offset[3]
    cdef double x[3]
    cdef double height
    cdef const double* face
    cdef bint on_face
    cdef int i
    for i in range(3):
        offset[i] = T_ball[4 * i + 3] - T[4 * i + 3]
    turn_back(T, offset, x)
    on_face = _highest_face(ones, p, x, &height, &face)
    gap[0] = height - radius
    if gap[0] > tolerance:
        return 0
    if gap[0] < -max_penetration or not on_face:
        return -1
    turn(T, face, row + 3)
    for i in range(3):
        row[3 + i] = -row[3 + i]
        row[i] = T_ball[4 * i + 3] + 0.5 * (height + radius) * row[3 + i]
    return 1
