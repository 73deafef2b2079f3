"""The default method on single meshes: what is left, how far from the input, how long.

    python benchmarks/stills.py --data DIR [--no-rest] [--variant NAME] [--sheet FILE.png]
        [--split N] [--only CLASS ...]

DIR holds misc/*.obj, humans/human_0*.obj with human_male_rest.obj, transfer/horse/horse-*.obj with
horse_ref.obj, transfer/camel/camel_ref.obj and animals/*.obj. Prints Markdown: class means, then
single meshes. Intersections and folds are counted on the float32 coordinates of the result;
displacements are relative to the bounding-box diagonal; seconds are processor time of the repair,
tightening included, set-up (tree, operators, factors) not. Run it with OMP_NUM_THREADS=1.

--split N divides every triangle into four, N times, without changing the surface.

--variant measures one idea beside the default:
    rest-shape  creases filled towards the rest pose's differential coordinates, not towards zero
    no-volume, no-fill, no-unbend, no-tighten  a stage left out
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import linalg

from dtrepair import Repairer, RepairOptions
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector, find_intersections
from dtrepair.intersect.queries import Queries
from dtrepair.numerics.geometry import extent, shared_edges, triangle_normals, unique_edges
from dtrepair.numerics.metrics import edge_log_ratio, volume
from dtrepair.numerics.operators import REGULARIZATION
from dtrepair.repair.full import biharmonic_fill as crease

# Jang et al. 2025, table 1: triangles left after 60 iterations of the published method.
PUBLISHED = {"misc": "32.2", "humans": "243.3", "animals": "64.8", "horses": ""}
VARIANTS = ("default", "rest-shape", "no-volume", "no-fill", "no-unbend", "no-tighten")


@dataclass(frozen=True)
class Row:
    """One mesh, repaired."""

    name: str
    before: int
    after: int
    folds: tuple[int, int]
    bent: tuple[int, int]
    mean: float
    largest: float
    edges: float
    volume: float
    seconds: float


def classes(data: Path, use_rest: bool) -> dict[str, list[tuple[Path, Path | None]]]:
    """Meshes of each class with their rest mesh."""
    horse, camel = (data / f"transfer/{name}/{name}_ref.obj" for name in ("horse", "camel"))

    def found(pattern: str, rest: Path | None) -> list[tuple[Path, Path | None]]:
        return [(path, rest if use_rest else None) for path in sorted(data.glob(pattern))]

    return {
        "misc": found("misc/*.obj", None),
        "humans": found("humans/human_0*.obj", data / "humans/human_male_rest.obj"),
        "horses": found("transfer/horse/horse-0[1-8].obj", horse),
        "animals": found("animals/horse*.obj", horse) + found("animals/camel*.obj", camel),
    }


def split(
    poses: list[NDArray[np.float64]], faces: NDArray[np.int32]
) -> tuple[list[NDArray[np.float64]], NDArray[np.int32]]:
    """Poses (V, 3) and faces with every triangle divided into four at the middles of its edges."""
    ends = np.sort(faces[:, [[0, 1], [1, 2], [2, 0]]].reshape(-1, 2), axis=1)
    edges, middle = np.unique(ends, axis=0, return_inverse=True)
    a, b, c = faces.T
    ab, bc, ca = middle.reshape(-1, 3).T + len(poses[0])
    corners = [(a, ab, ca), (ab, b, bc), (ca, bc, c), (ab, bc, ca)]
    finer = np.concatenate([np.stack(own, axis=1) for own in corners]).astype(np.int32)
    return [np.concatenate([own, own[edges].mean(axis=1)]) for own in poses], finer


def measure(path: Path, rest: Path | None, options: RepairOptions, splits: int = 0) -> Row:
    """Repair one mesh and measure the result."""
    mesh = read_mesh(path)
    faces, shape = mesh.faces(), mesh.points if rest is None else read_mesh(rest).points
    poses = [mesh.points.astype(np.float64), shape.astype(np.float64)]
    for _ in range(splits):
        poses, faces = split(poses, faces)
    before, shape = poses
    repairer = Repairer(shape, faces, options=options)
    nudged = before + 1e-3 * np.random.default_rng(0).normal(size=before.shape)
    repairer(nudged.astype(np.float32))  # builds everything that is built once
    start = time.process_time()
    result = repairer(before)
    seconds = time.process_time() - start
    points = np.asarray(result.points, dtype=np.float64)
    return Row(
        path.stem,
        result.before.triangles,
        len(np.unique(find_intersections(points, faces))),
        (fold_count(before, faces), fold_count(points, faces)),
        (bent_count(before, faces), bent_count(points, faces)),
        result.displacement_mean,
        result.displacement_max,
        edge_log_ratio(before, points, unique_edges(faces)),
        volume(points, faces) / volume(before, faces),
        seconds,
    )


def fold_count(points: NDArray[np.float64], faces: NDArray[np.int32]) -> int:
    """Pairs of triangles that share one vertex and cross beyond it."""
    return len(Queries(Detector(points, faces)).folds(points.astype(np.float32)))


def bent_count(points: NDArray[np.float64], faces: NDArray[np.int32]) -> int:
    """Edges whose triangles' normals are more than 120 degrees apart."""
    normals = triangle_normals(points, faces)
    first, second = shared_edges(faces).T
    return int((np.einsum("ij,ij->i", normals[first], normals[second]) < -0.5).sum())


def rest_shape_fill(rest: NDArray[np.float64]) -> Callable[..., NDArray[np.float64]]:
    """A fill whose patches keep the turned differential coordinates of the rest pose."""

    def fill(
        laplacian: sparse.csr_matrix,
        field: NDArray[np.float64],
        mask: NDArray[np.bool_],
        *_: object,
    ) -> NDArray[np.float64]:
        inner = np.flatnonzero(mask)
        rows = np.flatnonzero(abs(laplacian) @ mask)
        around = np.setdiff1d(rows, inner)
        if len(around) < 3:
            return default_fill(laplacian, field, mask)
        turn = best_rotation(rest[around], field[around])
        system = laplacian[rows][:, inner]
        known = laplacian[rows] @ np.where(mask[:, None], 0.0, field)
        wanted = (laplacian @ rest)[rows] @ turn.T
        normal = (system.T @ system + REGULARIZATION * sparse.identity(len(inner))).tocsc()
        result = field.copy()
        result[inner] = linalg.splu(normal).solve(system.T @ (wanted - known))
        return result

    default_fill = crease.bilaplacian_fill
    return fill


def best_rotation(source: NDArray[np.float64], target: NDArray[np.float64]) -> NDArray[np.float64]:
    """Rotation (3, 3) that turns centred points (N, 3) best onto others (Kabsch 1976)."""
    u, _, v = np.linalg.svd((target - target.mean(axis=0)).T @ (source - source.mean(axis=0)))
    rotation: NDArray[np.float64] = u @ np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ v))]) @ v
    return rotation


def options_of(variant: str) -> RepairOptions:
    """Options of a variant."""
    if variant == "no-tighten":
        return RepairOptions(tighten=0)
    if variant in ("no-volume", "no-fill", "no-unbend"):
        return RepairOptions(skip=(variant.removeprefix("no-"),))
    return RepairOptions()


def sheet(data: Path, target: Path, use_rest: bool) -> None:
    """One picture of all meshes, before and after."""
    from dtrepair.display.render import best_view, render, save_pictures

    images, captions = [], []
    for meshes in classes(data, use_rest).values():
        for path, rest in meshes:
            mesh = read_mesh(path)
            faces = mesh.faces()
            shape = mesh.points if rest is None else read_mesh(rest).points
            after = Repairer(shape, faces)(mesh.points).points
            marks = [hit(points, faces) for points in (mesh.points, after)]
            view = best_view(mesh.points, faces, marks[0])
            for points, mark in zip((mesh.points, after), marks, strict=True):
                images.append(render(points, faces, view=view, intersecting=mark, size=300))
                captions.append(f"{path.stem}: {int(mark.sum())}")
    save_pictures(target, images, captions=captions, columns=8)


def hit(points: NDArray[np.float64], faces: NDArray[np.int32]) -> NDArray[np.bool_]:
    """Mask (F,) of the triangles that intersect."""
    mask = np.zeros(len(faces), dtype=bool)
    mask[find_intersections(points, faces).ravel()] = True
    return mask


def print_tables(rows: dict[str, list[Row]]) -> None:
    """Class means, then every mesh."""
    print("| class | meshes | before | left | published | mean / max displacement | edges | s |")
    print("|---|---|---|---|---|---|---|---|")
    for name, found in rows.items():
        print(
            f"| {name} | {len(found)} | {mean(r.before for r in found):.1f} "
            f"| {mean(r.after for r in found):.1f} | {PUBLISHED[name]} "
            f"| {mean(r.mean for r in found):.4f} / {mean(r.largest for r in found):.4f} "
            f"| {mean(r.edges for r in found):.4f} | {mean(r.seconds for r in found):.2f} |"
        )
    print(
        "\n| mesh | before | left | folds | bent edges | mean / max displacement | edges | volume "
        "| s |"
    )
    print("|---|---|---|---|---|---|---|---|---|")
    for row in (row for found in rows.values() for row in found):
        print(
            f"| {row.name} | {row.before} | {row.after} | {row.folds[0]} -> {row.folds[1]} "
            f"| {row.bent[0]} -> {row.bent[1]} "
            f"| {row.mean:.4f} / {row.largest:.4f} | {row.edges:.4f} | {row.volume:.3f} "
            f"| {row.seconds:.2f} |"
        )


def main() -> None:
    """Measure and print, or draw the sheet."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True)
    parser.add_argument("--no-rest", action="store_true", help="every mesh is its own rest pose")
    parser.add_argument("--variant", choices=VARIANTS, default="default")
    parser.add_argument("--split", type=int, default=0, help="times that triangles are divided")
    parser.add_argument("--only", nargs="+", choices=PUBLISHED, default=[*PUBLISHED])
    parser.add_argument("--sheet", type=Path, help="draw all meshes before and after")
    arguments = parser.parse_args()
    if arguments.sheet:
        sheet(arguments.data, arguments.sheet, not arguments.no_rest)
        return
    rows: dict[str, list[Row]] = {}
    default_fill = crease.bilaplacian_fill
    for name, meshes in classes(arguments.data, not arguments.no_rest).items():
        for path, rest in meshes if name in arguments.only else ():
            if arguments.variant == "rest-shape":
                shape = read_mesh(rest or path).points
                crease.bilaplacian_fill = rest_shape_fill(shape / extent(shape))
            row = measure(path, rest, options_of(arguments.variant), arguments.split)
            rows.setdefault(name, []).append(row)
            crease.bilaplacian_fill = default_fill
    print_tables(rows)


if __name__ == "__main__":
    main()
