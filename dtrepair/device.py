"""Where the work runs: device names, a Warp that starts without a word, queues and graphs."""

from __future__ import annotations

import atexit
import os
import shutil
import stat
import sys
import tempfile
import threading
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

_START = threading.Lock()
# How the names of compiled modules of this program begin.
_OWN_KERNELS = "wp_dtrepair"


class KernelCacheError(Exception):
    """No folder for compiled kernels can be written."""

    exit_code = 5  # as the errors of outputs


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
                _init_with_cache(warp)
            finally:
                os.dup2(saved, 2)
                os.close(saved)
                os.close(sink)
    return warp


def _init_with_cache(warp: Any) -> None:
    """Initialise Warp; where its folder for compiled kernels cannot be written, choose another.

    A folder that holds kernels of ours is kept: others may have filled it for everybody.
    """
    try:
        warp.init()
        folder = warp.config.kernel_cache_dir
        filled = any(name.startswith(_OWN_KERNELS) for name in os.listdir(folder))
        if filled or os.access(folder, os.W_OK):
            return
    except OSError:
        pass
    warp.config.kernel_cache_dir = own_cache()
    warp.init()


def own_cache() -> str:
    """Return a folder for compiled kernels below that of temporary files, for this user alone.

    It stays, so that the next run need not compile. Raises KernelCacheError.
    """
    user = os.getuid() if hasattr(os, "getuid") else 0
    folder = os.path.join(tempfile.gettempdir(), f"dtrepair-kernels-{user}")
    try:
        with suppress(FileExistsError):
            os.mkdir(folder, 0o700)
        found = os.lstat(folder)
        # Kernels are run: a folder that anybody else could write to is none to take them from.
        if not stat.S_ISDIR(found.st_mode) or found.st_uid != user or found.st_mode & 0o077:
            folder = tempfile.mkdtemp(prefix="dtrepair-kernels-")
            atexit.register(shutil.rmtree, folder, ignore_errors=True)
    except OSError as error:
        raise KernelCacheError(
            f"no folder for compiled kernels can be written ({error.strerror}); set "
            "WARP_CACHE_PATH or TMPDIR to one that can"
        ) from error
    return folder


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


class Device:
    """Arrays and launches of Warp on one device: what stages work on has one, and they name none.

    Launches are in Warp's current stream, and what is read on the host waits for them.

    Args:
        name: "cpu" or "cuda:N".
    """

    def __init__(self, name: str = "cpu") -> None:
        self.name = name
        # A launch on the CPU runs all its threads one after the other.
        self.serial = name == "cpu"
        self._warp = start_warp()
        # To look the name up again takes a fifth of a launch.
        self._there = self._warp.get_device(name)

    def array(self, values: ArrayLike, dtype: Any) -> Any:
        """Return a copy of values on the device, as a Warp array."""
        return self._warp.array(np.ascontiguousarray(values), dtype=dtype, device=self._there)

    def view(self, values: Any, dtype: Any) -> Any:
        """Return values of the type itself as a Warp array to be read: on the CPU no copy.

        values: an array of NumPy or, as it is, of Warp on this device.
        """
        own = np.ascontiguousarray(values) if isinstance(values, np.ndarray) else values
        return self._warp.array(own, dtype=dtype, device=self._there, copy=False)

    def empty(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return a Warp array to be written."""
        return self._warp.empty(shape, dtype=dtype, device=self._there)

    def zeros(self, shape: int | tuple[int, ...], dtype: Any) -> Any:
        """Return a Warp array of zeros."""
        return self._warp.zeros(shape, dtype=dtype, device=self._there)

    def launch(self, kernel: Any, dim: int | tuple[int, ...], inputs: Sequence[Any]) -> None:
        """Launch a Warp kernel."""
        self._warp.launch(kernel, dim=dim, inputs=inputs, device=self._there)

    def load(self) -> None:
        """Compile and load what was imported of kernels, before processes are forked."""
        self._warp.force_load(self._there)


class DeviceQueue:
    """Work of PyTorch and Warp on one device, in the order it was asked for.

    On CUDA a stream of its own, given to every launch: Warp's current stream belongs to all
    threads, and another thread's detection must not end up in a graph that is being captured.
    """

    def __init__(self, device: str) -> None:
        """Take "cpu" or "cuda:N"."""
        self.device = device
        # Why the last graph could not be had; empty if none was refused.
        self.refusal = ""
        self._warp = start_warp()
        self._stream: Any = None
        self._torch_stream: Any = None
        if device != "cpu":
            import torch

            self._torch_stream = torch.cuda.Stream(device)
            self._stream = self._warp.stream_from_torch(self._torch_stream)

    def launch(self, kernel: Any, dim: tuple[int, ...], inputs: Sequence[Any]) -> None:
        """Launch a Warp kernel."""
        self._warp.launch(kernel, dim=dim, inputs=inputs, device=self.device, stream=self._stream)

    @contextmanager
    def active(self) -> Iterator[None]:
        """PyTorch works in this queue inside the block, after what was asked for before it."""
        if self._torch_stream is None:
            yield
            return
        import torch

        self._torch_stream.wait_stream(torch.cuda.current_stream(self.device))
        try:
            with torch.cuda.stream(self._torch_stream):
                yield
        finally:
            # After an error too: what the launches use may be freed from here on.
            torch.cuda.current_stream(self.device).wait_stream(self._torch_stream)

    def wait(self) -> None:
        """Wait until the device is done with all that anybody asked for."""
        if self._torch_stream is not None:
            self._warp.synchronize_device(self.device)

    def repeated(self, work: Callable[[], None], times: int) -> Callable[[], None]:
        """A function that does `work` so many times: one CUDA graph, or plain calls on the CPU.

        On CUDA `work` must have run once before, allocate by PyTorch only, and ask for no value.
        Where a driver refuses the graph, calls are plain from then on, which is slower; `refusal`
        tells why. It is not asked twice: PyTorch may keep the memory of a capture that failed.
        """

        def calls() -> None:
            for _ in range(times):
                work()

        if self._torch_stream is None or self.refusal:
            return calls
        try:
            return self._captured(calls)
        except RuntimeError as error:
            if out_of_memory(error):
                raise
            self.refusal = str(error)
            return calls

    def _captured(self, calls: Callable[[], None]) -> Callable[[], None]:
        import torch

        graph, stream = torch.cuda.CUDAGraph(), self._torch_stream
        # Other threads may use the GPU meanwhile; Warp's capture keeps its kernels loaded.
        with torch.cuda.graph(graph, stream=stream, capture_error_mode="thread_local"):
            with self._warp.ScopedCapture(
                stream=self._stream, external=True, force_module_load=False
            ) as capture:
                calls()
        kept = (graph, capture.graph)
        return lambda: kept[0].replay()


def out_of_memory(error: BaseException) -> bool:
    """Whether PyTorch, Warp or a library below them could not get memory."""
    name, text = type(error).__name__, str(error).lower()
    words = ("out of memory", "failed to allocate", "alloc_failed")
    return name == "OutOfMemoryError" or any(word in text for word in words)


def cuda_in_use() -> bool:
    """Whether this process has worked on a GPU: forked processes could not go on with that."""
    torch, warp = sys.modules.get("torch"), sys.modules.get("warp")
    if torch is not None and torch.cuda.is_initialized():
        return True
    return warp is not None and any(device.has_context for device in warp.get_cuda_devices())
