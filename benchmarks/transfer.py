"""How long the transfer takes, and how good it is, from the horse to the camel.

    python benchmarks/transfer.py --data DIR [--repeats 3] [--no-large]

DIR holds `horse/`, `camel/` and `horse_camel.cons` (meshes of Sumner & Popovic 2004). The large
target is the camel with every triangle split into four, twice: 350,000 vertices.
"""

from __future__ import annotations

import argparse
import os
import platform
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.files.mesh_files import read_mesh
from dtrepair.numerics.geometry import diagonal
from dtrepair.numerics.operators import Factor, cotangent_laplacian
from dtrepair.transfer import (
    Transfer,
    check_markers,
    examine,
    match_triangles,
    read_markers,
    register,
)

Mesh = tuple[NDArray[np.float64], NDArray[np.int32]]
Poses = NDArray[np.float64]
Pairs = NDArray[np.int64]


def load(path: Path) -> Mesh:
    """Points (V, 3) and triangles (F, 3) of a mesh file of triangles."""
    mesh = read_mesh(path)
    return mesh.points, mesh.faces()


def split(mesh: Mesh) -> Mesh:
    """Every triangle split into four at the middles of its edges; triangle t gives t + k F."""
    points, faces = mesh
    edges = np.sort(np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]]), axis=1)
    unique, index = np.unique(edges, axis=0, return_inverse=True)
    ab, bc, ca = (len(points) + index.reshape(3, -1)).astype(np.int32)
    a, b, c = faces.T
    parts = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.concatenate([np.stack(part, axis=1) for part in parts])
    return np.concatenate([points, points[unique].mean(axis=1)]), finer


def best(function: Callable[[], Any], repeats: int) -> tuple[Any, float]:
    """Result of the last call and the shortest time in seconds."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        result = function()
        times.append(time.perf_counter() - start)
    return result, min(times)


def row(name: str, value: str, bar: str = "") -> None:
    """One line of a Markdown table."""
    print(f"| {name} | {value} | {bar} |", flush=True)


def animals(
    source: Mesh, target: Mesh, poses: Poses, rows: NDArray[np.int32], repeats: int
) -> Pairs:
    """Horse to camel: print the table, return the pairs (K, 2)."""
    checked, seconds = best(lambda: check_markers(*source, *target, rows), repeats)
    row(f"marker check, {len(rows)} markers", f"{seconds:.2f} s, {len(checked.suspects)} suspects")
    registered, first = best(lambda: register(*source, *target, rows), repeats)
    pairs, second = best(lambda: match_triangles(registered, source[1], *target), repeats)
    row("registration + matching", f"{first:.2f} + {second:.2f} s", "8 s")
    transfer, seconds = best(lambda: Transfer(*source, *target, pairs), repeats)
    row("set-up", f"{seconds:.2f} s")
    before = Factor.count
    found, seconds = best(lambda: transfer(poses), repeats)
    factors = Factor.count - before
    row("a frame", f"{1e3 * seconds / len(poses):.1f} ms, {factors} factorisations", "10 ms")
    report = examine(transfer, poses, found)
    unmatched = f"{report.coverage.unmatched} of {len(target[1])}"
    row("unmatched target triangles", unmatched, "0.5 %")
    row("residual, median / 95 %", f"{report.residual_median:.3f} / {report.residual_p95:.2f}")
    row("triangles turned, worst pose", f"{100 * report.flipped:.2f} %", "1 %")
    back = Transfer(*target, *source, pairs[:, ::-1])(found)
    off = 100 * np.linalg.norm(back - poses, axis=2) / diagonal(source[0])
    rms = np.sqrt((off**2).mean(axis=1)).max()
    row("round trip, rms / max", f"{rms:.2f} / {off.max():.1f} % of the diagonal", "1.6 / 6 %")
    return np.asarray(pairs)


def large_target(source: Mesh, target: Mesh, poses: Poses, pairs: Pairs) -> None:
    """The same transfer to a target of sixteen times as many triangles."""
    count = len(target[1])
    large = split(split(target))
    children = [pairs + np.array([0, k * count]) for k in range(16)]
    matrix = cotangent_laplacian(*large)[1:, 1:]
    _, seconds = best(lambda: Factor(matrix), 1)
    row(f"factor, {len(large[0])} vertices", f"{seconds:.1f} s", "10 s")
    transfer, seconds = best(lambda: Transfer(*source, *large, np.concatenate(children)), 1)
    row("set-up, factor included", f"{seconds:.1f} s")
    _, seconds = best(lambda: transfer(poses[:3]), 1)
    row("a frame", f"{1e3 * seconds / 3:.0f} ms")


def main() -> int:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of the meshes")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--no-large", action="store_true")
    options = parser.parse_args()
    source = load(options.data / "horse" / "horse_ref.obj")
    target = load(options.data / "camel" / "camel_ref.obj")
    files = sorted((options.data / "horse").glob("horse-*.obj"))
    poses = np.stack([load(path)[0] for path in files])
    rows = read_markers(
        options.data / "horse_camel.cons",
        source_count=len(source[0]),
        target_count=len(target[0]),
    )
    threads = os.environ.get("OMP_NUM_THREADS", "default")
    print(f"{platform.machine()}, {os.cpu_count()} cores, OMP_NUM_THREADS {threads}, ", end="")
    print(f"{len(source[0])} -> {len(target[0])} vertices, {len(poses)} poses\n")
    print("| what | measured | bar |\n|---|---|---|")
    pairs = animals(source, target, poses, rows, options.repeats)
    if not options.no_large:
        large_target(source, target, poses, pairs)
    return 0


if __name__ == "__main__":
    sys.exit(main())
