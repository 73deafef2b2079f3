"""What a report advises: what is left or strained, in which frames, and what may be done."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from html import escape
from typing import Any

from dtrepair.diagnosis import (
    KEPT,
    LEFT_OUT,
    REMEDIES,
    Advice,
    Diagnosis,
    Status,
    Strain,
    concerns,
)

Frames = Sequence[Mapping[str, Any]]
Remedies = Mapping[Advice, str]

# So many objects are named in a line, and so many runs of frames.
NAMED, RUNS = 4, 12


def label(frame: Mapping[str, Any]) -> str:
    """Return what a frame is called: its time code, or default."""
    return "default" if frame["time"] is None else f"{frame['time']:.10g}"


def only_counts(report: Mapping[str, Any]) -> bool:
    """Return whether a report is of a run that repairs nothing: what was and what is are one."""
    return report["output"] is None and report["command"] != "repair"


def frame_links(frames: Frames, numbers: Iterable[int]) -> str:
    """Return buttons that lead to runs of frames, such as 3 to 7, and 9."""
    every = sorted(set(numbers))
    runs: list[list[int]] = []
    for number in every:
        if runs and runs[-1][-1] == number - 1:
            runs[-1].append(number)
        else:
            runs.append([number])
    links = []
    for run in runs[:RUNS]:
        name = label(frames[run[0]])
        name += f" to {label(frames[run[-1]])}" if len(run) > 1 else ""
        links.append(f'<button class=frame data-go="{run[0]}">{escape(name)}</button>')
    more = sum(len(run) for run in runs[RUNS:])
    return " ".join(links) + (f" and {more} more" if more else "")


def advice_box(
    report: Mapping[str, Any], remedies: Remedies = REMEDIES, notes: Sequence[str] = ()
) -> str:
    """Return the box on top of a page: what is to be done, frame numbers, warnings.

    notes: what else to tell, such as what the page had to leave out.
    """
    frames = report["frames"]
    lines = [*_unusable(frames), *_left(frames, remedies), *_strained(frames, remedies)]
    if only_counts(report):
        lines += _found(frames)
    texts = [*report["warnings"], *notes]
    told = lines + [f"Warning: {escape(text)}" for text in texts]
    well = "" if lines else " well"
    if not lines:
        nothing = "Nothing is left in any frame" if texts else "Nothing needs to be done"
        end = ": see what the warnings say." if texts else ": no frame has anything left."
        told.insert(0, nothing + end)
    items = "".join(f"<li>{line}</li>" for line in told)
    return f'<section class="advice{well}"><h2>What to do</h2><ul>{items}</ul></section>'


def _found(frames: Frames) -> Iterator[str]:
    hit = [k for k, frame in enumerate(frames) if frame["before"] and frame["before"]["pairs"]]
    if hit:
        yield f"{_in(frames, hit)}: intersects; <code>dtrepair repair</code> resolves it."


def _unusable(frames: Frames) -> Iterator[str]:
    messages: dict[str, list[int]] = {}
    for number, frame in enumerate(frames):
        if frame["before"] is None:
            messages.setdefault(f"{frame['status']}: {frame['message']}", []).append(number)
    for text, numbers in messages.items():
        yield f"{_in(frames, numbers)}: {escape(text)}"


def _left(frames: Frames, remedies: Remedies) -> Iterator[str]:
    """Lines of what is left, with most frames first."""
    where: dict[str, list[int]] = {}
    objects: dict[str, dict[str, None]] = {}
    for number, frame in enumerate(frames):
        if "left" not in frame:
            continue
        found = concerns(
            Diagnosis.from_document(frame["left"]), Status(frame["status"]), remedies=remedies
        )
        for advice, concerned in found.items():
            where.setdefault(advice, []).append(number)
            objects.setdefault(advice, {}).update(dict.fromkeys(concerned))
    for advice, numbers in sorted(where.items(), key=lambda item: -len(item[1])):
        named = list(objects[advice])
        more = f" and {len(named) - NAMED} more" if named[NAMED:] else ""
        end = f": <b>{escape(advice)}</b>" if advice else ""
        yield f"{_in(frames, numbers)}: {escape('; '.join(named[:NAMED]) + more)}{end}"


def _strained(frames: Frames, remedies: Remedies) -> Iterator[str]:
    """Lines of what is strained: each part and measure with its worst number."""
    found: dict[tuple[object, ...], list[tuple[int, Strain]]] = {}
    for number, frame in enumerate(frames):
        left = Diagnosis.from_document(frame["left"]) if "left" in frame else Diagnosis()
        for strain in left.strains:
            key = (strain.body, strain.part, strain.kind, left.left_out)
            found.setdefault(key, []).append((number, strain))
    for (*_, left_out), own in sorted(found.items(), key=lambda item: -len(item[1])):
        number, worst = max(own, key=lambda each: each[1].value / each[1].bound)
        end = f"{LEFT_OUT}; {remedies[Advice.TAKE_AT_ANY_COST]}" if left_out else KEPT
        at = f", worst in {frame_links(frames, [number])}" if len(own) > 1 else ""
        where = _in(frames, [each for each, _ in own])
        yield f"{where}{at}: {escape(f'{worst.where}: {worst.measure}')}: <b>{escape(end)}</b>"


def _in(frames: Frames, numbers: Sequence[int]) -> str:
    if len(frames) == 1:
        return "Here"
    noun = "Frame" if len(set(numbers)) == 1 else "Frames"
    return f"{noun} {frame_links(frames, numbers)}"
