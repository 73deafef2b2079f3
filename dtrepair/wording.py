"""Numbers in sentences."""

from __future__ import annotations

from collections.abc import Sequence

# So many items of a list are named.
NAMED = 3


def counted(count: int, noun: str) -> str:
    """A number and what it counts: "1 pair", "2 pairs"."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"


def listed(items: Sequence[str], *, named: int = NAMED) -> str:
    """The first few items, and how many more there are: "a, b, c and 4 more"."""
    more = f" and {len(items) - named} more" if len(items) > named else ""
    return ", ".join(items[:named]) + more
