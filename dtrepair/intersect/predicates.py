"""The filtered triangle-triangle test: apart, intersecting, or left to exact arithmetic.

Coordinates are float32, arithmetic is float64 with an error bound on every sign (Shewchuk 1997).
The bounds stay valid under fused multiply-add, which only takes rounding errors away.
"""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

APART = wp.constant(0)
INTERSECTING = wp.constant(1)
UNCERTAIN = wp.constant(2)
THIN = wp.constant(3)

# (7 + 56 eps) eps of Shewchuk's orientation filter is 7.8e-16.
SIGN_BOUND = wp.constant(wp.float64(1.0e-15))
# Below this a product of three differences may have lost bits to underflow.
UNDERFLOW = wp.constant(wp.float64(1.0e-280))
ZERO = wp.constant(wp.float64(0.0))


@wp.func
def double(v: wp.vec3f) -> wp.vec3d:
    """The same vector in float64."""
    return wp.vec3d(wp.float64(v[0]), wp.float64(v[1]), wp.float64(v[2]))


@wp.func
def absolute(v: wp.vec3d) -> wp.vec3d:
    """Absolute values of the components."""
    return wp.vec3d(wp.abs(v[0]), wp.abs(v[1]), wp.abs(v[2]))


@wp.func
def cross_bound(u: wp.vec3d, v: wp.vec3d) -> wp.vec3d:
    """The cross product with every difference turned into a sum: bounds its rounding errors."""
    return wp.vec3d(
        wp.abs(u[1] * v[2]) + wp.abs(u[2] * v[1]),
        wp.abs(u[2] * v[0]) + wp.abs(u[0] * v[2]),
        wp.abs(u[0] * v[1]) + wp.abs(u[1] * v[0]),
    )


@wp.func
def filtered_sign(normal: wp.vec3d, bound: wp.vec3d, w: wp.vec3d) -> int:
    """Sign of normal . w if it is certain, else 0."""
    value = wp.dot(normal, w)
    error = SIGN_BOUND * wp.dot(bound, absolute(w)) + UNDERFLOW
    sign = int(0)
    if value > error:
        sign = int(1)
    if value < -error:
        sign = int(-1)
    return sign


@wp.func
def separated_along(
    axis: wp.vec3d, a1: wp.vec3d, a2: wp.vec3d, b0: wp.vec3d, b1: wp.vec3d, b2: wp.vec3d
) -> bool:
    """Whether the axis, taken as it is, certainly separates two triangles; a0 is the origin."""
    size = absolute(axis)
    pa1 = wp.dot(axis, a1)
    pa2 = wp.dot(axis, a2)
    pb0 = wp.dot(axis, b0)
    pb1 = wp.dot(axis, b1)
    pb2 = wp.dot(axis, b2)
    reach = wp.max(
        wp.max(wp.dot(size, absolute(a1)), wp.dot(size, absolute(a2))),
        wp.max(
            wp.dot(size, absolute(b0)),
            wp.max(wp.dot(size, absolute(b1)), wp.dot(size, absolute(b2))),
        ),
    )
    error = wp.float64(2.0) * (SIGN_BOUND * reach + UNDERFLOW)
    low_a = wp.min(ZERO, wp.min(pa1, pa2))
    high_a = wp.max(ZERO, wp.max(pa1, pa2))
    low_b = wp.min(pb0, wp.min(pb1, pb2))
    high_b = wp.max(pb0, wp.max(pb1, pb2))
    return low_b - high_a > error or low_a - high_b > error


@wp.func
def separated_in_plane(
    normal: wp.vec3d,
    a0: wp.vec3d,
    a1: wp.vec3d,
    a2: wp.vec3d,
    b0: wp.vec3d,
    b1: wp.vec3d,
    b2: wp.vec3d,
) -> bool:
    """Whether a line along an edge certainly separates two nearly coplanar triangles."""
    u1 = a1 - a0
    u2 = a2 - a0
    v0 = b0 - a0
    v1 = b1 - a0
    v2 = b2 - a0
    return (
        separated_along(wp.cross(normal, u1), u1, u2, v0, v1, v2)
        or separated_along(wp.cross(normal, u2), u1, u2, v0, v1, v2)
        or separated_along(wp.cross(normal, u2 - u1), u1, u2, v0, v1, v2)
        or separated_along(wp.cross(normal, v1 - v0), u1, u2, v0, v1, v2)
        or separated_along(wp.cross(normal, v2 - v0), u1, u2, v0, v1, v2)
        or separated_along(wp.cross(normal, v2 - v1), u1, u2, v0, v1, v2)
    )


@wp.func
def edge_side(p: wp.vec3d, q: wp.vec3d, c: wp.vec3d, d: wp.vec3d) -> int:
    """Certain sign of the volume of the tetrahedron over the edges pq and cd, else 0."""
    u = q - p
    v = c - p
    return filtered_sign(wp.cross(u, v), cross_bound(u, v), d - p)


@wp.func
def edge_hits(p: wp.vec3d, q: wp.vec3d, t0: wp.vec3d, t1: wp.vec3d, t2: wp.vec3d) -> int:
    """Whether the line pq, which certainly crosses the plane of the triangle, meets it."""
    s0 = edge_side(p, q, t0, t1)
    s1 = edge_side(p, q, t1, t2)
    if s0 * s1 < 0:
        return APART
    s2 = edge_side(p, q, t2, t0)
    if s0 * s2 < 0 or s1 * s2 < 0:
        return APART
    if s0 != 0 and s0 == s1 and s1 == s2:
        return INTERSECTING
    return UNCERTAIN


@wp.func
def classify_doubles(
    a0: wp.vec3d, a1: wp.vec3d, a2: wp.vec3d, b0: wp.vec3d, b1: wp.vec3d, b2: wp.vec3d
) -> int:
    """`classify` in float64; of differences of given coordinates only: others round twice."""
    normal_a = wp.cross(a1 - a0, a2 - a0)
    bound_a = cross_bound(a1 - a0, a2 - a0)
    sb0 = filtered_sign(normal_a, bound_a, b0 - a0)
    sb1 = filtered_sign(normal_a, bound_a, b1 - a0)
    sb2 = filtered_sign(normal_a, bound_a, b2 - a0)
    if sb0 != 0 and sb0 == sb1 and sb1 == sb2:
        return APART
    normal_b = wp.cross(b1 - b0, b2 - b0)
    bound_b = cross_bound(b1 - b0, b2 - b0)
    sa0 = filtered_sign(normal_b, bound_b, a0 - b0)
    sa1 = filtered_sign(normal_b, bound_b, a1 - b0)
    sa2 = filtered_sign(normal_b, bound_b, a2 - b0)
    if sa0 != 0 and sa0 == sa1 and sa1 == sa2:
        return APART
    if sb0 * sb1 * sb2 * sa0 * sa1 * sa2 == 0:
        if separated_in_plane(normal_a, a0, a1, a2, b0, b1, b2):
            return APART
        if separated_in_plane(normal_b, a0, a1, a2, b0, b1, b2):
            return APART
        if wp.dot(normal_a, normal_a) == ZERO or wp.dot(normal_b, normal_b) == ZERO:
            return THIN
        return UNCERTAIN
    result = APART
    for edge in range(6):
        p = a0
        q = a1
        crosses = sa0 * sa1 < 0
        if edge == 1:
            p = a1
            q = a2
            crosses = sa1 * sa2 < 0
        if edge == 2:
            p = a2
            q = a0
            crosses = sa2 * sa0 < 0
        if edge == 3:
            p = b0
            q = b1
            crosses = sb0 * sb1 < 0
        if edge == 4:
            p = b1
            q = b2
            crosses = sb1 * sb2 < 0
        if edge == 5:
            p = b2
            q = b0
            crosses = sb2 * sb0 < 0
        if crosses:
            hit = APART
            if edge < 3:
                hit = edge_hits(p, q, b0, b1, b2)
            else:
                hit = edge_hits(p, q, a0, a1, a2)
            if hit == INTERSECTING:
                return INTERSECTING
            result = wp.max(result, hit)
    return result


@wp.func
def classify(
    a0: wp.vec3f, a1: wp.vec3f, a2: wp.vec3f, b0: wp.vec3f, b1: wp.vec3f, b2: wp.vec3f
) -> int:
    """Whether two closed triangles have a common point: APART, INTERSECTING or UNCERTAIN.

    THIN is uncertain, too: one of them has no area, for which there are no planes to tell.
    """
    return classify_doubles(double(a0), double(a1), double(a2), double(b0), double(b1), double(b2))


@wp.struct
class Zones:
    """Contacts that were modelled, in leaf order; of no triangles if there are none.

    part: the part of each triangle; towards: bits of the parts towards which it has zones;
    by_third: whether a third part tells anything of two.
    """

    part: wp.array(dtype=wp.int32)
    towards: wp.array2d(dtype=wp.uint64)
    by_third: wp.array2d(dtype=wp.uint8)


@wp.func
def is_modelled(i: int, j: int, zones: Zones) -> bool:
    """Whether a pair of triangles is a modelled contact, see `Attachments.modelled`."""
    if zones.part.shape[0] == 0:
        return False
    a = zones.part[i]
    b = zones.part[j]
    there = zones.towards[i, b >> 6] >> wp.uint64(b & 63)
    back = zones.towards[j, a >> 6] >> wp.uint64(a & 63)
    shared = there & back & wp.uint64(1)
    if zones.by_third[a, b] != wp.uint8(0):
        for k in range(zones.towards.shape[1]):
            shared = shared | (zones.towards[i, k] & zones.towards[j, k])
    return shared != wp.uint64(0)
