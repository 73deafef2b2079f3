"""Processor time of a repair from Python, with and without OMP_NUM_THREADS=1.

    python -m benchmarks.threads --data DIR [--repeats 3]

The library keeps linear algebra to one thread while it solves, so that both should take the same;
threads that wait for each other would take several times as much on a busy machine. A pose of a
human is repaired in processes of their own, in turns. Exit code 1 where the medians differ by more
than a tenth.
"""

from __future__ import annotations

import argparse
import os
import statistics
import subprocess
import sys
import time
from pathlib import Path

from dtrepair import Repairer, RepairOptions
from dtrepair.files.mesh_files import read_mesh

BAR = 0.10
POSE, REST = "humans/human_01_crossed_arms_deep.obj", "humans/human_male_rest.obj"
# Any of these bounds the threads of a library of linear algebra.
VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def measure(data: Path, method: str) -> float:
    """Processor seconds of a pose, in this process; a first, clean pose loads all libraries."""
    pose, rest = read_mesh(data / POSE), read_mesh(data / REST)
    repairer = Repairer(rest.points, rest.faces(), options=RepairOptions(method=method))
    repairer(rest.points)
    start = time.process_time()
    repairer(pose.points)
    return time.process_time() - start


def measured_apart(data: Path, method: str, *, one_thread: bool) -> float:
    """The same in a process of its own."""
    environment = {name: value for name, value in os.environ.items() if name not in VARIABLES}
    if one_thread:
        environment |= dict.fromkeys(VARIABLES, "1")
    command = [sys.executable, "-m", "benchmarks.threads", "--data", str(data), "--here", method]
    done = subprocess.run(command, env=environment, capture_output=True, text=True, check=True)
    return float(done.stdout)


def main() -> int:
    """Measure both methods; 1 where they miss the bar."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of humans/")
    parser.add_argument("--repeats", type=int, default=3)
    parser.add_argument("--here", metavar="METHOD", help="print the seconds of this process only")
    given = parser.parse_args()
    if given.here:
        print(measure(given.data, given.here))
        return 0
    print("| method | processor s | with OMP_NUM_THREADS=1 | ratio, bar 0.9 to 1.1 |")
    print("|---|---|---|---|")
    missed = 0
    for method in ("full", "paper"):
        seconds: dict[bool, list[float]] = {False: [], True: []}
        for _ in range(given.repeats):
            for one_thread, found in seconds.items():
                found.append(measured_apart(given.data, method, one_thread=one_thread))
        free, bound = (statistics.median(seconds[one_thread]) for one_thread in (False, True))
        missed += abs(free / bound - 1.0) > BAR
        print(f"| {method} | {free:.2f} | {bound:.2f} | {free / bound:.2f} |", flush=True)
    return int(missed > 0)


if __name__ == "__main__":
    sys.exit(main())
