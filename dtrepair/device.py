"""Where the work runs: device names, and a Warp that starts without a word."""

from __future__ import annotations

import os
import sys
import threading
from typing import Any

_START = threading.Lock()


def start_warp() -> Any:
    """The initialised `warp` module; it prints nothing, not even its hint about a missing driver.

    The hint comes from native code, so the file descriptor is silenced, once per process.
    """
    import warp

    with _START:
        if warp.config.log_level < warp.LOG_ERROR:
            warp.config.log_level = warp.LOG_ERROR
            sys.stderr.flush()
            saved = os.dup(2)
            sink = os.open(os.devnull, os.O_WRONLY)
            try:
                os.dup2(sink, 2)
                warp.init()
            finally:
                os.dup2(saved, 2)
                os.close(saved)
                os.close(sink)
    return warp


def resolve_device(name: str) -> str:
    """`auto`, `cpu`, `cuda` or `cuda:N` as a device that is there ("cpu" or "cuda:N").

    ValueError for an unknown name and for a CUDA device that is not there.
    """
    if name == "cpu":
        return name
    if name != "auto" and not (name == "cuda" or name.removeprefix("cuda:").isdecimal()):
        raise ValueError(f"device should be auto, cpu, cuda or cuda:N, got {name!r}")
    # Without a GPU that Warp can use there is nothing to ask PyTorch, which takes a second to load.
    if name == "auto" and start_warp().get_cuda_device_count() == 0:
        return "cpu"
    import torch

    available = torch.cuda.device_count() if torch.cuda.is_available() else 0
    if name == "auto":
        return "cuda:0" if available else "cpu"
    index = int(name.partition(":")[2] or 0)
    if index >= available:
        raise ValueError(
            f"device {name!r} is not there: PyTorch sees {available} CUDA devices; use 'cpu'"
        )
    return f"cuda:{index}"
