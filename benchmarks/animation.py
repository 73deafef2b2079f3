"""A clip repaired together and frame by frame: what is left, how steady, how fast.

    python benchmarks/animation.py CLIP.usdc REST.obj [--jobs 1 2] [--alone] [--stages]

CLIP holds one animated mesh, REST its rest pose. Prints Markdown. Counts are exact, of the float32
coordinates handed back; displacements and jitter (rms second difference of the displacement) are
relative to the bounding-box diagonal; acceleration is the mean second difference of the result over
that of the input. `--stages` prints where the processor time of one worker goes, with reading and
writing the stage, under a profiler. Run it with OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import cProfile
import pstats
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair import Repairer
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.geometry import weld_map
from dtrepair.numerics.metrics import displacements, jitter
from usd_io import OverrideWriter, open_stage, read_meshes, read_points


def print_row(
    name: str,
    points: NDArray[np.float64],
    found: NDArray[np.float64],
    faces: NDArray[np.int32],
    seconds: float,
) -> None:
    """Measure one way of repairing the clip (T, V, 3)."""
    detector = Detector(points[0], faces, weld=weld_map(points[0]))
    dirty = sum(len(detector(pose)) > 0 for pose in found)
    moved = np.array([displacements(a, b) for a, b in zip(points, found, strict=True)])
    second = [np.linalg.norm(np.diff(clip, 2, axis=0), axis=2).mean() for clip in (found, points)]
    still = int((found == points).all(axis=(1, 2)).sum())
    print(
        f"| {name} | {dirty} | {jitter(points, found):.2e} "
        f"| {moved.mean():.4f} / {moved.max():.4f} "
        f"| {second[0] / second[1]:.2f} | {still} | {seconds / len(points):.2f} |",
        flush=True,
    )


# What is counted as what, by file and function; none of them calls another.
PARTS = {
    "detection": [("detector.py", "__call__")],
    "buried vertices": [("winding.py", "winding_numbers")],
    "ring distances": [("ring_distances.py", "__call__")],
    "diffusion solves": [("surface.py", "diffuse")],
    "softening of creases": [("adaptive_fairing.py", n) for n in ("__call__", "settle", "update")],
    "smoothing in time": [("temporal.py", "undamped")],
    "USD": [("reader.py", "read_points"), ("writer.py", "write"), ("writer.py", "commit")],
}
# The stages of a clip; each holds parts of the above.
PHASES = [
    ("push_frames.py", "push_frames"),
    ("mend_frames.py", "mend_frames"),
    ("mend_frames.py", "lend_frames"),
    ("tighten_frames.py", "tighten_frames"),
    ("tighten_frames.py", "settle_frames"),
    ("restore_shape.py", "relax_frames"),
    ("steady_frames.py", "steady_frames"),
    ("restore_shape.py", "cure_frames"),
]


def print_stages(clip: Path, rest_file: Path) -> None:
    """Profile reading, repairing by one worker and writing a clip; processor seconds by part."""
    rest = read_mesh(rest_file).points
    profile = cProfile.Profile(time.process_time)
    with tempfile.TemporaryDirectory() as folder:
        profile.enable()
        stage = open_stage(clip)
        mesh = read_meshes(stage.stage).meshes[0]
        points = read_points(mesh, mesh.times)
        results = Repairer(rest, mesh.faces).animation(points, times=mesh.times, jobs=1)
        writer = OverrideWriter(stage, str(Path(folder) / "out.usdc"), settings={}, version="0")
        for moment, result in zip(mesh.times, results, strict=True):
            writer.write(mesh, float(moment), result.points.astype(np.float32))
        writer.commit(record={})
        profile.disable()
    stats: Any = pstats.Stats(profile)
    calls = {(Path(file).name, name): row[3] for (file, _, name), row in stats.stats.items()}
    total, named = stats.total_tt, 0.0
    print("| part | s | part of all |")
    print("|---|---|---|")
    for part, functions in PARTS.items():
        seconds = sum(calls.get(function, 0.0) for function in functions)
        named += seconds
        print(f"| {part} | {seconds:.2f} | {seconds / total:.0%} |")
    print(f"| all else | {total - named:.2f} | {1 - named / total:.0%} |")
    for file, name in PHASES:
        seconds = calls.get((file, name), 0.0)
        print(f"| of it in {name} | {seconds:.2f} | {seconds / total:.0%} |")
    print(f"| all | {total:.2f} | {total / len(points):.3f} s a frame |", flush=True)


def main() -> None:
    """Repair the clip in each way and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("rest", type=Path)
    parser.add_argument("--jobs", type=int, nargs="*", default=[1])
    parser.add_argument("--alone", action="store_true", help="each frame for itself as well")
    parser.add_argument("--stages", action="store_true", help="where the time goes, instead")
    arguments = parser.parse_args()
    if arguments.stages:
        print_stages(arguments.clip, arguments.rest)
        return
    stage = open_stage(arguments.clip)
    mesh = read_meshes(stage.stage).meshes[0]
    points = np.asarray(read_points(mesh, mesh.times), dtype=np.float64)
    rest = read_mesh(arguments.rest).points
    print("| frames | not clean | jitter | mean / max | acceleration | untouched | s a frame |")
    print("|---|---|---|---|---|---|---|")
    for jobs in arguments.jobs:
        repairer = Repairer(rest, mesh.faces)
        start = time.perf_counter()
        results = repairer.animation(points, times=mesh.times, jobs=jobs)
        seconds = time.perf_counter() - start
        found = np.array([result.points for result in results])
        print_row(f"together, {jobs} workers", points, found, mesh.faces, seconds)
    if arguments.alone:
        repairer = Repairer(rest, mesh.faces)
        start = time.perf_counter()
        found = np.array([repairer(pose).points for pose in points])
        print_row("each alone", points, found, mesh.faces, time.perf_counter() - start)


if __name__ == "__main__":
    main()
