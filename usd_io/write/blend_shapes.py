"""UsdSkel blend shapes: reading those of a mesh, and writing some onto a mesh without a skeleton.

Shapes are kept dense here, (K, V, 3); in files only the points that move are stored.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel, Vt

from usd_io.errors import StageError
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.stages import OpenedStage, check_not_an_input
from usd_io.write.atomic_layer import AtomicLayer, relative_asset_path
from usd_io.write.authoring import AuthoredMesh, define_mesh
from usd_io.write.metadata import copy_stage_metadata, set_record
from usd_io.write.normals_sources import vec3f_array

# Points that move less than this part of the largest offset are left out of a shape.
_STILL = 1e-6


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
    """The blend shapes of a mesh, and their weights over time; None if it has none.

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
    chosen = np.arange(len(offsets)) if not indices else np.asarray(indices, dtype=np.int64)
    fits = len(chosen) == len(offsets) and chosen.max(initial=-1) < len(row)
    if not fits or chosen.min(initial=0) < 0:
        raise StageError(
            f"{shape.GetPath()}: expected offsets for indices below {len(row)}, got "
            f"{len(offsets)} offsets and {len(chosen)} indices; export the shape again"
        )
    row[chosen] = offsets


def _weights(mesh: AnimatedMesh, count: int) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Weights (T, K) as the mesh's animation has them; without one each shape in turn."""
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
    """Times 1, 2, ... (K,) and weights (K, K) that show one shape after the other."""
    return np.arange(1.0, count + 1.0), np.eye(count)


def valid_names(names: Iterable[str]) -> tuple[str, ...]:
    """Names as identifiers, each once."""
    found: list[str] = []
    for name in names:
        base = Tf.MakeValidIdentifier(f"_{name}" if name[:1].isdigit() else name)
        number = 2
        unique = base
        while unique in found:
            unique, number = f"{base}_{number}", number + 1
        found.append(unique)
    return tuple(found)


def write_shapes_over(
    path: str | os.PathLike[str],
    opened: OpenedStage,
    mesh: AnimatedMesh,
    shapes: BlendShapes,
    *,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a layer over a stage that gives a mesh blend shapes, atomically.

    The topmost Xform above the mesh becomes a SkelRoot, which UsdSkel needs.

    Raises:
        StageError: the mesh is skinned already, or has no prim above it that can be a SkelRoot.
        UsageError, OutputError: as `OverrideWriter`.
    """
    root = check_target(mesh)
    check_not_an_input(opened.stage, os.fspath(path))
    with AtomicLayer(path) as file:
        layer = file.layer
        assert layer is not None
        directory = os.path.dirname(file.path)
        copy_stage_metadata(opened.stage, layer, directory)
        stage = Usd.Stage.Open(layer)
        stage.OverridePrim(root).SetTypeName("SkelRoot")
        _author(stage, root, stage.OverridePrim(mesh.path), shapes)
        del stage
        # Last: from the temporary folder the relative path leads nowhere.
        source = opened.stage.GetRootLayer()
        layer.subLayerPaths = [relative_asset_path(source.realPath, directory)]
        set_record(layer, record or {})
        file.commit()


def check_target(mesh: AnimatedMesh) -> Sdf.Path:
    """The prim that can be the SkelRoot of a mesh. Raises StageError where there is none."""
    if mesh.skinned:
        raise StageError(f"{mesh.path}: is skinned already; give its mesh without the skin")
    root = Sdf.Path(mesh.path).GetPrefixes()[0]
    prim = mesh.stage.GetPrimAtPath(root)
    if root == Sdf.Path(mesh.path) or prim.GetTypeName() not in ("", "Xform", "Scope", "SkelRoot"):
        raise StageError(
            f"{mesh.path}: blend shapes need a SkelRoot above the mesh; put it under an Xform"
        )
    return root


def write_shapes(
    path: str | os.PathLike[str],
    mesh: AuthoredMesh,
    shapes: BlendShapes,
    *,
    up: str = "Y",
    meters_per_unit: float = 1.0,
    fps: float = 24.0,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a new stage of one mesh with blend shapes, atomically.

    Raises:
        ValueError: arrays of the mesh do not fit together.
        UsageError, OutputError: as `write_animation`.
    """
    root = Sdf.Path(mesh.path).GetPrefixes()[0]
    with AtomicLayer(path) as file:
        stage = Usd.Stage.Open(file.layer)
        UsdGeom.SetStageUpAxis(stage, up)
        UsdGeom.SetStageMetersPerUnit(stage, meters_per_unit)
        stage.SetTimeCodesPerSecond(fps)
        stage.SetFramesPerSecond(fps)
        stage.SetDefaultPrim(UsdSkel.Root.Define(stage, root).GetPrim())
        geometry = define_mesh(stage, mesh)
        _author(stage, root, geometry.GetPrim(), shapes)
        set_record(stage.GetRootLayer(), record or {})
        del geometry, stage
        file.commit()


def _author(stage: Usd.Stage, root: Sdf.Path, prim: Usd.Prim, shapes: BlendShapes) -> None:
    """Shapes below the mesh, and a skeleton without joints that carries their animation."""
    skeleton = UsdSkel.Skeleton.Define(stage, root.AppendChild("ShapeSkeleton"))
    animation = UsdSkel.Animation.Define(stage, root.AppendChild("ShapeAnimation"))
    animation.CreateBlendShapesAttr(Vt.TokenArray(shapes.names))
    weights = animation.CreateBlendShapeWeightsAttr()
    for time, row in zip(shapes.times, shapes.weights, strict=True):
        weights.Set(Vt.FloatArray.FromNumpy(row.astype(np.float32)), float(time))
    carrier = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    carrier.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateBlendShapesAttr(Vt.TokenArray(shapes.names))
    targets = []
    largest = float(np.abs(shapes.offsets).max(initial=0.0))
    for name, offsets in zip(shapes.names, shapes.offsets, strict=True):
        shape = UsdSkel.BlendShape.Define(stage, prim.GetPath().AppendChild(name))
        moving = np.flatnonzero(np.abs(offsets).max(axis=1) > _STILL * largest)
        shape.CreateOffsetsAttr(vec3f_array(offsets[moving]))
        shape.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(moving.astype(np.int32)))
        targets.append(shape.GetPath())
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)
    stage.SetStartTimeCode(float(shapes.times.min()))
    stage.SetEndTimeCode(float(shapes.times.max()))
