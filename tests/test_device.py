"""Device names, and the silent start of Warp."""

from __future__ import annotations

import atexit
import os
import stat
import subprocess
import sys
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NoReturn

import numpy as np
import pytest
import torch

from dtrepair import device
from dtrepair.device import DeviceQueue, out_of_memory, resolve_device, start_warp
from dtrepair.pipeline.errors import OutputError, plain_error


def pretend(monkeypatch: pytest.MonkeyPatch, count: int) -> None:
    """Let Warp and PyTorch see `count` CUDA devices."""
    warp = SimpleNamespace(get_cuda_device_count=lambda: count)
    monkeypatch.setattr(device, "start_warp", lambda: warp)
    monkeypatch.setattr(torch.cuda, "is_available", lambda: count > 0)
    monkeypatch.setattr(torch.cuda, "device_count", lambda: count)


def test_cpu_is_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 2)
    assert resolve_device("cpu") == "cpu"


def test_auto_takes_the_first_gpu_or_the_cpu(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 0)
    assert resolve_device("auto") == "cpu"
    pretend(monkeypatch, 2)
    assert resolve_device("auto") == "cuda:0"


def test_cuda_with_and_without_a_number(monkeypatch: pytest.MonkeyPatch) -> None:
    pretend(monkeypatch, 2)
    assert resolve_device("cuda") == "cuda:0"
    assert resolve_device("cuda:1") == "cuda:1"


@pytest.mark.parametrize("name", ["gpu", "cuda:", "cuda:x", "cuda:-1", "", "CPU", "cuda1"])
def test_unknown_names_are_named(name: str) -> None:
    with pytest.raises(ValueError, match="device should be auto, cpu, cuda or cuda:N, got"):
        resolve_device(name)


@pytest.mark.parametrize(("name", "count"), [("cuda", 0), ("cuda:2", 2)])
def test_devices_that_are_not_there_are_named(
    monkeypatch: pytest.MonkeyPatch, name: str, count: int
) -> None:
    pretend(monkeypatch, count)
    with pytest.raises(ValueError, match=f"PyTorch sees {count} CUDA devices; use 'cpu'"):
        resolve_device(name)


def test_warp_starts_silently() -> None:
    code = (
        "import numpy as np\n"
        "from dtrepair import find_intersections\n"
        "from dtrepair.device import start_warp\n"
        "assert start_warp() is start_warp()\n"
        "find_intersections(np.eye(3), [[0, 1, 2]])\n"
    )
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert (run.stdout, run.stderr) == ("", "")


def test_standard_error_still_works_after_the_start() -> None:
    code = "import sys; from dtrepair.device import start_warp; start_warp(); sys.stderr.write('x')"
    run = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert run.stderr == "x"


def test_start_warp_is_the_module() -> None:
    import warp

    assert start_warp() is warp


class Refusing(DeviceQueue):
    """A queue as on a GPU, whose driver answers a capture with an error."""

    def __init__(self, error: RuntimeError) -> None:
        super().__init__("cpu")
        self._torch_stream, self.error = object(), error

    def _captured(self, calls: Any) -> NoReturn:
        raise self.error


def test_work_is_repeated_as_often_as_asked() -> None:
    done: list[int] = []
    queue = DeviceQueue("cpu")
    ten = queue.repeated(lambda: done.append(1), 10)
    assert not done and not queue.refusal
    ten()
    ten()
    assert len(done) == 20


def test_a_graph_that_cannot_be_had_is_done_call_by_call_and_told() -> None:
    done: list[int] = []
    queue = Refusing(RuntimeError("operation not permitted when stream is capturing"))
    queue.repeated(lambda: done.append(1), 3)()
    assert len(done) == 3 and "not permitted" in queue.refusal


@pytest.mark.parametrize(
    "error",
    [
        torch.OutOfMemoryError("no room"),
        RuntimeError("Failed to allocate 4000 bytes on device 'cuda:0'"),
        RuntimeError("CUDA error: CUBLAS_STATUS_ALLOC_FAILED when calling `cublasCreate(handle)`"),
    ],
)
def test_lack_of_memory_is_not_taken_for_a_graph_that_cannot_be_had(error: RuntimeError) -> None:
    assert out_of_memory(error) and not out_of_memory(ValueError("memory of elephants"))
    with pytest.raises(RuntimeError, match=str(error)[:7]):
        Refusing(error).repeated(lambda: None, 3)


@pytest.mark.skipif(os.name != "posix", reason="homes of POSIX")
def test_without_a_home_kernels_are_kept_in_a_folder_of_this_user(tmp_path: Path) -> None:
    code = "from dtrepair.device import start_warp; print(start_warp().config.kernel_cache_dir)"
    without = ("WARP_CACHE_PATH", "XDG_CACHE_HOME")
    environment = {name: value for name, value in os.environ.items() if name not in without}
    run = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        env={**environment, "HOME": os.devnull, "TMPDIR": str(tmp_path)},
        cwd=Path(__file__).parents[1],
        check=False,
    )
    assert run.returncode == 0, run.stderr
    folder = tmp_path / f"dtrepair-kernels-{os.getuid()}"
    assert Path(run.stdout.strip()).parent == folder
    assert stat.S_IMODE(folder.stat().st_mode) == 0o700


@pytest.mark.skipif(os.name != "posix", reason="owners of POSIX")
def test_kernels_are_taken_from_no_folder_that_others_can_write(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", str(tmp_path))
    monkeypatch.setattr(atexit, "register", lambda *_, **__: None)
    own = Path(device.own_cache())
    assert own == Path(device.own_cache())
    own.chmod(0o777)
    other = Path(device.own_cache())
    assert other != own and stat.S_IMODE(other.stat().st_mode) == 0o700
    own.rmdir()
    own.symlink_to(other)
    assert Path(device.own_cache()) not in (own, other)


def test_an_error_says_what_to_set_where_no_folder_can_be_written(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(tempfile, "tempdir", os.devnull)
    with pytest.raises(device.KernelCacheError, match="set WARP_CACHE_PATH or TMPDIR") as caught:
        device.own_cache()
    error = plain_error(caught.value)
    assert isinstance(error, OutputError) and error.exit_code == 5


def test_views_copy_nothing_and_take_arrays_of_warp_as_they_are(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    warp, own, values = start_warp(), device.Device(), np.arange(6, dtype=np.int32)
    view = own.view(values, warp.int32)
    values[2] = 7
    assert view.numpy().tolist() == [0, 1, 7, 3, 4, 5]
    assert own.view(values[::2], warp.int32).numpy().tolist() == [0, 7, 4]

    def refused(*_: Any) -> NoReturn:
        # Warp hands no array of a GPU to NumPy.
        raise TypeError("no implicit conversion")

    monkeypatch.setattr(np, "ascontiguousarray", refused)
    assert own.view(view, warp.int32).ptr == view.ptr
