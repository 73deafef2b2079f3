"""Solutions that were found before come back with the same bits, and nothing is solved twice."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from dtrepair import Body, RepairOptions, RepairResult, SceneRepairer
from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.work import add_work, work_done
from dtrepair.repair.clip.clip_repairer import ClipRepairer
from dtrepair.repair.clip.window_method import WindowSolver
from dtrepair.repair.parallel.worker_pool import WorkerPool
from dtrepair.repair.scene.welded_mesh import WeldedMesh, WeldedMeshes
from dtrepair.repair.solution_cache import hash_of, remembering, repair_each
from tests.meshes import bent_tube, overlapping_spheres, tube

LIMB = tube(24, 40, 0.2, 4.0)
REST, FACES = bent_tube(0.1, around=12, along=40, radius=0.08)
POSES = [bent_tube(angle, around=12, along=40, radius=0.08)[0] for angle in (6.4, 6.45, 6.5)]


class Kept(dict[str, Mapping[str, NDArray[Any]]]):
    """A memory that is a dictionary."""

    def recall(self, key: str) -> Mapping[str, NDArray[Any]] | None:
        return self.get(key)

    def keep(self, key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        self[key] = arrays


def refuses(poses: Sequence[Sequence[Any]]) -> list[list[RepairResult]]:
    raise AssertionError("nothing is left to solve")


def test_solved_windows_are_looked_up() -> None:
    frames = [(float(k), [pose]) for k, pose in enumerate(POSES)]
    memory, scene = Kept(), SceneRepairer([Body(REST, FACES)])
    plain = [frame.results[0].points for frame in scene.animator.stream(frames, jobs=1)]
    for kept in (0, 1):
        assert len(memory) == kept
        repairer = scene.make_animator(memory)
        found = [frame.results[0].points for frame in repairer.stream(frames, jobs=1)]
        assert len(memory) == 1
        assert all(np.array_equal(a, b) for a, b in zip(found, plain, strict=True))

    def refuses(*window: object, **options: object) -> NDArray[np.float64]:
        raise AssertionError("nothing is left to solve")

    make_method = remembering(lambda mesh: refuses, memory)
    known = ClipRepairer(scene.scene, scene.meshes, make_method=make_method)
    again = [frame.results[0].points for frame in known.stream(frames, jobs=1)]
    assert all(np.array_equal(a, b) for a, b in zip(again, plain, strict=True))
    moved = [(time, [poses[0] + 0.01]) for time, poses in frames]
    with pytest.raises(AssertionError, match="left to solve"):
        list(known.stream(moved, jobs=1))


def test_windows_are_solved_once_in_each_way() -> None:
    memory, solved = Kept(), list[str]()
    sleeve, moved = tube(24, 24, 0.23, 2.0), np.ones_like(LIMB[0])
    scene = SceneRepairer([Body(*LIMB, direction=moved), Body(*sleeve)]).scene
    meshes = WeldedMeshes(scene)
    ways = [
        meshes,
        meshes.undirected,
        meshes.dressed,
        *meshes.creased,
        meshes.with_inner_mobility(0.1),
        meshes.with_rigid([0]),
        meshes.with_rigid([1]),
        meshes.of_bodies((0, 1)).meshes,
    ]
    window, times = np.stack([scene.centred_rest] * 2), np.arange(2.0)

    def make_method(mesh: WeldedMesh) -> WindowSolver:
        def solve(original: FloatArray, *rest: object, **more: object) -> FloatArray:
            solved.append(mesh.way)
            return original

        return solve

    for _ in range(2):
        for way in ways:
            assert way is not None
            mesh = way([way.scene.rest_weld])
            remembering(make_method, memory)(mesh)(window, times, WorkerPool())
    assert len(solved) == len(set(solved)) == len(memory) == len(ways)


def test_what_is_looked_up_counts_as_much_work_as_solving_it() -> None:
    memory, solved, spent = Kept(), list[int](), list[float]()
    window, times = np.stack(POSES), np.arange(float(len(POSES)))

    def solve(original: FloatArray, *rest: object, **more: object) -> FloatArray:
        add_work(7.0)
        solved.append(len(original))
        return original

    scene = SceneRepairer([Body(REST, FACES)]).scene
    solver = remembering(lambda _: solve, memory)(WeldedMeshes(scene)([scene.rest_weld]))
    for _ in range(2):
        begun = work_done()
        solver(window, times, WorkerPool())
        spent.append(work_done() - begun)
    assert spent == [7.0, 7.0] and len(solved) == 1
    # What an older program kept tells none: it is solved again.
    for key, arrays in memory.items():
        memory[key] = {name: array for name, array in arrays.items() if name != "work"}
    solver(window, times, WorkerPool())
    assert len(solved) == 2


def test_windows_that_were_led_from_other_inputs_are_solved_for_themselves() -> None:
    memory, solved = Kept(), list[bool]()
    led, times = np.stack(POSES), np.arange(float(len(POSES)))

    def make_method(mesh: WeldedMesh) -> WindowSolver:
        def solve(original: FloatArray, *rest: object, **more: object) -> FloatArray:
            solved.append(rest[-1] is not None)
            return original

        return solve

    scene = SceneRepairer([Body(REST, FACES)]).scene
    mesh = WeldedMeshes(scene)([scene.rest_weld])
    solver = remembering(make_method, memory)(mesh)
    for inputs in (None, led + 0.1, None, led + 0.1, led + 0.2):
        solver(led, times, WorkerPool(), inputs)
    assert solved == [False, True, True]


def test_results_of_single_poses_come_back_whole() -> None:
    points, faces = overlapping_spheres()
    scene = SceneRepairer([Body(points, faces, rigid=True)], options=RepairOptions(tighten=0))
    memory = Kept()
    first = list(repair_each(scene.batch, [[points]], memory, jobs=1))
    (again,) = repair_each(refuses, [[points]], memory, jobs=1)
    assert isinstance(first[0], list) and isinstance(again, list)
    for one, other in zip(first[0], again, strict=True):
        assert np.array_equal(one.points, other.points)
        assert one.diagnosis == other.diagnosis and one.diagnosis.contacts
        assert one.message == other.message
        assert (one.before, one.after, one.status) == (other.before, other.after, other.status)
        assert one.stages == other.stages and one.seconds == other.seconds


def test_errors_are_not_kept() -> None:
    memory, broken = Kept(), POSES[0] * np.nan
    scene = SceneRepairer([Body(REST, FACES)])
    (found,) = repair_each(scene.batch, [[broken]], memory, jobs=1)
    assert isinstance(found, ValueError) and not memory


def test_a_hash_tells_shapes_types_and_bits_apart() -> None:
    array = np.arange(6.0)
    others = [array.reshape(2, 3), array.astype(np.float32), np.where(array == 0, -0.0, array)]
    hashes = {hash_of(array), *(hash_of(other) for other in others), hash_of(array, array)}
    assert len(hashes) == 5 and hash_of(array) == hash_of(array.copy())
