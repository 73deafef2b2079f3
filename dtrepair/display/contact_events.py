"""Contact events: intersecting pairs of triangles, connected on the mesh and over frames."""

from __future__ import annotations

from collections.abc import Mapping, MutableMapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray
from scipy import sparse
from scipy.sparse import csgraph

Integers = NDArray[np.integer]
NO_PAIRS = np.zeros((0, 2), dtype=np.int64)


@dataclass(frozen=True)
class FramePairs:
    """Intersecting pairs of triangles of one frame, (P, 2) before and (Q, 2) after a repair."""

    before: Integers = field(default_factory=lambda: NO_PAIRS)
    after: Integers = field(default_factory=lambda: NO_PAIRS)


@dataclass(frozen=True)
class ContactEvent:
    """One contact from its first frame to its last.

    Args:
        before: Number of a frame -> its intersecting triangles (N,) before a repair.
        after: The same after it.
    """

    before: MutableMapping[int, Integers]
    after: MutableMapping[int, Integers]

    @property
    def frames(self) -> tuple[int, ...]:
        """Numbers of the frames in which it intersects, before or after, rising."""
        return tuple(sorted({*self.before, *self.after}))

    @property
    def worst(self) -> int:
        """The frame with most triangles; what a repair left counts first."""
        return max(self.frames, key=lambda k: (self.count(k, "after"), self.count(k, "before"), -k))

    def count(self, frame: int, when: str) -> int:
        """Return how many triangles intersect in a frame, "before" or "after"."""
        return len(getattr(self, when).get(frame, ()))

    @property
    def weight(self) -> tuple[int, int]:
        """What sorts events: triangles left and triangles found, each in the worst frame."""
        most = (max((len(t) for t in f.values()), default=0) for f in (self.after, self.before))
        left, found = most
        return left, found


def contact_events(
    pairs: Mapping[int, FramePairs], faces: NDArray[np.int32], *, gap: int = 3
) -> list[ContactEvent]:
    """Return the events of a clip, the worst first.

    In a frame triangles belong together that intersect or share a vertex. Such a patch goes on with
    an event that had most of its vertices, of those that ended at most `gap` frames before; each
    event goes on with one patch.

    Args:
        pairs: Number of a frame -> its pairs of triangles; frames without any may be left out.
        faces: Triangles (F, 3).
        gap: Frames without a contact that do not end it.
    """
    events: list[ContactEvent] = []
    ends: list[tuple[int, Integers]] = []  # of each event the last frame, and its vertices there
    for number in sorted(pairs):
        patches = _patches(pairs[number], faces)
        vertices = [np.unique(faces[np.concatenate(patch)]) for patch in patches]
        open_events = [k for k, (frame, _) in enumerate(ends) if number - frame <= gap]
        known = _followed([ends[k][1] for k in open_events], vertices)
        for index, (before, after) in enumerate(patches):
            if index in known:
                event = open_events[known[index]]
            else:
                event = len(events)
                events.append(ContactEvent({}, {}))
                ends.append((number, vertices[index]))
            ends[event] = (number, vertices[index])
            for own, found in ((events[event].before, before), (events[event].after, after)):
                if len(found):
                    own[number] = found
    return sorted(events, key=lambda event: (*(-weight for weight in event.weight), event.frames))


def _patches(found: FramePairs, faces: NDArray[np.int32]) -> list[tuple[Integers, Integers]]:
    """Return the connected patches of a frame: triangles (N,) before and (M,) after."""
    each = [np.unique(pairs) for pairs in (found.before, found.after)]
    every = np.union1d(*each)
    if not len(every):
        return []
    meeting = np.concatenate([found.before, found.after])
    corners = faces[every]
    links = np.concatenate([corners[:, :2], corners[:, 1:], faces[meeting, 0]])
    nodes, ends = np.unique(links, return_inverse=True)
    ends = ends.reshape(-1, 2)
    graph = sparse.coo_matrix((np.ones(len(ends)), (ends[:, 0], ends[:, 1])), (len(nodes),) * 2)
    count, label = csgraph.connected_components(graph, directed=False)
    owner = [label[np.searchsorted(nodes, faces[triangles, 0])] for triangles in each]
    return [(each[0][owner[0] == k], each[1][owner[1] == k]) for k in range(count)]


def _followed(earlier: Sequence[Integers], later: Sequence[Integers]) -> dict[int, int]:
    """Return which of the earlier sets of vertices each of the later ones goes on with, if any."""
    shared = [
        (len(np.intersect1d(old, new)), -first, -second)
        for first, old in enumerate(earlier)
        for second, new in enumerate(later)
    ]
    known: dict[int, int] = {}
    taken = set()
    for count, first, second in sorted(shared, reverse=True):
        if count and -first not in taken and -second not in known:
            known[-second] = -first
            taken.add(-first)
    return known
