"""Warp kernels of the as-rigid-as-possible step (Sorkine & Alexa 2007)."""

from __future__ import annotations

from dtrepair.device import start_warp

wp = start_warp()
wp.set_module_options({"enable_backward": False, "fast_math": False})


@wp.kernel
def fit_rotations(
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    laplacian: wp.array(dtype=wp.float64),
    original: wp.array(dtype=wp.vec3d),
    points: wp.array(dtype=wp.vec3d),
    moving: wp.array(dtype=wp.uint8),
    rotations: wp.array(dtype=wp.mat33d),
):
    """Rotation of each vertex that best turns its original edges into the present ones (eq. 6)."""
    i = wp.tid()
    if moving[i] == wp.uint8(0):
        rotations[i] = wp.identity(n=3, dtype=wp.float64)
        return
    covariance = wp.mat33d()
    for k in range(indptr[i], indptr[i + 1]):
        j = indices[k]
        if j != i:
            covariance += -laplacian[k] * wp.outer(points[i] - points[j], original[i] - original[j])
    u, sigma, v = wp.svd3(covariance)
    rotation = u * wp.transpose(v)
    if wp.determinant(rotation) < wp.float64(0.0):
        # Turn the axis of the smallest singular value, which is the last one.
        flip = wp.diag(wp.vec3d(wp.float64(1.0), wp.float64(1.0), wp.float64(-1.0)))
        rotation = u * flip * wp.transpose(v)
    rotations[i] = rotation


@wp.kernel
def rotated_edges(
    indptr: wp.array(dtype=wp.int32),
    indices: wp.array(dtype=wp.int32),
    laplacian: wp.array(dtype=wp.float64),
    original: wp.array(dtype=wp.vec3d),
    rotations: wp.array(dtype=wp.mat33d),
    result: wp.array(dtype=wp.vec3d),
):
    """Right-hand side of the global step (eq. 9): weighted edges under the mean rotations."""
    i = wp.tid()
    total = wp.vec3d()
    for k in range(indptr[i], indptr[i + 1]):
        j = indices[k]
        if j != i:
            turn = (rotations[i] + rotations[j]) * wp.float64(0.5)
            total += -laplacian[k] * (turn * (original[i] - original[j]))
    result[i] = total
