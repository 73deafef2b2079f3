"""A host without a terminal: no click, no rich, no command line is loaded."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from tests.command_line import CLOSED, tube_stage

SCRIPT = """
import signal, sys
handlers = [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
import dtrepair.pipeline
assert not {"numpy", "pxr", "torch", "scipy"} & set(sys.modules), "the import should be light"
import dtrepair.repair.repairer
heavy = {"pxr", "torch", "dtrepair.repair.clip.window_method"}
assert not heavy & set(sys.modules), "a single pose needs no stage, no tensors and no clip"
from dtrepair.pipeline import check_stage, repair_stage, join_layers, Selection
check_stage(sys.argv[1])
repair_stage(sys.argv[1], sys.argv[2], selection=Selection(frames="1"))
join_layers([sys.argv[2]], sys.argv[3])
loaded = {name for name in sys.modules if name.partition(".")[0] in ("click", "rich")}
loaded |= {name for name in sys.modules if name.startswith("dtrepair.cli")}
assert not loaded, loaded
assert handlers == [signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM)]
"""


def test_a_run_loads_no_command_line_and_no_signal_handler(tmp_path: Path) -> None:
    clip = tube_stage(tmp_path / "a.usdc", (CLOSED, CLOSED))
    arguments = [clip, tmp_path / "b.usdc", tmp_path / "c.usdc"]
    done = subprocess.run(
        [sys.executable, "-c", SCRIPT, *map(str, arguments)], capture_output=True, text=True
    )
    assert (done.returncode, done.stdout, done.stderr) == (0, "", "")
    assert arguments[2].exists()
