"""Threads of linear algebra: one while the library solves.

Its products are small, so that more threads only wait for each other, at full load.
"""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Iterator
from contextlib import contextmanager

from threadpoolctl import LibController, ThreadpoolController


class _SharedLimit:
    """The limit of all blocks together: BLAS and PyTorch count threads for the whole process."""

    def __init__(self) -> None:
        """No block has been entered."""
        self.lock = threading.Lock()
        self._blocks = 0
        self._blas: list[tuple[LibController, int]] = []
        self._torch_threads = 0

    def enter(self, blas: ThreadpoolController) -> None:
        """Set the limit, for PyTorch from the first block on that finds it loaded."""
        with self.lock:
            if self._blocks == 0:
                self._blas = [(library, library.num_threads) for library in blas.lib_controllers]
                for library, _ in self._blas:
                    _set_threads(library, 1)
            torch = sys.modules.get("torch")
            if torch is not None and not self._torch_threads:
                self._torch_threads = torch.get_num_threads()
                torch.set_num_threads(1)
            self._blocks += 1

    def leave(self) -> None:
        """Restore what was set before the first block, after the last."""
        with self.lock:
            self._blocks -= 1
            if self._blocks == 0:
                for library, number in self._blas:
                    _set_threads(library, number)
                if self._torch_threads:
                    sys.modules["torch"].set_num_threads(self._torch_threads)
                    self._torch_threads = 0


def _set_threads(library: LibController, number: int) -> None:
    """Set the threads of a library, and let any thread of Python set them next.

    Later versions of threadpoolctl keep that to the first thread that did, which need not be the
    one that leaves the last block.
    """
    library.set_num_threads(number)
    if hasattr(library, "clear_controlling_thread"):
        library.clear_controlling_thread()


_shared = _SharedLimit()


def _renew_lock() -> None:
    """Replace the lock in a forked process: the thread that held it is not there."""
    _shared.lock = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)


@contextmanager
def one_thread() -> Iterator[None]:
    """Keep linear algebra to one thread within the block, or the function that it decorates.

    The numbers of threads of before are restored. Blocks may be nested, and entered by several
    threads of Python: OpenMP counts its threads for each of those by itself.
    """
    controller = ThreadpoolController()
    with controller.select(user_api="openmp").limit(limits=1):
        _shared.enter(controller.select(user_api="blas"))
        try:
            yield
        finally:
            _shared.leave()
