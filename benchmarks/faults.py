"""Breaks runs on purpose, and tells as a table what becomes of them; 1 if anything is taken over.

    python -m benchmarks.faults [--kills 3] [--frames 70]

Each row is a run of the command line from outside. `benchmarks/kill_resume.py` has the long row of
kills at random moments.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import signal
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

import numpy as np
from pxr import Sdf

from benchmarks.kill_resume import make_clip

TRIES = 600  # looks for a worker process, 10 ms apart


class Faults:
    """One clip, its repair undisturbed, and runs that are disturbed."""

    def __init__(self, folder: Path, frames: int) -> None:
        """Make the clip and repair it."""
        self.folder = folder
        self.clip, self.output, self.whole = (folder / f"{n}.usdc" for n in ("a", "b", "whole"))
        make_clip(self.clip, frames)
        assert self.repair(self.whole).wait() == 0

    def repair(self, output: Path, *options: object, disk: int = 0) -> subprocess.Popen[bytes]:
        """Start a repair; disk: largest size of a file in bytes."""
        command = ["dtrepair", "repair", "-q", self.clip, "-o", output, *options]

        def limit() -> None:
            if disk:
                signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
                resource.setrlimit(resource.RLIMIT_FSIZE, (disk, disk))

        arguments = [sys.executable, "-m", *map(str, command)]
        return subprocess.Popen(arguments, stderr=subprocess.DEVNULL, preexec_fn=limit)

    def same(self) -> bool:
        """Whether the output is that of the undisturbed run."""
        return self.output.read_bytes() == self.whole.read_bytes()

    def old(self) -> bool:
        """Whether the output is what it was before."""
        return self.output.read_bytes() == b"old"

    def killed(self, kills: int) -> bool:
        """Kill the run so many times, then let it end."""
        intact = True
        for number in range(kills):
            self.output.write_bytes(b"old")
            process = self.repair(self.output, "--resume")
            time.sleep(2.0 + number)
            process.kill()
            process.wait()
            intact &= self.old() or self.same()
        return intact and self.repair(self.output, "--resume").wait() == 0 and self.same()

    def lost_worker(self) -> bool:
        """Kill the first worker process."""
        process = self.repair(self.output, "--jobs", 2)
        children = Path(f"/proc/{process.pid}/task/{process.pid}/children")
        for _ in range(TRIES):
            worker = children.read_text().split() if process.poll() is None else []
            if worker:
                os.kill(int(worker[0]), signal.SIGKILL)
                break
            time.sleep(0.01)
        return process.wait() == 0 and self.same()

    @contextmanager
    def cluster(self) -> Iterator[tuple[str, list[subprocess.Popen[bytes]]]]:
        """The address of a scheduler with two workers, and the three processes."""
        file = self.folder / "scheduler.json"
        common = ["--no-dashboard", "--scheduler-file", str(file)]
        arguments = [["dask_scheduler", "--port", "0"], *[["dask_worker", "--no-nanny"]] * 2]
        made = []
        try:
            for name, *options in arguments:
                command = [sys.executable, "-m", f"distributed.cli.{name}", *options, *common]
                made.append(subprocess.Popen(command, stderr=subprocess.DEVNULL))
                while not file.exists():  # workers wait for no scheduler
                    time.sleep(0.1)
            yield json.loads(file.read_text())["address"], made
        finally:
            for process in reversed(made):
                process.kill()
                process.wait()
            file.unlink(missing_ok=True)

    def cluster_killed(self, victim: int, code: int) -> bool:
        """Kill a part of a Dask cluster while it repairs: 0 for the scheduler, 1 for a worker."""
        self.output.write_bytes(b"old")
        with self.cluster() as (address, made):
            process = self.repair(self.output, "--distributed", address)
            while process.poll() is None and not list(self.folder.glob(".*/.part*")):
                time.sleep(0.1)  # until a chunk begins its layer
            made[victim].kill()
            ended = process.wait()
        intact = self.old() if code else _points(self.output) == _points(self.whole)
        return ended == code and intact and not list(self.folder.glob(".*"))

    def full_disk(self) -> bool:
        """Let no file grow beyond 20 kB."""
        self.output.write_bytes(b"old")
        return self.repair(self.output, disk=20_000).wait() == 5 and self.old()

    def hostile(self, name: str, make: Callable[[Path], object], code: int) -> bool:
        """Write the layer onto something that is no file."""
        path = self.folder / f"{name}.usdc"
        make(path)
        kind = path.stat().st_mode
        return self.repair(path).wait() == code and path.stat().st_mode == kind

    def foreign_folder(self) -> bool:
        """Put a folder of somebody else where progress is kept."""
        mine = self.folder / ".b.usdc.resume"
        mine.mkdir()
        (mine / "thesis.txt").write_text("years of work")
        done = self.repair(self.output, "--resume").wait() == 0 and self.same()
        kept = os.listdir(mine) == ["thesis.txt"]
        (mine / "thesis.txt").unlink()
        mine.rmdir()
        return done and kept


def _points(path: Path) -> dict[float, bytes]:
    """The points of each frame of a layer, as they were written."""
    layer = Sdf.Layer.FindOrOpen(str(path))
    points = Sdf.Path("/Root/Tube.points")
    times = layer.ListTimeSamplesForPath(points)
    return {time: np.asarray(layer.QueryTimeSample(points, time)).tobytes() for time in times}


def _socket(path: Path) -> None:
    with socket.socket(socket.AF_UNIX) as made:
        made.bind(str(path))


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the benchmark; 0 if all is as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kills", type=int, default=3)
    parser.add_argument("--frames", type=int, default=70)
    options = parser.parse_args(arguments)
    bad = 0
    with tempfile.TemporaryDirectory() as folder:
        faults = Faults(Path(folder), options.frames)
        rows: dict[str, Callable[[], bool]] = {
            f"{options.kills} kills, each resumed": lambda: faults.killed(options.kills),
            "lost worker": faults.lost_worker,
            "killed Dask scheduler": lambda: faults.cluster_killed(0, 7),
            "killed Dask worker": lambda: faults.cluster_killed(1, 0),
            "full disk": faults.full_disk,
            "foreign folder": faults.foreign_folder,
            "layer onto FIFO": lambda: faults.hostile("fifo", os.mkfifo, 5),
            "layer onto socket": lambda: faults.hostile("socket", _socket, 5),
            "layer onto directory": lambda: faults.hostile("directory", os.mkdir, 5),
        }
        print("| fault | as it should be | seconds |\n|---|---|---|")
        for name, row in rows.items():
            start = time.perf_counter()
            good = row()
            bad += not good
            seconds = time.perf_counter() - start
            print(f"| {name} | {'yes' if good else 'NO'} | {seconds:.1f} |", flush=True)
    return int(bad > 0)


if __name__ == "__main__":
    sys.exit(main())
