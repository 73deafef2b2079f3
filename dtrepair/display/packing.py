"""Arrays as text for a page: small numbers, compressed."""

from __future__ import annotations

import base64
import zlib
from collections.abc import Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

# What a page reads back, by the names that JavaScript has for them.
_KINDS = {"uint8": "Uint8Array", "uint16": "Uint16Array", "uint32": "Uint32Array"}


def packed(arrays: Mapping[str, NDArray[Any]]) -> dict[str, Any]:
    """Return arrays of unsigned integers as JSON values: their names, kinds, sizes; one text.

    Each starts at a multiple of four bytes. Of numbers of two bytes all low ones come first, which
    compresses better.
    """
    entries, parts = [], []
    for name, array in arrays.items():
        flat = np.ascontiguousarray(array).ravel()
        entries.append([name, _KINDS[flat.dtype.name], len(flat)])
        octets = flat.view(np.uint8)
        if flat.dtype == np.uint16:
            octets = octets.reshape(-1, 2).T.ravel()
        parts.append(octets.tobytes())
        parts.append(b"\0" * (-len(parts[-1]) % 4))
    data = base64.b64encode(zlib.compress(b"".join(parts), 9)).decode()
    return {"arrays": entries, "data": data}


def unpacked(document: Mapping[str, Any]) -> dict[str, NDArray[Any]]:
    """Return the flat arrays that `packed` was given; a page does the same."""
    octets = zlib.decompress(base64.b64decode(document["data"]))
    names = {javascript: np.dtype(name) for name, javascript in _KINDS.items()}
    arrays, start = {}, 0
    for name, kind, count in document["arrays"]:
        dtype = names[kind]
        size = count * dtype.itemsize
        part = np.frombuffer(octets[start : start + size], np.uint8)
        if dtype == np.uint16:
            part = np.ascontiguousarray(part.reshape(2, -1).T).ravel()
        arrays[name] = part.view(dtype)
        start += size + -size % 4
    return arrays


def differences(poses: NDArray[np.float64], step: float) -> NDArray[np.uint16]:
    """Return poses (T, V, 3) in steps: the first, then what changes from one to the next.

    All modulo 65536, as adding up in numbers of two bytes undoes it.
    """
    steps = np.round(poses / step).astype(np.int64)
    steps[1:] -= steps[:-1].copy()
    wrapped: NDArray[np.uint16] = (steps & 0xFFFF).astype(np.uint16)
    return wrapped
