"""Check and repair as jobs: begun, looked at from time to time, finished or cancelled.

Nothing in the scene changes before a job has its result.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from ..host.exchange import Request, SampledMesh, read_pairs, read_points
from ..host.process import Worker
from .marks import Contact, contacts
from .sampling import SceneError, sample
from .shape_keys import Applied, apply, needs_keys


class Job:
    """A request in work for objects of the scene.

    Args:
        command: "check" or "repair".
        python: the interpreter of the worker.
        objects: what takes part.
        frames: which frames.
        settings: as `Request` has them.

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
    ) -> None:
        self.objects = [each for each in objects if each.type == "MESH"]
        if not self.objects:
            raise SceneError("no mesh is selected; select what should take part")
        self.frames = tuple(frames)
        self.meshes: list[SampledMesh] = sample(self.objects, self.frames)
        request = Request(command, self.frames, tuple(self.meshes), settings)
        self.worker = Worker(python, request)

    def cancel(self) -> None:
        """End the worker; the scene is as it was."""
        self.worker.close()

    def found(self, told: Mapping[str, Any]) -> tuple[list[Any], list[Contact]]:
        """Return the pairs (K, 4) of each frame, and the contacts, of a finished check."""
        pairs = read_pairs(self.worker.folder / told["result"], len(self.frames))
        return pairs, contacts(self.meshes, self.frames, pairs)

    def apply(self, told: Mapping[str, Any]) -> list[Applied]:
        """Put the result of a finished repair into the scene."""
        points = read_points(self.worker.folder / told["result"], self.meshes)
        return [
            apply(each, self.frames, mesh, own)
            for each, mesh, own in zip(self.objects, self.meshes, points, strict=True)
            if needs_keys(mesh, own)
        ]
