"""UsdSkel blend shapes written onto a mesh without a skeleton.

Shapes are dense in memory, (K, V, 3); in files only the points that move are stored.
"""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Tf, Usd, UsdGeom, UsdSkel, Vt

from usd_io.errors import StageError
from usd_io.paths import relative_asset_path
from usd_io.read.blend_shapes import BlendShapes
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.stages import OpenedStage, check_not_an_input
from usd_io.times import time_code
from usd_io.values import vec3f_array
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.authoring import AuthoredMesh, define_mesh
from usd_io.write.metadata import copy_stage_metadata, set_record

# Points that move less than this part of the largest offset are left out of a shape.
_STILL = 1e-6


def valid_names(names: Iterable[str]) -> tuple[str, ...]:
    """Return names as identifiers, each once."""
    identifiers: list[str] = []
    for name in names:
        base = Tf.MakeValidIdentifier(f"_{name}" if name[:1].isdigit() else name)
        number = 2
        unique = base
        while unique in identifiers:
            unique, number = f"{base}_{number}", number + 1
        identifiers.append(unique)
    return tuple(identifiers)


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
    """Return the SkelRoot above a mesh, or the prim that can be one. Raises StageError without."""
    if mesh.skinned:
        raise StageError(f"{mesh.path}: is skinned already; give its mesh without the skin")
    above = Sdf.Path(mesh.path).GetPrefixes()[:-1]
    known = [path for path in above if mesh.stage.GetPrimAtPath(path).IsA(UsdSkel.Root)]
    root = known[0] if known else Sdf.Path(mesh.path).GetPrefixes()[0]
    prim = mesh.stage.GetPrimAtPath(root)
    if not above or prim.GetTypeName() not in ("", "Xform", "Scope", "SkelRoot"):
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
    """Author shapes below the mesh, and a skeleton without joints that carries their weights."""
    skeleton, animation = define_carrier(stage, root)
    author_weights(animation, shapes.names, shapes.times, shapes.weights)
    binding = UsdSkel.BindingAPI.Apply(prim)
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    define_shapes(stage, prim, shapes.names, shapes.offsets)
    stage.SetStartTimeCode(float(shapes.times.min()))
    stage.SetEndTimeCode(float(shapes.times.max()))


def define_carrier(stage: Usd.Stage, root: Sdf.Path) -> tuple[UsdSkel.Skeleton, UsdSkel.Animation]:
    """Define a skeleton without joints below a SkelRoot, and the animation of its shapes."""
    skeleton = UsdSkel.Skeleton(define_below(stage, root.AppendChild("ShapeSkeleton"), "Skeleton"))
    animation = define_animation(stage, root.AppendChild("ShapeAnimation"))
    carrier = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    carrier.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return skeleton, animation


def define_animation(stage: Usd.Stage, path: Sdf.Path) -> UsdSkel.Animation:
    """Define an animation; what is above it is left as it is."""
    return UsdSkel.Animation(define_below(stage, path, "SkelAnimation"))


def define_below(stage: Usd.Stage, path: Sdf.Path, kind: str) -> Usd.Prim:
    """Define a prim of a type in the root layer; what is above it is an `over` if it is not there.

    `Usd.Stage.DefinePrim` would define all of that as well, without a type, where the layer is not
    over the stage that has it yet.
    """
    spec = Sdf.CreatePrimInLayer(stage.GetRootLayer(), path)
    spec.specifier, spec.typeName = Sdf.SpecifierDef, kind
    return stage.GetPrimAtPath(path)


def author_weights(
    animation: UsdSkel.Animation,
    names: Sequence[str],
    times: NDArray[np.floating],
    weights: NDArray[np.floating],
) -> None:
    """Author the names of an animation's shapes, and their weights (T, K) at times (T,)."""
    animation.CreateBlendShapesAttr(Vt.TokenArray(list(names)))
    attribute = animation.CreateBlendShapeWeightsAttr()
    for time, row in zip(times, weights, strict=True):
        attribute.Set(Vt.FloatArray.FromNumpy(row.astype(np.float32)), time_code(float(time)))


def define_shapes(
    stage: Usd.Stage,
    prim: Usd.Prim,
    names: Sequence[str],
    offsets: NDArray[np.floating],
    *,
    before: tuple[Sequence[str], Sequence[Sdf.Path]] = ((), ()),
) -> None:
    """Define blend shapes below a mesh and bind it to them; offsets (K, V, 3) may be 0.

    before: names and targets of shapes that the mesh has already.
    """
    binding = UsdSkel.BindingAPI(prim)
    binding.CreateBlendShapesAttr(Vt.TokenArray([*before[0], *names]))
    targets = list(before[1])
    largest = float(np.abs(offsets).max(initial=0.0))
    for name, row in zip(names, offsets, strict=True):
        path = prim.GetPath().AppendChild(name)
        shape = UsdSkel.BlendShape(define_below(stage, path, "BlendShape"))
        moving = np.flatnonzero(np.abs(row).max(axis=1) > _STILL * largest)
        shape.CreateOffsetsAttr(vec3f_array(row[moving]))
        shape.CreatePointIndicesAttr(Vt.IntArray.FromNumpy(moving.astype(np.int32)))
        targets.append(shape.GetPath())
    binding.CreateBlendShapeTargetsRel().SetTargets(targets)
