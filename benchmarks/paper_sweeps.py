"""The published method over its numbers: lambda, beta, exponents and rates; memory over the size.

    python -m benchmarks.paper_sweeps --data DIR [--misc FOLDER] [--sweep NAME ...] [--plot FOLDER]

Sweeps: `diffusion` and `regularization` (lambda and beta, figure 9 of Jang et al. 2025), `kernel`
(the exponents of the text, (3, 6), against those of the authors' code, (1, 1), at many learning
rates), `laplacian` (of the rest or of the input) and `memory` (figure 8: peak memory of 60
iterations in a process of its own, over the number of triangles). Default: all. Meshes are those of
misc/ and one human, counts exact, on average; a mesh that diverges counts with its best iterate.
Prints Markdown; `--plot` also draws a PNG of each sweep.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path
from statistics import mean
from typing import NamedTuple

from benchmarks.paper_mode import Run, iterations_to_zero, repair
from dtrepair import RepairOptions

HUMANS = ("human_05_seated_twist",)
LAMBDAS = (3.0, 10.0, 30.0, 99.0, 300.0, 999.0, 3000.0)
BETAS = (0.0, 1e4, 1e6, 1e7, 1e8)
EXPONENTS = ((1, 1.0), (3, 6.0))
RATES = (1e-6, 1e-4, 1e-2, 1.0, 5.0)
TRIANGLES = (2_000, 5_000, 14_000, 27_000, 50_000, 100_000)
# What the paper gives for a mesh of SMPL's size on its GPU, MB.
PUBLISHED_MEMORY = 476

# Runs in a process of its own: peak resident size before and after, in MB.
MEMORY = """
import resource, sys
import numpy as np
from benchmarks.detection import trefoil
from dtrepair import Repairer, RepairOptions
peak = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
small = trefoil(200, 0.75)
options = RepairOptions(method="paper", iterations=60)
Repairer(*small, options=options)(small[0])
before, (points, faces) = peak(), trefoil(int(sys.argv[1]), 0.75)
Repairer(points, faces, options=options)(points)
print(len(faces), before, peak())
"""


class Row(NamedTuple):
    """A value of a sweep: what is left on average of each group, and how it got there."""

    series: str
    value: float
    left: tuple[float, ...]
    cells: tuple[str, ...]


class Meshes(NamedTuple):
    """The misc meshes, and humans with their rest pose."""

    misc: list[Path]
    humans: list[Path]
    rest: Path

    def runs(self, options: RepairOptions) -> tuple[list[Run], list[Run]]:
        """All of them repaired."""
        return (
            [repair(path, None, options) for path in self.misc],
            [repair(path, self.rest, options) for path in self.humans],
        )


def row(meshes: Meshes, series: str, value: float, options: RepairOptions) -> Row:
    """Repair all meshes with some options."""
    groups = meshes.runs(options)
    left = tuple(mean(run.after for run in runs) for runs in groups)
    cells = [f"{count:.1f}" for count in left]
    cells += [iterations_to_zero(groups[0])]
    cells += [f"{mean(run.normals for run in runs):.4f}" for runs in groups]
    cells += [f"{100 * max(run.displacement for run in runs):.0f}" for runs in groups]
    return Row(series, value, left, tuple(cells))


def diffusion(meshes: Meshes) -> Iterator[Row]:
    """lambda: how far a push spreads."""
    for strength in LAMBDAS:
        yield row(meshes, "lambda", strength, RepairOptions(method="paper", diffusion=strength))


def regularization(meshes: Meshes) -> Iterator[Row]:
    """beta: the weight of the shape."""
    for weight in BETAS:
        yield row(meshes, "beta", weight, RepairOptions(method="paper", regularization=weight))


def kernel(meshes: Meshes) -> Iterator[Row]:
    """Exponents of the signed tangent-point energy, at learning rates of gradient descent."""
    for exponent, power in EXPONENTS:
        for rate in RATES:
            options = RepairOptions(
                method="paper",
                optimizer="gradient-descent",
                kernel_exponent=exponent,
                kernel_power=power,
                learning_rate=rate,
            )
            yield row(meshes, f"({exponent}, {power:g})", rate, options)


def laplacian(meshes: Meshes) -> Iterator[Row]:
    """The Laplacian of the rest, or that of the input; the misc meshes are their own rest."""
    for index, pose in enumerate(("rest", "input")):
        yield row(meshes, pose, float(index), RepairOptions(method="paper", laplacian=pose))


SWEEPS: dict[str, Callable[[Meshes], Iterator[Row]]] = {
    "diffusion": diffusion,
    "regularization": regularization,
    "kernel": kernel,
    "laplacian": laplacian,
}


def print_sweep(name: str, meshes: Meshes, plot: Path | None) -> None:
    """The table of a sweep, and its picture."""
    print(
        f"\n{SWEEPS[name].__doc__}\n\n| {name} | value | misc left | humans left | iterations to "
        "zero, misc | NC misc | NC humans | largest move misc, % | humans, % |\n" + "|---" * 9 + "|"
    )
    rows = []
    for found in SWEEPS[name](meshes):
        rows.append(found)
        print(f"| {found.series} | {found.value:g} | " + " | ".join(found.cells) + " |", flush=True)
    if plot:
        curves: dict[str, list[tuple[float, float]]] = {}
        for found in rows:
            for group, left in zip(("misc", "humans"), found.left, strict=True):
                curves.setdefault(f"{found.series}, {group}", []).append((found.value, left))
        draw(plot / f"{name}.png", curves, name, "triangles left, mean")


def print_memory(plot: Path | None) -> None:
    """Peak memory over the size, beyond what the program takes itself."""
    print(
        "\nPeak memory of 60 iterations on one core, beyond that of the program with a mesh of 200 "
        f"triangles; the paper: {PUBLISHED_MEMORY} MB on its GPU for a human of about 14k "
        "triangles.\n\n| triangles | MB beyond | MB in all |\n|---|---|---|"
    )
    curve = []
    for triangles in TRIANGLES:
        command = [sys.executable, "-c", MEMORY, str(triangles)]
        told = subprocess.run(command, check=True, capture_output=True, text=True).stdout.split()
        count, before, peak = int(told[0]), float(told[1]), float(told[2])
        curve.append((float(count), peak - before))
        print(f"| {count} | {peak - before:.0f} | {peak:.0f} |", flush=True)
    if plot:
        draw(plot / "memory.png", {"trefoil": curve}, "triangles", "MB beyond the program")


def draw(path: Path, curves: dict[str, list[tuple[float, float]]], along: str, up: str) -> None:
    """Curves by name, the axis along logarithmic."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for name, points in curves.items():
        axes.plot(*zip(*points, strict=True), marker="o", label=name)
    axes.set_xscale("symlog", linthresh=min(x for own in curves.values() for x, _ in own if x > 0))
    axes.set_xlabel(along)
    axes.set_ylabel(up)
    axes.legend()
    path.parent.mkdir(parents=True, exist_ok=True)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def main() -> None:
    """Parse the command line, run, print."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of misc/ and humans/")
    parser.add_argument("--misc", type=Path, help="folder of the misc meshes, if another")
    names = (*SWEEPS, "memory")
    parser.add_argument("--sweep", nargs="+", choices=names, default=names, metavar="NAME")
    parser.add_argument("--plot", type=Path, metavar="FOLDER", help="draw pictures into a folder")
    arguments = parser.parse_args()
    humans, misc = arguments.data / "humans", arguments.misc or arguments.data / "misc"
    meshes = Meshes(
        sorted(misc.glob("*.obj")),
        [humans / f"{name}.obj" for name in HUMANS],
        humans / "human_male_rest.obj",
    )
    if not meshes.misc:
        raise SystemExit(f"no meshes in {misc}: expected *.obj")
    if "memory" in arguments.sweep:  # first: a process is told at least the peak of its parent
        print_memory(arguments.plot)
    for name in arguments.sweep:
        if name in SWEEPS:
            print_sweep(name, meshes, arguments.plot)


if __name__ == "__main__":
    main()
