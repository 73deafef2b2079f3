"""What reaches a terminal, and streams that cannot be written to."""

from __future__ import annotations

import io
import os
import subprocess
import sys
from pathlib import Path

import pytest

from dtrepair.cli.terminal.streams import say, show_exception, shown, shown_line
from tests.command_line import CLOSED, OPEN, assert_fails, run, tube_obj, tube_stage
from tests.usd_stages import cube_file

ESCAPE = "\x1b[31m"


class Full(io.StringIO):
    """A stream on a full disk, or whose reader has gone."""

    def __init__(self, error: OSError) -> None:
        super().__init__()
        self.error = error

    def write(self, text: str) -> int:
        raise self.error


def test_control_characters_are_shown_as_escapes() -> None:
    assert shown("a\x1b[31mb\x07\x9b\r\x00") == r"a\x1b[31mb\x07\x9b\r\x00"
    assert shown("right\u202eleft\u2066\udcff") == r"right\u202eleft\u2066\udcff"
    assert shown("Käfer 名\t1\n2") == "Käfer 名\t1\n2"
    assert shown_line("a\nb") == r"a\nb"


def test_names_of_a_stage_and_of_files_reach_no_terminal(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda")
    text = path.read_text().replace('"none"', f'"no{ESCAPE}RED"')
    path = tmp_path / f"in{ESCAPE}\nforged.usda"
    path.write_text(text)
    outcome = run("check", path)
    assert outcome.code == 0 and r"(no\x1b[31mRED)" in outcome.err
    outcome = run("repair", path, "-o", tmp_path / "out.usda")
    assert outcome.code == 3 and "its path has control characters" in outcome.err
    assert sorted(os.listdir(tmp_path)) == sorted(["in.usda", path.name])
    outcome = run("repair", tmp_path / "in.usda", "-o", tmp_path / f"out{ESCAPE}.usda")
    assert outcome.code == 0 and r"out\x1b[31m.usda" in outcome.out
    assert "\x1b" not in outcome.out + outcome.err
    missing = run("check", tmp_path / f"gone{ESCAPE}\nforged.usda")
    assert_fails(missing, 3, r"gone\x1b[31m forged.usda: no such file")


def test_a_name_that_is_no_text_is_an_error_of_the_caller(tmp_path: Path) -> None:
    path = cube_file(tmp_path / "in.usda")
    outcome = run("repair", path, "-o", tmp_path / "out.usda", "--pin", "\udcff")
    assert_fails(outcome, 2, r"'\udcff' is no UTF-8 text")


def test_tracebacks_are_shown_and_what_pxr_prints_beside_its_errors_is_not(
    capsys: pytest.CaptureFixture[str],
) -> None:
    show_exception(ValueError, ValueError(ESCAPE), None)
    show_exception(
        TypeError, TypeError("No to_python (by-value) converter found for C++ type: X"), None
    )
    assert capsys.readouterr().err == "ValueError: \\x1b[31m\n"


def test_a_stream_that_cannot_be_written_stops_nothing(monkeypatch: pytest.MonkeyPatch) -> None:
    full = OSError(28, "No space left on device")
    monkeypatch.setattr(sys, "stdout", Full(full))
    assert say("text") is full
    monkeypatch.setattr(sys, "stdout", None)
    assert say("text") is not None
    ascii_only = io.TextIOWrapper(io.BytesIO(), encoding="ascii")
    monkeypatch.setattr(sys, "stdout", ascii_only)
    assert say("Käfer") is None
    ascii_only.seek(0)
    assert ascii_only.read() == "K\\xe4fer\n"


def program(*arguments: object, streams: str) -> subprocess.CompletedProcess[str]:
    """Run the program in a shell that closes or fills its streams."""
    line = f'"$0" -m dtrepair "$@" {streams}'
    environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
    return subprocess.run(
        ["sh", "-c", line, sys.executable, *map(str, arguments)],
        capture_output=True,
        text=True,
        env=environment,
        timeout=100,
        check=False,
    )


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full device here")
@pytest.mark.parametrize("streams", [">/dev/full", "2>&-", "<&- >&- 2>&-"])
def test_the_output_is_written_whatever_becomes_of_the_streams(
    tmp_path: Path, streams: str
) -> None:
    path, out = tube_stage(tmp_path / "in.usda", (OPEN,)), tmp_path / "out.usda"
    done = program("repair", path, "-o", out, streams=streams)
    assert done.returncode == 0 and out.exists(), done
    assert "Traceback" not in done.stderr


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="no full device here")
def test_results_that_are_the_output_are_missed(tmp_path: Path) -> None:
    path = tube_obj(tmp_path / "in.obj", CLOSED)
    for arguments in (["check", path], ["check", path, "--json", "-"], ["--help"]):
        done = program(*arguments, streams=">/dev/full")
        line = "dtrepair: error: standard output: cannot be written: No space left on device\n"
        assert (done.returncode, done.stderr) == (5, line)
    done = program("check", path, streams="| head -c 1; exit 0")
    assert done.stderr == "" and done.stdout == "f"
