"""Reading the meshes of a stage, for tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import Sdf, UsdGeom

from tests.usd_stages import define_cube, new_stage
from usd_io import MeshSelection, open_stage, read_meshes


def selection_of(path: Path, **options: Any) -> MeshSelection:
    return read_meshes(open_stage(path), **options)


def edited_cube(tmp_path: Path, edit: Callable[[UsdGeom.Mesh], object], **options: Any) -> Path:
    """A file with one cube that a function changed before it was saved."""
    stage = new_stage(tmp_path / "cube.usda")
    edit(define_cube(stage, **options))
    stage.GetRootLayer().Save()
    return tmp_path / "cube.usda"


def defined_in(path: Path) -> dict[str, str]:
    """Types of the prims that a layer defines itself, by path; those of an `over` are left out."""
    layer, found = Sdf.Layer.FindOrOpen(str(path)), dict[str, str]()

    def visit(place: Sdf.Path) -> None:
        spec = layer.GetPrimAtPath(place) if place.IsPrimPath() else None
        if spec is not None and spec.specifier != Sdf.SpecifierOver:
            found[str(place)] = spec.typeName

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found
