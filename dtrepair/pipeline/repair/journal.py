"""Progress of a run beside its output: solved windows and frames, from which --resume goes on."""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import stat
import zipfile
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any, BinaryIO

import numpy as np
from numpy.typing import NDArray

from dtrepair import __version__
from dtrepair.files.atomic import atomic_output

if TYPE_CHECKING:
    from dtrepair.repair.scene.bodies import Body

_HEADER = "run.json"
# Entries, and those that a killed run was writing.
_ENTRY = re.compile(r"\.?[0-9a-f]{32}(-\w+)?\.npz")
_DIGEST = hashlib.sha256
_BLOCK = 1 << 20


class Journal:
    """A hidden folder `.OUT.resume` with one file for each solved window or frame.

    It belongs to one input and one set of settings: `run` is a hash of both, and a folder with
    another one is not used. Nothing is made before there is something to keep. A folder that cannot
    be written, or that no repair of this user made, is done without, and left as it is.

    Each entry ends with a digest of `run`, its key and its content: one without it does not count.

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
        self._output = Path(os.path.abspath(output))
        self.folder = self._output.parent / f".{self._output.name}.resume"
        self.recalled = self.kept = 0
        self.warnings: list[str] = []
        self.failures: list[str] = []
        self._run = run
        self._on_kept = on_kept
        found = self._header()
        self._works = found is not None
        self._resumes = resume and found == run
        if found is None:
            self.warnings.append(
                f"{self.folder}: progress cannot be kept: no repair of this user made it; move it "
                "away"
            )
        elif found == run and not resume:
            self.warnings.append(
                f"{output}: starting over; --resume would go on with an interrupted run"
            )
        elif found and found != run:
            if resume:
                self.warnings.append(
                    f"{output}: the interrupted run had another input or other settings, so it is "
                    "not resumed; starting over"
                )
            self.remove()

    def recall(self, key: str) -> Mapping[str, NDArray[Any]] | None:
        """Arrays of an earlier run; None where there are none, or only broken ones."""
        if not self._resumes:
            return None
        try:
            with open(self.folder / f"{key}.npz", "rb") as stream:
                size = os.fstat(stream.fileno()).st_size - _DIGEST().digest_size
                if self._digest(key, stream, size) != stream.read():
                    return None
                stream.seek(0)
                with np.load(stream, allow_pickle=False) as file:
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
            self._make()
            with (
                atomic_output(self.folder / f"{key}.npz") as temporary,
                open(temporary, "w+b") as file,
            ):
                np.savez(file, allow_pickle=False, **arrays)
                size = file.seek(0, os.SEEK_END)
                digest = self._digest(key, file, size)
                file.write(digest)
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
        """Remove the folder: the run is done, or starts over. What no repair made is left."""
        if not self._header():
            return
        with suppress(OSError):
            # The header last: without it, nothing here is known to be of a repair.
            for name in [*filter(_ENTRY.fullmatch, os.listdir(self.folder)), _HEADER]:
                os.unlink(self.folder / name)
            os.rmdir(self.folder)

    def _make(self) -> None:
        """Make the folder, unless it is there: under another name first, so that it appears whole.

        Raises OSError where something else has the name.
        """
        from usd_io.write.temporary import make_temporary_folder

        if self._header() == self._run:
            return
        made = make_temporary_folder(os.fspath(self._output))
        try:
            header = Path(made) / _HEADER
            header.write_text(json.dumps({"program": "dtrepair", "run": self._run}))
            os.rename(made, self.folder)
        except BaseException:
            shutil.rmtree(made, ignore_errors=True)
            raise

    def _header(self) -> str | None:
        """The run of the folder, "" where there is none; None where it is not of a repair.

        That is a real directory that only this user can write to, either empty or with a header.
        """
        try:
            status = os.lstat(self.folder)
        except OSError:
            return ""
        mine = not hasattr(os, "geteuid") or status.st_uid == os.geteuid()
        if not (stat.S_ISDIR(status.st_mode) and mine) or status.st_mode & 0o022:
            return None
        with suppress(OSError, ValueError, AttributeError):
            if not os.listdir(self.folder):
                return ""
            header = json.loads((self.folder / _HEADER).read_text(encoding="utf-8"))
            found = header.get("run")
            return found if isinstance(found, str) and found else None
        return None

    def _digest(self, key: str, stream: BinaryIO, size: int) -> bytes:
        """The digest of the first `size` bytes of an entry, from where reading goes on."""
        digest = _DIGEST(f"{self._run} {key} ".encode())
        stream.seek(0)
        while size > 0 and (block := stream.read(min(size, _BLOCK))):
            digest.update(block)
            size -= len(block)
        return digest.digest()


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
        choices = body.diffusion, body.mobility, body.rigid, body.of_set, body.prop
        digest.update(str(choices).encode())
        for array in (body.rest, body.faces, body.pin, body.direction, body.layer):
            values = np.zeros(0) if array is None else np.ascontiguousarray(array)
            digest.update(f"{values.dtype.str}{values.shape}".encode())
            digest.update(values.tobytes())
    digest.update(np.ascontiguousarray(times).tobytes())
    return digest.hexdigest()
