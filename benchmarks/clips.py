"""All clips of a body: what the repair leaves, counted by libigl and CGAL, how steady, how fast.

    python -m benchmarks.clips --data DIR [--clip NAME ...] [--jobs N] [--save DIR]

DIR holds humans/ with walk_male.usdc, human_male_rest.obj and human_01 ... 08; the other clips are
made by heavy_clip.py and dance.py. Prints Markdown. "not clean" are frames with intersecting
triangles that share no vertex, in the float32 coordinates handed back, found by libigl + CGAL
(`-` where they are not installed) and by dtrepair. Displacements and jitter (rms second difference
of the displacement) are relative to the bounding-box diagonal; acceleration is the mean second
difference of the result over that of the input; seconds are processor time of one worker.
`--save` writes each clip and its result as DIR/NAME.npz. Run it with OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import tempfile
import time
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from benchmarks.dance import Dancer, motion, write_skeleton
from benchmarks.heavy_clip import make_clip
from dtrepair import Repairer
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import weld_map
from dtrepair.numerics.metrics import displacements, jitter
from usd_io import open_stage, read_meshes, read_points

Floats = NDArray[np.float64]

# Options of dance.py; "skinned" is read back from a skeleton and weights.
DANCES: dict[str, dict[str, Any]] = {
    "cross": {},
    "kick": {"clip": "kick"},
    "hug": {"clip": "hug"},
    "cross deep": {"depth": 1.3},
    "kick deep": {"clip": "kick", "depth": 1.3},
    "hug deep": {"clip": "hug", "depth": 1.3},
    "cross fast": {"speed": 2.0},
    "cross sparse": {"samples": "sparse"},
    "hug cut": {"clip": "hug", "samples": "cut"},
    "kick skinned": {"clip": "kick", "skinned": True},
}
CLIPS = ("walk", "arms", "knees", *DANCES)


class Clip(NamedTuple):
    """Time codes (T,), rest (V, 3), faces (F, 3) and poses (T, V, 3)."""

    times: Floats
    rest: Floats
    faces: NDArray[np.int32]
    poses: Floats


def clip_of(data: Path, name: str) -> Clip:
    """A clip of CLIPS."""
    humans = data / "humans"
    if name == "walk":
        return _read(humans / "walk_male.usdc", humans)
    if name in ("arms", "knees"):
        rest, faces, poses = make_clip(humans, name, 64)
        return Clip(np.arange(1.0, 65.0), rest, faces, _written(poses))
    options = {"clip": "cross", "speed": 1.0, "depth": 1.0, "samples": "even", **DANCES[name]}
    skinned = options.pop("skinned", False)
    mesh = read_mesh(humans / "human_male_rest.obj")
    dancer = Dancer(mesh.points, mesh.faces())
    codes, moved = motion(dancer, options.pop("clip"), 48, **options)
    if skinned:
        with tempfile.TemporaryDirectory() as folder:
            file = Path(folder) / "skinned.usdc"
            write_skeleton(file, dancer, mesh.faces(), codes, moved)
            return _read(file, humans)
    poses = np.stack([dancer.pose(transforms) for transforms in moved])
    return Clip(codes, mesh.points, mesh.faces(), _written(poses))


def _read(file: Path, humans: Path) -> Clip:
    mesh = read_meshes(open_stage(file).stage).meshes[0]
    poses = np.asarray(read_points(mesh, mesh.times), dtype=np.float64)
    rest = read_mesh(humans / "human_male_rest.obj").points
    return Clip(np.asarray(mesh.times, dtype=np.float64), rest, mesh.faces, poses)


def _written(poses: Floats) -> Floats:
    """What a file in single precision holds."""
    return poses.astype(np.float32).astype(np.float64)


def left_by_cgal(points: Floats, faces: NDArray[np.int32], weld: NDArray[np.int32]) -> int:
    """Intersecting pairs that share no vertex, by libigl and the exact predicates of CGAL."""
    from igl.copyleft.cgal import remesh_self_intersections

    wide = faces.astype(np.int64)
    pairs = remesh_self_intersections(points.astype(np.float32), wide, detect_only=True)[2]
    corners = weld[faces][pairs]
    shared = (corners[:, 0, :, None] == corners[:, 1, None, :]).any(axis=(1, 2))
    return int((~shared).sum())


def print_row(name: str, clip: Clip, found: Floats, seconds: float, before: int) -> None:
    """Measure a repaired clip."""
    poses, faces = clip.poses, clip.faces
    weld = weld_map(poses[0])
    detector = Detector(poses[0], faces, weld=weld)
    dirty = sum(len(detector(pose)) > 0 for pose in found)
    try:
        counted = str(sum(left_by_cgal(pose, faces, weld) > 0 for pose in found))
    except ImportError:
        counted = "-"
    moved = np.array([displacements(a, b) for a, b in zip(poses, found, strict=True)])
    second = [np.linalg.norm(np.diff(p, 2, axis=0), axis=2).mean() for p in (found, poses)]
    print(
        f"| {name} | {len(poses)} | {before} | {counted} / {dirty} "
        f"| {1e3 * jitter(poses, found):.2f} | {moved.mean():.4f} / {moved.max():.4f} "
        f"| {second[0] / second[1]:.2f} | {seconds / len(poses):.2f} |",
        flush=True,
    )


def main() -> None:
    """Repair the clips and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--clip", nargs="+", choices=CLIPS, default=CLIPS)
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--save", type=Path)
    asked = parser.parse_args()
    if asked.save:
        asked.save.mkdir(parents=True, exist_ok=True)
    print("| clip | frames | triangles before | not clean | jitter, 1e-3 | mean / max "
          "| acceleration | s a frame |")  # fmt: skip
    print("|---|---|---|---|---|---|---|---|")
    for name in asked.clip:
        clip = clip_of(asked.data, name)
        repairer = Repairer(clip.rest, clip.faces)
        start = time.process_time()
        results = repairer.animation(clip.poses, times=clip.times, jobs=asked.jobs)
        seconds = time.process_time() - start
        found = np.array([result.points for result in results])
        if asked.save:
            np.savez(asked.save / f"{name}.npz", **clip._asdict(), found=found)
        before = sum(result.before.triangles for result in results)
        print_row(name, clip, found, seconds, before)


if __name__ == "__main__":
    main()
