"""Peak memory of `dtrepair repair` for clips of different lengths.

    python benchmarks/memory.py CLIP.usdc REST.obj [--frames 60 200 600] [--jobs 1]

CLIP holds one animated mesh, REST its rest pose; longer clips go through it forwards and backwards.
Each run is a process of its own. Prints Markdown: the largest resident size of one process, as the
kernel reports it, and the largest sum over all processes of the run (proportional set size: what
they share counts once), sampled every 0.1 s. Linux only. Run it with OMP_NUM_THREADS=1.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import time
from pathlib import Path

from pxr import Usd, UsdGeom


def write_clip(source: Path, frames: int, path: Path) -> None:
    """Write a stage of `frames` frames that goes through the mesh of `source` to and fro."""
    stage = Usd.Stage.Open(str(source))
    mesh = next(UsdGeom.Mesh(prim) for prim in stage.Traverse() if prim.IsA(UsdGeom.Mesh))
    points = mesh.GetPointsAttr()
    times = points.GetTimeSamples()
    order = [*times, *times[-2:0:-1]]
    result = Usd.Stage.CreateNew(str(path))
    copy = UsdGeom.Mesh.Define(result, "/Body")
    copy.CreateFaceVertexCountsAttr(mesh.GetFaceVertexCountsAttr().Get())
    copy.CreateFaceVertexIndicesAttr(mesh.GetFaceVertexIndicesAttr().Get())
    written = copy.CreatePointsAttr()
    for frame in range(frames):
        written.Set(points.Get(order[frame % len(order)]), float(frame))
    result.Save()


def processes_below(number: int) -> list[int]:
    """A process and all that it started, directly or not."""
    found = [number]
    for process in found:
        try:
            children = Path(f"/proc/{process}/task/{process}/children").read_text().split()
        except OSError:
            continue
        found.extend(int(child) for child in children)
    return found


def shared_size(process: int) -> int:
    """Proportional set size in bytes; 0 if the process is gone."""
    try:
        lines = Path(f"/proc/{process}/smaps_rollup").read_text().splitlines()
    except OSError:
        return 0
    return sum(1024 * int(line.split()[1]) for line in lines if line.startswith("Pss:"))


def run(command: list[str]) -> tuple[float, float, float]:
    """Run a command: largest process and largest sum in MB, seconds."""
    start, together = time.perf_counter(), 0
    with subprocess.Popen(command, stdout=subprocess.DEVNULL) as process:
        while True:
            # wait4 gives the resident size of this process; Popen.poll would take it away.
            done, status, usage = os.wait4(process.pid, os.WNOHANG)
            if done:
                break
            together = max(together, sum(map(shared_size, processes_below(process.pid))))
            time.sleep(0.1)
        process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in (0, 1):
        raise SystemExit(f"exit code {process.returncode}: {' '.join(command)}")
    return usage.ru_maxrss / 1024, together / 2**20, time.perf_counter() - start


def main() -> None:
    """Repair clips of each length and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("clip", type=Path)
    parser.add_argument("rest", type=Path)
    parser.add_argument("--frames", type=int, nargs="*", default=[60, 200, 600])
    parser.add_argument("--jobs", type=int, nargs="*", default=[1])
    arguments = parser.parse_args()
    print("| frames | jobs | largest process, MB | all processes, MB | s |")
    print("|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as folder:
        for frames in arguments.frames:
            clip, output = Path(folder) / f"{frames}.usdc", Path(folder) / "output.usdc"
            write_clip(arguments.clip, frames, clip)
            for jobs in arguments.jobs:
                command = [sys.executable, "-m", "dtrepair", "repair", str(clip), "-o", str(output)]
                command += ["--rest", str(arguments.rest), "--jobs", str(jobs)]
                largest, together, seconds = run(command)
                print(
                    f"| {frames} | {jobs} | {largest:.0f} | {together:.0f} | {seconds:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
