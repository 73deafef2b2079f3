"""The command line: one file per command, thin over `dtrepair.pipeline`.

Commands and everything heavy load when they run, so that `dtrepair --help` is quick.
"""

from __future__ import annotations

from dtrepair.cli.app import main

__all__ = ["main"]
