"""Reading the meshes of a stage, for tests."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import Any

from pxr import UsdGeom

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
