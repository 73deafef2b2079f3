"""The worker: reads a request from a folder, and tells its progress as lines of JSON on stdout."""

from __future__ import annotations

import json
import os
import sys
from pathlib import Path
from typing import Any

from ..host.exchange import read_request


def tell(event: str, **values: Any) -> None:
    """Write one line that the host reads."""
    print(json.dumps({"event": event, **values}), flush=True)


def main(folder: Path) -> int:
    """Do what a request asks; return the exit code of the process."""
    try:
        import dtrepair
        from dtrepair.pipeline import PipelineError
    except ImportError as error:
        text = f"{sys.executable} has no dtrepair ({error}); install it there: see the README"
        tell("error", message=text)
        return 70
    from .tasks import run

    tell("ready", version=dtrepair.__version__)
    try:
        tell("done", **run(read_request(folder), folder))
    except (PipelineError, ValueError) as error:
        tell("error", message=str(error))
        return 1
    except Exception as error:
        tell("error", message=f"internal error: {type(error).__name__}: {error}")
        raise
    return 0


if __name__ == "__main__":
    os.environ.setdefault("USDC_USE_PREAD", "1")
    sys.exit(main(Path(sys.argv[1])))
