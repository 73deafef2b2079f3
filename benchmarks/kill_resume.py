"""Kills a repair with SIGKILL at random moments until it is done: is the result still the same?

    python benchmarks/kill_resume.py [--kills 20] [--frames 140] [--seed 0] [--alone]

Makes a clip in code, repairs it once undisturbed, then again and again with --resume, to be killed
after a random time, until so many runs were killed before they ended. Checks after every kill that
the old output is untouched, and of each run that ended, the last one above all, that the result is
the same byte for byte; in the end that nothing is left over.
"""

from __future__ import annotations

import argparse
import os
import random
import signal
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

AROUND, ALONG, RADIUS = 8, 24, 0.1


def tube(angle: float) -> NDArray[np.float64]:
    """Points (V, 3) of a tube of length 2 bent by an angle: from 2 pi on its ends meet."""
    along, around = np.meshgrid(
        np.linspace(0.0, 1.0, ALONG + 1), 2 * np.pi * np.arange(AROUND) / AROUND, indexing="ij"
    )
    turn, bend = angle * along, 2.0 / angle
    out = bend + RADIUS * np.cos(around)
    points = np.stack([out * np.cos(turn), RADIUS * np.sin(around), out * np.sin(turn)], axis=-1)
    return points.reshape(-1, 3)


def make_clip(path: Path, frames: int) -> None:
    """A clip of the tube that intersects here and there."""
    from usd_io import AuthoredMesh, write_animation

    ring, place = np.meshgrid(np.arange(ALONG), np.arange(AROUND), indexing="ij")
    corners = [(ring, place), (ring, place + 1), (ring + 1, place + 1), (ring + 1, place)]
    quads = np.stack([(r * AROUND + p % AROUND).ravel() for r, p in corners], axis=1)
    angles = 6.2 + 0.25 * np.sin(0.3 * np.arange(frames))
    mesh = AuthoredMesh(
        path="/Root/Tube", faces=quads, points=[tube(a) for a in angles], rest=tube(5.0)
    )
    write_animation(path, mesh, times=np.arange(1.0, frames + 1.0))


def main() -> int:
    """Run the benchmark; 0 if all is as it should be."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("--kills", type=int, default=20)
    parser.add_argument("--frames", type=int, default=140)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--alone", action="store_true")
    options = parser.parse_args()
    moments = random.Random(options.seed)
    with tempfile.TemporaryDirectory() as folder:
        clip, whole, output = (Path(folder) / name for name in ("a.usdc", "whole.usdc", "b.usdc"))
        make_clip(clip, options.frames)
        command = [sys.executable, "-m", "dtrepair", "repair", "-q", str(clip), "--resume"]
        command += ["--alone"] if options.alone else []
        start = time.perf_counter()
        subprocess.run([*command, "-o", str(whole)], check=True)
        seconds = time.perf_counter() - start
        runs, killed = 0, 0
        while killed < options.kills:
            runs += 1
            output.write_bytes(b"old")
            process = subprocess.Popen([*command, "-o", str(output)])
            try:
                process.wait(timeout=moments.uniform(0.0, seconds))
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()
            assert process.returncode in (0, -signal.SIGKILL), "a run failed on its own"
            killed += process.returncode != 0
            # A run may be killed between its last rename and its end: the whole new output.
            allowed = [whole.read_bytes()] + [b"old"] * (process.returncode != 0)
            assert output.read_bytes() in allowed, "a killed run changed the output"
        start = time.perf_counter()
        subprocess.run([*command, "-o", str(output)], check=True)
        last = time.perf_counter() - start
        assert output.read_bytes() == whole.read_bytes(), "the result differs"
        left = sorted(set(os.listdir(folder)) - {clip.name, whole.name, output.name})
        assert not left, f"left over: {left}"
    print(
        f"{options.frames} frames, {seconds:.1f} s undisturbed; {killed} of {runs} runs "
        f"killed; results equal byte for byte, nothing left over; last run {last:.1f} s"
    )
    return 0


if __name__ == "__main__":
    sys.exit(main())
