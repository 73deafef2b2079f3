"""What a page shows beside the numbers of a report: made by whoever has the poses."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

from dtrepair.wording import counted


def pair_name(first: str, second: str, others: int = 0) -> str:
    """Return what two objects are called together, or one with itself, and more such pairs."""
    who = f"{first} with itself" if first == second else f"{first} and {second}"
    return who + (f", and {counted(others, 'more pair')}" if others else "")


@dataclass(frozen=True, kw_only=True)
class Contact:
    """A contact event: where two things meet, or one meets itself, over some frames.

    Args:
        first: Name of one object.
        second: Name of the other; the same where it meets itself.
        frames: Numbers of the first, the last and the worst frame among those of the report.
        triangles: Intersecting triangles in the worst frame: before, and after; None where the
            report has one pose only.
        others: So many more pairs of objects meet in it in the worst frame.
        png: Its picture; empty without one.
        view: What the viewer shows, see `dtrepair.display`; None without.
    """

    first: str
    second: str
    frames: tuple[int, int, int]
    triangles: tuple[int | None, int | None]
    others: int = 0
    png: bytes = b""
    view: Mapping[str, Any] | None = None

    @property
    def between(self) -> str:
        """What meets in it, in words."""
        return pair_name(self.first, self.second, self.others)


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
