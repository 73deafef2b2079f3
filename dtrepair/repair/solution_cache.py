"""Solutions that were found before, so that an interrupted repair can go on from them.

Solving is by far the longest part of a repair, and its result depends on its input alone. So what
is remembered are solved windows of an animation, and single poses, by a hash of their input; a
repair that goes on does all the rest again, and ends with the same bits.
"""

from __future__ import annotations

import hashlib
import json
from collections import deque
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import asdict
from itertools import chain
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.repair.clip.animation import OVERLAP, WINDOW, AnimationRepairer
from dtrepair.repair.clip.window_method import ShotMethod
from dtrepair.repair.independent import in_batches
from dtrepair.repair.options import Count, RepairResult, Stage, Status
from dtrepair.repair.parallel.process_pool import forked_map
from dtrepair.repair.parallel.worker_pool import Crew

if TYPE_CHECKING:
    from dtrepair.repair.repairer import SceneRepairer
    from dtrepair.repair.scene.welded_mesh import System

Arrays = Mapping[str, NDArray[Any]]
# Poses, and their results if they are known.
_Item = tuple[list[NDArray[Any]], list[RepairResult] | None]


class Memory(Protocol):
    """Keeps arrays by a key; one memory serves one scene with one set of options only."""

    def recall(self, key: str) -> Arrays | None:
        """What was kept; None where there is nothing."""

    def keep(self, key: str, arrays: Arrays) -> None:
        """Keep arrays, if that is possible."""


class RememberingAnimator(AnimationRepairer):
    """An animation repairer that looks up solved windows, and keeps those it solves."""

    def __init__(
        self,
        scene: SceneRepairer,
        memory: Memory,
        *,
        window: int = WINDOW,
        overlap: int = OVERLAP,
    ) -> None:
        """Use `memory` for the windows of `scene`; ValueError for a bad window."""
        super().__init__(scene, window=window, overlap=overlap)
        self.memory = memory

    def method(self, system: System) -> ShotMethod:
        """The shot method of a system, with a memory."""
        return _RememberingShot(super().method(system), self.memory)


class _RememberingShot(ShotMethod):
    """A shot method that looks up windows first."""

    def __init__(self, method: ShotMethod, memory: Memory) -> None:
        self.__dict__.update(method.__dict__)
        self._method, self._memory = method, memory

    def __call__(
        self,
        original: FloatArray,
        frames: FloatArray,
        crew: Crew,
        *,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> FloatArray | None:
        """Repaired poses (T, V, 3) of poses at times in frame units; None if `unless` says so."""
        key = hash_of(original, frames, self.surface.faces, self.surface.rest)
        kept = self._memory.recall(key)
        if kept is not None:
            found = original.copy()
            found[:, kept["vertices"]] = kept["points"]
            return found
        solved = self._method(original, frames, crew, unless=unless)
        if solved is not None:
            vertices = np.flatnonzero((solved != original).any(axis=(0, 2)))
            self._memory.keep(key, {"vertices": vertices, "points": solved[:, vertices]})
        return solved


def repair_each(
    scene: SceneRepairer, poses: Iterable[Sequence[Any]], memory: Memory | None, *, jobs: int
) -> Iterator[list[RepairResult] | Exception]:
    """The results of each pose (V, 3) of each body, looked up, or found by `jobs` and kept.

    What a pose raises takes the place of its results.
    """
    recalled: deque[tuple[str, bool]] = deque()

    def items() -> Iterator[_Item]:
        for points in poses:
            arrays = [np.asarray(pose) for pose in points]
            key = hash_of(*arrays) if memory is not None else ""
            kept = memory.recall(key) if memory is not None else None
            recalled.append((key, kept is not None))
            yield arrays, None if kept is None else _results(kept)

    def solved(batch: list[_Item]) -> list[list[RepairResult] | Exception]:
        kept = [known for _, known in batch if known is not None]
        if len(kept) == len(batch):
            return [*kept]
        # Always the whole batch: products of another width round differently on a GPU.
        return _solved([arrays for arrays, _ in batch], scene)

    batches = in_batches(items(), scene.poses_at_once)
    for results in chain.from_iterable(forked_map(solved, batches, jobs=jobs)):
        key, known = recalled.popleft()
        if memory is not None and not known and not isinstance(results, Exception):
            memory.keep(key, _arrays(results))
        yield results


def _solved(
    poses: list[list[NDArray[Any]]], scene: SceneRepairer
) -> list[list[RepairResult] | Exception]:
    """The results of each pose, or what it raises: then the others are solved without it."""
    if len(poses) > 1:
        try:
            return [*scene.batch(poses)]
        except ValueError:
            pass  # of one of the poses
        except Exception as error:
            return [error] * len(poses)
    found: list[list[RepairResult] | Exception] = []
    for pose in poses:
        try:
            found.append(scene(pose))
        except Exception as error:
            found.append(error)
    return found


def _arrays(results: list[RepairResult]) -> dict[str, NDArray[Any]]:
    facts = [{**asdict(result), "points": None} for result in results]
    content = {f"points{k}": np.asarray(result.points) for k, result in enumerate(results)}
    return {**content, "facts": np.frombuffer(json.dumps(facts).encode(), dtype=np.uint8)}


def _results(kept: Arrays) -> list[RepairResult]:
    facts = json.loads(bytes(kept["facts"]).decode())
    return [_result(kept[f"points{k}"], fact) for k, fact in enumerate(facts)]


def hash_of(*arrays: NDArray[Any]) -> str:
    """A hash of shapes, types and bits of arrays."""
    digest = hashlib.sha256()
    for array in arrays:
        digest.update(f"{array.dtype.str}{array.shape}".encode())
        digest.update(np.ascontiguousarray(array).tobytes())
    return digest.hexdigest()[:32]


def _result(points: NDArray[Any], fact: dict[str, Any]) -> RepairResult:
    return RepairResult(
        **{
            **fact,
            "points": points,
            "before": Count(**fact["before"]),
            "after": Count(**fact["after"]),
            "status": Status(fact["status"]),
            "stages": tuple(Stage(**stage) for stage in fact["stages"]),
        }
    )
