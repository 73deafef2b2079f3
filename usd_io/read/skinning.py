"""Points of skinned and blend-shaped meshes, frame by frame.

`UsdSkel.BakeSkinning` would retype the SkelRoot, which changes every mesh below it, and sample only
the authored joint keys: in between, interpolated points are not skinned points (2 % of the size off
in the middle of keys 30 frames apart). So the queries are used directly, at every wanted frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from pxr import Tf, Usd, UsdGeom, UsdSkel, Vt

from usd_io.errors import FrameError, StageError, one_line
from usd_io.frame_grid import frame_grid
from usd_io.read.matrices import chain_times, inverse_matrix, prim_matrix, transform_points
from usd_io.times import time_code
from usd_io.values import vec3f_array


@dataclass(frozen=True)
class Skin:
    """What deforms one mesh.

    Attributes:
        prim: the mesh prim.
        skeleton: the skeleton prim.
        skeleton_query: animation of the skeleton.
        skinning_query: influences and blend shapes of the mesh.
        cache: owner of the queries.
    """

    prim: Usd.Prim
    skeleton: Usd.Prim
    skeleton_query: UsdSkel.SkeletonQuery
    skinning_query: UsdSkel.SkinningQuery
    cache: UsdSkel.Cache

    def times(self) -> NDArray[np.float64]:
        """Return the time codes to skin at (T,); [nan] if nothing moves.

        All samples, and every whole frame from the first to the last of them. Only the samples
        where these are too many, see `FrameGrid.filled`.
        """
        samples = self.samples()
        if np.isnan(samples).any():
            return samples
        filled = frame_grid(self.prim.GetStage()).filled(samples)
        return samples if filled is None else filled

    def samples(self) -> NDArray[np.float64]:
        """Return the authored time codes (T,) of what moves the points; [nan] if nothing moves.

        Those of joints, blend shapes, base points and transforms between mesh and skeleton.
        """
        times = set(UsdGeom.PointBased(self.prim).GetPointsAttr().GetTimeSamples())
        animation = self.skeleton_query.GetAnimQuery()
        if animation:
            times.update(animation.GetJointTransformTimeSamples())
            times.update(animation.GetBlendShapeWeightTimeSamples())
        if self.skinning_query.HasJointInfluences():
            times.update(self._influence_times())
            shared = self.prim.GetPath().GetCommonPrefix(self.skeleton.GetPath())
            for prim in (self.prim, self.skeleton):
                times.update(chain_times(prim, below=shared))
        return np.array(sorted(times)) if times else np.array([np.nan])

    def _influence_times(self) -> set[float]:
        """Return the samples of influences and bind transform.

        The query's own list throws where no bind transform is authored, which means the identity.
        """
        binding = UsdSkel.BindingAPI(self.prim)
        attributes = (
            binding.GetJointIndicesAttr(),
            binding.GetJointWeightsAttr(),
            binding.GetGeomBindTransformAttr(),
        )
        return {time for item in attributes if item for time in item.GetTimeSamples()}

    def points(self, time: float) -> NDArray[np.float32] | None:
        """Return deformed points (V, 3) float32, local space of the mesh; None if blocked.

        Raises:
            FrameError: influences or blend shapes do not fit the points.
        """
        points = self.unposed(time)
        return None if points is None else self.posed(points, time)

    def unposed(self, time: float) -> NDArray[np.float32] | None:
        """Return base points with blend shapes (V, 3), before joints move them; None if blocked.

        Raises:
            FrameError: blend shapes do not fit the points.
        """
        value = UsdGeom.PointBased(self.prim).GetPointsAttr().Get(time_code(time))
        if value is None:
            return None
        points = Vt.Vec3fArray(vec3f_array(value))
        self._change(self._blend, points, time)
        return np.asarray(points)

    def posed(self, points: NDArray[np.floating], time: float) -> NDArray[np.float32]:
        """Return points (V, 3) where the joints move them, local space of the mesh.

        Raises:
            FrameError: influences do not fit the points.
        """
        moved = Vt.Vec3fArray(vec3f_array(points))
        self._change(self._skin, moved, time)
        return self._to_mesh(moved, time)

    def _change(
        self, change: Callable[[Vt.Vec3fArray, float], bool], points: Vt.Vec3fArray, time: float
    ) -> None:
        """Change points in place. Raises FrameError where that fails."""
        try:
            done = change(points, time)
        except (Tf.ErrorException, UnicodeError) as error:
            raise self._failed(time, one_line(error)) from None
        if not done:
            raise self._failed(time, "influences or blend shapes do not fit the points")

    def rest(self, time: float) -> NDArray[np.float64]:
        """Return undeformed points (V, 3) where the skeleton binds them, in the mesh's space."""
        base = UsdGeom.PointBased(self.prim).GetPointsAttr().Get(time_code(time))
        points = np.asarray(base, dtype=np.float64).reshape(-1, 3)
        if not self.skinning_query.HasJointInfluences():
            return points
        bind = np.array(self.skinning_query.GetGeomBindTransform(time_code(time)))
        return transform_points(points, bind @ self._skeleton_to_mesh(float(self.times()[0])))

    def _blend(self, points: Vt.Vec3fArray, time: float) -> bool:
        """Add the blend shapes to the points, in place."""
        animation = self.skeleton_query.GetAnimQuery()
        if not self.skinning_query.HasBlendShapes() or not animation:
            return True
        weights = animation.ComputeBlendShapeWeights(time_code(time))
        mapped = self.skinning_query.GetBlendShapeMapper().Remap(weights)
        shapes = UsdSkel.BlendShapeQuery(UsdSkel.BindingAPI(self.prim))
        return bool(
            shapes.ComputeDeformedPoints(
                *shapes.ComputeSubShapeWeights(mapped),
                shapes.ComputeBlendShapePointIndices(),
                shapes.ComputeSubShapePointOffsets(),
                points,
            )
        )

    def _skin(self, points: Vt.Vec3fArray, time: float) -> bool:
        """Move the points with the joints, in place, into the space of the skeleton."""
        if not self.skinning_query.HasJointInfluences():
            return True
        transforms = self.skeleton_query.ComputeSkinningTransforms(time_code(time))
        return bool(self.skinning_query.ComputeSkinnedPoints(transforms, points, time_code(time)))

    def _to_mesh(self, points: Vt.Vec3fArray, time: float) -> NDArray[np.float32]:
        """Return points (V, 3) of the space of the skeleton in the local space of the mesh."""
        if not self.skinning_query.HasJointInfluences():
            return np.asarray(points)
        matrix = self._skeleton_to_mesh(time)
        if np.array_equal(matrix, np.eye(4)):
            return np.asarray(points)
        return transform_points(np.asarray(points), matrix).astype(np.float32)

    def _skeleton_to_mesh(self, time: float) -> NDArray[np.float64]:
        """Return the matrix (4, 4) from the space of the skeleton to that of the mesh."""
        mesh = prim_matrix(self.prim, time)
        inverse = inverse_matrix(mesh, path=str(self.prim.GetPath()), time=time)
        skeleton = prim_matrix(self.skeleton, time)
        # Linear parts first: a common offset of 1e6 then costs no digits.
        product: NDArray[np.float64] = skeleton @ inverse
        product[3, :3] = (skeleton[3, :3] - mesh[3, :3]) @ inverse[:3, :3]
        return product

    def _failed(self, time: float, reason: str) -> FrameError:
        """Return the error of a frame that cannot be skinned."""
        return FrameError(str(self.prim.GetPath()), time, f"cannot be skinned: {reason}")


def find_skin(prim: Usd.Prim) -> Skin | None:
    """Return what deforms a mesh prim, None if nothing does.

    Raises:
        StageError: the mesh inherits its influences, so that it cannot be unbound alone.
    """
    root = prim
    while root and not root.IsA(UsdSkel.Root):
        root = root.GetParent()
    if not root:
        return None
    cache = UsdSkel.Cache()
    skel_root = UsdSkel.Root(root)
    # What lies below an instance is seen by its proxies only.
    everything = Usd.TraverseInstanceProxies(Usd.PrimDefaultPredicate)
    cache.Populate(skel_root, everything)
    for binding in cache.ComputeSkelBindings(skel_root, everything):
        for query in binding.GetSkinningTargets():
            if query.GetPrim() == prim:
                _check_own_binding(prim)
                skeleton = binding.GetSkeleton()
                skeleton_query = cache.GetSkelQuery(skeleton)
                return Skin(prim, skeleton.GetPrim(), skeleton_query, query, cache)
    return None


def names_joints(prim: Usd.Prim) -> bool:
    """Return whether a prim names a skeleton that exists, and joints of it, itself or inherited."""
    binding = UsdSkel.BindingAPI(prim)
    indices = binding.GetJointIndicesPrimvar()
    return bool(binding.GetInheritedSkeleton()) and indices.HasAuthoredValue()


def _check_own_binding(prim: Usd.Prim) -> None:
    """Raise StageError if influences are inherited: then the mesh cannot be unbound alone."""
    above = prim.GetParent()
    while above and not above.IsPseudoRoot():
        if UsdSkel.BindingAPI(above).GetJointIndicesAttr().HasAuthoredValue():
            raise StageError(
                f"{prim.GetPath()}: inherits joint influences from {above.GetPath()} and cannot be "
                "unbound alone; bake the skinning first or exclude it"
            )
        above = above.GetParent()
