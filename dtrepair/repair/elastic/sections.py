"""Sections of limbs that lie in each other, each led out as a whole the way of least overlap.

A push follows the gradient of what overlaps, which has no way to tell where two limbs cross like an
X: what one step gains the next one loses. Here each contact is asked once which way is short.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from dtrepair.intersect.topology.components import link_labels
from dtrepair.numerics.geometry import FloatArray, IntArray, cross, lengths, unit_vectors
from dtrepair.repair.surface.defects import near_contacts
from dtrepair.repair.surface.surface import BoolArray, Surface
from dtrepair.repair.surface.winding import winding_numbers


@dataclass(frozen=True, kw_only=True)
class SectionOptions:
    """How sections are led apart.

    Args:
        rounds: At most so many times; the pose with the fewest contacts is taken, ...
        patience: ... which is sought for so many rounds, ...
        left: ... if it has at most this share of them: layers of clothes have no sections.
        near: Contacts within so many edge rings are creases, which have no two sides.
        least: What fewer pairs connect is left to the push.
        rings: Sections reach so many edge rings beyond what crosses or is buried.
        ways: Directions, spread over the sphere, that are tried beside the sections' own axes.
        against: Most that a direction may lead the sections deeper into each other, as the cosine
            with the mean of their vector areas, by their areas: a fingertip is drawn out of a
            belly, not pushed on.
        column: Width of the columns in which overlaps are measured, mean edge lengths.
        step: Longest way of two sections in a round, units of the size.
        farthest: No vertex goes farther in a round, units of the size.
        columns: Sections are at most so many columns wide, which are wider beyond, ...
        points: ... and about so many of the points of each are looked at.
        numbers: At most so many numbers are kept: of large meshes only what most pairs connect.
        beyond: Sections go so much farther than their overlap, units of the size.
        soft: How far ways that hinder each other give way, next to what each would cost alone.
    """

    rounds: int = 6
    patience: int = 3
    left: float = 0.3
    near: int = 20
    least: int = 3
    rings: int = 3
    ways: int = 64
    against: float = 0.15
    column: float = 1.5
    step: float = 0.02
    farthest: float = 0.1
    columns: int = 100
    points: int = 4000
    numbers: int = 2 * 10**7
    beyond: float = 0.002
    soft: float = 0.03


class _Section(NamedTuple):
    """Vertices of a section, the points (P, 3) that it reaches, and which way out it faces (3,).

    That is the mean of its vector areas, by their lengths: 0 of what goes all round a limb.
    """

    vertices: NDArray[np.intp]
    reached: FloatArray
    facing: FloatArray


class _Meeting(NamedTuple):
    """Two sections that meet, the direction (3,) in which the first one leaves, and how far."""

    first: NDArray[np.intp]
    second: NDArray[np.intp]
    way: FloatArray
    length: float


def sections_apart(
    surface: Surface, points: FloatArray, *, options: SectionOptions = SectionOptions()
) -> FloatArray | None:
    """Return a pose (V, 3) with far fewer contacts between limbs; None where there is none.

    In each round all sections go at once, the displacements u being those with the least
    u' A M^-1 A u, A = M + lambda L, that lead each pair of them apart along its way.
    """
    start, best, counts = points, points, list[int]()
    for _ in range(options.rounds + 1):
        pairs = surface.contacts.pairs(points)
        between = pairs[_between_limbs(surface, pairs, options.near)]
        if len(between) < min(counts, default=len(between) + 1):
            best = points
        counts.append(len(between))
        stalled = len(counts) - 1 - int(np.argmin(counts))
        if len(between) == 0 or len(counts) > options.rounds or stalled >= options.patience:
            break
        meetings = _meetings(surface, points, pairs, between, options)
        if not meetings:
            break
        points = points + _displacement(surface, meetings, options)
    return best if min(counts) <= options.left * counts[0] and best is not start else None


def _between_limbs(surface: Surface, pairs: IntArray, near: int) -> BoolArray:
    """Return which pairs (K,) are contacts of two limbs of one character, no creases."""
    cluster = surface.cluster_of_body[surface.body_of[pairs]]
    one: BoolArray = cluster[:, 0] == cluster[:, 1]
    return one & ~near_contacts(surface, pairs, near)


def _meetings(
    surface: Surface,
    points: FloatArray,
    pairs: IntArray,
    between: IntArray,
    options: SectionOptions,
) -> list[_Meeting]:
    """Return the sections of a pose (V, 3) that meet in the pairs (K, 2) `between` limbs."""
    inside = surface.vertices_of(between) | (winding_numbers(surface, points, pairs) > 0)
    # What is tied together, as a hand and its glove, is one section.
    edges = surface.linked[inside[surface.linked].all(axis=1)]
    labels = link_labels(edges, surface.count, device=surface.device)
    sides = np.sort(labels[surface.faces[between][:, :, 0]], axis=1)
    met, counts = np.unique(sides[sides[:, 0] != sides[:, 1]], axis=0, return_counts=True)
    areas = surface.vector_areas(points)

    def section(label: int) -> _Section:
        own = inside & (labels == label)
        out = areas[own]
        facing = out.sum(axis=0) / (lengths(out).sum() + 1e-30)
        return _Section(np.flatnonzero(own), points[surface.dilate(own, options.rings)], facing)

    width = options.column * surface.edge_length
    most = max(1, options.numbers // surface.count)
    several = np.flatnonzero(counts >= options.least)
    if len(several) > most:
        several = np.sort(several[np.argsort(-counts[several], kind="stable")[:most]])
    found = [_meeting(section(a), section(b), width, options) for a, b in met[several].tolist()]
    return [meeting for meeting in found if meeting is not None]


def _meeting(
    first: _Section, second: _Section, width: float, options: SectionOptions
) -> _Meeting | None:
    """Return two sections that meet and their shortest way; None where no column holds both."""
    ways = _directions(first.reached, second.reached, options.ways)
    ways = ways[ways @ (second.facing - first.facing) >= -2.0 * options.against]
    one, other = (own.reached[:: 1 + len(own.reached) // options.points] for own in (first, second))
    span = float(np.ptp(np.concatenate([one, other]), axis=0).max())
    overlaps = overlaps_along(one, other, ways, max(width, span / options.columns))
    if not np.isfinite(overlaps).any():
        return None
    best = int(overlaps.argmin())
    return _Meeting(first.vertices, second.vertices, ways[best], float(overlaps[best]))


def _directions(first: FloatArray, second: FloatArray, count: int) -> FloatArray:
    """Return directions (N, 3) that two sets of points may leave each other in.

    The axes of either, what is across the long axes of both, and `count` ones evenly spread.
    """
    own = [
        np.linalg.svd(some - some.mean(axis=0), full_matrices=False)[2] for some in (first, second)
    ]
    across = cross(own[0][:2, None], own[1][None, :2]).reshape(-1, 3)
    special = np.concatenate([*own, across[lengths(across) > 0.2]])
    height = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = np.pi * (1.0 + np.sqrt(5.0)) * (np.arange(count) + 0.5)
    flat = np.sqrt(1.0 - height**2)
    spread = np.stack([flat * np.cos(turn), flat * np.sin(turn), height], axis=1)
    return np.concatenate([unit_vectors(special), -unit_vectors(special), spread])


def overlaps_along(
    first: FloatArray, second: FloatArray, directions: FloatArray, width: float
) -> FloatArray:
    """Return how far (N,) points (P, 3) have to go along unit directions (N, 3) to pass others.

    Points only pass those (Q, 3) in the same column along the direction, of this width. Infinite
    where no column holds some of both.
    """
    # Two axes across each direction.
    least = np.eye(3)[np.abs(directions).argmin(axis=1)]
    side = unit_vectors(cross(directions, least))
    axes = np.stack([side, cross(directions, side)], axis=1)
    columns = [np.floor(np.einsum("nkj,pj->npk", axes, some) / width) for some in (first, second)]
    corner = np.minimum(*(cells.min(axis=1) for cells in columns))
    cells = [(some - corner[:, None]).astype(np.int64) for some in columns]
    across = 1 + int(max(some.max() for some in cells))
    size = across * across
    row = np.arange(len(directions))[:, None] * size
    keys = [row + some[:, :, 0] * across + some[:, :, 1] for some in cells]
    low, high = np.full(len(directions) * size, np.inf), np.full(len(directions) * size, -np.inf)
    np.minimum.at(low, keys[0], directions @ first.T)
    np.maximum.at(high, keys[1], directions @ second.T)
    overlap = np.where(np.isfinite(low) & np.isfinite(high), high - low, -np.inf)
    result: FloatArray = overlap.reshape(len(directions), size).max(axis=1)
    return np.where(np.isfinite(result), result, np.inf)


def _displacement(
    surface: Surface, meetings: list[_Meeting], options: SectionOptions
) -> FloatArray:
    """Return the least displacement (V, 3) that leads sections apart, each pair along its way.

    The mean of the first of two, by its mass, goes farther than that of the second by the length
    of the way, at least.
    """
    difference = np.zeros((surface.count, len(meetings)))
    for index, (first, second, _, _) in enumerate(meetings):
        difference[first, index] += surface.mass[first] / surface.mass[first].sum()
        difference[second, index] -= surface.mass[second] / surface.mass[second].sum()
    mobility = np.where(surface.stiff, 0.0, surface.mobility)[:, None]
    difference *= mobility
    moved = surface.diffuse(difference)
    ways = np.stack([meeting.way for meeting in meetings])
    wanted = np.array([meeting.length + options.beyond for meeting in meetings])
    wanted = np.clip(wanted, 0.0, options.step)
    gains = (ways @ ways.T) * (difference.T @ moved)
    # What cannot move at all has no gain.
    alone = gains.diagonal() + 1e-9 * gains.trace() + 1e-300
    # Forces f >= 0 with the least f'(G + soft diag G)f / 2 - f'w.
    root = np.linalg.cholesky(gains + np.diag(options.soft * alone))
    forces, _ = nnls(root.T, np.linalg.solve(root, wanted))
    result: FloatArray = mobility * ((moved * forces) @ ways)
    # What hardly may move where it is in contact would throw what is around it.
    return result * min(1.0, options.farthest / (float(lengths(result).max()) + 1e-300))
