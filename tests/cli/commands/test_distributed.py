"""`repair --distributed`: the workers of a Dask cluster write what one run here writes."""

from __future__ import annotations

import pickle
import socket
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import numpy as np
import pytest

from dtrepair.pipeline.errors import INPUT, PipelineError
from dtrepair.pipeline.repair.distributed import repair_chunk
from dtrepair.pipeline.repair.settings import RepairSettings
from dtrepair.pipeline.repair.stage import repair_stage
from dtrepair.report.record import read_report
from tests.command_line import assert_fails, read_samples, run, swaying, tube_stage

HALF = 6  # a cut between them: two windows
FRAMES = 2 * HALF


@pytest.fixture
def taken_port() -> Iterator[None]:
    """The port of the dashboards of Dask is taken, as by another cluster."""
    with socket.socket() as other:
        with suppress(OSError):  # then somebody else has it
            other.bind(("", 8787))
            other.listen()
        yield


@pytest.fixture
def clip(tmp_path: Path) -> Path:
    angles = swaying(HALF)
    return tube_stage(tmp_path / "a.usdc", [*angles, *(-angle for angle in angles)])


# Of the cluster's own event loops, at their end.
@pytest.mark.filterwarnings("ignore::ResourceWarning", "ignore::DeprecationWarning")
@pytest.mark.usefixtures("taken_port")
def test_two_workers_write_what_one_run_writes(tmp_path: Path, clip: Path) -> None:
    reports = []
    for name, options in {"whole": [], "parts": ["--distributed", "local", "--jobs", 2]}.items():
        output, report = tmp_path / f"{name}.usdc", tmp_path / f"{name}.json"
        done = run("repair", clip, "-o", output, "--report", report, *options)
        assert done.code == 0, done
        assert f"{FRAMES} of {FRAMES} frames clean" in done.out
        reports.append(read_report(report))
    whole, parts = (read_samples(tmp_path / f"{name}.usdc") for name in ("whole", "parts"))
    assert list(whole) == list(parts)
    assert all(np.array_equal(whole[time], parts[time]) for time in whole)
    assert reports[0]["summary"]["triangles_before"] > 0
    first, second = (report["summary"] for report in reports)
    assert first.pop("contacts") == second.pop("contacts") == []
    assert first == pytest.approx(second, rel=1e-9)
    assert not list(tmp_path.glob(".*"))


def test_cluster_that_is_not_there(
    tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    done = run("repair", clip, "-o", tmp_path / "b.usdc", "--distributed", "no address")
    assert_fails(done, 2, "--distributed", "no address")
    assert not (tmp_path / "b.usdc").exists()


def test_chunks_of_its_own_are_refused(tmp_path: Path, clip: Path) -> None:
    options = ["--distributed", "local"]
    for more in (["--chunk", "1/2"], ["--resume"]):
        done = run("repair", clip, "-o", tmp_path / "b.usdc", *options, *more)
        assert_fails(done, 2, "--distributed", more[0])


def test_chunk_tells_what_was_wrong(
    tmp_path: Path, clip: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    missing = str(tmp_path / "missing.usd")
    for directory, stage, words in (
        (tmp_path, missing, "missing.usd"),
        (tmp_path / "elsewhere", str(clip), "same paths"),
    ):
        with pytest.raises(PipelineError, match=words) as caught:
            repair_chunk(
                repair_stage,
                str(directory),
                stage,
                str(tmp_path / "b.usdc"),
                RepairSettings(),
                jobs=1,
                device="auto",
            )
        assert caught.value.exit_code == INPUT
        # It comes from a worker with its code.
        assert pickle.loads(pickle.dumps(caught.value)).exit_code == INPUT
