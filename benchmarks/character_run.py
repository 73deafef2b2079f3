"""Runs the command line on a stage as a user would, bounded in time, and reads its report."""

from __future__ import annotations

import json
import os
import resource
import signal
import subprocess
import sys
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

# A run that waits for others is ended after this many times its limit has passed all the same.
PATIENCE = 20.0


@dataclass(frozen=True)
class Run:
    """A run of `dtrepair repair`: what it cost and what it said.

    code: exit code, None where it was ended because it took more than `limit`.
    seconds: processor seconds of the whole command; wall: seconds that passed.
    report: its JSON report, empty without.
    """

    code: int | None
    seconds: float
    wall: float
    limit: float
    report: dict[str, Any] = field(default_factory=dict)
    errors: str = ""

    @property
    def statuses(self) -> dict[float, str]:
        """Status of each frame that the report names, by time code."""
        return {frame["time"]: frame["status"] for frame in self.report.get("frames", ())}

    def pairs(self, when: str, time: float) -> int | None:
        """Pairs, modelled ones too, that the report counts `before` or `after` in a frame."""
        for frame in self.report.get("frames", ()):
            if frame["time"] == time and frame[when] is not None:
                counts = frame[when]
                return int(counts["pairs"]) + int(counts.get("modelled_pairs", 0))
        return None

    def told(self) -> str:
        """Exit code and the number of frames of each status, as text."""
        if self.code is None:
            return f"ended after {self.limit:g} processor s"
        names = list(self.statuses.values())
        counts = [f"{names.count(name)} {name}" for name in dict.fromkeys(names)]
        return f"exit {self.code}: {', '.join(counts) or 'no report'}"


def repair(stage: Path, folder: Path, options: list[str], limit: float) -> Run:
    """Repair a stage into the folder; it is ended after `limit` processor seconds.

    Where those of all its processes cannot be read (only Linux tells), after as many that passed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    layer, report, note = files(stage, folder)
    for path in (layer, report, note):
        path.unlink(missing_ok=True)
    command = [sys.executable, "-m", "dtrepair", "repair", str(stage), "-o", str(layer)]
    command += ["--report", str(report), "-q", *options]
    spent, start = _children(), os.times().elapsed
    process = subprocess.Popen(
        command, stderr=subprocess.PIPE, text=True, errors="replace", start_new_session=True
    )
    code: int | None = None
    while True:
        try:
            errors = process.communicate(timeout=1.0)[1]
            code = process.returncode
        except subprocess.TimeoutExpired:
            passed = os.times().elapsed - start
            if max(_session(process.pid, passed), passed / PATIENCE) < limit:
                continue
            os.killpg(process.pid, signal.SIGKILL)
            errors = process.communicate()[1]
        break
    run = Run(
        code,
        _children() - spent,
        os.times().elapsed - start,
        limit,
        json.loads(report.read_text()) if report.exists() else {},
        errors[-2000:],
    )
    kept = {name: value for name, value in asdict(run).items() if name != "report"}
    note.write_text(json.dumps(kept, indent=1))
    return run


def earlier(stage: Path, folder: Path) -> Run:
    """The run that wrote what lies in the folder. Raises SystemExit where none did."""
    _, report, note = files(stage, folder)
    if not note.exists():
        raise SystemExit(f"{note}: no run wrote it; leave out --no-repair to repair the stage")
    content = json.loads(report.read_text()) if report.exists() else {}
    return Run(**json.loads(note.read_text()), report=content)


def files(stage: Path, folder: Path) -> tuple[Path, Path, Path]:
    """Layer, report and note of a run."""
    names = (f"{stage.stem}{end}" for end in (".usdc", ".report.json", ".run.json"))
    layer, report, note = (folder / name for name in names)
    return layer, report, note


def _session(leader: int, passed: float) -> float:
    """Processor seconds of the processes of a session so far; `passed` where /proc tells none."""
    if not Path("/proc/self/stat").exists():
        return passed
    ticks = 0
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            # The second field is a name in brackets and may hold anything.
            fields = path.read_text().rpartition(")")[2].split()
        except OSError:  # it ended meanwhile
            continue
        if int(fields[3]) == leader:
            ticks += sum(int(field) for field in fields[11:15])
    return ticks / os.sysconf("SC_CLK_TCK")


def _children() -> float:
    spent = resource.getrusage(resource.RUSAGE_CHILDREN)
    return spent.ru_utime + spent.ru_stime
