"""Whether two triangles have a common point, exactly: one source for the CPU and CUDA.

A triangle is the convex hull of its corners: a segment where they lie on one line, a point where
all three are one. Every decision is the sign of a determinant of float32 coordinates. Where float64
leaves it open it is summed in integers of 896 bits, which hold all products of three coordinates.
"""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.intersect.predicates import ZERO, absolute, cross_bound, double, filtered_sign

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False, "max_unroll": 1})

# Limbs of 32 bits, carried late: each holds the sum of 96 numbers below 2^55.
limbs = wp.types.vector(length=28, dtype=wp.int64)
LIMBS = wp.constant(28)
LOW_24 = wp.constant(wp.int64(0xFFFFFF))
LOW_32 = wp.constant(wp.int64(0xFFFFFFFF))
UP = wp.constant(wp.vec3f(0.0, 0.0, 1.0))


@wp.func
def exponent(x: float) -> int:
    """The power of two, from 0 for the smallest, of the unit of a float32's significand."""
    return wp.max(int((wp.cast(x, wp.uint32) >> wp.uint32(23)) & wp.uint32(255)), 1) - 1


@wp.func
def significand(x: float) -> wp.int64:
    """The signed whole number of 24 bits that a float32 is, times 2^`exponent`."""
    bits = wp.cast(x, wp.uint32)
    whole = wp.int64(bits & wp.uint32(0x7FFFFF))
    if (bits >> wp.uint32(23)) & wp.uint32(255) != wp.uint32(0):
        whole = whole + wp.int64(0x800000)
    if bits >> wp.uint32(31) != wp.uint32(0):
        whole = -whole
    return whole


@wp.func
def sign_of(total: limbs) -> int:
    """The sign of a sum in limbs."""
    carry = wp.int64(0)
    rest = wp.int64(0)
    for k in range(LIMBS):
        limb = total[k] + carry
        carry = limb >> wp.int64(32)
        rest = rest | (limb & LOW_32)
    if carry < wp.int64(0):
        return -1
    if rest != wp.int64(0):
        return 1
    return 0


@wp.func
def exact_orientation(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, s: wp.vec3f) -> int:
    """The sign of the determinant of q - p, r - p and s - p, summed in integers."""
    rows = wp.matrix_from_rows(
        wp.vec4f(p[0], q[0], r[0], s[0]),
        wp.vec4f(p[1], q[1], r[1], s[1]),
        wp.vec4f(p[2], q[2], r[2], s[2]),
    )
    total = limbs()
    for row in range(4):
        # The determinant with a column of ones, developed by it: signs alternate.
        for term in range(6):
            axis = term % 3
            turn = 1 + term / 3
            x = rows[axis, (row + 1) % 4]
            y = rows[(axis + turn) % 3, (row + 2) % 4]
            z = rows[(axis + 2 * turn) % 3, (row + 3) % 4]
            if x == 0.0 or y == 0.0 or z == 0.0:
                continue
            first = significand(x) * significand(y)
            last = significand(z)
            if (row + turn) % 2 == 0:
                last = -last
            place = exponent(x) + exponent(y) + exponent(z)
            for part in range(2):
                product = (first & LOW_24) * last
                if part == 1:
                    product = (first >> wp.int64(24)) * last
                for half in range(2):
                    piece = product & LOW_24
                    if half == 1:
                        piece = product >> wp.int64(24)
                    at = place + 24 * (part + half)
                    total[at / 32] = total[at / 32] + (piece << wp.int64(at % 32))
    return sign_of(total)


@wp.func
def orientation(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, s: wp.vec3f) -> int:
    """The sign of the determinant of q - p, r - p and s - p."""
    u = double(q) - double(p)
    v = double(r) - double(p)
    w = double(s) - double(p)
    bound = cross_bound(u, v)
    sign = filtered_sign(wp.cross(u, v), bound, w)
    # Without a term that is not zero, as in a plane along the axes, nothing is left to sum.
    if sign == 0 and wp.dot(bound, absolute(w)) != ZERO:
        sign = exact_orientation(p, q, r, s)
    return sign


@wp.func
def turn_along(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, axis: int) -> int:
    """The sense in which three points go around, seen along an axis: -1, 0 or 1."""
    u = (axis + 1) % 3
    v = (axis + 2) % 3
    return orientation(
        wp.vec3f(p[u], p[v], 0.0), wp.vec3f(q[u], q[v], 0.0), wp.vec3f(r[u], r[v], 0.0), UP
    )


@wp.func
def apart_on(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, s: wp.vec3f, k: int) -> bool:
    """Whether the intervals of two segments on a coordinate axis have no common point."""
    return wp.max(p[k], q[k]) < wp.min(r[k], s[k]) or wp.max(r[k], s[k]) < wp.min(p[k], q[k])


@wp.func
def cross_along(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, s: wp.vec3f, axis: int) -> bool:
    """Whether two closed segments, or points, have a common point as seen along an axis."""
    ends = wp.matrix_from_rows(p, q, r, s)
    in_line = bool(True)
    for first in range(0, 4, 2):
        product = int(1)
        for other in range(2):
            turn = turn_along(ends[first], ends[first + 1], ends[2 - first + other], axis)
            product = product * turn
            in_line = in_line and turn == 0
        if product > 0:
            return False
    apart = apart_on(p, q, r, s, (axis + 1) % 3) or apart_on(p, q, r, s, (axis + 2) % 3)
    return not (in_line and apart)


@wp.func
def segments_meet(p: wp.vec3f, q: wp.vec3f, r: wp.vec3f, s: wp.vec3f) -> bool:
    """Whether two closed segments, or points, have a common point.

    They do if they lie in one plane and do so as seen along every axis: one of the views shows
    that plane, or the line in which all lies, without loss.
    """
    if orientation(p, q, r, s) != 0:
        return False
    for axis in range(3):
        if not cross_along(p, q, r, s, axis):
            return False
    return True


@wp.func
def open_axis(t: wp.mat33f) -> int:
    """An axis along which a triangle shows area; 3 if it has none."""
    for axis in range(3):
        if turn_along(t[0], t[1], t[2], axis) != 0:
            return axis
    return 3


@wp.func
def middle_corner(t: wp.mat33f) -> int:
    """Which corner of a triangle without area lies between the two others, or on one of them."""
    for k in range(2):
        low = wp.min(t[(k + 1) % 3], t[(k + 2) % 3])
        high = wp.max(t[(k + 1) % 3], t[(k + 2) % 3])
        if wp.min(t[k], low) == low and wp.max(t[k], high) == high:
            return k
    return 2


@wp.func
def enters(p: wp.vec3f, q: wp.vec3f, t: wp.mat33f, axis: int) -> bool:
    """Whether a closed segment, or point, meets a triangle that shows area along `axis`."""
    of_p = orientation(t[0], t[1], t[2], p)
    of_q = orientation(t[0], t[1], t[2], q)
    if of_p * of_q > 0:
        return False
    low = int(0)
    high = int(0)
    for k in range(3):
        a = t[k]
        b = t[(k + 1) % 3]
        turn = int(0)
        if of_p != 0 or of_q != 0:
            turn = orientation(p, q, a, b)
        elif cross_along(p, q, a, b, axis):
            return True
        else:
            turn = turn_along(a, b, p, axis)
        low = wp.min(low, turn)
        high = wp.max(high, turn)
    return high - low < 2


@wp.func
def have_common_point(a: wp.mat33f, b: wp.mat33f) -> bool:
    """Whether the convex hulls of three points each, as rows, have a common point.

    That point can be one of an edge, and a triangle without area is one of its edges.
    """
    axis_a = open_axis(a)
    axis_b = open_axis(b)
    if axis_a == 3 and axis_b == 3:
        i = middle_corner(a)
        j = middle_corner(b)
        return segments_meet(a[(i + 1) % 3], a[(i + 2) % 3], b[(j + 1) % 3], b[(j + 2) % 3])
    for edge in range(6):
        edges = a
        t = b
        axis = axis_b
        if edge > 2:
            edges = b
            t = a
            axis = axis_a
        if axis < 3 and enters(edges[edge % 3], edges[(edge + 1) % 3], t, axis):
            return True
    return False


@wp.func
def corners(points: wp.array2d(dtype=wp.vec3f), frame: int, f: wp.vec3i) -> wp.mat33f:
    """The corners of a triangle of a pose, as rows."""
    return wp.matrix_from_rows(points[frame, f[0]], points[frame, f[1]], points[frame, f[2]])


@wp.kernel
def settle(
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
    points: wp.array2d(dtype=wp.vec3f),
    faces: wp.array(dtype=wp.vec3i),
    meet: wp.array(dtype=wp.bool),
):
    """Whether each of the first `count` pairs (frame, i, j) has a common point."""
    slot = wp.tid()
    if slot < count[0]:
        pair = pairs[slot]
        a = corners(points, pair[0], faces[pair[1]])
        b = corners(points, pair[0], faces[pair[2]])
        meet[slot] = have_common_point(a, b)
