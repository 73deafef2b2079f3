"""What a host hears of a run, and how it ends one."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from dtrepair.pipeline.errors import Cancelled
from dtrepair.report.parts import AttachedList, PassingRecord, WornRecord
from dtrepair.report.record import FrameRecord

Item = TypeVar("Item")


@dataclass(frozen=True)
class FrameDone:
    """A frame is finished: its record, and the exception behind a failed one."""

    record: FrameRecord
    error: Exception | None = None


@dataclass(frozen=True)
class SpansDone:
    """So many of the spans between keys are looked at, and mended as far as they can be."""

    done: int
    total: int


@dataclass(frozen=True)
class Trouble:
    """An exception that the run survived; a warning says what it led to."""

    error: Exception


@dataclass(frozen=True)
class ProgressKept:
    """So many solved windows or frames lie beside the output; a resumed run goes on from them."""

    entries: int


@dataclass(frozen=True)
class ModelledFound:
    """The pairs of connected parts whose contacts are taken as modelled, once for a run."""

    attached: AttachedList


@dataclass(frozen=True)
class PassingFound:
    """Pairs of connected parts that only pass each other in the bind pose, once for a run."""

    parts: tuple[PassingRecord, ...]


@dataclass(frozen=True)
class WornFound:
    """The connected parts that are taken as worn, once for a run.

    Those that the poses show, the largest first; what the user told is not among them.
    """

    worn: tuple[WornRecord, ...]


@dataclass(frozen=True)
class SetsFound:
    """The meshes that are taken as a set around, and so as colliders, once for a run."""

    paths: tuple[str, ...]


@dataclass(frozen=True)
class PropsFound:
    """The meshes that are taken as props, and so as rigid where that does, once for a run."""

    paths: tuple[str, ...]


@dataclass(frozen=True)
class CorrectionWritten:
    """A layer of corrections is written: "shapes" or "offsets", of so many vertices and bytes.

    shapes: their number, of offsets that of frames. least: so many shapes there must be, for a
    repair is not met with fewer to its tolerance. error: the largest distance of a vertex from
    where the repair has it, as a part of the diagonal of its mesh, `size`, in stage units.
    """

    form: str
    shapes: int
    vertices: int
    bytes: int
    error: float
    size: float | None = None
    least: int = 0


@dataclass(frozen=True, eq=False)
class PairsFound:
    """The pairs (K, 2) of triangles that count in a frame of a check.

    Triangles are numbered through all meshes in a row, in the order of the report's prims;
    polygons are split into fans from their first corner.
    """

    time: float | None
    pairs: NDArray[np.int32]


Remark = (
    ModelledFound
    | PassingFound
    | WornFound
    | SetsFound
    | PropsFound
    | FrameDone
    | PairsFound
    | SpansDone
    | Trouble
    | ProgressKept
    | CorrectionWritten
)


class Observer:
    """Hears of a run, and may end it; the defaults say nothing and let it run.

    A host subclasses it and overrides what it wants to know. All methods are called from the
    thread that runs the pipeline, but `remark(ProgressKept)`, which any thread may call. An
    exception that a method raises ends the run as `Cancelled` does.
    """

    def start(self, phase: str, total: int) -> None:
        """A phase of `total` frames begins, such as "repairing"."""

    def advance(self, done: float) -> None:
        """So many frames of the phase are done, with fractions of those in work; never fewer."""

    def end(self) -> None:
        """The phase is over, also where an error ended it."""

    def warning(self, text: str) -> None:
        """Something that the user should know; the run goes on."""

    def remark(self, remark: Remark) -> None:
        """Something that a user may want to know."""

    def cancelled(self) -> bool:
        """Whether the run should end: asked between frames, and while frames are solved."""
        return False


# Hears nothing and lets every run go on.
SILENT = Observer()


class RecordingObserver(Observer):
    """Passes all that it hears on to another observer, and records the warnings for a report."""

    def __init__(self, observer: Observer) -> None:
        """Name the observer that hears of the run."""
        self._observer = observer
        self._warnings: dict[str, None] = {}

    @property
    def warnings(self) -> tuple[str, ...]:
        """All warnings so far, each once, in the order in which they were given."""
        return tuple(self._warnings)

    def start(self, phase: str, total: int) -> None:
        """Pass on that a phase begins."""
        self._observer.start(phase, total)

    def advance(self, done: float) -> None:
        """Pass on how far it is."""
        self._observer.advance(done)

    def end(self) -> None:
        """Pass on that it is over."""
        self._observer.end()

    def warning(self, text: str) -> None:
        """Record a warning, and pass it on."""
        self._warnings[text] = None
        self._observer.warning(text)

    def remark(self, remark: Remark) -> None:
        """Pass on a remark."""
        self._observer.remark(remark)

    def cancelled(self) -> bool:
        """Return whether the other observer wants the run to end."""
        return self._observer.cancelled()


class Progress:
    """The frames of one phase: tells the observer how far they are, and ends a cancelled run."""

    def __init__(self, observer: Observer, phase: str, total: int) -> None:
        """Name the phase and the number of its frames."""
        self._observer, self._phase, self._total = observer, phase, total
        self._handed_out, self._done = 0, 0.0

    def __enter__(self) -> Progress:
        """Begin the phase. Raises Cancelled where the observer wants the run to end."""
        stop_if_cancelled(self._observer)
        self._observer.start(self._phase, self._total)
        return self

    def __exit__(self, *error: object) -> None:
        """End the phase."""
        self._observer.end()

    def over(self, items: Iterable[Item]) -> Iterator[Item]:
        """Yield the items of the phase; one is done as soon as the next is asked for.

        Raises Cancelled where the observer wants the run to end.
        """
        for item in items:
            stop_if_cancelled(self._observer)
            yield item
            self._handed_out += 1
            self.ahead(0.0)

    def ahead(self, frames: float) -> None:
        """Tell how many frames' worth of work is done beyond those handed out.

        Raises Cancelled where the observer wants the run to end.
        """
        stop_if_cancelled(self._observer)
        self._done = max(self._done, min(self._handed_out + frames, self._total))
        self._observer.advance(self._done)


def stop_if_cancelled(observer: Observer) -> None:
    """Raise Cancelled where the observer wants the run to end."""
    if observer.cancelled():
        raise Cancelled("cancelled; no output was written")


def warn(observer: Observer, texts: Iterable[str]) -> None:
    """Tell the observer several warnings."""
    for text in texts:
        observer.warning(text)
