"""Measures one repaired character, or one worn thing, against what its README asks for."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from benchmarks.character_run import Run
from benchmarks.character_stages import Character, Worn
from tests.measures.crossing_numbers import crossing_numbers
from tests.measures.exact_pairs import intersecting_pairs
from tests.measures.modelled_zones import Attachment, Ties, Zones, attach, behind, drift, join_ties
from tests.measures.motion import box_diagonal, jitter, moves, spoilt_edges, volume_changes
from tests.measures.penetration import deepest_penetration
from tests.measures.surfaces import (
    Floats,
    Ints,
    Mask,
    Surface,
    make_surface,
    winding_numbers,
)

# Parts without a common bind pose are attached where they meet in this share of all frames.
NEARLY_ALL = 0.9
SAMPLES = 9  # frames that tell whether a vertex is usually inside an open part

Figures = dict[str, Any]


@dataclass(frozen=True)
class Input:
    """What is known of a stage before anything is repaired.

    pairs: intersecting pairs of triangles (K, 2) of every frame.
    real: for every frame which of them are not modelled (K,).
    usual: vertices of a part that are inside an open part anyway, once they were asked for.
    """

    character: Character
    surface: Surface
    attachments: list[Attachment]
    zones: Zones
    ties: Ties
    pairs: list[Ints]
    real: list[Mask]
    usual: dict[tuple[int, int], Mask] = field(default_factory=dict)

    def welded(self, points: Floats) -> Floats:
        """Points (V, 3) as welded points (W, 3)."""
        return points[self.surface.point_of]

    def exempt(self, part: int, other: int) -> Mask:
        """Vertices (W,) of a part that may lie in another.

        Those of zones, and of an open part those that lie in it in the bind pose, or without a
        common one in half of a few frames: a leg in its trousers.
        """
        held = self.zones.held(part, other)
        if self.surface.closed[other]:
            return held
        if (part, other) not in self.usual:
            poses = [self.character.poses[k] for k in self._sample()]
            first, second = self.skeleton(part), self.skeleton(other)
            if first == second != "":
                poses = [self.character.rest]
            count = np.zeros(len(held), dtype=np.int64)
            for points in poses:
                count[behind(self.surface, self.welded(points), part, other)] += 1
            self.usual[part, other] = 2 * count >= len(poses)
        return np.asarray(held | self.usual[part, other])

    def skeleton(self, part: int) -> str:
        """The skeleton whose bind pose a part has, "" without."""
        face = int(self.surface.triangles(part)[0])
        return self.character.skeleton[int(self.character.owner[self.character.faces[face, 0]])]

    def _sample(self) -> Ints:
        count = len(self.character.poses)
        return np.unique(np.linspace(0, count - 1, SAMPLES).astype(np.int64))

    def pairs_of(self, points: Floats) -> Ints:
        """Intersecting pairs (K, 2) of points (V, 3)."""
        return _pairs(self.character, self.surface, points, slice(None))


def study(character: Character, *, at_rest: bool = False) -> Input:
    """Count every frame, and find the modelled contacts.

    at_rest: they are those of the points at the default time, whatever the frames have.
    """
    surface = make_surface(character.rest, character.faces, character.owner)
    pairs = [_pairs(character, surface, points, slice(None)) for points in character.poses]
    if at_rest:
        met = _pairs(character, surface, character.default, slice(None))
        attachments = attach(surface, character.default[surface.point_of], met)
    else:
        attachments = _attachments(character, surface, pairs)
    zones = Zones(surface, attachments)
    return Input(
        character=character,
        surface=surface,
        attachments=attachments,
        zones=zones,
        ties=join_ties([own.ties for own in attachments]),
        pairs=pairs,
        real=[~zones.modelled(own) for own in pairs],
    )


def _pairs(character: Character, surface: Surface, points: Floats, faces: Ints | slice) -> Ints:
    """Intersecting pairs (K, 2) among some of the triangles of points (V, 3)."""
    return intersecting_pairs(points, character.faces[faces], surface.vertex_of, character.owner)


def _attachments(character: Character, surface: Surface, pairs: list[Ints]) -> list[Attachment]:
    """Parts that meet in a common bind pose; without one, those that meet in nearly all frames."""
    names = np.array(character.skeleton)
    skeleton = names[character.owner[character.faces[:, 0]]]
    found: list[Attachment] = []
    for name in sorted(set(character.skeleton) - {""}):
        own = np.flatnonzero(skeleton == name)
        met = _pairs(character, surface, character.rest, own)
        found += attach(surface, character.rest[surface.point_of], own[met])
    meetings: dict[tuple[int, int], list[tuple[int, int]]] = {}
    for frame, every in enumerate(pairs):
        kind = skeleton[every]
        free = every[(kind[:, 0] != kind[:, 1]) | (kind[:, 0] == "")]
        parts = np.sort(surface.part_of_face[free], axis=1)
        met, counts = np.unique(parts, axis=0, return_counts=True)
        for (a, b), count in zip(met.tolist(), counts.tolist(), strict=True):
            meetings.setdefault((a, b), []).append((count, frame))
    for (a, b), frames in sorted(meetings.items()):
        if a != b and len(frames) >= NEARLY_ALL * len(pairs):
            frame = min(frames)[1]
            of = np.sort(surface.part_of_face[pairs[frame]], axis=1)
            own = pairs[frame][(of == (a, b)).all(axis=1)]
            found += attach(surface, character.poses[frame][surface.point_of], own)
    return found


def deepest_window(known: Input, count: int) -> Ints:
    """Frames of the run of `count` that has most real pairs."""
    numbers = np.array([int(own.sum()) for own in known.real])
    count = min(count, len(numbers))
    sums = np.convolve(numbers, np.ones(count), mode="valid")
    return np.arange(count) + int(np.argmax(sums))


def input_figures(known: Input, frames: Ints) -> Figures:
    """Figures of the input alone; lists have one value for each frame."""
    real = [int(known.real[k].sum()) for k in frames]
    depth = []
    for k in frames:
        points = known.character.poses[k]
        unwanted = known.pairs[k][known.real[k]]
        deep = deepest_penetration(known.surface, known.welded(points), unwanted, known.exempt)
        depth.append(deep / box_diagonal(points))
    return {
        "times": known.character.times[frames].tolist(),
        "frames": len(frames),
        "triangles": len(known.character.faces),
        "parts": known.surface.parts,
        "closed_parts": int(known.surface.closed.sum()),
        "attachments": len(known.attachments),
        "ties": len(known.ties.vertices),
        "zone_share": _zone_share(known),
        "real_before": real,
        "modelled_before": [len(known.pairs[k]) - n for k, n in zip(frames, real, strict=True)],
        "depth": depth,
    }


def _zone_share(known: Input) -> float:
    """Share of the triangles that lie in any zone."""
    if not known.attachments:
        return 0.0
    zones = [side.zone for own in known.attachments for side in own.sides]
    return float(np.any(zones, axis=0).mean())


def measure_character(known: Input, after: Floats, frames: Ints, run: Run) -> Figures:
    """Figures of a repaired character (T, V, 3); lists have one value for each frame."""
    character, surface = known.character, known.surface
    used = np.unique(character.faces)
    result: Figures = {name: [] for name in PER_FRAME}
    for points, frame in zip(after, frames, strict=True):
        before = character.poses[frame]
        old, new = known.welded(before), known.welded(points)
        pairs = known.pairs_of(points)
        real = int((~known.zones.modelled(pairs)).sum())
        slid = drift(known.ties, old, new) / box_diagonal(before)
        far = moves(before[used], points[used])
        change = volume_changes(surface, old, new)
        spoilt = spoilt_edges(surface, old, new)
        result["real_after"].append(real)
        result["modelled_after"].append(len(pairs) - real)
        result["drift_p95"].append(float(np.quantile(slid, 0.95)) if len(slid) else 0.0)
        result["drift_max"].append(float(slid.max(initial=0.0)))
        result["edges"].append(spoilt)
        result["edges_share"].append(spoilt / len(surface.edges))
        result["volume"].append(float(np.nanmax(np.abs(change), initial=0.0)))
        result["move_max"].append(float(far.max()))
        result["move_mean"].append(float(far.mean()))
    result["jitter"] = jitter(character.poses[frames][:, used], after[:, used])
    return {**result, **_said(known, run, frames, result)}


PER_FRAME = (
    *("real_after", "modelled_after", "drift_p95", "drift_max", "edges", "edges_share"),
    *("volume", "move_max", "move_mean"),
)


def _said(known: Input, run: Run, frames: Ints, after: Figures) -> Figures:
    """What a run cost and said, and in how many frames it said what is not so.

    after: what is left in each frame, modelled or not.
    """
    left = after["real_after"]
    total = [sum(own) for own in zip(left, after["modelled_after"], strict=True)]
    times = known.character.times[frames].tolist()
    before = [len(known.pairs[frame]) for frame in frames]
    miscounted = sum(
        [run.pairs("before", time), run.pairs("after", time)] != counts
        for time, *counts in zip(times, before, total, strict=True)
    )
    statuses = [run.statuses.get(time, "missing") for time in times]
    wrong = sum(
        status == "clean" and count > 0 for status, count in zip(statuses, left, strict=True)
    )
    return {
        "code": run.code,
        "told": run.told(),
        "statuses": {name: statuses.count(name) for name in sorted(set(statuses))},
        "wrongly_clean": wrong,
        "miscounted": miscounted,
        "wrong_exit": bool(run.code == 0 and any(left)),
        "seconds_per_frame": run.seconds / max(len(times), 1),
    }


def measure_worn(known: Input, worn: list[Worn], after: Floats, frames: Ints, run: Run) -> Figures:
    """Figures of a repaired stage (T, V, 3) with something worn; lists as above."""
    character = known.character
    vertices = np.concatenate([own.vertices for own in worn])
    rest = [_crossings(own, character.in_world(character.default, 0), 0) for own in worn]
    if not worn or not all(any(loop) for own in rest for loop in own):
        raise ValueError(f"{character.path}: a loop of what is worn goes round no core in the rest")
    result: Figures = {"crossings_rest": rest, "crossings": [], "worn": []}
    result |= {name: [] for name in ("inside_before", "inside_after", "inside_new", "worn_move")}
    result |= {"real_after": [], "modelled_after": [], "move_max": [], "edges": []}
    for points, frame in zip(after, frames, strict=True):
        before = character.poses[frame]
        index = int(frame) + 1
        now = [_crossings(own, character.in_world(points, int(frame)), index) for own in worn]
        was, still = (_inside(known, vertices, own) for own in (before, points))
        far = moves(before, points)
        result["crossings"].append(now)
        result["worn"].append(now == rest)
        result["inside_before"].append(int(was.sum()))
        result["inside_after"].append(int(still.sum()))
        result["inside_new"].append(int((still & ~was).sum()))
        result["worn_move"].append(float(far[vertices].max()))
        result["move_max"].append(float(far.max()))
        pairs = known.pairs_of(points)
        real = int((~known.zones.modelled(pairs)).sum())
        result["real_after"].append(real)
        result["modelled_after"].append(len(pairs) - real)
        old, new = known.welded(before), known.welded(points)
        result["edges"].append(spoilt_edges(known.surface, old, new))
    result["jitter"] = jitter(character.poses[frames][:, vertices], after[:, vertices])
    return {**result, **_said(known, run, frames, result)}


def _crossings(worn: Worn, points: Floats, index: int) -> list[list[int]]:
    return crossing_numbers(worn.cores[index], [points[loop] for loop in worn.loops])


def _inside(known: Input, vertices: Ints, points: Floats) -> Mask:
    """Which of the vertices (N,) lie inside a closed part other than their own."""
    surface = known.surface
    welded = known.welded(points)
    part = surface.part_of_vertex[surface.vertex_of[vertices]]
    result = np.zeros(len(vertices), dtype=bool)
    for closed in np.flatnonzero(surface.closed).tolist():
        asked = (part != closed) & ~result
        if closed in part or not asked.any():
            continue
        triangles = welded[surface.faces[surface.triangles(closed)]]
        result[asked] = np.abs(winding_numbers(points[vertices[asked]], triangles)) > 0.5
    return result
