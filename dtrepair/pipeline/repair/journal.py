"""Progress of a run beside its output: solved windows and frames, from which --resume goes on."""

from __future__ import annotations

import hashlib
import json
import os
import shutil
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from dtrepair import __version__
from dtrepair.files.atomic import atomic_output, write_atomically

if TYPE_CHECKING:
    from dtrepair.repair.scene.bodies import Body

_HEADER = "run.json"


class Journal:
    """A hidden folder `.OUT.resume` with one file for each solved window or frame.

    It belongs to one input and one set of settings: `run` is a hash of both, and a folder with
    another one is not used. Nothing is made before there is something to keep. A folder that cannot
    be written is done without.

    Attributes:
        recalled: entries of an earlier run that were used.
        kept: entries that were used or made.
        warnings: one line each, about the journal that was found.
        failures: one line, if progress could not be kept.
    """

    def __init__(
        self,
        output: str,
        run: str,
        *,
        resume: bool,
        on_kept: Callable[[int], object] = lambda entries: None,
    ) -> None:
        """Find the journal of an interrupted run; one of another run is removed.

        on_kept: called with `kept` whenever that changes.
        """
        target = Path(os.path.abspath(output))
        self.folder = target.parent / f".{target.name}.resume"
        self.recalled = self.kept = 0
        self.warnings: list[str] = []
        self.failures: list[str] = []
        self._resumes = resume
        self._run = run
        self._on_kept = on_kept
        self._works = True
        if not self.folder.is_dir():
            return
        if self._header() == run:
            if not resume:
                self.warnings.append(
                    f"{output}: starting over; --resume would go on with an interrupted run"
                )
            return
        if resume:
            self.warnings.append(
                f"{output}: the interrupted run had another input or other settings, so it is not "
                "resumed; starting over"
            )
        self.remove()

    def recall(self, key: str) -> Mapping[str, NDArray[Any]] | None:
        """Arrays of an earlier run; None where there are none, or only broken ones."""
        if not self._resumes:
            return None
        try:
            with (
                open(self.folder / f"{key}.npz", "rb") as stream,
                np.load(stream, allow_pickle=False) as file,
            ):
                arrays = {name: file[name] for name in file.files}
        except (OSError, ValueError, EOFError, zipfile.BadZipFile):
            return None
        self.recalled += 1
        self._count(self.kept + 1)
        return arrays

    def keep(self, key: str, arrays: Mapping[str, NDArray[Any]]) -> None:
        """Keep arrays; a file appears whole or not at all."""
        if not self._works:
            return
        try:
            if not self.folder.is_dir():
                self.folder.mkdir()
                write_atomically(self.folder / _HEADER, json.dumps({"run": self._run}))
            with atomic_output(self.folder / f"{key}.npz") as temporary:
                with open(temporary, "wb") as file:
                    np.savez(file, allow_pickle=False, **arrays)
        except OSError as error:
            self._works = False
            reason = error.strerror or str(error)
            self.failures.append(f"{self.folder}: progress cannot be kept: {reason}")
            self.remove()
            self._count(0)
            return
        self._count(self.kept + 1)

    def _count(self, entries: int) -> None:
        self.kept = entries
        self._on_kept(entries)

    def remove(self) -> None:
        """Remove the folder: the run is done, or starts over."""
        shutil.rmtree(self.folder, ignore_errors=True)

    def _header(self) -> str | None:
        with suppress(OSError, ValueError, AttributeError):
            found = json.loads((self.folder / _HEADER).read_text(encoding="utf-8")).get("run")
            return found if isinstance(found, str) else None
        return None


def hash_of_run(
    settings: Mapping[str, Any], device: str, bodies: Sequence[Body], times: NDArray[np.float64]
) -> str:
    """A hash of all that results depend on besides the poses themselves.

    settings: of the run; poses are hashed one by one when they are looked up.
    """
    digest = hashlib.sha256()
    facts = {"version": __version__, "numpy": np.__version__, "device": device}
    digest.update(json.dumps([facts, dict(settings)], sort_keys=True, default=str).encode())
    for body in bodies:
        digest.update(f"{body.diffusion} {body.mobility} {body.rigid}".encode())
        for array in (body.rest, body.faces, body.pin, body.direction, body.layer):
            values = np.zeros(0) if array is None else np.ascontiguousarray(array)
            digest.update(f"{values.dtype.str}{values.shape}".encode())
            digest.update(values.tobytes())
    digest.update(np.ascontiguousarray(times).tobytes())
    return digest.hexdigest()
