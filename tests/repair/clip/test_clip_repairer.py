"""Animations are repaired clean, close to the input and steady, one factor for all frames."""

from __future__ import annotations

import itertools
from collections.abc import Generator, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import torch
from numpy.typing import NDArray
from scipy import sparse

from dtrepair import Body, Detector, Repairer, RepairOptions, SceneRepairer, Status
from dtrepair.files.mesh_files import read_mesh
from dtrepair.numerics.geometry import weld_map
from dtrepair.numerics.metrics import displacements, jitter
from dtrepair.numerics.operators import Factor
from dtrepair.repair.clip.clip_options import ClipOptions
from dtrepair.repair.clip.restore_shape import RelaxFramesOptions
from tests.meshes import icosphere, swept
from usd_io import open_stage, read_meshes, read_points

Swung = tuple[Repairer, NDArray[np.float64], NDArray[np.float64]]

Poses = NDArray[np.float64]


def pincers(opening: float) -> tuple[Poses, NDArray[np.int32]]:
    """A closed capsule bent to a U in the xz plane; its arms cross for an opening below 0."""
    t = np.linspace(-1.0, 1.0, 31)
    bend = np.clip(np.abs(t) / 0.4, 0.0, 1.0)
    angle = np.sign(t) * (0.5 * np.pi - opening) * bend
    steps = np.stack([np.cos(angle), np.full_like(t, 0.04), np.sin(angle)], axis=1)
    centre = np.cumsum(steps, axis=0) * (t[1] - t[0])
    centre -= centre[len(t) // 2]
    radius = 0.09 * np.ones(len(t))
    radius[[0, -1]] *= 0.7
    return swept(centre, radius, 8, closed=False)


def swing(frames: int = 30) -> tuple[Poses, NDArray[np.int32], Poses]:
    """Rest, faces and frames (T, V, 3) of pincers that swing through themselves and back."""
    rest, faces = pincers(0.4)
    closing = np.sin(np.pi * np.clip((np.arange(frames) - 8) / (frames - 16), 0.0, 1.0)) ** 2
    return rest, faces, np.stack([pincers(0.4 - 0.85 * part)[0] for part in closing])


def crossings(rest: Poses, faces: NDArray[np.int32], frames: Poses) -> list[int]:
    detector = Detector(rest, faces)
    return [len(detector(pose, weld=weld_map(pose))) for pose in frames]


def results_of(repairer: Repairer, frames: Poses, **options: Any) -> Poses:
    return np.stack([result.points for result in repairer.animation(frames, **options)])


def moved_frames(frames: Poses, repaired: Poses) -> list[int]:
    return np.flatnonzero((frames != repaired).any(axis=(1, 2))).tolist()


@pytest.fixture(scope="module")
def swung() -> tuple[Repairer, Poses, Poses]:
    """Repairer, frames and what it makes of them together."""
    rest, faces, frames = swing()
    repairer = Repairer(rest, faces)
    return repairer, frames, results_of(repairer, frames)


def test_every_frame_is_clean(swung: Swung) -> None:
    _, frames, repaired = swung
    rest, faces, _ = swing()
    assert sum(count > 0 for count in crossings(rest, faces, frames)) >= 5
    assert sum(crossings(rest, faces, repaired)) == 0


def test_steadier_and_hardly_farther_than_frames_alone(swung: Swung) -> None:
    repairer, frames, repaired = swung
    alone = np.stack([repairer(pose).points for pose in frames])
    assert jitter(frames, alone) > 0
    assert jitter(frames, repaired) < 0.25 * jitter(frames, alone)
    contact = [index for index in range(30) if repairer(frames[index]).before.pairs]
    together = np.mean([displacements(frames[i], repaired[i]).mean() for i in contact])
    apart = np.mean([displacements(frames[i], alone[i]).mean() for i in contact])
    assert together < 3.5 * apart


def test_result_accelerates_no_more_than_the_input(swung: Swung) -> None:
    _, frames, repaired = swung
    acceleration = [
        np.linalg.norm(np.diff(p, 2, axis=0), axis=2).mean() for p in (frames, repaired)
    ]
    assert acceleration[1] < 1.15 * acceleration[0]


def test_frames_beyond_the_reach_of_contacts_keep_every_bit(swung: Swung) -> None:
    _, frames, repaired = swung
    rest, faces, _ = swing()
    dirty = np.flatnonzero(crossings(rest, faces, frames))
    moved = moved_frames(frames, repaired)
    # The kernel ends at 3 sigma = 10.5 frames.
    assert dirty[0] - 10 <= moved[0] and moved[-1] <= dirty[-1] + 10
    assert len(moved) < len(frames)


def test_contacts_ease_in_and_out(swung: Swung) -> None:
    _, frames, repaired = swung
    size = [displacements(a, b).max() for a, b in zip(frames, repaired, strict=True)]
    assert np.abs(np.diff(size)).max() < 0.35 * max(size)
    assert size[0] == size[-1] == 0.0


def test_the_same_factors_for_all_frames_and_clips(monkeypatch: pytest.MonkeyPatch) -> None:
    """One of diffusion and one for each weight of agreement; small regions have their own."""
    rest, faces, frames = swing()
    sizes: list[int] = []
    made = Factor.__init__

    def counted(factor: Factor, matrix: sparse.spmatrix) -> None:
        made(factor, matrix)
        sizes.append(factor.size)

    monkeypatch.setattr(Factor, "__init__", counted)
    repairer = Repairer(rest, faces)
    repairer.animation(frames[8:22])
    weights = set(RelaxFramesOptions().agreement)
    assert sizes.count(len(rest)) <= 1 + len(weights)
    sizes.clear()
    repairer.animation(frames[10:20])
    assert sizes.count(len(rest)) == 0


def test_deterministic_whatever_the_number_of_threads(swung: Swung) -> None:
    repairer, frames, _ = swung
    rest, faces, _ = swing()
    found = [
        results_of(each, frames[10:20], jobs=jobs)
        for each, jobs in ((repairer, 1), (repairer, 2), (Repairer(rest, faces), 1))
    ]
    assert (found[0] != frames[10:20]).any()
    assert (found[1] == found[0]).all() and (found[2] == found[0]).all()


def test_cut_ends_a_run(swung: Swung) -> None:
    repairer, frames, _ = swung
    first, second = frames[10:15], frames[15:20, :, [1, 2, 0]] + 5.0
    both = results_of(repairer, np.concatenate([first, second]))
    assert (both[:5] == results_of(repairer, first)).all()
    assert (both[5:] == results_of(repairer, second)).all()


def test_windows_overlap_without_a_seam() -> None:
    rest, faces, frames = swing()
    inner = frames[9:22]  # open at both ends
    double = np.concatenate([inner[:-1], inner])
    sizes = ClipOptions(window=16, overlap=6)
    animator = SceneRepairer([Body(rest, faces)], clip=sizes).animator
    stamped = ((float(index), [pose]) for index, pose in enumerate(double))
    repaired = np.stack([frame.results[0].points for frame in animator.stream(stamped)])
    assert sum(crossings(rest, faces, repaired)) == 0
    whole = results_of(Repairer(rest, faces), double)
    assert jitter(double, repaired) < 1.5 * jitter(double, whole)


def test_stream_holds_one_window() -> None:
    rest, faces, frames = swing()
    taken: list[int] = []

    def endless() -> Iterator[tuple[float, list[Poses]]]:
        for index in itertools.count():
            taken.append(index)
            yield float(index), [frames[index % 6]]

    sizes = ClipOptions(window=16, overlap=4)
    stream = SceneRepairer([Body(rest, faces)], clip=sizes).animator.stream(endless())
    for index in range(100):
        assert next(stream).time == index
        assert len(taken) <= index + 17 + sizes.cuts.held  # holds are looked past
    assert isinstance(stream, Generator)
    stream.close()


def test_times_count_not_indices() -> None:
    rest, faces, frames = swing(45)
    fine = np.arange(45.0)
    kept = np.sort(np.concatenate([np.arange(6, 39, 2), np.arange(17, 28, 2)]))
    repairer = Repairer(rest, faces)
    uneven = results_of(repairer, frames[kept], times=fine[kept])
    assert sum(crossings(rest, faces, uneven)) == 0
    by_index = results_of(repairer, frames[kept])
    assert roughness(fine[kept], uneven - frames[kept]) < roughness(
        fine[kept], by_index - frames[kept]
    )


def roughness(times: Poses, field: Poses) -> float:
    """Root mean square change of velocity over uneven times."""
    velocity = np.diff(field, axis=0) / np.diff(times)[:, None, None]
    return float(np.sqrt((np.diff(velocity, axis=0) ** 2).mean()))


def test_limit_of_the_displacement_holds() -> None:
    rest, faces, frames = swing()
    options = RepairOptions(maximum_displacement=0.03)
    results = Repairer(rest, faces, options=options).animation(frames[9:21])
    moved = [
        np.linalg.norm(r.points - f, axis=1).max()
        for r, f in zip(results, frames[9:21], strict=True)
    ]
    assert 0.02 < max(moved) <= 0.03


def test_collider_keeps_every_bit() -> None:
    points, faces = icosphere(2)
    bodies = [Body(points, faces, mobility=0.0), Body(points, faces)]
    distances = 2.2 - 0.5 * np.sin(np.pi * np.arange(16) / 15) ** 2
    frames = [
        (float(i), [points, points + np.array([d, 0.01, 0.02])]) for i, d in enumerate(distances)
    ]
    for repaired, (_, given) in zip(
        SceneRepairer(bodies).animator.stream(frames), frames, strict=True
    ):
        assert (repaired.results[0].points == given[0]).all()
        assert all(result.status is Status.CLEAN for result in repaired.results)


def test_tensors_come_back_as_tensors() -> None:
    rest, faces, frames = swing()
    given = torch.as_tensor(frames[12:17], dtype=torch.float32)
    results = Repairer(rest, faces).animation(given)
    assert all(r.points.dtype == torch.float32 and r.after.pairs == 0 for r in results)


def test_published_method_repairs_frames_one_by_one() -> None:
    rest, faces, frames = swing()
    repairer = Repairer(rest, faces, options=RepairOptions(method="paper", iterations=4))
    together = results_of(repairer, frames[12:15])
    assert (together[1] == repairer(frames[13]).points).all()


def test_empty_clip() -> None:
    rest, faces, _ = swing()
    assert Repairer(rest, faces).animation(np.zeros((0, *rest.shape))) == []


def test_wrong_times_and_windows() -> None:
    rest, faces, frames = swing()
    repairer = Repairer(rest, faces)
    with pytest.raises(ValueError, match="one time for each of 3 frames"):
        repairer.animation(frames[:3], times=[1.0, 2.0])
    with pytest.raises(ValueError, match=r"increase, got 2\.0 after 2\.0"):
        repairer.animation(frames[:3], times=[1.0, 2.0, 2.0])
    with pytest.raises(ValueError, match=r"should have \d+ rows"):
        repairer.animation(frames[:2, :-1])
    with pytest.raises(ValueError, match="at least 2 x 12 frames, got 20"):
        ClipOptions(window=20)


def test_walk_stays_clean_and_steady(shared_data: Path) -> None:
    stage = open_stage(shared_data / "humans" / "walk_male.usdc")
    mesh = read_meshes(stage).meshes[0]
    frames = read_points(mesh, mesh.times[3:11]).astype(np.float64)
    rest = read_mesh(shared_data / "humans" / "human_male_rest.obj").points
    results = Repairer(rest, mesh.faces).animation(frames)
    assert all(result.status is Status.CLEAN for result in results)
    assert all(result.before.triangles > 200 for result in results)
    assert jitter(frames, np.stack([result.points for result in results])) < 2e-3


def test_a_hopeless_frame_does_not_spoil_the_others() -> None:
    rest, faces, frames = swing()
    spoiled = frames.copy()
    # Everything at one height: no smooth field takes this apart.
    spoiled[20, :, 1] *= 1e-3
    repairer = Repairer(rest, faces)
    results = repairer.animation(spoiled)
    assert all(result.status is Status.CLEAN for result in results[:19])
    counts = [result.after.pairs <= result.before.pairs for result in results]
    assert all(counts)


def test_a_window_of_frames_tells_how_far_it_is() -> None:
    rest, faces, frames = swing()
    animator = SceneRepairer([Body(rest, faces)]).animator
    told: list[float] = []
    poses = ((float(time), [pose]) for time, pose in enumerate(frames[10:20]))
    assert sum(1 for _ in animator.stream(poses, jobs=1, progress=told.append)) == 10
    assert len(told) > 3 and told == sorted(told)
    # What judges the solved frames and starts some of them again is still to come.
    assert 0.0 < told[0] and told[-1] < 10
