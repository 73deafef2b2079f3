"""UsdSkel blend shapes of a mesh, dense (K, V, 3), and their weights over time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import UsdSkel

from usd_io.errors import StageError
from usd_io.read.mesh import AnimatedMesh


@dataclass(frozen=True)
class BlendShapes:
    """Blend shapes of one mesh.

    Attributes:
        names: one each, valid identifiers.
        offsets: from the rest points at full weight (K, V, 3), local space, stage units.
        times: time codes of the weights (T,).
        weights: (T, K).
        skipped: names of in-between shapes, which are not kept.
    """

    names: tuple[str, ...]
    offsets: NDArray[np.float64]
    times: NDArray[np.float64]
    weights: NDArray[np.float64]
    skipped: tuple[str, ...] = ()


def read_blend_shapes(mesh: AnimatedMesh) -> BlendShapes | None:
    """Return the blend shapes of a mesh and their weights over time; None if it has none.

    Raises:
        StageError: a shape is missing or does not fit the points.
    """
    binding = UsdSkel.BindingAPI(mesh.prim)
    names = binding.GetBlendShapesAttr().Get()
    targets = binding.GetBlendShapeTargetsRel().GetForwardedTargets()
    if not names or not targets:
        return None
    if len(names) != len(targets):
        raise StageError(
            f"{mesh.path}: expected a target for each of {len(names)} blend shapes, got "
            f"{len(targets)}; mend skel:blendShapeTargets"
        )
    offsets = np.zeros((len(names), *mesh.rest.shape))
    skipped: list[str] = []
    for row, target in enumerate(targets):
        shape = UsdSkel.BlendShape(mesh.stage.GetPrimAtPath(target))
        if not shape:
            raise StageError(f"{mesh.path}: no blend shape at {target}; mend its targets")
        _fill(offsets[row], shape)
        skipped += [
            f"{names[row]}:{part.GetAttr().GetBaseName()}" for part in shape.GetInbetweens()
        ]
    times, weights = _weights(mesh, len(names))
    return BlendShapes(tuple(names), offsets, times, weights, tuple(skipped))


def _fill(row: NDArray[np.float64], shape: UsdSkel.BlendShape) -> None:
    """Write a shape's offsets into a row (V, 3)."""
    values = shape.GetOffsetsAttr().Get()
    offsets = np.zeros((0, 3)) if values is None else np.asarray(values, dtype=np.float64)
    indices = shape.GetPointIndicesAttr().Get()
    moving = np.arange(len(offsets)) if not indices else np.asarray(indices, dtype=np.int64)
    fits = len(moving) == len(offsets) and moving.max(initial=-1) < len(row)
    if not fits or moving.min(initial=0) < 0:
        raise StageError(
            f"{shape.GetPath()}: expected offsets for indices below {len(row)}, got "
            f"{len(offsets)} offsets and {len(moving)} indices; export the shape again"
        )
    row[moving] = offsets


def _weights(mesh: AnimatedMesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return weights (T, K) as the mesh's animation has them; without one each shape in turn."""
    animation = mesh.skin.skeleton_query.GetAnimQuery() if mesh.skin is not None else None
    if mesh.skin is None or not animation:
        return in_turn(count)
    times = np.array(animation.GetBlendShapeWeightTimeSamples(), dtype=np.float64)
    if not len(times):
        return in_turn(count)
    mapper = mesh.skin.skinning_query.GetBlendShapeMapper()
    rows = [mapper.Remap(animation.ComputeBlendShapeWeights(time)) for time in times]
    return times, np.asarray(rows, dtype=np.float64)


def in_turn(count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return times 1, 2, ... (K,) and weights (K, K) that show one shape after the other."""
    return np.arange(1.0, count + 1.0), np.eye(count)
