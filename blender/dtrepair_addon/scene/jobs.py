"""Check and repair as jobs: begun, looked at from time to time, finished or cancelled.

Nothing in the scene changes before a job has its result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from ..host.exchange import Request, SampledMesh, read_pairs, read_points
from ..host.process import Worker
from .marks import Contact, contacts
from .roles import Roles, ignored_names, taking_part, with_roles
from .sampling import SceneError, sample
from .shape_keys import Applied, apply, discard, needs_keys, refuse_added_vertices

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
    ) -> None:
        self.objects = taking_part(objects, roles)
        if not self.objects:
            raise SceneError("no mesh is selected; select what should take part")
        self.frames = tuple(frames)
        meshes = sample(self.objects, self.frames)
        if command == "repair":
            refuse_added_vertices(self.objects, meshes)
        self.meshes: list[SampledMesh] = with_roles(self.objects, meshes, roles)
        settings = {**settings, "ignore": ignored_names(self.objects, roles)}
        request = Request(command, self.frames, tuple(self.meshes), settings)
        self._python, self._settings = python, settings
        self.worker = Worker(python, request)

    def cancel(self) -> None:
        """End the worker; the scene is as it was."""
        self.worker.close()

    def found(self, told: Mapping[str, Any]) -> tuple[list[Any], list[Contact]]:
        """Return the pairs (K, 4) of each frame, and the contacts, of a finished check."""
        pairs = read_pairs(self.worker.folder / told["result"], len(self.frames))
        return pairs, contacts(self.meshes, self.frames, pairs)

    def apply(self, told: Mapping[str, Any]) -> tuple[list[Applied], list[int]]:
        """Put the result of a finished repair into the scene; waits until it is counted again.

        Returns the copies, and the frames in which their evaluated meshes intersect. Where few
        shape keys cost a frame that was clean, each frame has a key of its own.
        """
        points = read_points(self.worker.folder / told["result"], self.meshes)
        clean = {int(f["frame"]) for f in told["frames"] if f["after"] == 0}
        copies, dirty = self._applied(points, TOLERANCE)
        if clean & set(dirty):
            for each, (original, hidden) in copies:
                discard(each, original, hidden)
            copies, dirty = self._applied(points, 0.0)
        return [each for each, _ in copies], dirty

    def _applied(self, points: Sequence[Any], tolerance: float) -> tuple[list[Any], list[int]]:
        """Copies with what they hide, and the frames in which they intersect."""
        copies, shown = [], []
        for each, mesh, own in zip(self.objects, self.meshes, points, strict=True):
            shown.append(each)
            if needs_keys(mesh, own):
                hidden = each.hide_get(), each.hide_render
                applied = apply(each, self.frames, mesh, own, tolerance)
                copies.append((applied, (each, hidden)))
                shown[-1] = applied.object
        return copies, self._intersecting(shown) if copies else []

    def _intersecting(self, objects: Sequence[Any]) -> list[int]:
        names = {new.name: old.name for new, old in zip(objects, self.objects, strict=True)}
        meshes = [replace(mesh, name=names[mesh.name]) for mesh in sample(objects, self.frames)]
        worker = Worker(self._python, Request("check", self.frames, tuple(meshes), self._settings))
        try:
            told = worker.wait()
        finally:
            worker.close()
        return [int(frame["frame"]) for frame in told["frames"] if frame["before"]]
