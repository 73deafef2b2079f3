"""Outputs of a run: refused before anything is computed, and whole or not there at all."""

from __future__ import annotations

import os
from collections.abc import Iterable, Iterator
from contextlib import contextmanager

from dtrepair.pipeline.errors import OutputError, UsageError

FilePath = str | os.PathLike[str]


@contextmanager
def writing(path: FilePath) -> Iterator[None]:
    """Turn an OSError while writing `path` into an OutputError."""
    try:
        yield
    except OSError as error:
        reason = error.strerror or str(error)
        raise OutputError(f"{path}: cannot be written: {reason}; choose another place") from None


def check_writable(path: FilePath) -> None:
    """Refuse an output before any computing: no such directory, no file, no permission."""
    from dtrepair.files.atomic import atomic_output

    try:
        # A trial without the last step: it leaves nothing behind.
        with writing(path), atomic_output(path):
            raise _TrialDone
    except _TrialDone:
        pass


class _TrialDone(Exception):
    """Ends the trial of `check_writable`."""


def is_readable(path: FilePath) -> bool:
    """Return whether a path is a file that opens as a layer or mesh file."""
    from dtrepair.files.polygon_mesh import MeshFileError
    from dtrepair.pipeline.stages.sources import is_stage

    if not os.path.isfile(path):
        return False
    if is_stage(os.fspath(path)):
        from usd_io import UsdIoError, open_stage

        try:
            open_stage(path)
        except UsdIoError:
            return False
        return True
    from dtrepair.files.mesh_files import read_mesh

    try:
        read_mesh(path)
    except MeshFileError:
        return False
    return True


def refuse_overwriting(
    output: FilePath,
    *inputs: str | None,
    others: Iterable[str | None] = (),
) -> None:
    """Refuse an output that is one of the inputs, or of the `others`, outputs as well."""
    for what, names in (("an input", inputs), ("another output", others)):
        if any(name and os.path.realpath(name) == os.path.realpath(output) for name in names):
            raise UsageError(f"{output}: is {what} of this run; choose another output")


def remove_unfinished(output: FilePath) -> None:
    """Remove what this process has written of an output so far: it will exit without an end."""
    from usd_io.write.temporary import remove_own_folders

    remove_own_folders(output)
