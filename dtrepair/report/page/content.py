"""What a page shows beside the numbers of a report: made by whoever has the poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A contact event: where two things meet, or one meets itself, over some frames.

    Args:
        first: Name of one object.
        second: Name of the other; the same where it meets itself.
        frames: Numbers of the first, the last and the worst frame among those of the report.
        triangles: Intersecting triangles in the worst frame: before, and after; None where the
            report has one pose only.
        png: Its picture; empty without one.
        view: What the viewer shows, see `dtrepair.display`; None without.
    """

    first: str
    second: str
    frames: tuple[int, int, int]
    triangles: tuple[int | None, int | None]
    png: bytes = b""
    view: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True)
class PageContent:
    """Contacts with their pictures, and measures of the frames.

    Args:
        contacts: The worst first; those with pictures and views before those without.
        measures: By name a number for each frame of the report, or None.
        colours: Of each object in pictures, red, green and blue from 0 to 1.
    """

    contacts: Sequence[Contact] = ()
    measures: Mapping[str, Sequence[float | None]] = field(default_factory=dict)
    colours: Sequence[tuple[float, float, float]] = ()
