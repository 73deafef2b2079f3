"""Corrections of posed meshes: blend shapes that leave a character bound, or offsets alone.

Points are not written: what a rig does to them stays, and a correction can be dialled down.
"""

from __future__ import annotations

import os
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, Usd, UsdGeom, UsdSkel, Vt

from usd_io.errors import StageError
from usd_io.paths import relative_asset_path
from usd_io.read.mesh import AnimatedMesh
from usd_io.read.skinning import find_skin
from usd_io.read.stages import OpenedStage, check_not_an_input
from usd_io.times import time_code
from usd_io.values import vec3f_array
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.blend_shapes import (
    author_weights,
    check_target,
    define_animation,
    define_carrier,
    define_shapes,
    valid_names,
)
from usd_io.write.metadata import copy_stage_metadata, set_record

# Offsets of `write_offsets`; a constant index array says which vertex has which of them.
OFFSETS = "dtrepair:offset"


@dataclass(frozen=True)
class Correction:
    """What is added to one mesh: shapes with weights over time.

    Attributes:
        mesh: the mesh.
        vertices: that the shapes move (M,).
        shapes: offsets of these (K, M, 3), in the space of the points before joints move them.
        times: time codes of the weights (T,), [nan] for a still mesh.
        weights: (T, K).
    """

    mesh: AnimatedMesh
    vertices: NDArray[np.int64]
    shapes: NDArray[np.float32]
    times: NDArray[np.float64]
    weights: NDArray[np.float32]


@dataclass
class _Carrier:
    """An animation that carries weights: those it had, and the corrections that join them."""

    animation: UsdSkel.Animation
    names: list[str]
    old: UsdSkel.AnimQuery | None
    corrections: list[tuple[Correction, tuple[str, ...]]] = field(default_factory=list)


def check_correctable(mesh: AnimatedMesh) -> None:
    """Raise StageError for a mesh that cannot be given blend shapes."""
    advice = "leave it out with --exclude, keep it in place with --collider, or write --delta"
    if mesh.skin is not None:
        query = mesh.skin.skeleton_query.GetAnimQuery()
        prim = query.GetPrim() if query else mesh.skin.skeleton
        if prim.IsInPrototype() or prim.IsInstanceProxy():
            raise StageError(
                f"{mesh.path}: {prim.GetPath()}, which would carry the weights of its shapes, lies "
                f"in an instance; {advice}"
            )
        return
    if not np.isnan(mesh.times).all():
        raise StageError(
            f"{mesh.path}: its points are animated, and blend shapes need a rest pose; {advice}"
        )
    root = mesh.stage.GetPrimAtPath(check_target(mesh))
    inner = [prim for prim in Usd.PrimRange(root) if prim != root and prim.IsA(UsdSkel.Root)]
    if inner:
        raise StageError(
            f"{mesh.path}: blend shapes need a SkelRoot above the mesh, and {inner[0].GetPath()} "
            f"would lie below it; {advice}"
        )


def write_corrections(
    path: str | os.PathLike[str],
    opened: OpenedStage,
    corrections: Sequence[Correction],
    *,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a layer over a stage that gives meshes corrective blend shapes, atomically.

    Skinned meshes stay bound: shapes are added to those they have, and weights to the animation of
    their skeleton, which gets one if it has none. Others are bound to a skeleton without joints.

    Raises:
        StageError: see `check_correctable`.
        UsageError, OutputError: as `OverrideWriter`.
    """
    with _layer_over(path, opened, record) as layer:
        _author_corrections(layer, corrections)


def preview(opened: OpenedStage, corrections: Sequence[Correction]) -> Usd.Stage:
    """Return the stage with corrections, in memory: what `write_corrections` would give."""
    layer = Sdf.Layer.CreateAnonymous(".usda")
    copy_stage_metadata(opened.stage, layer, os.getcwd())
    _author_corrections(layer, corrections)
    layer.subLayerPaths = [opened.stage.GetRootLayer().identifier]
    stage = Usd.Stage.Open(layer, Usd.Stage.LoadNone)
    stage.SetLoadRules(opened.stage.GetLoadRules())  # no more than was looked into
    return stage


def points_of(stage: Usd.Stage, path: str, time: float) -> NDArray[np.float32] | None:
    """Return points (V, 3) of a mesh of a stage as skinning and shapes pose them."""
    prim = stage.GetPrimAtPath(path)
    skin = find_skin(prim)
    if skin is not None:
        return skin.points(time)
    value = UsdGeom.Mesh(prim).GetPointsAttr().Get(time_code(time))
    return None if value is None else np.asarray(value, dtype=np.float32)


def write_offsets(
    path: str | os.PathLike[str],
    opened: OpenedStage,
    offsets: Sequence[Correction],
    *,
    record: Mapping[str, Any] | None = None,
) -> None:
    """Write a layer over a stage that holds offsets of meshes, and no points, atomically.

    The primvar `dtrepair:offset` of a mesh is to be added to its posed points, in its local space.
    It is indexed: entry 0 is zero, and belongs to all vertices that never move. `shapes` of the
    corrections are the offsets at `times`, and `weights` are not used.

    Raises:
        UsageError, OutputError: as `OverrideWriter`.
    """
    with _layer_over(path, opened, record) as layer:
        stage = Usd.Stage.Open(layer)
        for own in offsets:
            prim = _over(stage, own.mesh)
            primvar = UsdGeom.PrimvarsAPI(prim).CreatePrimvar(
                OFFSETS, Sdf.ValueTypeNames.Vector3fArray, UsdGeom.Tokens.vertex
            )
            indices = np.zeros(len(own.mesh.rest), dtype=np.int32)
            indices[own.vertices] = 1 + np.arange(len(own.vertices))
            primvar.SetIndices(Vt.IntArray.FromNumpy(indices))
            for time, row in zip(own.times, own.shapes, strict=True):
                values = np.concatenate([np.zeros((1, 3), np.float32), row])
                primvar.Set(vec3f_array(values), time_code(float(time)))
        del stage


@contextmanager
def _layer_over(
    path: str | os.PathLike[str], opened: OpenedStage, record: Mapping[str, Any] | None
) -> Iterator[Sdf.Layer]:
    """Give a layer to author into; afterwards it lies over the stage, and at its path."""
    check_not_an_input(opened.stage, os.fspath(path))
    with AtomicLayer(path) as file:
        assert file.layer is not None
        directory = os.path.dirname(file.path)
        copy_stage_metadata(opened.stage, file.layer, directory)
        yield file.layer
        # Last: from the temporary folder the relative path leads nowhere.
        root = opened.stage.GetRootLayer()
        source = relative_asset_path(root.realPath or root.identifier, directory)
        file.layer.subLayerPaths = [source]
        set_record(file.layer, {"input": source, **(record or {})})
        file.commit()


def _over(stage: Usd.Stage, mesh: AnimatedMesh) -> Usd.Prim:
    """Return the `over` of a mesh, taken out of its instances."""
    for instance in mesh.uninstanced:
        stage.OverridePrim(instance).SetInstanceable(False)
    return stage.OverridePrim(mesh.path)


def _author_corrections(layer: Sdf.Layer, corrections: Sequence[Correction]) -> None:
    """Author shapes below each mesh, and weights on the animations that carry them."""
    stage = Usd.Stage.Open(layer)
    carriers: dict[Sdf.Path, _Carrier] = {}
    for own in corrections:
        check_correctable(own.mesh)
        prim = _over(stage, own.mesh)
        carrier = _carrier(stage, prim, own.mesh, carriers)
        base = f"repair_{prim.GetName()}"
        taken = [*carrier.names, *own.mesh.prim.GetAllChildrenNames()]
        wished = [f"{base}_{number}" for number in range(1, len(own.shapes) + 1)]
        names = valid_names([*taken, *wished])[len(taken) :]
        offsets = np.zeros((len(own.shapes), len(own.mesh.rest), 3), dtype=np.float32)
        offsets[:, own.vertices] = own.shapes
        binding = UsdSkel.BindingAPI(own.mesh.prim)
        had = binding.GetBlendShapesAttr().Get() or ()
        targets = binding.GetBlendShapeTargetsRel().GetForwardedTargets() if had else ()
        define_shapes(stage, prim, names, offsets, before=(had, targets))
        carrier.names.extend(names)
        carrier.corrections.append((own, names))
    for carrier in carriers.values():
        _author_weights(carrier)


def _carrier(
    stage: Usd.Stage, prim: Usd.Prim, mesh: AnimatedMesh, known: dict[Sdf.Path, _Carrier]
) -> _Carrier:
    """Return the animation that carries the weights of a mesh, and bind the mesh to it."""
    if mesh.skin is None:
        root = check_target(mesh)
        stage.OverridePrim(root).SetTypeName("SkelRoot")
        skeleton, animation = define_carrier(stage, root)
        binding = UsdSkel.BindingAPI.Apply(prim)
        binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
        return known.setdefault(animation.GetPath(), _Carrier(animation, [], None))
    query = mesh.skin.skeleton_query.GetAnimQuery()
    if query:
        path = query.GetPrim().GetPath()
        animation = UsdSkel.Animation(stage.OverridePrim(path))
        return known.setdefault(
            path, _Carrier(animation, list(query.GetBlendShapeOrder() or ()), query)
        )
    skeleton = UsdSkel.BindingAPI.Apply(stage.OverridePrim(mesh.skin.skeleton.GetPath()))
    animation = define_animation(stage, skeleton.GetPath().AppendChild("RepairAnimation"))
    skeleton.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    return known.setdefault(animation.GetPath(), _Carrier(animation, [], None))


def _author_weights(carrier: _Carrier) -> None:
    """Author all weights of an animation at the times of all of its shapes."""
    times = [own.times for own, _ in carrier.corrections]
    if carrier.old is not None:
        times.append(np.array(carrier.old.GetBlendShapeWeightTimeSamples(), dtype=np.float64))
    union = np.unique(np.concatenate(times))
    if (~np.isnan(union)).any():
        union = union[~np.isnan(union)]
    rows = np.zeros((len(union), len(carrier.names)))
    if carrier.old is not None:
        for row, time in zip(rows, union, strict=True):
            weights = carrier.old.ComputeBlendShapeWeights(time_code(float(time)))
            row[: len(weights)] = weights
    for own, names in carrier.corrections:
        for column, name in enumerate(names):
            own_row = own.weights[:, column]
            still = np.isnan(own.times).all()
            values = own_row[0] if still else np.interp(union, own.times, own_row)
            rows[:, carrier.names.index(name)] = values
    author_weights(carrier.animation, carrier.names, union, rows)
