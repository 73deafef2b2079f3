"""--skip-existing: what is there already, and whole, is not made again."""

from __future__ import annotations

import os

from dtrepair.cli.terminal.console import Console
from dtrepair.pipeline.stages.outputs import is_readable


def already_written(output: str, console: Console) -> bool:
    """Return whether an output is there and can be read; tell both that and what cannot."""
    if not os.path.exists(output):
        return False
    if is_readable(output):
        console.result(f"{output}: exists; skipped")
        return True
    console.warn([f"{output}: exists, but cannot be read: it is written again"])
    return False
