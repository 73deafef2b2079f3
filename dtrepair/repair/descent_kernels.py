"""Warp kernels of the published loop on a device: forces of pairs, rows of a sparse matrix."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

# Forces are summed as whole numbers of 2^-40 (lengths in units of the mesh's size): integers add
# to the same sum in any order. A force counts up to 2^18, which leaves room for sixteen of those.
FORCE_UNITS = 2.0**40
LARGEST_FORCE = 2.0**18


@wp.func
def add_force(
    forces: wp.array3d(dtype=wp.int64), frame: wp.int32, vertex: wp.int32, force: wp.vec3d
):
    """Add a force to the sum of a vertex."""
    limit = wp.float64(LARGEST_FORCE)
    for axis in range(3):
        part = wp.clamp(force[axis], -limit, limit) * wp.float64(FORCE_UNITS)
        wp.atomic_add(forces, frame, vertex, axis, wp.int64(wp.rint(part)))


@wp.kernel
def push_pairs(
    pairs: wp.array(dtype=wp.vec3i),
    count: wp.array(dtype=wp.int32),
    going: wp.array(dtype=wp.bool),
    points: wp.array2d(dtype=wp.vec3d),
    faces: wp.array(dtype=wp.vec3i),
    direction: wp.array(dtype=wp.vec3d),
    exponent: wp.float64,
    power: wp.float64,
    keeps_sign: wp.int32,
    nearest: wp.float64,
    noise: wp.float64,
    forces: wp.array3d(dtype=wp.int64),
):
    """Gradient of the tangent-point energy of pairs, both ways; see `energy.pair_energy`."""
    slot = wp.tid()
    if slot >= count[0]:
        return
    pair = pairs[slot]
    frame = pair[0]
    if not going[frame]:
        return
    zero = wp.float64(0.0)
    third = wp.float64(1.0) / wp.float64(3.0)
    for side in range(2):
        moving = pair[1 + side]
        fixed = pair[2 - side]
        corners = faces[moving]
        plane = faces[fixed]
        a = points[frame, plane[0]]
        first = points[frame, plane[1]] - a
        second = points[frame, plane[2]] - a
        centroid = a + (first + second) * third
        normal = wp.cross(first, second)
        doubled = wp.length(normal)
        area = wp.float64(0.5) * doubled
        if doubled > noise * wp.length(first) * wp.length(second):
            normal = normal / doubled
        else:
            normal = wp.vec3d(zero, zero, zero)
            area = zero
        if direction.shape[0] > 0:
            steered = direction[moving]
            other = direction[fixed]
            if wp.length_sq(steered) > zero and wp.length_sq(other) == zero:
                normal = wp.normalize(steered)
        reaction = wp.vec3d(zero, zero, zero)
        for k in range(3):
            offset = centroid - points[frame, corners[k]]
            height = wp.dot(offset, normal)
            size = height
            sign = wp.float64(1.0)
            if keeps_sign == 0:
                size = wp.abs(height)
                sign = wp.sign(height)
                if height == zero:
                    sign = zero
            numerator = wp.pow(wp.abs(size), exponent)
            slope = exponent * wp.pow(wp.abs(size), exponent - wp.float64(1.0)) * sign
            if size < zero:
                numerator = -numerator
            squared = wp.length_sq(offset)
            floor = nearest * nearest * area + wp.float64(1.0e-77)
            near = squared < floor
            squared = wp.max(squared, floor)
            scale = area * wp.pow(squared, wp.float64(-0.5) * power)
            derivative = normal * (scale * slope)
            if not near:
                derivative = derivative - offset * (power * scale * numerator / squared)
            add_force(forces, frame, corners[k], -derivative)
            reaction += derivative
        for k in range(3):
            add_force(forces, frame, plane[k], reaction * third)


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
