"""Archives (zip, npz, bz2): refused by the sizes they announce, before anything is unpacked."""

from __future__ import annotations

import bz2
import zipfile
import zlib
from io import BytesIO

# Bytes that any archive may unpack to, and how many times its own size a larger one may. Text and
# coordinates shrink to a tenth or so; only what is made to fill a memory shrinks to a thousandth.
UNPACKED = 2**28
RATIO = 100

# What a damaged archive raises when it is read.
DAMAGE = (
    zipfile.BadZipFile,
    zlib.error,
    EOFError,
    KeyError,
    MemoryError,
    NotImplementedError,
    OSError,
    RuntimeError,
    ValueError,
)


def is_archive(data: bytes) -> bool:
    """Return whether bytes begin as those of a zip or bz2 file do."""
    return data.startswith((b"PK", b"BZh"))


def check_archive(data: bytes) -> None:
    """Raise ValueError for an archive that unpacks to far more than its size, or is damaged."""
    most = max(UNPACKED, RATIO * len(data))
    try:
        if data.startswith(b"BZh"):
            unpacked = len(bz2.BZ2Decompressor().decompress(data, most + 1))
        else:
            # The announced sizes hold: no more than that is unpacked of a member.
            with zipfile.ZipFile(BytesIO(data)) as archive:
                unpacked = sum(member.file_size for member in archive.infolist())
    except DAMAGE as error:
        raise ValueError(f"the archive is damaged ({error})") from None
    if unpacked > most:
        raise ValueError(
            f"an archive of {len(data)} bytes unpacks to {unpacked} or more: too much to be meant"
        )
