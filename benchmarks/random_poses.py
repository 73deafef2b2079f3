"""Fresh poses of a body, drawn at random: what the default method leaves, and what it moves.

    OMP_NUM_THREADS=1 python -m benchmarks.random_poses REST.obj [--poses N] [--seed S]

REST.obj is the standing body of `benchmarks.dance`, whose joints turn by random angles: arms across
the chest and through it, thighs through each other, a bent back. Poses that do not intersect are
left out. Nothing was tuned on them; another seed gives others. Prints Markdown: a pose a line, then
what is asked of all. Far vertices are those at least 0.15 of the diagonal from what intersects,
along the surface; seconds are processor time of the repair, set-up left out.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

from benchmarks.dance import Dancer
from benchmarks.stills import fold_count
from dtrepair import Repairer
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import find_intersections
from dtrepair.numerics.geometry import diagonal, lengths, unique_edges
from dtrepair.numerics.metrics import edge_log_ratio, volume

Floats = NDArray[np.float64]

# Mean and standard deviation of the angles of the left side about X, Y, Z, in degrees.
TURNS = {
    "chest": ((12, 0, 0), (12, 15, 4)),
    "head": ((5, 0, 0), (10, 15, 5)),
    "left_arm": ((8, -30, -45), (12, 20, 20)),
    "left_forearm": ((0, -55, 0), (8, 25, 8)),
    "left_thigh": ((-25, 0, -12), (30, 6, 12)),
    "left_shin": ((25, 0, 0), (20, 0, 0)),
}
FAR = 0.15
COLUMNS = (
    "pose", "before", "left", "folds", "mean / max", "edges", "far and still", "volume", "s",
)  # fmt: skip


def random_poses(dancer: Dancer, seed: int, spread: float = 1.0) -> Iterator[Floats]:
    """Yield poses (V, 3) whose joints turn by normally distributed angles.

    spread: factor of their standard deviations.
    """
    random = np.random.default_rng(seed)
    while True:
        turns = {name: np.zeros(3) for name in dancer.joints}
        for name, (centre, usual) in TURNS.items():
            wide = np.multiply(spread, usual)
            turns[name] = random.normal(centre, wide)
            if name.startswith("left"):
                other = random.normal(centre, wide)
                # What turns about Y or Z is mirrored.
                turns[name.replace("left", "right")] = other * (1.0, -1.0, -1.0)
        yield dancer.pose(dancer.transforms(turns))


def far_from(points: Floats, faces: NDArray[np.int32], triangles: NDArray[np.integer]) -> Floats:
    """Return the distance (V,) of vertices from triangles along edges."""
    edges = unique_edges(faces)
    length = lengths(points[edges[:, 0]] - points[edges[:, 1]])
    graph = sparse.coo_matrix((length, edges.T), shape=(len(points), len(points)))
    sources = np.unique(faces[triangles])
    distance: Floats = csgraph.dijkstra(graph, directed=False, indices=sources, min_only=True)
    return distance


def measure(repairer: Repairer, pose: Floats, faces: NDArray[np.int32]) -> list[float]:
    """Repair a pose (V, 3); return the numbers of a line."""
    points = pose.astype(np.float32).astype(np.float64)
    before = find_intersections(points, faces)
    start = time.process_time()
    result = repairer(points)
    seconds = time.process_time() - start
    after = np.asarray(result.points, dtype=np.float64)
    size = diagonal(points)
    moved = lengths(after - points) / size
    far = far_from(points, faces, before) >= FAR * size
    return [
        len(np.unique(before)),
        len(np.unique(find_intersections(after, faces))),
        fold_count(after, faces),
        moved.mean(),
        moved.max(),
        edge_log_ratio(points, after, unique_edges(faces)),
        (moved[far] == 0.0).mean() if far.any() else 1.0,
        volume(after, faces) / volume(points, faces),
        seconds,
    ]


def line(name: str, row: list[float]) -> str:
    """Return a line of the table."""
    before, left, folds, mean, most, edges, still, kept, seconds = row
    cells = [name, f"{before:.0f}", f"{left:.0f}", f"{folds:.0f}", f"{mean:.4f} / {most:.4f}"]
    cells += [f"{edges:.4f}", f"{100 * still:.0f} %", f"{kept:.3f}", f"{seconds:.2f}"]
    return f"| {' | '.join(cells)} |"


def main() -> int:
    """Print the table; 1 if anything is left."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("rest", type=Path)
    parser.add_argument("--poses", type=int, default=12)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--spread", type=float, default=1.0, help="1.6: limbs through the body")
    given = parser.parse_args()
    mesh = read_mesh(given.rest)
    faces = mesh.faces()
    repairer = Repairer(mesh.points, faces)
    rows: list[list[float]] = []
    print(f"| {' | '.join(COLUMNS)} |\n|{' --- |' * len(COLUMNS)}", flush=True)
    poses = random_poses(Dancer(mesh.points, faces), given.seed, given.spread)
    for number, pose in enumerate(poses, start=1):
        if len(find_intersections(pose.astype(np.float32), faces)) == 0:
            continue
        rows.append(measure(repairer, pose, faces))
        print(line(str(number), rows[-1]), flush=True)
        if len(rows) == given.poses:
            break
    every = np.array(rows)
    means = every.mean(axis=0)
    means[[1, 2, 4]], means[7] = every[:, [1, 2, 4]].max(axis=0), every[:, 7].min()
    print(line("all: means, most left, folds and motion, least volume", means.tolist()))
    return int(every[:, 1].any())


if __name__ == "__main__":
    raise SystemExit(main())
