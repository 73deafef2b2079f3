"""The budgets of speed and memory, measured in one run: is each of them met?

    python -m pip install -r benchmarks/requirements.txt
    OMP_NUM_THREADS=1 python -m benchmarks.budgets [--clip CLIP.usdc REST.obj] [--plot FILE.png]

Prints one Markdown table; exit code 1 if a budget is not met. Times are processor times on one core
unless the row says otherwise, the best of some repeats, and ratios are of the same run. Meshes are
trefoil knots (see detection.py), with `--clip` also an animated mesh and its rest pose: frames a
second of one worker and of two, and the peak memory of short and long clips made of it. Wall times
mean something on an idle machine only; the first line tells how busy it was.
"""

from __future__ import annotations

import argparse
import os
import platform
import resource
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np
import torch

from benchmarks.detection import contenders, growth, measure, trefoil
from benchmarks.memory import run, write_clip
from benchmarks.paper_speed import iteration_runs
from dtrepair import Repairer
from dtrepair.files.mesh_files import read_mesh
from dtrepair.repair.surface.surface import Surface
from usd_io import open_stage, read_meshes, read_points

# Triangles of the single meshes: SMPL's size, and that of a detailed character.
SMALL, LARGE = 14_000, 27_000
GROWTH_SIZES = (5_000, 14_000, 27_000, 50_000, 100_000, 200_000)
# Radius of the tube of the knots: strands that run into each other, and strands that do not.
THICK, THIN = 0.75, 0.3
SHORT_CLIP, LONG_CLIP = 60, 200
# Memory counts as flat if the long clip needs at most this times that of the short one.
FLAT = 1.2


# What detection may cost next to its peers.
PEERS = {"libigl + CGAL": 1 / 3, "MeshLib, tree kept": 1.0}


class Row(NamedTuple):
    """One budget: what it is about, the bar in words, what was measured, and whether it is met."""

    what: str
    budget: str
    measured: str
    met: bool


def at_most(what: str, value: float, bar: float, *, unit: str = "", note: str = "") -> Row:
    """A row whose value should not exceed a bar."""
    digits = 0 if value >= 100 else 2
    shown = f"{value:.{digits}f}{unit}{f' ({note})' if note else ''}"
    return Row(what, f"<= {bar:.{digits}f}{unit}", shown, value <= bar)


def detection_rows() -> Iterator[Row]:
    """Detection next to its peers; a peer that is not installed has no row."""
    points, faces = trefoil(SMALL, THICK)
    runs = contenders(trefoil(SMALL, THIN)[0], points, faces)
    kept = {name: run for name, run in runs.items() if name in ("dtrepair", *PEERS)}
    best = measure(kept, 9)
    for name, bar in PEERS.items():
        if name in best:
            note = f"{best['dtrepair']:.1f} against {best[name]:.1f} ms"
            what = f"detection, {len(faces)} triangles, over {name}"
            yield at_most(what, best["dtrepair"] / best[name], bar, note=note)


def iteration_rows() -> Iterator[Row]:
    """An iteration of the published method, and sixty of them one after the other."""
    points, faces = trefoil(SMALL, THICK)
    runs = iteration_runs(points, faces, trefoil(SMALL, THIN)[0])
    best = measure(runs, 15)
    ours, reference = best["iteration"], best["reference iteration"]
    what = f"iteration, {len(faces)} triangles, over the reference structure"
    yield at_most(what, ours / reference, 0.5, note=f"{ours:.1f} against {reference:.1f} ms")
    seconds = float("inf")
    for _ in range(3):
        start = time.perf_counter()
        for _ in range(60):
            runs["iteration"]()
        seconds = min(seconds, time.perf_counter() - start)
    shown = f"{1e3 * seconds:.0f} ms on one core"
    yield Row("60 iterations, wall", "aim: 484 ms (paper, GPU)", shown, seconds <= 0.484)


def set_up_row() -> Row:
    """All that is built once for a topology: operators, adjacency, tree, factors."""
    rest, faces = trefoil(LARGE, THIN)

    def build() -> None:
        surface = Surface(rest, faces)
        surface.diffuse(rest)
        surface.arap_factor(rest)

    build()
    seconds = 1e-3 * measure({"build": build}, 3)["build"]
    return at_most(f"set-up of a topology, {len(faces)} triangles", seconds, 0.5, unit=" s")


def growth_rows(plot: Path | None) -> Iterator[Row]:
    """How detection and an iteration grow with the mesh."""
    sizes: list[int] = []
    times: dict[str, list[float]] = {"detection": [], "iteration": []}
    for size in GROWTH_SIZES:
        points, faces = trefoil(size, THICK)
        runs = iteration_runs(points, faces, trefoil(size, THIN)[0])
        best = measure({name: runs[name] for name in times}, 7)
        sizes.append(len(faces))
        for name in times:
            times[name].append(best[name])
    for name, column in times.items():
        note = ", ".join(f"{time:.1f}" for time in column) + " ms"
        what = f"growth of {name}, {sizes[0]} to {sizes[-1]} triangles: exponent"
        yield at_most(what, growth(sizes, column), 1.15, note=note)
    if plot:
        draw_growth(sizes, times, plot)


def draw_growth(sizes: list[int], times: dict[str, list[float]], path: Path) -> None:
    """Times over sizes, both logarithmic, with the slope of the budget."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(figsize=(6, 4), layout="constrained")
    for name, column in times.items():
        label = f"{name}, n^{growth(sizes, column):.2f}"
        (line,) = axes.loglog(sizes, column, marker="o", label=label)
        slope = column[0] * (np.array(sizes) / sizes[0]) ** 1.15
        axes.loglog(sizes, slope, linestyle=":", color=line.get_color(), label="n^1.15")
    axes.set(xlabel="triangles", ylabel="ms on one core")
    axes.grid(visible=True, which="both", alpha=0.3)
    axes.legend()
    figure.savefig(path, dpi=120)


def throughput_row(clip: Path, rest: Path) -> Row:
    """Frames a second of the default method with two workers over one, whole clip, wall."""
    stage = open_stage(clip)
    mesh = read_meshes(stage.stage).meshes[0]
    points = np.asarray(read_points(mesh, mesh.times), dtype=np.float64)
    repairer = Repairer(read_mesh(rest).points, mesh.faces)
    seconds = []
    for jobs in (1, 2):
        start = time.perf_counter()
        repairer.animation(points, times=mesh.times, jobs=jobs)
        seconds.append(time.perf_counter() - start)
    ratio, frames = seconds[0] / seconds[1], len(points)
    shown = f"{ratio:.2f} ({frames / seconds[0]:.2f} and {frames / seconds[1]:.2f} frames a s)"
    return Row("frames a second, two workers over one, wall", ">= 1.7", shown, ratio >= 1.7)


def memory_rows(clip: Path, rest: Path) -> Iterator[Row]:
    """Peak of the whole command for a long clip, and over that of a short one."""
    peaks = []
    with tempfile.TemporaryDirectory() as folder:
        for frames in (SHORT_CLIP, LONG_CLIP):
            source, output = Path(folder) / f"{frames}.usdc", Path(folder) / "output.usdc"
            write_clip(clip, frames, source)
            command = [sys.executable, "-m", "dtrepair", "repair", str(source), "-o", str(output)]
            peaks.append(run([*command, "--rest", str(rest), "--jobs", "1"])[0])
    yield at_most(f"peak memory, {LONG_CLIP} frames", peaks[1], 1000.0, unit=" MB")
    note = f"{peaks[0]:.0f} MB"
    yield at_most(
        f"peak memory over that of {SHORT_CLIP} frames", peaks[1] / peaks[0], FLAT, note=note
    )


def start_rows() -> Iterator[Row]:
    """Processor time of short runs of the program, start of the interpreter included."""
    runs = {"dtrepair --help": (["-m", "dtrepair", "--help"], 0.5)}
    runs["import dtrepair"] = (["-c", "import dtrepair"], 0.3)
    for name, (arguments, bar) in runs.items():
        seconds = min(_process_seconds([sys.executable, *arguments]) for _ in range(5))
        yield at_most(name, seconds, bar, unit=" s")


def _process_seconds(command: list[str]) -> float:
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    return after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime


def machine() -> str:
    """The machine and how busy it is, in a line."""
    model = platform.processor() or platform.machine()
    cpus = Path("/proc/cpuinfo")
    if cpus.exists():
        lines = [line for line in cpus.read_text().splitlines() if line.startswith("model name")]
        model = lines[0].split(":")[1].strip() if lines else model
    load = os.getloadavg()[0]
    return f"{model}, {os.cpu_count()} cores, load {load:.1f}, Python {platform.python_version()}"


def rows(arguments: argparse.Namespace) -> Iterator[Row]:
    """All rows, one after the other.

    Memory comes first: a program is told at least the peak of the process that starts it.
    """
    if arguments.clip:
        yield from memory_rows(*arguments.clip)
    yield from detection_rows()
    yield from iteration_rows()
    yield set_up_row()
    yield from growth_rows(arguments.plot)
    yield from start_rows()
    if arguments.clip:
        yield throughput_row(*arguments.clip)


def main() -> None:
    """Measure, print the table."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--clip", type=Path, nargs=2, metavar=("CLIP", "REST"))
    parser.add_argument("--plot", type=Path, help="draw the growth with the size into this file")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    print(f"Machine: {machine()}\n\n| what | budget | measured | |\n|---|---|---|---|")
    missed = False
    for row in rows(arguments):
        missed |= not row.met
        print(f"| {row.what} | {row.budget} | {row.measured} | {'met' if row.met else 'NOT MET'} |")
        sys.stdout.flush()
    raise SystemExit(int(missed))


if __name__ == "__main__":
    main()
