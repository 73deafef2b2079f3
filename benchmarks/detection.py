"""How fast is the detection of self-intersections, next to its peers and as meshes grow?

    python -m pip install -r benchmarks/requirements.txt
    python benchmarks/detection.py [--triangles 5000 14000 ...] [--repeats 7] [--mesh FILE]

All run in one process on one core, in turns; the best processor time of the repeats counts. The
mesh is a thick trefoil knot whose strands run into each other; the hierarchy of the detector is
built on the thin knot. Peers answer related questions, not the same: see benchmarks/README.md.
"""

from __future__ import annotations

import argparse
import os
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

Run = Callable[[], Any]
Points = NDArray[np.float64]
Faces = NDArray[np.int32]
SIZES = (5_000, 14_000, 27_000, 50_000, 100_000, 200_000)


def trefoil(triangles: int, thickness: float) -> tuple[Points, Faces]:
    """A closed tube of radius `thickness` about a trefoil knot, near `triangles` faces."""
    across = max(8, round((triangles / 16) ** 0.5))
    along = max(16, round(triangles / (2 * across)))
    t = 2 * np.pi * np.arange(along) / along

    def curve(t: Points) -> Points:
        return np.stack(
            [np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)], axis=1
        )

    step = 1e-5
    tangent = curve(t + step) - curve(t - step)
    bend = curve(t + step) + curve(t - step) - 2 * curve(t)
    binormal = np.cross(tangent, bend)
    binormal /= np.linalg.norm(binormal, axis=1, keepdims=True)
    normal = np.cross(binormal, tangent)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    angle = 2 * np.pi * np.arange(across) / across
    ring = np.cos(angle)[None, :, None] * normal[:, None]
    ring = ring + np.sin(angle)[None, :, None] * binormal[:, None]
    points = (curve(t)[:, None] + thickness * ring).reshape(-1, 3)
    i, j = np.meshgrid(np.arange(along), np.arange(across), indexing="ij")
    a, b, c, d = (
        (p % along * across + q % across).ravel()
        for p, q in ((i, j), (i + 1, j), (i + 1, j + 1), (i, j + 1))
    )
    faces = np.concatenate([np.stack([a, b, c], 1), np.stack([a, c, d], 1)])
    return points, faces.astype(np.int32)


def read_mesh(path: Path) -> tuple[Points, Faces]:
    """Points and fan-triangulated faces of a Wavefront file."""
    rows = [line.split() for line in path.read_text().splitlines()]
    points = [[float(x) for x in row[1:4]] for row in rows if row[:1] == ["v"]]
    polygons = [[int(x.split("/")[0]) - 1 for x in row[1:]] for row in rows if row[:1] == ["f"]]
    fans = [(p[0], p[k], p[k + 1]) for p in polygons for k in range(1, len(p) - 1)]
    return np.array(points), np.array(fans, dtype=np.int32)


def ours(rest: Points, points: Points, faces: Faces) -> dict[str, Run]:
    """The detector with its tree built once, without its exact stage, and with all set-up.

    Then also with triangles that have no area: one on an edge of every third triangle.
    """
    from dtrepair import Detector

    detector = Detector(rest, faces)
    pose = points.astype(np.float32)
    ends = faces[::3]
    own = len(points) + np.arange(len(ends))
    thin = np.concatenate([faces, np.stack([ends[:, 0], own, ends[:, 1]], axis=1)])
    weld = np.concatenate([np.arange(len(points)), ends[:, 0]])
    detector_of_thin = Detector(rest[weld], thin, weld=weld)
    pose_of_thin = pose[weld]
    return {
        "dtrepair": lambda: detector(pose),
        "dtrepair, a third more without area": lambda: detector_of_thin(pose_of_thin),
        "dtrepair, uncertain pairs kept": lambda: detector(pose, exact=False),
        "dtrepair, set-up only": lambda: Detector(rest, faces),
    }


def libigl(points: Points, faces: Faces) -> dict[str, Run]:
    """Exact predicates of CGAL, on boxes swept by CGAL."""
    from igl.copyleft.cgal import remesh_self_intersections

    wide = faces.astype(np.int64)
    return {"libigl + CGAL": lambda: remesh_self_intersections(points, wide, detect_only=True)[2]}


def meshlib(points: Points, faces: Faces) -> dict[str, Run]:
    """MeshLib's box tree and its own triangle test, with the tree kept or built anew."""
    from meshlib import mrmeshnumpy, mrmeshpy

    mesh = mrmeshnumpy.meshFromFacesVerts(faces, points)
    part = mrmeshpy.MeshPart(mesh)

    def kept() -> Any:
        return mrmeshpy.findSelfCollidingTriangles(part, touchIsIntersection=True)

    def built() -> Any:
        mesh.invalidateCaches()
        return kept()

    return {"MeshLib, tree kept": kept, "MeshLib, tree built": built}


def pymeshlab(points: Points, faces: Faces) -> dict[str, Run]:
    """MeshLab's selection of self-intersecting faces."""
    import pymeshlab

    meshes = pymeshlab.MeshSet()
    meshes.add_mesh(pymeshlab.Mesh(points, faces))

    def select() -> int:
        meshes.compute_selection_by_self_intersections_per_face()
        selected: int = meshes.current_mesh().selected_face_number()
        return selected

    return {"pymeshlab": select}


def ipctk(points: Points, faces: Faces) -> dict[str, Run]:
    """IPC Toolkit's candidates of edges against triangles: boxes only, no intersection test."""
    import ipctk

    edges = ipctk.edges(faces)

    def candidates() -> Any:
        tree = ipctk.LBVH()
        tree.build(points, edges, faces, 0.0)
        return tree.detect_edge_face_candidates()

    return {"ipctk LBVH, candidates only": candidates}


def contenders(rest: Points, points: Points, faces: Faces) -> dict[str, Run]:
    """All that can run here, by name; a peer that is not installed is named on standard error."""
    runs = ours(rest, points, faces)
    for peer in (libigl, meshlib, pymeshlab, ipctk):
        try:
            runs |= peer(points, faces)
        except ImportError as error:
            print(f"{peer.__name__} is left out: {error}", file=sys.stderr)
    return runs


def size_of(answer: Any) -> str:
    """How many pairs (or faces) an answer holds."""
    if isinstance(answer, int):
        return f"{answer} faces"
    if type(answer).__name__ == "Detector":
        return ""
    return f"{len(answer)}"


def measure(runs: dict[str, Run], repeats: int) -> dict[str, float]:
    """Best processor time of each run in milliseconds; the runs take turns."""
    best = dict.fromkeys(runs, float("inf"))
    for _ in range(repeats):
        for name, run in runs.items():
            start = time.process_time()
            run()
            best[name] = min(best[name], 1e3 * (time.process_time() - start))
    return best


def growth(sizes: list[int], times: list[float]) -> float:
    """Exponent p of the best fit time = c * size ** p."""
    return float(np.polyfit(np.log(sizes), np.log(times), 1)[0])


def print_table(sizes: list[int], columns: list[dict[str, float]], answers: dict[str, str]) -> None:
    """Milliseconds, ratio to ours at each size, and growth, as a Markdown table."""
    print("| ms (ratio to dtrepair) | " + " | ".join(map(str, sizes)) + " | growth | finds |")
    print("|---" * (len(sizes) + 3) + "|")
    for name in columns[0]:
        times = [column[name] for column in columns]
        cells = [
            f"{time:.1f} ({time / column['dtrepair']:.1f})"
            for time, column in zip(times, columns, strict=True)
        ]
        exponent = f"n^{growth(sizes, times):.2f}" if len(sizes) > 1 else ""
        print(f"| {name} | {' | '.join(cells)} | {exponent} | {answers[name]} |")


def main() -> None:
    """Measure and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--triangles", type=int, nargs="+", default=SIZES)
    parser.add_argument("--repeats", type=int, default=5)
    parser.add_argument("--mesh", type=Path, help="a Wavefront file in place of the knots")
    options = parser.parse_args()
    if hasattr(os, "sched_setaffinity"):  # one core for everybody, threads of the peers included
        os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
    if options.mesh:
        poses = [read_mesh(options.mesh)]
        rests = [poses[0][0]]
    else:
        poses = [trefoil(count, 0.75) for count in options.triangles]
        rests = [trefoil(count, 0.3)[0] for count in options.triangles]
    sizes, columns = [], []
    answers: dict[str, str] = {}
    for rest, (points, faces) in zip(rests, poses, strict=True):
        runs = contenders(rest, points, faces)
        # The last size tells what each contender finds; the first run of each also warms it up.
        answers = {name: size_of(run()) for name, run in runs.items()}
        columns.append(measure(runs, options.repeats))
        sizes.append(len(faces))
    print_table(sizes, columns, answers)


if __name__ == "__main__":
    main()
