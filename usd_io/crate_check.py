"""Whether the tables of a binary layer can hold what they announce, before memory is taken.

The reader of USD takes memory for as many entries as a table announces before it looks at them. So
the numbers are read here first, by the layout that OpenUSD publishes (pxr/usd/usd/crateFile.h): a
head, a table of sections, and in each section a number of entries before their compressed bytes.
"""

from __future__ import annotations

import os
import struct
import zipfile
from typing import IO, NamedTuple

from usd_io.errors import StageError

_MAGIC = b"PXR-USDC"
_HEAD = struct.Struct("<8s8Bq")
_SECTION = struct.Struct("<16sqq")
# From this version on the tables are compressed.
_COMPRESSED = (0, 4)
# A byte of LZ4 stands for at most so many, and whole numbers take at least a quarter byte before.
_LZ4 = 255
_WHOLE_NUMBERS = 4 * _LZ4
# The most entries for each byte of a section: that of its numbers that compress worst, or all.
_ENTRIES = {
    b"FIELDS": _LZ4 / 8,  # values of eight bytes
    b"FIELDSETS": _WHOLE_NUMBERS,
    b"PATHS": _WHOLE_NUMBERS / 3,  # three numbers each
    b"SPECS": _WHOLE_NUMBERS / 3,
    b"STRINGS": 1 / 4,  # not compressed
    b"TOKENS": _LZ4,
}
# Short tables have a head of their own.
_LEAST = 256


class _Section(NamedTuple):
    """A section of a crate: its name, and the bytes it has."""

    name: bytes
    start: int
    size: int


def check_crates(path: str) -> None:
    """Raise StageError for a binary layer, or a package with one, that announces too much.

    Whatever else is wrong with a file is left to the reader of USD. OSError: it cannot be read.
    """
    with open(path, "rb") as file:
        start = file.read(len(_MAGIC))
        if start == _MAGIC:
            _check_crate(path, file, os.fstat(file.fileno()).st_size)
        elif start.startswith(b"PK"):
            _check_package(path, file)


def _check_package(path: str, file: IO[bytes]) -> None:
    """Check the binary layers of a usdz, which are stored as they are."""
    try:
        with zipfile.ZipFile(file) as package:
            for entry in package.infolist():
                if entry.compress_type != zipfile.ZIP_STORED:
                    continue
                with package.open(entry) as layer:
                    if layer.read(len(_MAGIC)) == _MAGIC:
                        _check_crate(f"{path}[{entry.filename}]", layer, entry.file_size)
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, ValueError):
        return  # no package: the reader of USD tells


def _check_crate(path: str, file: IO[bytes], size: int) -> None:
    """Check the tables of a crate of so many bytes."""
    head = _read(file, 0, _HEAD.size)
    if len(head) < _HEAD.size:
        return
    _, *version, toc = _HEAD.unpack(head)
    compressed = tuple(version[:2]) >= _COMPRESSED
    for name, start, length in _sections(path, file, toc, size):
        if name not in _ENTRIES:
            continue
        count, second, third = struct.unpack("<3Q", _read(file, start, 24).ljust(24, b"\0"))
        told = name.decode().lower()
        most = max(_LEAST, (_ENTRIES[name] if compressed else 1.0) * length)
        if count > most or (compressed and name == b"PATHS" and second > most):
            raise _too_much(path, f"{max(count, second):,} {told}", length)
        if name == b"TOKENS" and second > _LZ4 * max(_LEAST, length):
            raise _too_much(path, f"{told} of {second:,} bytes", length)
        if name == b"TOKENS" and compressed and third > length:
            raise _too_much(path, f"{told} compressed to {third:,} bytes", length)


def _sections(path: str, file: IO[bytes], toc: int, size: int) -> list[_Section]:
    """Return the sections of a crate, none where it is cut before their table."""
    if not 0 < toc <= size - 8:
        return []
    (count,) = struct.unpack("<Q", _read(file, toc, 8))
    room = size - toc - 8
    if count * _SECTION.size > room:
        raise _too_much(path, f"{count:,} sections", room)
    rows = _SECTION.iter_unpack(_read(file, toc + 8, count * _SECTION.size))
    found = [_Section(name.rstrip(b"\0"), start, length) for name, start, length in rows]
    for name, start, length in found:
        if start < 0 or length < 0 or start + length > size:
            text = f"{length:,} bytes of {name.decode(errors='replace').lower()} from {start:,} on"
            raise _too_much(path, text, size)
    return found


def _read(file: IO[bytes], start: int, count: int) -> bytes:
    """Return bytes of a file, fewer at its end."""
    file.seek(start)
    return file.read(count)


def _too_much(path: str, announced: str, size: int) -> StageError:
    """Return the error for a table that announces more than its bytes can hold."""
    return StageError(
        f"{path}: cannot be opened as USD ({announced} are announced in {size:,} bytes); "
        "export it again"
    )
