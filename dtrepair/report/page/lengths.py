"""Lengths on a page: in stage units, and in per cent of the size, as a terminal has them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

from dtrepair.wording import length

Record = Mapping[str, Any]


def largest_move(frame: Record) -> str:
    """The largest move of a frame, with its share of the size of the mesh that moved so far."""
    share = frame["displacement_max"]
    if share == 0.0 or not frame["prims"]:
        return _held(share, None) if share else "0"
    most = max(frame["prims"], key=_moved)
    motion = most.get("motion")
    return _held(motion["displacement_max"] if motion else share, most.get("size"))


def farthest(frame: Record) -> float:
    """How far the vertex of a frame that was moved most was moved."""
    return max((_moved(prim) for prim in frame["prims"]), default=0.0) or frame["displacement_max"]


def length_of(prims: Sequence[Record], name: str) -> str:
    """The largest value of a motion among the frames of one mesh: "" where it has none."""
    known = [prim for prim in prims if prim.get("motion")]
    if not known:
        return ""
    most = max(known, key=lambda prim: float(prim["motion"][name]))
    return _held(most["motion"][name], most.get("size"))


def _held(share: float, size: float | None) -> str:
    """A length whose per cent sign stays with its number in a narrow table."""
    return length(share, size).replace(" %", "\u00a0%")


def _moved(prim: Record) -> float:
    motion = prim.get("motion")
    return float(motion["displacement_max"]) * (prim.get("size") or 1.0) if motion else 0.0
