"""AnimatedMesh: what a stage says about one mesh, without its animation loaded."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from pxr import Usd, UsdGeom

from usd_io.errors import StageError
from usd_io.polygons import nonmanifold_edges
from usd_io.read.skinning import Skin, names_joints


@dataclass(frozen=True)
class AnimatedMesh:
    """One mesh of a stage; its frames are read one by one with `read_frame`.

    Attributes:
        path: prim path.
        rest: rest points (V, 3) float64, local space, stage units: those of the default time where
            they fit the animation, else of the first usable sample.
        faces: triangles (F, 3) int32; fans, ear clipping for concave polygons of five and more
            sides; winding flipped for left-handed meshes; holes and degenerate polygons left out.
        polygons: source polygon of each triangle (F,) int32.
        times: time codes of the points (T,) float64, exactly as composed; [nan] for points that
            exist at the default time only. Skinned: the samples of the skin, and every whole frame
            between them, unless that were too many (see `usd_io.frame_grid`).
        up: up axis of the stage (3,).
        meters_per_unit: metres per stage unit.
        warnings: one line each.
        rest_time: time code of `rest`, NaN for the default time.
        uninstanced: paths of the instances that were expanded to reach this mesh.
        stage: the stage; held here because prims die with their stage.
        skin: skeleton and blend shapes that deform the points, if any; writing unbinds the prim.
    """

    path: str
    rest: NDArray[np.float64]
    faces: NDArray[np.int32]
    polygons: NDArray[np.int32]
    times: NDArray[np.float64]
    up: NDArray[np.float64]
    meters_per_unit: float
    warnings: tuple[str, ...] = ()
    rest_time: float = float("nan")
    uninstanced: tuple[str, ...] = ()
    stage: Usd.Stage = field(default=None, repr=False, compare=False)
    skin: Skin | None = field(default=None, repr=False, compare=False)

    @property
    def prim(self) -> Usd.Prim:
        """The prim of the mesh. Raises StageError if it is gone from the stage."""
        prim = self.stage.GetPrimAtPath(self.path)
        if not prim:
            raise StageError(f"{self.path}: no longer on the stage; read the meshes again")
        return prim

    @property
    def instanced(self) -> bool:
        """Whether it lies in an instance, where changes have no effect."""
        return bool(self.prim.IsInstanceProxy())

    @property
    def skinned(self) -> bool:
        """Whether a skeleton or blend shapes deform the points."""
        return self.skin is not None

    @property
    def skeleton(self) -> str:
        """Path of the skeleton whose joints move the points, "" for none."""
        bound = self.skin is not None and self.skin.skinning_query.HasJointInfluences()
        return str(self.skin.skeleton.GetPath()) if self.skin is not None and bound else ""

    @property
    def samples(self) -> NDArray[np.float64]:
        """Authored time codes (T,) of what moves the points; [nan] if nothing does."""
        return self.times if self.skin is None else self.skin.samples()

    @property
    def linear(self) -> bool:
        """Whether points that are not skinned are linear in time between their samples.

        Value clips jump where one clip ends, and stages may hold samples.
        """
        source = self.geometry.GetPointsAttr().GetResolveInfo(Usd.TimeCode.EarliestTime())
        held = self.stage.GetInterpolationType() == Usd.InterpolationTypeHeld
        return not held and source.GetSource() != Usd.ResolveInfoSourceValueClips

    @property
    def coordinate_step(self) -> float:
        """The distance of neighbouring float32 numbers at the largest coordinate, stage units."""
        return float(np.spacing(np.float32(np.abs(self.rest).max())))

    @property
    def geometry(self) -> UsdGeom.Mesh:
        """The mesh schema of the prim."""
        return UsdGeom.Mesh(self.prim)


@dataclass(frozen=True)
class MeshSelection:
    """Meshes of a stage in the order of traversal, and what was left out.

    Attributes:
        meshes: the usable meshes.
        warnings: one line each: skipped meshes and oddities of the selected ones.
        shapes: path and type of what was selected and is no mesh, such as "/Set/Ball (Sphere)".
    """

    meshes: tuple[AnimatedMesh, ...]
    warnings: tuple[str, ...]
    shapes: tuple[str, ...] = ()


def mesh_warnings(mesh: AnimatedMesh, degenerate: int) -> tuple[str, ...]:
    """Return what an artist should know about a mesh that was read."""
    warnings = []
    edges = nonmanifold_edges(mesh.faces)
    if edges:
        warnings.append(f"{mesh.path}: {edges} non-manifold edges (more than two triangles)")
    if degenerate:
        warnings.append(f"{mesh.path}: {degenerate} degenerate polygons take no part")
    if mesh.skin is None and names_joints(mesh.geometry.GetPrim()):
        warnings.append(
            f"{mesh.path}: names a skeleton and joints, but nothing poses it: it needs a SkelRoot "
            "above it, and no prim without a type between; it is taken as it stands"
        )
    scheme = mesh.geometry.GetSubdivisionSchemeAttr().Get()
    if scheme != UsdGeom.Tokens.none:
        warnings.append(
            f"{mesh.path}: subdivision surface ({scheme}); its control cage is used, not its limit"
        )
    size = float(np.ptp(mesh.rest, axis=0).max())
    if size > 0.0 and mesh.coordinate_step > 1e-4 * size:
        warnings.append(
            f"{mesh.path}: points lie far from their origin: float32 steps of "
            f"{mesh.coordinate_step:.3g} units on a mesh of {size:.3g} units"
        )
    return tuple(warnings)


def shape_warnings(selections: Iterable[MeshSelection], named: int = 3) -> list[str]:
    """Return a line on what was selected and is no mesh, if anything is; each is named once."""
    shapes = list(dict.fromkeys(shape for own in selections for shape in own.shapes))
    if not shapes:
        return []
    more = f" and {len(shapes) - named} more" if shapes[named:] else ""
    are = "is no mesh" if len(shapes) == 1 else "are no meshes"
    return [
        f"{', '.join(shapes[:named])}{more} {are}, so that nothing meets there; convert to meshes "
        "what should count"
    ]
