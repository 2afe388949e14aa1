"""The contacts that are known in closed form: spheres over faces, and faces on half-spaces."""

from libc.math cimport fabs
from libc.string cimport memcpy

cimport numpy as cnp


cpdef enum:
    OTHER = 0
    BALL = 1
    PLANE = 2
    POLYTOPE = 3

cdef double _ON_FACE = 1e-9  # m, as in `polytopes`


cdef class ConvexSets:
    """K convex sets in the frames of their geometries, as `plain_contacts` takes them."""

    cdef Py_ssize_t count
    cdef cnp.ndarray _kinds, _bodies, _centers, _halves, _reaches, _planes, _starts, _faces
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
            kinds: (K,) `BALL`, `PLANE`, `POLYTOPE` or 0 for others.
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
        self._kinds = <cnp.ndarray>cnp.PyArray_ContiguousFromAny(kinds, cnp.NPY_INTP, 1, 1)
        self.count = self._kinds.shape[0]
        self._bodies = as_integers(bodies, self.count)
        self._centers = as_shaped(centers, self.count, 3)
        self._halves = as_shaped(half_extents, self.count, 3)
        self._reaches = as_vector(reaches, self.count)
        self._planes = as_shaped(planes, self.count, 4)
        self._starts = as_integers(starts, self.count + 1)
        self.starts = numbers_of(self._starts)
        self._faces = as_shaped(faces, self.starts[self.count], 4)
        self.kinds = numbers_of(self._kinds)
        self.bodies = numbers_of(self._bodies)
        if self.starts[0] != 0:
            raise ValueError("needs faces from the first one on")
        for k in range(self.count):
            if not (0 <= self.bodies[k] < self.count and self.starts[k] <= self.starts[k + 1]):
                raise ValueError("needs bodies below K and starts that rise")
            if self.kinds[k] == POLYTOPE and self.starts[k] == self.starts[k + 1]:
                raise ValueError("needs faces of every polytope")
        self.centers, self.halves = data(self._centers), data(self._halves)
        self.reaches, self.planes = data(self._reaches), data(self._planes)
        self.faces = data(self._faces)


cdef bint near_boxes(
    ConvexSets ones, Py_ssize_t p, const double* T, ConvexSets others, Py_ssize_t k,
    const double* T_other, const double* center, double tolerance
) noexcept nogil:
    """Whether no side of the boxes around two sets parts them; `center` is the other's, world."""
    cdef double offset[3]
    cdef double local[3]
    cdef double R[9]
    cdef double reach, along
    cdef const double* half = ones.halves + 3 * p
    cdef const double* other_half = others.halves + 3 * k
    cdef int i, j
    if others.kinds[k] == PLANE:
        return True
    for i in range(3):
        offset[i] = center[i] - T[4 * i + 3]
    turn_back(T, offset, local)
    for i in range(3):
        local[i] -= ones.centers[3 * p + i]
        if fabs(local[i]) > half[i] + others.reaches[k] + tolerance:
            return False
    for i in range(3):
        for j in range(3):
            R[3 * i + j] = (
                T[i] * T_other[j] + T[4 + i] * T_other[4 + j] + T[8 + i] * T_other[8 + j]
            )
    for i in range(3):
        reach = half[i]
        for j in range(3):
            reach += fabs(R[3 * i + j]) * other_half[j]
        if fabs(local[i]) - reach > tolerance:
            return False
    for j in range(3):
        reach, along = other_half[j], 0.0
        for i in range(3):
            reach += fabs(R[3 * i + j]) * half[i]
            along += R[3 * i + j] * local[i]
        if fabs(along) - reach > tolerance:
            return False
    return True


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


cdef class _Rows:
    """Contacts as they are found, in an array that grows."""

    cdef cnp.ndarray array
    cdef double* data
    cdef Py_ssize_t count, capacity

    def __cinit__(self):
        self.count, self.capacity = 0, 16
        self.array = empty(self.capacity, 6)
        self.data = data(self.array)

    cdef void add(self, const double* surface, double height, const double* normal):
        """A contact half a height back along its normal from a point."""
        cdef cnp.ndarray larger
        cdef int i
        if self.count == self.capacity:
            larger = empty(2 * self.capacity, 6)
            memcpy(data(larger), self.data, 6 * self.capacity * sizeof(double))
            self.array, self.data, self.capacity = larger, data(larger), 2 * self.capacity
        for i in range(3):
            self.data[6 * self.count + i] = surface[i] - 0.5 * height * normal[i]
            self.data[6 * self.count + 3 + i] = normal[i]
        self.count += 1

    cdef cnp.ndarray part(self, int first):
        """(M, 3) the first or the last three columns."""
        cdef cnp.ndarray columns = empty(self.count, 3)
        cdef Py_ssize_t row
        for row in range(self.count):
            memcpy(data(columns) + 3 * row, self.data + 6 * row + first, 3 * sizeof(double))
        return columns


def plain_contacts(
    ConvexSets ones not None, ones_poses, ConvexSets others not None, others_poses,
    double tolerance, double max_penetration, face_of,
):
    """Contacts of spheres over faces and of faces on half-spaces, and the pairs that are left.

    Args:
        ones: P sets of the object.
        ones_poses: (P, 4, 4).
        others: K sets.
        others_poses: (K, 4, 4).
        tolerance: Largest gap, m.
        max_penetration: Largest overlap, m.
        face_of: Called with p and a (3,) direction in that set's frame: the corners (V, 4) of the
            face farthest along it, its contact points (G, 4), both [x, y, z, 1], and whether these
            are its corners; None where there is no such face.

    Returns:
        For each of M contacts the place of its pair; (M, 3) positions, (M, 3) normals into the
        object and M gaps; the near pairs (p, k); the places of those that are left.
    """
    cdef cnp.ndarray one_poses = as_poses(ones_poses), other_poses = as_poses(others_poses)
    cdef Py_ssize_t P = ones.count, K = others.count, p, k, place
    if one_poses.shape[0] != P or other_poses.shape[0] != K:
        raise ValueError("needs one pose for each set")
    cdef const double* T
    cdef const double* T_other
    cdef double center[3]
    cdef cnp.npy_intp count = P * K
    cdef cnp.ndarray near = <cnp.ndarray>cnp.PyArray_EMPTY(1, &count, cnp.NPY_INTP, 0)
    cdef cnp.npy_intp* hits = numbers_of(near)
    count = K
    cdef cnp.ndarray seen = <cnp.ndarray>cnp.PyArray_ZEROS(1, &count, cnp.NPY_INTP, 0)
    cdef cnp.npy_intp* times = numbers_of(seen)
    cdef _Rows rows = _Rows()
    cdef list left = [], pairs = [], places = [], gaps = []
    cdef double row[6]
    cdef double gap
    cdef int touches
    cdef bint plain
    count = 0
    for k in range(K):
        T_other = data(other_poses) + 16 * k
        move(T_other, others.centers + 3 * k, center)
        for p in range(P):
            T = data(one_poses) + 16 * p
            if near_boxes(ones, p, T, others, k, T_other, center, tolerance):
                hits[count] = k * P + p
                count += 1
                times[others.bodies[k]] += 1
    for place in range(count):
        p, k = hits[place] % P, hits[place] // P
        T, T_other = data(one_poses) + 16 * p, data(other_poses) + 16 * k
        pairs.append((p, k))
        plain = ones.kinds[p] == POLYTOPE and times[others.bodies[k]] == 1
        if plain and others.kinds[k] == BALL:
            touches = ball_on_face(
                ones, p, T, others.reaches[k], T_other, tolerance, max_penetration, row, &gap
            )
            plain = touches >= 0
            if touches > 0:
                rows.add(row, 0.0, row + 3)
                gaps.append(gap)
        elif plain and others.kinds[k] == PLANE:
            plain = _face_on_plane(
                p, T, others.planes + 4 * k, T_other, tolerance, max_penetration, face_of, rows,
                gaps,
            )
        else:
            plain = False
        if plain:
            while len(places) < len(gaps):
                places.append(place)
        else:
            left.append(place)
    return places, rows.part(0), rows.part(3), gaps, pairs, left


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


cdef bint _face_on_plane(
    Py_ssize_t p, const double* T, const double* plane, const double* T_plane, double tolerance,
    double max_penetration, object face_of, _Rows rows, list gaps
):
    """Whether all of a face is near a half-space."""
    cdef cnp.ndarray direction = empty1(3)
    cdef double* down = data(direction)
    cdef double normal[3]
    cdef double x[3]
    cdef double height, offset = plane[3]
    cdef int i
    cdef Py_ssize_t g, begun = rows.count
    cdef cnp.ndarray corners, points
    turn(T_plane, plane, normal)
    turn_back(T, normal, down)
    for i in range(3):
        offset += normal[i] * T_plane[4 * i + 3]
        down[i] = -down[i]
    face = face_of(p, direction)
    if face is None:
        return False
    corners, points = as_reals(face[0], 2), as_reals(face[1], 2)
    if corners.shape[1] != 4 or points.shape[1] != 4:
        raise ValueError("needs rows [x, y, z, 1]")
    if not face[2]:
        for g in range(corners.shape[0]):
            move(T, data(corners) + 4 * g, x)
            height = dot(normal, x) - offset
            if not -max_penetration <= height <= tolerance:
                return False
    for g in range(points.shape[0]):
        move(T, data(points) + 4 * g, x)
        height = dot(normal, x) - offset
        if not -max_penetration <= height <= tolerance:
            rows.count = begun
            del gaps[begun:]
            return False
        rows.add(x, height, normal)
        gaps.append(height)
    return True
