"""Check and repair as jobs: begun, looked at from time to time, finished or cancelled.

Nothing in the scene changes before a job has its result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import bpy
import numpy as np

from ..host.exchange import Request, SampledMesh, read_pairs, read_points
from ..host.process import Worker
from ..host.runs import moved
from . import mesh_cache, shape_keys
from .copies import Copy, copied, discard, discarded_on_failure
from .marks import Contact, contacts
from .roles import Roles, ignored_names, taking_part, with_roles
from .sampling import SceneError, sample

# How far off a vertex may be for fewer shape keys, as a part of the size of its mesh.
TOLERANCE = 1e-4
NO_ROLES = Roles()


class Job:
    """A request in work for objects of the scene.

    Args:
        command: "check" or "repair".
        python: the interpreter of the worker.
        objects: what takes part.
        frames: which frames.
        settings: as `Request` has them.
        roles: what single objects do.
        caches: folder for mesh caches, of which a repair then makes one; None: shape keys.

    Raises:
        SceneError: nothing to work on, or an object that cannot be used.
    """

    def __init__(
        self,
        command: str,
        python: Path,
        objects: Sequence[Any],
        frames: Sequence[int],
        settings: Mapping[str, Any],
        roles: Roles = NO_ROLES,
        caches: Path | None = None,
    ) -> None:
        own = taking_part(objects, roles)
        if not own:
            raise SceneError("no mesh is selected; select what should take part")
        self.frames = tuple(frames)
        meshes = sample(own, self.frames)
        if command == "repair":
            refuse = shape_keys.refuse_added_vertices
            refuse(own, meshes) if caches is None else mesh_cache.refuse_late_modifiers(own)
        self.meshes: list[SampledMesh] = with_roles(own, meshes, roles)
        settings = {**settings, "ignore": ignored_names(own, roles), "cache": caches is not None}
        request = Request(command, self.frames, tuple(self.meshes), settings)
        # Undo makes objects anew, and their numbers stay.
        self._numbers = [(each.session_uid, _size(each)) for each in own]
        self._python, self._settings, self._caches = python, settings, caches
        self.worker = Worker(python, request)

    @property
    def objects(self) -> list[Any]:
        """What takes part. Raises SceneError for what was deleted or edited in the meantime."""
        known = {each.session_uid: each for each in bpy.data.objects}
        for (number, size), mesh in zip(self._numbers, self.meshes, strict=True):
            if number not in known:
                raise SceneError(f"{mesh.name} was deleted in the meantime; nothing was changed")
            if _size(known[number]) != size:
                raise SceneError(f"{mesh.name} was edited in the meantime; start again")
        return [known[number] for number, _ in self._numbers]

    def cancel(self) -> None:
        """End the worker; the scene is as it was."""
        self.worker.close()

    def found(self, told: Mapping[str, Any]) -> tuple[list[Any], list[Contact]]:
        """Return the pairs (K, 4) of each frame, and the contacts, of a finished check."""
        pairs = read_pairs(self.worker.folder / told["result"], len(self.frames))
        return pairs, contacts(self.meshes, self.frames, pairs)

    def apply(self, told: Mapping[str, Any]) -> tuple[list[Any], list[int]]:
        """Put the result of a finished repair into the scene; waits until it is looked at again.

        Returns the copies, and the frames in which their evaluated meshes intersect. Where few
        shape keys cost a frame that was clean, each frame has a key of its own.
        """
        points = read_points(self.worker.folder / told["result"], self.meshes)
        dirty = [int(f["frame"]) for f in told["frames"] if f["after"] != 0]
        if not any(len(moved(m.points, own)) for m, own in zip(self.meshes, points, strict=True)):
            return [], dirty
        if self._caches is not None:
            return self._cached(points, told), dirty
        copies, left = self._keyed(points, TOLERANCE)
        if set(left) - set(dirty):
            for copy in copies:
                discard(copy)
            copies, left = self._keyed(points, 0.0)
        return [copy.object for copy in copies], left

    def _copied(self, points: Sequence[Any]) -> dict[int, Copy]:
        """Copies of the objects that move, by their place."""
        return {
            place: copied(each)
            for place, (each, own) in enumerate(zip(self.objects, points, strict=True))
            if len(moved(self.meshes[place].points, own))
        }

    def _keyed(self, points: Sequence[Any], tolerance: float) -> tuple[list[Copy], list[int]]:
        """Copies with shape keys, and the frames in which they intersect."""
        copies = self._copied(points)
        with discarded_on_failure(copies.values()):
            for place, copy in copies.items():
                mesh, own = self.meshes[place], points[place]
                shape_keys.apply(copy.object, self.frames, mesh, own, tolerance)
            return list(copies.values()), self._intersecting(copies)

    def _cached(self, points: Sequence[Any], told: Mapping[str, Any]) -> list[Any]:
        """Copies with a mesh cache, which have the points to the last bit."""
        assert self._caches is not None
        copies = self._copied(points)
        layer = self.worker.folder / told["cache"]
        with discarded_on_failure(copies.values()), mesh_cache.kept(layer, self._caches) as kept:
            file = mesh_cache.opened(kept)
            for place, copy in copies.items():
                changed = (self.meshes[place].points != points[place]).any(axis=(1, 2))
                mesh_cache.apply(copy.object, self.frames, changed, file, told["prims"][place])
            shown = [copy.object for copy in copies.values()]
            for each, place in zip(sample(shown, self.frames), copies, strict=True):
                if not np.array_equal(each.points, points[place]):
                    name = self.meshes[place].name
                    raise SceneError(f"{name}: Blender did not read its mesh cache {file.filepath}")
        return shown

    def _intersecting(self, copies: Mapping[int, Copy]) -> list[int]:
        shown = self.objects
        for place, copy in copies.items():
            shown[place] = copy.object
        meshes = [
            replace(mesh, points=now.points, matrices=now.matrices)
            for mesh, now in zip(self.meshes, sample(shown, self.frames), strict=True)
        ]
        worker = Worker(self._python, Request("check", self.frames, tuple(meshes), self._settings))
        try:
            told = worker.wait()
        finally:
            worker.close()
        return [int(frame["frame"]) for frame in told["frames"] if frame["before"]]


def _size(target: Any) -> tuple[int, int]:
    return len(target.data.vertices), len(target.data.polygons)
