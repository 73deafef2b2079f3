"""A tube on two joints that bends until it passes through itself, skinned by UsdSkel."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdGeom, UsdSkel, Vt

from tests.meshes import tube_quads

POINTS, QUADS = tube_quads(10, 28, 0.2, 2.4)
MESH = "/Root/Tube"


def rigged_tube(
    path: Path,
    angles: tuple[float, ...] = (0.0, 120.0, 0.0),
    *,
    every: float = 4.0,
    offset: tuple[float, float, float] = (3.0, 0.0, 1.0),
    scale: float = 1.0,
    bulge: bool = False,
    names: tuple[str, ...] = ("Tube",),
) -> Path:
    """Keys of the bend in degrees, so many time codes apart; with a blend shape if wanted.

    offset: where the mesh lies, the skeleton does not; scale: of its bind transform.
    """
    stage = Usd.Stage.CreateNew(str(path))
    UsdSkel.Root.Define(stage, "/Root")
    skeleton = UsdSkel.Skeleton.Define(stage, "/Root/Skeleton")
    skeleton.CreateJointsAttr(["a", "a/b"])
    skeleton.CreateBindTransformsAttr([Gf.Matrix4d(1), Gf.Matrix4d(1)])
    skeleton.CreateRestTransformsAttr([Gf.Matrix4d(1), Gf.Matrix4d(1)])
    animation = UsdSkel.Animation.Define(stage, "/Root/Animation")
    animation.CreateJointsAttr(["a", "a/b"])
    animation.CreateTranslationsAttr([(0, 0, 0), (0, 0, 0)])
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * 2))
    for row, angle in enumerate(angles):
        turn = Gf.Quatf(Gf.Rotation((0, 1, 0), angle).GetQuat())
        whole = Gf.Quatf(Gf.Rotation((1, 0, 0), 40.0 * row).GetQuat())
        animation.CreateRotationsAttr().Set([whole, turn], every * row)
    carrier = UsdSkel.BindingAPI.Apply(skeleton.GetPrim())
    carrier.CreateAnimationSourceRel().SetTargets(["/Root/Animation"])
    for number, name in enumerate(names):
        _tube(stage, f"/Root/{name}", np.array(offset) + 5.0 * number, scale)
        if bulge:
            _bulge(stage, f"/Root/{name}", animation, every * (len(angles) - 1))
    stage.GetRootLayer().Save()
    return path


def _tube(stage: Usd.Stage, path: str, offset: NDArray[np.float64], scale: float) -> None:
    mesh = UsdGeom.Mesh.Define(stage, path)
    mesh.AddTranslateOp().Set(tuple(offset.tolist()))
    points = (POINTS / scale).astype(np.float32)
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(points))
    mesh.CreateFaceVertexCountsAttr([4] * len(QUADS))
    mesh.CreateFaceVertexIndicesAttr(QUADS.reshape(-1).tolist())
    mesh.CreateSubdivisionSchemeAttr("none")
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets(["/Root/Skeleton"])
    upper = np.clip(0.5 + POINTS[:, 2] / 0.3, 0.0, 1.0)
    pairs = np.stack([1.0 - upper, upper], axis=1)
    count = len(POINTS)
    binding.CreateJointIndicesPrimvar(False, 2).Set(Vt.IntArray([0, 1] * count))
    binding.CreateJointWeightsPrimvar(False, 2).Set(
        Vt.FloatArray.FromNumpy(pairs.reshape(-1).astype(np.float32))
    )
    binding.CreateGeomBindTransformAttr(Gf.Matrix4d().SetScale(scale))


def _bulge(stage: Usd.Stage, path: str, animation: UsdSkel.Animation, end: float) -> None:
    """A blend shape that makes the tube thicker over time."""
    shape = UsdSkel.BlendShape.Define(stage, f"{path}/bulge")
    shape.CreateOffsetsAttr([(0.0, 0.04, 0.0)] * 5)
    shape.CreatePointIndicesAttr(list(range(5)))
    binding = UsdSkel.BindingAPI(stage.GetPrimAtPath(path))
    binding.CreateBlendShapesAttr(["bulge"])
    binding.CreateBlendShapeTargetsRel().SetTargets([shape.GetPath()])
    animation.CreateBlendShapesAttr(["bulge"])
    animation.CreateBlendShapeWeightsAttr().Set([0.0], 0.0)
    animation.CreateBlendShapeWeightsAttr().Set([1.0], end)


def skinned_points(path: Path, time: float, mesh: str = MESH) -> NDArray[np.float64]:
    """World points of a mesh by UsdSkel's queries: a reader that shares nothing with usd_io."""
    stage = Usd.Stage.Open(str(path))
    prim = stage.GetPrimAtPath(mesh)
    root, cache = UsdSkel.Root(stage.GetPrimAtPath("/Root")), UsdSkel.Cache()
    cache.Populate(root, Usd.PrimDefaultPredicate)
    skeleton = cache.GetSkelQuery(UsdSkel.Skeleton(stage.GetPrimAtPath("/Root/Skeleton")))
    skinning = cache.GetSkinningQuery(prim)
    points = Vt.Vec3fArray(UsdGeom.Mesh(prim).GetPointsAttr().Get(time))
    if skinning.HasBlendShapes():
        weights = skeleton.GetAnimQuery().ComputeBlendShapeWeights(time)
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(prim))
        own = skinning.GetBlendShapeMapper().Remap(weights)
        assert shapes.ComputeDeformedPoints(
            *shapes.ComputeSubShapeWeights(own),
            shapes.ComputeBlendShapePointIndices(),
            shapes.ComputeSubShapePointOffsets(),
            points,
        )
    joints = skeleton.ComputeSkinningTransforms(time)
    assert skinning.ComputeSkinnedPoints(joints, points, time)
    return np.asarray(points, dtype=np.float64)  # the skeleton is not moved in the world


def baked_points(path: Path, time: float) -> NDArray[np.float64]:
    """World points of the mesh as UsdSkel bakes them, at a key of the joints."""
    stage = Usd.Stage.Open(Usd.Stage.Open(str(path)).Flatten())
    UsdSkel.BakeSkinning(UsdSkel.Root(stage.GetPrimAtPath("/Root")), Gf.Interval(time, time))
    geometry = UsdGeom.Mesh(stage.GetPrimAtPath(MESH))
    points = np.asarray(geometry.GetPointsAttr().Get(time), dtype=np.float64)
    matrix = np.array(geometry.ComputeLocalToWorldTransform(time))
    return np.asarray(points @ matrix[:3, :3] + matrix[3, :3])
