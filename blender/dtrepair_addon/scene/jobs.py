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
from . import mesh_cache
from .copies import copied, discarded_on_failure, hide, trial
from .marks import Contact, contacts
from .roles import Roles, ignored_names, taking_part, with_roles
from .sampling import SceneError, sample
from .shape_keys import refuse_added_vertices
from .shapes import Shapes

# How far off a vertex may be for fewer shape keys, as a part of the size of its mesh.
TOLERANCE = 1e-4
NO_ROLES = Roles()


class Job:
    """A request in work for objects of the scene.

    `worker` is the process at work, `recounts` whether that counts shape keys again; `told` is what
    came of the command itself, `dirty` the frames that are not clean.

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
            if caches is None:
                refuse_added_vertices(own, meshes)
            else:
                mesh_cache.refuse_late_modifiers(own)
        self.meshes: list[SampledMesh] = with_roles(own, meshes, roles)
        settings = {**settings, "ignore": ignored_names(own, roles), "cache": caches is not None}
        request = Request(command, self.frames, tuple(self.meshes), settings)
        # Undo makes objects anew, and their numbers stay.
        self._numbers = [(each.session_uid, _size(each)) for each in own]
        self._python, self._request, self._caches = python, request, caches
        self._shapes: Shapes | None = None
        self.worker = Worker(python, request)
        self.recounts = False

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

    def found(self) -> tuple[list[Any], list[Contact]]:
        """Return the pairs (K, 4) of each frame, and the contacts, of a finished check."""
        pairs = read_pairs(self.worker.folder / self.told["result"], len(self.frames))
        return pairs, contacts(self.meshes, self.frames, pairs)

    @property
    def progress(self) -> tuple[str, float]:
        """What is being done, and the share of it that is done."""
        if self._shapes is not None and self._shapes.fitted < 1.0:
            return "fitting shape keys", self._shapes.fitted
        now = self.worker.progress
        phase = "counting again" if self.recounts else now.phase
        return phase, now.done / max(now.total, 1)

    def goes_on(self) -> bool:
        """Look at the worker, which takes a moment; return whether there is more to wait for.

        Results that become shape keys are fitted, one frame in each look. Then another worker
        counts the evaluated meshes. Where few keys cost a frame that was clean, each frame is to
        have a key of its own, and they are counted once more.
        """
        if self._shapes is None or self._shapes.fitted == 1.0:
            told = self.worker.poll()
            if told is None:
                return True
            if self.recounts:
                return self._counted(told)
            self._arrived(told)
            return self._shapes is not None
        self._shapes.fit(self._moving())
        if self._shapes.fitted == 1.0:
            self._recount(TOLERANCE)
        return True

    def apply(self) -> list[Any]:
        """Put the result of a repair that goes on no more into the scene; return the copies."""
        originals = self._moving()
        if not originals:
            return []
        copies = {place: copied(each) for place, each in originals.items()}
        with discarded_on_failure(copies.values()):
            if self._shapes is not None:
                self._shapes.add(copies)
            elif self._caches is not None:
                self._cache(copies, self._caches)
        for original in originals.values():
            hide(original)
        return list(copies.values())

    def _arrived(self, told: Mapping[str, Any]) -> None:
        """Take in the result of the command."""
        self.told, self.warnings = told, self.worker.progress.warnings
        if self._request.command == "check":
            return
        unclean = (f for f in told["frames"] if f["after"] or f["status"] != "clean")
        self.dirty = self._unclean = [int(frame["frame"]) for frame in unclean]
        self._points = read_points(self.worker.folder / told["result"], self.meshes)
        if self._caches is None and self._moving():
            self._shapes = Shapes(self.frames, self.meshes, self._points)

    def _recount(self, tolerance: float) -> None:
        """Let a worker count what the keys lead to; nothing of them stays in the scene."""
        assert self._shapes is not None
        meshes, self._tolerance = list(self.meshes), tolerance
        self._shapes.choose(tolerance)
        with trial(self._moving()) as copies:
            self._shapes.add(copies)
            shown = sample(list(copies.values()), self.frames)
        for place, now in zip(copies, shown, strict=True):
            meshes[place] = replace(meshes[place], points=now.points, matrices=now.matrices)
        self.worker.close()
        request = replace(self._request, command="check", meshes=tuple(meshes))
        self.worker, self.recounts = Worker(self._python, request), True

    def _counted(self, told: Mapping[str, Any]) -> bool:
        """Take in a count of shape keys; return whether there will be another one."""
        left = {int(f["frame"]) for f in told["frames"] if f["before"]}
        again = self._tolerance > 0.0 and not left <= set(self._unclean)
        if again:
            self._recount(0.0)
        self.dirty = sorted(left.union(self._unclean))
        return again

    def _moving(self) -> dict[int, Any]:
        """The objects that move, by their place."""
        both = enumerate(zip(self.objects, self.meshes, self._points, strict=True))
        return {place: each for place, (each, m, own) in both if len(moved(m.points, own))}

    def _cache(self, copies: Mapping[int, Any], folder: Path) -> None:
        """Give copies a mesh cache, which has the points to the last bit."""
        layer = self.worker.folder / self.told["cache"]
        with mesh_cache.kept(layer, folder) as kept:
            file = mesh_cache.opened(kept)
            for place, copy in copies.items():
                changed = (self.meshes[place].points != self._points[place]).any(axis=(1, 2))
                mesh_cache.apply(copy, self.frames, changed, file, self.told["prims"][place])
            for each, place in zip(sample(list(copies.values()), self.frames), copies, strict=True):
                if not np.array_equal(each.points, self._points[place]):
                    name = self.meshes[place].name
                    raise SceneError(f"{name}: Blender did not read its mesh cache {file.filepath}")


def _size(target: Any) -> tuple[int, int]:
    return len(target.data.vertices), len(target.data.polygons)
