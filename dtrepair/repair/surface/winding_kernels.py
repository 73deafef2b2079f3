"""Warp kernel of the cut that winding numbers need: which edges cross which triangles."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

# An edge that meets an edge must be cut by one triangle at least: triangles are wider by this part
# of their edges. One edge too many does no harm, one too few joins the inside with the outside.
EDGE_MARGIN = wp.constant(wp.float64(1.0e-9))


@wp.func
def above_edge(normal: wp.vec3d, a: wp.vec3d, b: wp.vec3d, hit: wp.vec3d) -> bool:
    """Whether a point of a triangle's plane is on the inner side of its edge ab."""
    edge = b - a
    height = wp.dot(normal, wp.cross(edge, hit - a))
    return height >= -EDGE_MARGIN * wp.dot(edge, edge)


@wp.kernel
def find_cut(corners: wp.array2d(dtype=wp.vec3d), cut: wp.array2d(dtype=wp.uint8)):
    """Marks the edges (K, 6) of two triangles, given by six corners, that cross the other one.

    Edge k of a triangle leads from its corner k to the next one; one thread a pair.
    """
    t = wp.tid()
    zero = wp.float64(0.0)
    for side in range(2):
        mine = 3 * side
        other = 3 - mine
        a = corners[t, other]
        b = corners[t, other + 1]
        c = corners[t, other + 2]
        normal = wp.normalize(wp.cross(b - a, c - a))
        for k in range(3):
            p = corners[t, mine + k]
            q = corners[t, mine + (k + 1) % 3]
            above = wp.dot(normal, p - a)
            ahead = wp.dot(normal, q - a)
            cut[t, mine + k] = wp.uint8(0)
            if (above > zero) != (ahead > zero):
                hit = p + (above / (above - ahead)) * (q - p)
                if (
                    above_edge(normal, a, b, hit)
                    and above_edge(normal, b, c, hit)
                    and above_edge(normal, c, a, hit)
                ):
                    cut[t, mine + k] = wp.uint8(1)
