"""Running the command line inside the test process, and small inputs for it."""

from __future__ import annotations

import contextlib
import io
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from dtrepair.cli import main
from tests.meshes import bent_tube, tube_quads

# A tube of 192 quads bent by these angles: the ends pass through each other beyond 2 pi.
OPEN, CLOSED = 5.0, 6.5
AROUND, ALONG = 8, 24


@dataclass(frozen=True)
class Outcome:
    """How a run ended."""

    code: int
    out: str
    err: str

    @property
    def json(self) -> dict[str, Any]:
        """Standard output as JSON."""
        result: dict[str, Any] = json.loads(self.out)
        return result


def run(*arguments: object) -> Outcome:
    """Run `dtrepair` with arguments; what it prints is caught."""
    out, err = io.StringIO(), io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main([str(argument) for argument in arguments])
        except SystemExit as done:
            code = done.code
    assert isinstance(code, int)
    return Outcome(code, out.getvalue(), err.getvalue())


def assert_fails(outcome: Outcome, code: int, *words: str) -> None:
    """The run ended with a code and one line on stderr that holds all words; nothing on stdout."""
    assert outcome.code == code, outcome
    lines = [line for line in outcome.err.splitlines() if line]  # click ends the line of ^C first
    lines = [line for line in lines if not line.endswith("is replaced when this run is done")]
    assert len(lines) == 1 and lines[0].startswith("dtrepair: error: "), outcome.err
    for word in words:
        assert word in lines[0], lines[0]
    assert outcome.out == ""


def tube_pose(angle: float) -> NDArray[np.float64]:
    """Points (V, 3) of the bent tube."""
    return bent_tube(angle, AROUND, ALONG)[0]


def swaying(frames: int) -> list[float]:
    """Angles of a clip whose ends just meet in each eighth frame: little work for a repair."""
    return [6.1 + 0.2 * math.sin(0.8 * frame) for frame in range(frames)]


def tube_polygons() -> NDArray[np.int32]:
    """Quads (192, 4) of the tube."""
    return tube_quads(AROUND, ALONG)[1]


def write_obj(path: Path, points: NDArray[np.float64], faces: NDArray[np.int32]) -> Path:
    """Write an OBJ by hand, with full digits."""
    lines = [f"v {x!r} {y!r} {z!r}" for x, y, z in points.tolist()]
    lines += ["f " + " ".join(str(v + 1) for v in face) for face in faces.tolist()]
    path.write_text("\n".join(lines) + "\n")
    return path


def tube_obj(path: Path, angle: float = CLOSED) -> Path:
    """The bent tube as an OBJ of quads."""
    return write_obj(path, tube_pose(angle), tube_polygons())


def tube_stage(
    path: Path,
    angles: Sequence[float] = (OPEN, CLOSED, CLOSED + 0.1),
    *,
    rest: float | None = OPEN,
    times: Sequence[float] | None = None,
) -> Path:
    """A stage with the tube as /Root/Tube, one angle a time code, from 1; quads."""
    from usd_io import AuthoredMesh, write_animation

    mesh = AuthoredMesh(
        path="/Root/Tube",
        faces=tube_polygons(),
        points=[tube_pose(angle) for angle in angles],
        rest=None if rest is None else tube_pose(rest),
    )
    codes = np.arange(1.0, len(angles) + 1.0) if times is None else np.asarray(times)
    write_animation(path, mesh, times=codes)
    return path


def read_samples(path: Path, prim: str = "/Root/Tube") -> dict[float, NDArray[np.float32]]:
    """All composed point samples of a mesh by time code."""
    from pxr import Usd

    stage = Usd.Stage.Open(str(path))
    attribute = stage.GetPrimAtPath(prim).GetAttribute("points")
    return {time: np.array(attribute.Get(time)) for time in attribute.GetTimeSamples()}
