"""Repaired points as a USD layer that a MeshSequenceCache modifier of a copy reads."""

from __future__ import annotations

import os
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from ..host.runs import runs
from .sampling import PREFIX, REFINING, SceneError


def folder_of(text: str) -> Path:
    """Return the folder of caches. Raises SceneError where none can be written there."""
    if text.startswith("//") and not bpy.data.filepath:
        raise SceneError(
            f"a mesh cache is a file beside the scene, in {text}; save the scene, or choose "
            "another folder"
        )
    folder = Path(bpy.path.abspath(text))
    there = next(each for each in (folder, *folder.absolute().parents) if each.exists())
    if not (there.is_dir() and os.access(there, os.W_OK)):
        raise SceneError(f"no mesh cache can be written to {folder}; choose another folder")
    return folder


def refuse_late_modifiers(objects: Sequence[Any]) -> None:
    """Raise SceneError where a modifier would deform what the cache holds once more.

    The cache stands before the first refining modifier, since it holds the cage.
    """
    for each in objects:
        late = each.modifiers[_place(each) :]
        for modifier in late:
            if modifier.type not in REFINING and modifier.show_viewport:
                raise SceneError(
                    f"{each.name}: its modifier {modifier.name} comes after a subdivision; move it "
                    "before that, or choose shape keys"
                )


@contextmanager
def kept(layer: Path, folder: Path) -> Iterator[Path]:
    """Copy a layer into the folder of caches under a name of its own; give its path.

    Where the block fails, neither the file nor Blender's cache file of it is left behind.
    """
    target = _copied(layer, folder)
    try:
        yield target
    except BaseException:
        for each in list(bpy.data.cache_files):
            if Path(bpy.path.abspath(each.filepath)) == target:
                bpy.data.batch_remove([each])
        target.unlink(missing_ok=True)
        raise


def _copied(layer: Path, folder: Path) -> Path:
    folder.mkdir(parents=True, exist_ok=True)
    number = 1
    while (target := folder / f"{PREFIX}_{number:03}.usdc").exists():
        number += 1
    part = target.with_suffix(".part")
    try:
        shutil.copyfile(layer, part)
        os.replace(part, target)
    finally:
        part.unlink(missing_ok=True)
    return target


def opened(path: Path) -> Any:
    """Return Blender's cache file of a path; what is beside the scene moves with it."""
    known = {each.session_uid for each in bpy.data.cache_files}
    bpy.ops.cachefile.open(filepath=str(path))
    (found,) = (each for each in bpy.data.cache_files if each.session_uid not in known)
    if bpy.data.filepath and path.is_relative_to(Path(bpy.data.filepath).parent):
        found.filepath = bpy.path.relpath(str(path))
    return found


def apply(
    copy: Any, frames: Sequence[int], changed: NDArray[np.bool_], file: Any, prim: str
) -> None:
    """Let an object take its points from a prim of a cache file at the changed (T,) frames.

    Beside them the modifier is off, and the rig alone poses the object.
    """
    place = _place(copy)
    modifier = copy.modifiers.new(f"{PREFIX} cache", "MESH_SEQUENCE_CACHE")
    modifier.cache_file, modifier.object_path = file, prim
    modifier.read_data = {"VERT"}
    copy.modifiers.move(len(copy.modifiers) - 1, place)
    for run in runs(f for f, own in zip(frames, changed, strict=True) if own):
        for frame, on in ((run[0] - 1, False), (run[0], True), (run[-1] + 1, False)):
            for name in ("show_viewport", "show_render"):
                setattr(modifier, name, on)
                modifier.keyframe_insert(name, frame=frame)


def _place(target: Any) -> int:
    """Return the index of the first refining modifier, or that after the last one."""
    refining = (i for i, modifier in enumerate(target.modifiers) if modifier.type in REFINING)
    return next(refining, len(target.modifiers))
