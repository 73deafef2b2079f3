"""Numbers, lengths and frames in sentences."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

# So many items of a list are named.
NAMED = 3


def counted(count: int, noun: str, several: str | None = None) -> str:
    """A number and what it counts: "1 pair", "2 pairs"; `several`: another plural."""
    return f"{count} {noun if count == 1 else several or noun + 's'}"


def length(share: float, size: float | None) -> str:
    """A length in stage units, and in per cent of the size: "1.25 (0.7 %)".

    share: the length over the size; size: in stage units, None where it is not known.
    """
    percent = f"{100.0 * share:.3g} %"
    return f"{percent} of the size" if size is None else f"{share * size:.4g} ({percent})"


def frame_list(times: Iterable[float], *, named: int = 6) -> str:
    """Frames as --frames takes them, runs of whole ones as ranges: "2, 12:19 and 4 more"."""
    runs: list[list[float]] = []
    for time in sorted(set(times)):
        if runs and time == runs[-1][-1] + 1.0 and time == round(time):
            runs[-1].append(time)
        else:
            runs.append([time])
    words, left = list[str](), list[float]()
    for run in runs:
        parts = [run] if len(run) > 2 else [[time] for time in run]
        for part in parts:
            if len(words) == named:
                left += part
                continue
            ends = dict.fromkeys(f"{time:.10g}" for time in (part[0], part[-1]))
            words.append(":".join(ends))
    return ", ".join(words) + (f" and {len(left)} more" if left else "")


def frames_named(times: Iterable[float]) -> str:
    """The same after a noun: "frame 2" or "frames 2, 12:19"; nothing without times."""
    every = set(times)
    return f"{'frame' if len(every) == 1 else 'frames'} {frame_list(every)}" if every else ""


def listed(items: Sequence[str], *, named: int = NAMED) -> str:
    """The first few items, and how many more there are: "a, b, c and 4 more"."""
    more = f" and {len(items) - named} more" if len(items) > named else ""
    return ", ".join(items[:named]) + more
