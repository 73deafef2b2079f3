"""The published method (`--method paper`): triangles left, iterations to zero, seconds.

    python -m benchmarks.paper_mode --data DIR [--iterations 60] [--energies] [--masses] [--speed]

DIR holds misc/*.obj (knots and other objects) and humans/human_0*.obj with human_male_rest.obj, the
rest pose of the humans. Prints Markdown: means beside the published ones, then single meshes. More
tables on request: the baseline energies, the same loop with the mass-weighted diffusion, the time
of an iteration. Counts are exact, of the float32 coordinates.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean

import numpy as np
import torch
from scipy import sparse

from benchmarks.detection import Faces, Points, measure
from dtrepair import Repairer, RepairOptions
from dtrepair.files.mesh_files import read_mesh
from dtrepair.intersect.detector import Detector, triangle_count
from dtrepair.numerics.geometry import as_mesh, diagonal, extent
from dtrepair.numerics.operators import cotangent_laplacian, lumped_mass
from dtrepair.repair.paper.descent import Descent
from dtrepair.repair.paper.diffusion import Diffusion, SparseOperator
from dtrepair.repair.paper.energy import EnergyOptions, mean_square_strength
from dtrepair.repair.paper.optimizer import Moments, Optimizer, OptimizerOptions, start

OPTIMIZERS = ("gradient-descent", "uniform-adam", "momentum-brake")
ENERGIES = ("signed-tpe", "tpe", "point-to-plane", "conical")

# Jang et al. 2025: Table 1, triangles left on average (humans: SMPL; misc: ten meshes, five of them
# these), and Table 3, iterations to zero on average over the meshes that get there.
PUBLISHED_LEFT = {"misc": 32.2, "humans": 243.27}
PUBLISHED_ITERATIONS = {"gradient-descent": 83.28, "uniform-adam": 62.60, "momentum-brake": 37.42}


@dataclass(frozen=True)
class Run:
    """One mesh repaired once; `seconds` are those of the loop, without set-up."""

    before: int
    after: int
    iterations: int
    seconds: float
    displacement: float


def repair(path: Path, rest: Path | None, options: RepairOptions) -> Run:
    """Repair the mesh of one file; without a rest pose it is its own."""
    mesh = read_mesh(path)
    shape = mesh.points if rest is None else read_mesh(rest).points
    result = Repairer(shape, mesh.faces(), options=options)(mesh.points)
    return Run(
        result.before.triangles,
        result.after.triangles,
        result.iterations,
        sum(stage.seconds for stage in result.stages),
        result.displacement_max,
    )


def make_descent(
    points: Points,
    faces: Faces,
    shape: Points,
    optimizer: Optimizer,
    *,
    iterations: int,
    masses: bool,
) -> tuple[Descent, torch.Tensor]:
    """The loop itself with either diffusion, and the points (1, V, 3) in units of their size."""
    points, faces = as_mesh(points, faces)
    size, unit = extent(points), shape / extent(shape)
    laplacian = cotangent_laplacian(unit, faces)
    detector = Detector(shape, faces)
    descent = Descent(
        faces=torch.from_numpy(faces.astype(np.int64)),
        detect=lambda at: detector(at.numpy() * size),
        diffusion=Diffusion(laplacian, mass=lumped_mass(unit, faces) if masses else None),
        laplacian=SparseOperator(laplacian),
        optimizer=optimizer,
        iterations=iterations,
    )
    return descent, torch.from_numpy(points / size)[None]


def repair_with_masses(path: Path, rest: Path | None, options: RepairOptions) -> Run:
    """As `repair`, with A^-1 Mass A^-1 in place of the published (I + lambda L)^-2."""
    mesh = read_mesh(path)
    kernel = EnergyOptions().by_name[options.energy]
    descent, points = make_descent(
        mesh.points,
        mesh.faces(),
        mesh.points if rest is None else read_mesh(rest).points,
        OptimizerOptions().suited(options.optimizer, kernel.rate_factor),
        iterations=options.iterations,
        masses=True,
    )
    begin = time.perf_counter()
    result = descent(points)
    seconds = time.perf_counter() - begin
    moved = float((result.points - points).norm(dim=-1).max()) / diagonal(points[0].numpy())
    left = triangle_count(descent.detect(result.points)[:, 1:])
    return Run(int(result.history[0, 0]), left, int(result.iterations[0]), seconds, moved)


def repair_groups(
    data: Path,
    options: RepairOptions,
    one: Callable[[Path, Path | None, RepairOptions], Run] = repair,
) -> dict[str, dict[str, Run]]:
    """Runs by group and mesh name."""
    groups = {
        "misc": (sorted((data / "misc").glob("*.obj")), None),
        "humans": (
            sorted((data / "humans").glob("human_0*.obj")),
            data / "humans" / "human_male_rest.obj",
        ),
    }
    runs: dict[str, dict[str, Run]] = {}
    for group, (paths, rest) in groups.items():
        if not paths:
            raise SystemExit(f"no meshes in {data / group}: expected *.obj")
        runs[group] = {path.stem: one(path, rest, options) for path in paths}
    return runs


def iterations_to_zero(runs: Sequence[Run]) -> str:
    """Mean over the runs that reach zero, and how many do."""
    clean = [run.iterations for run in runs if run.after == 0]
    return f"{mean(clean):.1f} ({len(clean)} of {len(runs)})" if clean else f"- (0 of {len(runs)})"


def print_means(results: dict[str, dict[str, dict[str, Run]]]) -> None:
    """Table of means: one row an optimiser and group."""
    print("| optimiser | meshes | before | left | paper | iterations to zero | paper | s a mesh |")
    print("|---|---|---|---|---|---|---|---|")
    for name, groups in results.items():
        for group, by_mesh in groups.items():
            runs = list(by_mesh.values())
            print(
                f"| {name} | {len(runs)} {group} | {mean(r.before for r in runs):.1f} "
                f"| {mean(r.after for r in runs):.1f} | {PUBLISHED_LEFT[group]} "
                f"| {iterations_to_zero(runs)} | {PUBLISHED_ITERATIONS[name]} "
                f"| {mean(r.seconds for r in runs):.2f} |"
            )


def print_meshes(results: dict[str, dict[str, dict[str, Run]]]) -> None:
    """Table of single meshes: left @ iteration of the best, for each optimiser."""
    print("\n| mesh | before | " + " | ".join(results) + " |")
    print("|---" * (2 + len(results)) + "|")
    first = next(iter(results.values()))
    for group, by_mesh in first.items():
        for name, run in by_mesh.items():
            cells = [results[optimizer][group][name] for optimizer in results]
            shown = " | ".join(
                f"{c.after} @ {c.iterations}, {100 * c.displacement:.1f} %" for c in cells
            )
            print(f"| {name} | {run.before} | {shown} |")


def print_energies(results: dict[str, dict[str, dict[str, Run]]]) -> None:
    """Table of energies: mean triangles left of each group."""
    print("\n| energy | misc left | humans left |\n|---|---|---|")
    for name, groups in results.items():
        left = [mean(run.after for run in by_mesh.values()) for by_mesh in groups.values()]
        print(f"| {name} | " + " | ".join(f"{value:.1f}" for value in left) + " |")


def reference_iteration(
    descent: Descent, laplacian: torch.Tensor, points: torch.Tensor, moments: Moments
) -> None:
    """The authors' structure: detect, autograd of both terms, two solves, step, detect again."""
    pairs = torch.as_tensor(descent.detect(points)).long()
    moving = points[0].clone().requires_grad_()
    corners = moving[descent.faces]
    normals = torch.linalg.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    areas = 0.5 * normals.norm(dim=1)
    planes = (normals / (2.0 * areas[:, None])).detach()
    target = laplacian @ points[0]
    energy = mean_square_strength(1e6, len(moving)) * (laplacian @ moving - target).square().sum()
    for one, other in ((1, 2), (2, 1)):
        at = pairs[:, other]
        offsets = corners[at].mean(dim=1, keepdim=True) - corners[pairs[:, one]]
        heights = (offsets * planes[at, None]).sum(dim=-1)
        energy = energy + (areas.detach()[at, None] * heights / offsets.norm(dim=-1)).sum()
    energy.backward()
    assert moving.grad is not None
    step, _ = descent.optimizer(moments, descent.diffusion.begin(moving.grad[None]))
    descent.detect(points - descent.diffusion.finish(step))


def as_torch(matrix: sparse.csr_matrix) -> torch.Tensor:
    """A sparse matrix as PyTorch has it."""
    entries = matrix.tocoo()
    index = torch.from_numpy(np.stack([entries.row, entries.col]))
    with torch.sparse.check_sparse_tensor_invariants(False):
        return torch.sparse_coo_tensor(
            index, torch.from_numpy(entries.data), entries.shape
        ).coalesce()


def iteration_runs(points: Points, faces: Faces, shape: Points) -> dict[str, Callable[[], object]]:
    """Detection, an iteration, and one of the reference structure with the same detector.

    All of the same pose with the same pairs; nothing moves.
    """
    optimizer = OptimizerOptions().momentum_brake
    descent, pose = make_descent(points, faces, shape, optimizer, iterations=60, masses=False)
    assert isinstance(descent.laplacian, SparseOperator)
    target, moments = descent.laplacian(pose), start(pose)
    laplacian = as_torch(descent.laplacian.matrix)

    def iteration() -> object:
        pairs = torch.as_tensor(descent.detect(pose)).long()
        return descent.step(pose, pairs, target, moments)

    return {
        "detection": lambda: descent.detect(pose),
        "iteration": iteration,
        "reference iteration": lambda: reference_iteration(descent, laplacian, pose, moments),
    }


def print_speed(data: Path) -> None:
    """Table of the processor time of an iteration, best of 20, on a mesh of about 14k triangles."""
    path = data / "animals" / "horse_head_through_chest.obj"
    mesh = read_mesh(path)
    best = measure(iteration_runs(mesh.points, mesh.faces(), mesh.points), 20)
    _, ours, reference = best.values()
    print(f"\n| {path.stem}, {len(mesh.points)} vertices, {len(mesh.faces())} triangles | cpu ms |")
    print("|---|---|")
    for name, milliseconds in best.items():
        print(f"| {name} | {milliseconds:.1f} |")
    print(f"| ratio (bar 0.5) | {ours / reference:.2f} |\n| 60 iterations | {60 * ours:.0f} |")


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of misc/ and humans/")
    parser.add_argument("--iterations", type=int, default=60)
    parser.add_argument("--energies", action="store_true", help="compare the energies")
    parser.add_argument("--masses", action="store_true", help="mass-weighted diffusion")
    parser.add_argument("--speed", action="store_true", help="time of an iteration")
    arguments = parser.parse_args()

    def options(optimizer: str, energy: str = "signed-tpe") -> RepairOptions:
        return RepairOptions(
            method="paper",
            iterations=arguments.iterations,
            optimizer=optimizer,
            energy=energy,
        )

    results = {name: repair_groups(arguments.data, options(name)) for name in OPTIMIZERS}
    print_means(results)
    print_meshes(results)
    if arguments.masses:
        print("\nWith the mass-weighted diffusion:\n")
        weighted = {
            name: repair_groups(arguments.data, options(name), repair_with_masses)
            for name in OPTIMIZERS
        }
        print_means(weighted)
    if arguments.energies:
        # UniformAdam: the only one whose step does not depend on the size of the energy.
        chosen = {name: options("uniform-adam", name) for name in ENERGIES}
        print_energies({name: repair_groups(arguments.data, chosen[name]) for name in ENERGIES})
    if arguments.speed:
        print_speed(arguments.data)


if __name__ == "__main__":
    main()
