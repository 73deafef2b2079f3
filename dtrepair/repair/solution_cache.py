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
from functools import partial
from itertools import chain
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from numpy.typing import NDArray

from dtrepair.diagnosis import Diagnosis, Status
from dtrepair.numerics.geometry import FloatArray, IntArray
from dtrepair.numerics.work import add_work, counted
from dtrepair.repair.parallel.process_pool import in_batches, map_in_processes
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.result import Count, RepairResult, Stage
from dtrepair.repair.scene.bodies import Absent

if TYPE_CHECKING:
    # Single poses are remembered as well, and need no stages of clips.
    from dtrepair.repair.clip.window_method import MakeMethod, WindowSolver
    from dtrepair.repair.scene.welded_mesh import WeldedMesh

Arrays = Mapping[str, NDArray[Any]]
# Poses, and their results if they are known.
_Item = tuple[list[Any], list[RepairResult] | None]
# Finds the results of some poses, each of which holds the points of each body.
SolveBatch = Callable[[Sequence[Sequence[Any]]], list[list[RepairResult]]]


class Memory(Protocol):
    """Keeps arrays by a key; one memory serves one scene with one set of options only."""

    def recall(self, key: str) -> Arrays | None:
        """Return what was kept; None where there is nothing."""

    def keep(self, key: str, arrays: Arrays) -> None:
        """Keep arrays, if that is possible."""


def remembering(make_method: MakeMethod, memory: Memory) -> MakeMethod:
    """Return what makes solvers of windows that look them up first, and keep what they solve."""
    return lambda mesh: _remembering(make_method(mesh), mesh, memory)


def _remembering(solve: WindowSolver, mesh: WeldedMesh, memory: Memory) -> WindowSolver:
    def looked_up(
        original: FloatArray,
        frames: FloatArray,
        pool: WorkerPool,
        inputs: FloatArray | None = None,
        *,
        unless: Callable[[list[IntArray]], bool] | None = None,
    ) -> FloatArray | None:
        # A window may be solved in several ways: with props rigid, garments tied to what they wrap.
        way = np.frombuffer(mesh.way.encode(), dtype=np.uint8)
        lifted = [] if inputs is None else [inputs]
        key = hash_of(original, frames, mesh.surface.faces, way, *lifted)
        kept = memory.recall(key)
        if kept is not None and "work" in kept:
            found = original.copy()
            found[:, kept["vertices"]] = kept["points"]
            add_work(float(kept["work"]))
            return found
        solved, work = counted(partial(solve, original, frames, pool, inputs, unless=unless))
        if solved is not None:
            vertices = np.flatnonzero((solved != original).any(axis=(0, 2)))
            points = solved[:, vertices]
            memory.keep(key, {"vertices": vertices, "points": points, "work": np.array(work)})
        return solved

    return looked_up


def repair_each(
    solve: SolveBatch,
    poses: Iterable[Sequence[Any]],
    memory: Memory | None,
    *,
    jobs: int,
    at_once: int = 1,
) -> Iterator[list[RepairResult] | Exception]:
    """Yield the results of each pose (V, 3) of each body, looked up, or found by `solve` and kept.

    What a pose raises takes the place of its results. `at_once` poses make a batch, which `jobs`
    processes solve side by side.
    """
    recalled: deque[tuple[str, bool]] = deque()

    def items() -> Iterator[_Item]:
        for points in poses:
            absent = [isinstance(pose, Absent) for pose in points]
            arrays = [
                np.asarray(own.points if gone else own)
                for own, gone in zip(points, absent, strict=True)
            ]
            key = hash_of(*arrays, *[np.array(absent)] * any(absent)) if memory is not None else ""
            kept = memory.recall(key) if memory is not None else None
            recalled.append((key, kept is not None))
            yield [*points], None if kept is None else _results(kept)

    def solved(batch: list[_Item]) -> list[list[RepairResult] | Exception]:
        kept = [known for _, known in batch if known is not None]
        if len(kept) == len(batch):
            return [*kept]
        # Always the whole batch: products of another width round differently on a GPU.
        return _solved([arrays for arrays, _ in batch], solve)

    batches = in_batches(items(), at_once)
    for results in chain.from_iterable(map_in_processes(solved, batches, jobs=jobs)):
        key, known = recalled.popleft()
        if memory is not None and not known and not isinstance(results, Exception):
            memory.keep(key, _arrays(results))
        yield results


def _solved(poses: list[list[Any]], solve: SolveBatch) -> list[list[RepairResult] | Exception]:
    """Return the results of each pose, or what it raises; the others are solved without it."""
    if len(poses) > 1:
        try:
            return [*solve(poses)]
        except ValueError:
            pass  # of one of the poses
        except Exception as error:
            return [error] * len(poses)
    found: list[list[RepairResult] | Exception] = []
    for pose in poses:
        try:
            found.extend(solve([pose]))
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
    """Return a hash of shapes, types and bits of arrays."""
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
            "diagnosis": Diagnosis.from_document(fact["diagnosis"]),
            "stages": tuple(Stage(**stage) for stage in fact["stages"]),
        }
    )
