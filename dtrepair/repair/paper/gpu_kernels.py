"""Warp kernels of the published loop on a device: forces of pairs, rows of a sparse matrix.

The formulas of `corner_energy.py` and `energy.py`. Forces are summed as whole
numbers, times a scale: integers add to the same sum in any order, so that runs repeat to the bit.
"""

from __future__ import annotations

from dtrepair.device import start_warp
from dtrepair.repair.paper import energy as energies

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

SIGNED_TANGENT_POINT = wp.constant(0)
TANGENT_POINT = wp.constant(1)
POINT_TO_PLANE = wp.constant(2)
CONICAL = wp.constant(3)

ZERO = wp.constant(wp.float64(0.0))
ONE = wp.constant(wp.float64(1.0))
TWO = wp.constant(wp.float64(2.0))
# Two directions beyond this cosine are one.
PARALLEL = wp.constant(wp.float64(energies.PARALLEL))
# A force counts up to 2^57 of its whole numbers, which leaves room for 64 of those.
MOST = wp.constant(wp.float64(1.4411518807585587e17))
# The floor of corner_energy.py where the area is zero: the smallest float64 to the power of 1/4.
TINY = wp.constant(wp.float64(1.2213386697554620e-77))


@wp.struct
class Energy:
    """Which energy, its parameters, and the limits of `corner_energy.py`."""

    kind: wp.int32
    exponent: wp.float64
    power: wp.float64
    height: wp.float64
    nearest: wp.float64
    noise: wp.float64
    scale: wp.float64


@wp.struct
class Plane:
    """What the triangle of a plane contributes."""

    normal: wp.vec3d
    area: wp.float64
    radius: wp.float64


@wp.func
def plane_of(a: wp.vec3d, b: wp.vec3d, c: wp.vec3d, centroid: wp.vec3d, noise: wp.float64) -> Plane:
    """Normal, area and radius; a normal that is rounding error counts as none."""
    plane = Plane()
    normal = wp.cross(b - a, c - a)
    doubled = wp.length(normal)
    if doubled > noise * wp.length(b - a) * wp.length(c - a):
        plane.normal = normal / doubled
        plane.area = wp.float64(0.5) * doubled
    plane.radius = wp.max(
        wp.length(a - centroid), wp.max(wp.length(b - centroid), wp.length(c - centroid))
    )
    return plane


@wp.func
def tangent_point(energy: Energy, offset: wp.vec3d, plane: Plane, height: wp.float64) -> wp.vec3d:
    """Derivative of A value(s) / |d|^power, with value = s^exponent, or |s|^exponent."""
    sign = ONE
    if height < ZERO:
        sign = -ONE
    if height == ZERO:
        sign = ZERO
    size = wp.pow(wp.abs(height), energy.exponent)
    slope = energy.exponent * wp.pow(wp.abs(height), energy.exponent - ONE)
    if energy.kind == SIGNED_TANGENT_POINT:
        size = sign * size
    else:
        slope = sign * slope
    squared = wp.length_sq(offset)
    floor = energy.nearest * energy.nearest * plane.area + TINY
    scale = plane.area * wp.pow(wp.max(squared, floor), wp.float64(-0.5) * energy.power)
    result = scale * slope * plane.normal
    if squared >= floor:
        result = result - energy.power * scale * size / squared * offset
    return result


@wp.func
def conical(energy: Energy, offset: wp.vec3d, plane: Plane, height: wp.float64) -> wp.vec3d:
    """Derivative of the conical distance field."""
    top = energy.height
    over = -height
    if plane.area == ZERO or over >= top:
        return wp.vec3d(ZERO, ZERO, ZERO)
    radial = -offset - over * plane.normal
    distance = wp.length(radial)
    narrowing = wp.max(ONE - over / top, energy.nearest)
    radius = plane.radius * narrowing
    ratio = distance / radius
    if ratio >= ONE:
        return wp.vec3d(ZERO, ZERO, ZERO)
    quadratic = (ONE - TWO * top) / (wp.float64(4.0) * top * top)
    profile = -quadratic * over * over - over / (TWO * top)
    profile = profile + (wp.float64(3.0) - TWO * top) / wp.float64(4.0)
    slope = -TWO * quadratic * over - ONE / (TWO * top)
    if over <= -top:
        profile = ONE - top - over
        slope = -ONE
    narrowed = ratio / (top * narrowing) * plane.normal
    if distance > ZERO:
        narrowed = narrowed + radial / (distance * radius)
    by_corner = (ONE - ratio) * slope * plane.normal - profile * narrowed
    return -TWO * plane.area * (ONE - ratio) * profile * by_corner


@wp.func
def derivative(energy: Energy, offset: wp.vec3d, plane: Plane) -> wp.vec3d:
    """Derivative of the energy of one corner against one plane by d = centroid - corner."""
    height = wp.dot(offset, plane.normal)
    if energy.kind == POINT_TO_PLANE:
        return TWO * plane.area * wp.max(height, ZERO) * plane.normal
    if energy.kind == CONICAL:
        return conical(energy, offset, plane, height)
    return tangent_point(energy, offset, plane, height)


@wp.func
def add_force(
    forces: wp.array3d(dtype=wp.int64),
    frame: wp.int32,
    vertex: wp.int32,
    force: wp.vec3d,
    scale: wp.float64,
):
    """Add a force to the sum of a vertex."""
    for axis in range(3):
        part = wp.clamp(force[axis] * scale, -MOST, MOST)
        wp.atomic_add(forces, frame, vertex, axis, wp.int64(wp.rint(part)))


@wp.kernel
def push_pairs(
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
    going: wp.array(dtype=wp.bool),
    points: wp.array2d(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    direction: wp.array(dtype=wp.vec3d),
    energy: Energy,
    forces: wp.array3d(dtype=wp.int64),
):
    """Gradient of the energy of pairs, both ways; see `energy.pair_energy`."""
    slot = wp.tid()
    if slot >= count[0]:
        return
    pair = pairs[slot]
    frame = pair[0]
    if not going[frame]:
        return
    for side in range(2):
        moving = pair[1 + side]
        fixed = pair[2 - side]
        corners = faces[moving]
        triangle = faces[fixed]
        a = points[frame, triangle[0]]
        b = points[frame, triangle[1]]
        c = points[frame, triangle[2]]
        centroid = (a + b + c) / wp.float64(3.0)
        plane = plane_of(a, b, c, centroid, energy.noise)
        reacting = ONE
        if direction.shape[0] > 0:
            steered = wp.normalize(direction[moving])
            against = wp.normalize(direction[fixed])
            if wp.length_sq(steered) > ZERO:
                if wp.length_sq(against) == ZERO:
                    plane.normal = steered
                elif wp.dot(steered, against) < PARALLEL:
                    plane.normal = steered
                    reacting = ZERO
        reaction = wp.vec3d(ZERO, ZERO, ZERO)
        for k in range(3):
            force = derivative(energy, centroid - points[frame, corners[k]], plane)
            add_force(forces, frame, corners[k], -force, energy.scale)
            reaction += force
        for k in range(3):
            pushed_back = reacting * reaction / wp.float64(3.0)
            add_force(forces, frame, triangle[k], pushed_back, energy.scale)


@wp.kernel
def multiply_rows(
    start: wp.array(dtype=wp.int32),
    column: wp.array(dtype=wp.int32),
    value: wp.array(dtype=wp.float64),
    field: wp.array2d(dtype=wp.vec3d),
    result: wp.array2d(dtype=wp.vec3d),
):
    """A sparse matrix in compressed rows times fields (B, V); one thread a frame and row."""
    frame, row = wp.tid()
    total = wp.vec3d(wp.float64(0.0), wp.float64(0.0), wp.float64(0.0))
    for entry in range(start[row], start[row + 1]):
        total += field[frame, column[entry]] * value[entry]
    result[frame, row] = total
