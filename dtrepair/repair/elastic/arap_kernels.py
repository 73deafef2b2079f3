"""Warp kernels of the as-rigid-as-possible step (Sorkine & Alexa 2007)."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})

# Squared torque, next to the squared matrix, at which a rotation is found.
SETTLED = wp.constant(wp.float64(1.0e-26))
# What counts as nothing next to the squared matrix.
TINY = wp.constant(wp.float64(1.0e-12))


@wp.func
def nearest_rotation(matrix: wp.mat33d) -> wp.mat33d:
    """Rotation R of the largest trace of R^T matrix, by singular values."""
    u, sigma, v = wp.svd3(matrix)
    rotation = u * wp.transpose(v)
    if wp.determinant(rotation) < wp.float64(0.0):
        # Turn the axis of the smallest singular value, which is the last one.
        flip = wp.diag(wp.vec3d(wp.float64(1.0), wp.float64(1.0), wp.float64(-1.0)))
        rotation = u * flip * wp.transpose(v)
    return rotation


@wp.func
def followed_rotation(matrix: wp.mat33d) -> wp.mat33d:
    """The same by Newton steps from no rotation, or zero where they do not lead to it.

    With B = matrix R^T, a turn w changes the trace by t . w - w . M w / 2, t being the torque and
    M = tr(B) - B, symmetric part. M is definite at the largest trace and at no other point where
    the torque is zero. Singular values cost several times as much.
    """
    one = wp.float64(1.0)
    half = wp.float64(0.5)
    rotation = wp.identity(n=3, dtype=wp.float64)
    size = wp.ddot(matrix, matrix)
    for _step in range(6):
        b = matrix * wp.transpose(rotation)
        torque = wp.vec3d(b[2, 1] - b[1, 2], b[0, 2] - b[2, 0], b[1, 0] - b[0, 1])
        m = wp.trace(b) * wp.identity(n=3, dtype=wp.float64) - half * (b + wp.transpose(b))
        minor = m[0, 0] * m[1, 1] - m[0, 1] * m[0, 1]
        determinant = wp.determinant(m)
        definite = (
            m[0, 0] > wp.float64(0.0)
            and minor * minor > TINY * size * size
            and determinant * determinant > TINY * size * size * size
            and minor > wp.float64(0.0)
            and determinant > wp.float64(0.0)
        )
        if not definite:
            return wp.mat33d()
        if wp.dot(torque, torque) <= SETTLED * size:
            return rotation
        # Half the turn is the vector part of a quaternion over its scalar part (Cayley).
        w = half * (wp.inverse(m) * torque)
        turn = wp.quatd(w[0], w[1], w[2], one)
        rotation = wp.quat_to_matrix(wp.normalize(turn)) * rotation
    return wp.mat33d()


@wp.kernel
def fit_rotations(
    vertices: wp.array(dtype=wp.int32),
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    laplacian: wp.array(dtype=wp.float64),
    original: wp.array(dtype=wp.vec3d),
    points: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.mat33d),
):
    """Rotation of some vertices that best turns their original edges into the present (eq. 6)."""
    i = vertices[wp.tid()]
    covariance = wp.mat33d()
    for k in range(indptr[i], indptr[i + 1]):
        j = indices[k]
        if j != i:
            covariance += -laplacian[k] * wp.outer(points[i] - points[j], original[i] - original[j])
    rotation = followed_rotation(covariance)
    if wp.trace(rotation) == wp.float64(0.0):
        rotation = nearest_rotation(covariance)
    rotations[i] = rotation


@wp.kernel
def rotated_edges(
    vertices: wp.array(dtype=wp.int32),
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    laplacian: wp.array(dtype=wp.float64),
    original: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.mat33d),
    result: wp.array(dtype=wp.vec3d),
):
    """Right-hand side of the global step (eq. 9): weighted edges under the mean rotations."""
    i = vertices[wp.tid()]
    total = wp.vec3d()
    for k in range(indptr[i], indptr[i + 1]):
        j = indices[k]
        if j != i:
            turn = (rotations[i] + rotations[j]) * wp.float64(0.5)
            total += -laplacian[k] * (turn * (original[i] - original[j]))
    result[i] = total
