"""Boxes on a skeleton that bends them at half their height, and where their points belong."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Usd, UsdSkel, Vt

from tests.usd_stages import CUBE, define_cube
from usd_io import AnimatedMesh, open_stage, read_meshes

# A tall box: the lower four points on joint a, the upper four on joint b at height 2.
BOX = (CUBE * [0.5, 2.0, 0.5] + [0.0, 2.0, 0.0]).astype(np.float32)
UPPER = BOX[:, 1] > 2.0
BIND = np.array([0.0, 0.0, 0.25])
SKELETON = np.array([0.0, 1.0, 0.0])
MESH = np.array([0.0, 0.0, 7.0])
KEYS = {0.0: 0.0, 30.0: 90.0}


def skinned_stage(path: Path, *, keys: dict[float, float] = KEYS, names: str = "A") -> Usd.Stage:
    """Boxes that bend at half their height; not saved yet."""
    stage = Usd.Stage.CreateNew(str(path))
    root = UsdSkel.Root.Define(stage, "/Root")
    root.AddTranslateOp().Set((5, 0, 0))
    skeleton = UsdSkel.Skeleton.Define(stage, "/Root/Skeleton")
    skeleton.AddTranslateOp().Set(tuple(SKELETON))
    skeleton.CreateJointsAttr(["a", "a/b"])
    pose = [Gf.Matrix4d(1), Gf.Matrix4d(1).SetTranslate((0, 2, 0))]
    skeleton.CreateBindTransformsAttr(pose)
    skeleton.CreateRestTransformsAttr(pose)
    animation = UsdSkel.Animation.Define(stage, "/Root/Animation")
    animation.CreateJointsAttr(["a", "a/b"])
    for time, angle in keys.items():
        turn = Gf.Quatf(Gf.Rotation((0, 0, 1), angle).GetQuat())
        animation.CreateRotationsAttr().Set([Gf.Quatf(1), turn], time)
    animation.CreateTranslationsAttr([(0, 0, 0), (0, 2, 0)])
    animation.CreateScalesAttr(Vt.Vec3hArray([Gf.Vec3h(1, 1, 1)] * 2))
    source = UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel()
    source.SetTargets(["/Root/Animation"])
    for name in names:
        mesh = define_cube(stage, f"/Root/{name}", points=BOX)
        mesh.AddTranslateOp().Set(tuple(MESH))
        binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
        binding.CreateSkeletonRel().SetTargets(["/Root/Skeleton"])
        binding.CreateJointIndicesPrimvar(False, 1).Set([int(upper) for upper in UPPER])
        binding.CreateJointWeightsPrimvar(False, 1).Set([1.0] * 8)
        binding.CreateGeomBindTransformAttr().Set(Gf.Matrix4d(1).SetTranslate(tuple(BIND)))
    return stage


def skinned_file(path: Path, *, names: str = "A") -> None:
    """The boxes as a file."""
    stage = skinned_stage(path, names=names)
    stage.GetRootLayer().Save()


def bent(angle: float) -> NDArray[np.float64]:
    """Where the points belong, local space of the mesh."""
    radians = np.radians(angle)
    turn = np.array([[np.cos(radians), np.sin(radians)], [-np.sin(radians), np.cos(radians)]])
    points = BOX + BIND
    points[UPPER, :2] = (points[UPPER, :2] - [0, 2]) @ turn + [0, 2]
    values: NDArray[np.float64] = points + SKELETON - MESH
    return values


def only_mesh(path: Path, **options: Any) -> AnimatedMesh:
    return read_meshes(open_stage(path), **options).meshes[0]


def blend_shaped(path: Path, *, joints: bool) -> None:
    """Shape 'lift' raises points 4 to 7 by z; it comes second in the animation's order."""
    stage = skinned_stage(path)
    animation = UsdSkel.Animation(stage.GetPrimAtPath("/Root/Animation"))
    animation.CreateBlendShapesAttr(["other", "lift"])
    animation.CreateBlendShapeWeightsAttr().Set([1.0, 0.0], 0.0)
    animation.CreateBlendShapeWeightsAttr().Set([1.0, 1.0], 10.0)
    prim = stage.GetPrimAtPath("/Root/A")
    shape = UsdSkel.BlendShape.Define(stage, "/Root/A/lift")
    shape.CreateOffsetsAttr([(0, 0, 2)] * 4)
    shape.CreatePointIndicesAttr([4, 5, 6, 7])
    binding = UsdSkel.BindingAPI(prim)
    binding.CreateBlendShapesAttr(["lift"])
    binding.CreateBlendShapeTargetsRel().SetTargets(["/Root/A/lift"])
    if not joints:
        for name in ("jointIndices", "jointWeights"):
            prim.RemoveProperty(f"primvars:skel:{name}")
    stage.GetRootLayer().Save()
