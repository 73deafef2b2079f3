"""Misplaced and swapped markers, found by leaving each one out of the registration."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray, as_mesh
from dtrepair.numerics.operators import Factor
from dtrepair.transfer.arrays import Array, to_numpy
from dtrepair.transfer.matching.markers import checked_markers
from dtrepair.transfer.matching.registration import RegistrationOptions, RegistrationSystem


@dataclass(frozen=True, kw_only=True)
class MarkerCheckOptions:
    """From where on a marker is suspect.

    Args:
        distance: Least distance from where the others put a marker, diagonals of the target: a
            swapped pair is off by 0.1 to 0.5, good markers of unlike animals by 0.01 to 0.05, and
            by 0.1 where only the target has a hump.
        ratio: Least such distance next to the median of all markers.
        exchange_gain: Fraction of the energy that exchanging two markers must save. Good markers
            lose by any exchange; neighbours at 1 % of the diagonal save 7 %, distant ones 40 to
            99 %.
        registration: Its smooth part judges.
    """

    distance: float = 0.10
    ratio: float = 8.0
    exchange_gain: float = 0.05
    registration: RegistrationOptions = field(default_factory=RegistrationOptions)


@dataclass(frozen=True)
class MarkerCheck:
    """How far each marker is from where the others put it."""

    distances: FloatArray  # (K,), relative to the diagonal of the target
    suspects: tuple[int, ...]  # markers to look at
    swapped: tuple[tuple[int, int], ...]  # suspects that sit where the other belongs
    warnings: tuple[str, ...]


def check_markers(
    source: Array,
    source_faces: Array,
    target: Array,
    target_faces: Array,
    markers: Array,
    *,
    options: MarkerCheckOptions = MarkerCheckOptions(),
) -> MarkerCheck:
    """Return the suspects among markers (K, 2), by the smooth part of the registration.

    One factor and K right-hand sides reduce the registration to a quadratic energy of the marker
    positions (a Schur complement), on which every question is cheap. Swapped: exchanging the two
    lowers the energy by 5 % or more, and by more than leaving out one of them; the best exchange
    is made before the next is sought.
    Misplaced: left out, the marker is put further away by the others than 10 % of the target's
    diagonal and eight times the median distance; the worst is taken out before the next is
    judged, and comes back if the rest agrees with it, so that a wrong marker does not taint its
    neighbours. Raises ValueError as `register` does.
    """
    mesh = as_mesh(to_numpy(source), to_numpy(source_faces))
    goal = as_mesh(to_numpy(target), to_numpy(target_faces))
    rows = checked_markers(markers, len(mesh[0]), len(goal[0]))
    system = RegistrationSystem(mesh, goal, rows, options=options.registration)
    stiffness, load = _reduced(system)
    values, swapped = _exchanged(stiffness, load, system.values, options.exchange_gain)
    trusted = _trusted(stiffness, load, values, options)
    predicted = values + _offsets(stiffness, load, values, trusted)
    distances = _lengths(predicted - system.values)
    suspects = sorted({*map(int, np.flatnonzero(~trusted)), *np.array(swapped, int).ravel()})
    warnings = _marker_warnings(rows, distances, suspects, swapped)
    return MarkerCheck(distances, tuple(map(int, suspects)), swapped, warnings)


def _reduced(system: RegistrationSystem) -> tuple[FloatArray, FloatArray]:
    """Return the Schur complement (K, K) of the system on its markers, and its right side."""
    factor = Factor(system.free_matrix)
    coupling = system.coupling.toarray()
    solved = factor(np.concatenate([coupling, system.right[system.free]], axis=1))
    inner = system.matrix[system.fixed][:, system.fixed].toarray()
    stiffness = inner - coupling.T @ solved[:, :-3]
    return stiffness, system.right[system.fixed] - coupling.T @ solved[:, -3:]


def _offsets(
    stiffness: FloatArray, load: FloatArray, values: FloatArray, trusted: NDArray[np.bool_]
) -> FloatArray:
    """Return where the other trusted markers put each marker, minus where it is (K, 3)."""
    kept, removed = np.flatnonzero(trusted), np.flatnonzero(~trusted)
    offsets = np.empty_like(values)
    inner, right = stiffness[np.ix_(kept, kept)], load[kept]
    if len(removed):
        block = stiffness[np.ix_(removed, removed)]
        cross = stiffness[np.ix_(removed, kept)]
        eliminated = np.linalg.solve(block, np.concatenate([cross, load[removed]], axis=1))
        predicted = eliminated[:, -3:] - eliminated[:, :-3] @ values[kept]
        offsets[removed] = predicted - values[removed]
        inner = inner - cross.T @ eliminated[:, :-3]
        right = right - cross.T @ eliminated[:, -3:]
    # Freeing marker k alone moves it by the force on it divided by its own stiffness.
    offsets[kept] = (right - inner @ values[kept]) / np.diag(inner)[:, None]
    return offsets


def _lengths(vectors: FloatArray) -> FloatArray:
    """Return the length (K,) of each vector (K, 3)."""
    lengths: FloatArray = np.linalg.norm(vectors, axis=1)
    return lengths


def _exchanged(
    stiffness: FloatArray, load: FloatArray, values: FloatArray, least_gain: float
) -> tuple[FloatArray, tuple[tuple[int, int], ...]]:
    """Return marker positions with the swapped pairs set right, and those pairs.

    E(y) = y . A y / 2 - b . y; exchanging i and j adds (g_i - g_j) . d + c |d|^2 / 2 with
    g = A y - b, d = y_j - y_i and c = A_ii + A_jj - 2 A_ij.
    """
    values = values.copy()
    # The energy does not see a common translation, so the matrix is singular.
    lowest = np.linalg.lstsq(stiffness, load, rcond=None)[0]
    own = np.diag(stiffness)
    curvature = 0.5 * (own[:, None] + own[None] - 2.0 * stiffness)
    pairs: list[tuple[int, int]] = []
    while len(pairs) < len(values) // 2:
        force = stiffness @ values - load
        away = values - lowest
        energy = 0.5 * float((away * (stiffness @ away)).sum())
        step = values[None] - values[:, None]
        slope = np.einsum("ijk,ijk->ij", force[:, None] - force[None], step)
        change = slope + curvature * (step**2).sum(axis=2)
        # A single misplaced marker is better explained by leaving it out than by any exchange.
        alone = 0.5 * (force**2).sum(axis=1) / own
        change[-change < np.maximum(alone[:, None], alone[None])] = np.inf
        done = [index for pair in pairs for index in pair]
        change[done], change[:, done] = np.inf, np.inf
        change[np.tril_indices(len(values))] = np.inf
        first, second = map(int, np.unravel_index(change.argmin(), change.shape))
        if not change[first, second] < -least_gain * energy:
            break
        values[[first, second]] = values[[second, first]]
        pairs.append((first, second))
    return values, tuple(pairs)


def _trusted(
    stiffness: FloatArray, load: FloatArray, values: FloatArray, options: MarkerCheckOptions
) -> NDArray[np.bool_]:
    """Return the mask (K,) of the markers that agree with each other."""
    trusted = np.ones(len(values), dtype=bool)
    while trusted.sum() > 3:
        distances = _lengths(_offsets(stiffness, load, values, trusted))
        worst = int(np.where(trusted, distances, 0.0).argmax())
        if distances[worst] <= _limit(distances, options):
            break
        trusted[worst] = False
    while not trusted.all():
        distances = _lengths(_offsets(stiffness, load, values, trusted))
        best = int(np.where(trusted, np.inf, distances).argmin())
        if distances[best] > _limit(distances, options):
            break
        trusted[best] = True
    return trusted


def _limit(distances: FloatArray, options: MarkerCheckOptions) -> float:
    return max(options.distance, options.ratio * float(np.median(distances)))


def _marker_warnings(
    rows: NDArray[np.int32],
    distances: FloatArray,
    suspects: list[int],
    swapped: tuple[tuple[int, int], ...],
) -> tuple[str, ...]:
    partner = {i: j for pair in swapped for i, j in (pair, pair[::-1])}
    warnings = []
    for index in suspects:
        cure = f"swapped with marker {partner[index]}" if index in partner else "misplaced"
        warnings.append(
            f"marker {index} (source vertex {rows[index, 0]}, target vertex {rows[index, 1]}) is "
            f"{100 * distances[index]:.0f} % of the diagonal from where the others put it: {cure}?"
        )
    return tuple(warnings)
