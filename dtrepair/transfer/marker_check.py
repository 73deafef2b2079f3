"""Misplaced and swapped markers, found by leaving each one out of the registration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from dtrepair.geometry import FloatArray, as_mesh
from dtrepair.operators import Factor
from dtrepair.transfer.arrays import Array, to_numpy
from dtrepair.transfer.markers import checked_markers
from dtrepair.transfer.registration import RegistrationSystem

# Distances relative to the diagonal of the target: a swapped pair is off by 0.1 to 0.5, good
# markers of unlike animals by 0.01 to 0.05, and by 0.1 where only the target has a hump.
SUSPECT_DISTANCE = 0.10
SUSPECT_RATIO = 8.0


@dataclass(frozen=True)
class MarkerCheck:
    """How far each marker is from where the others put it."""

    distances: FloatArray  # (K,), relative to the diagonal of the target
    suspects: tuple[int, ...]  # markers to look at
    swapped: tuple[tuple[int, int], ...]  # suspects that sit where the other belongs
    warnings: tuple[str, ...]


def check_markers(
    source: Array, source_faces: Array, target: Array, target_faces: Array, markers: Array
) -> MarkerCheck:
    """Leave-one-out distances of markers (K, 2), from the smooth part of the registration.

    One factor and K right-hand sides reduce the registration to the markers (a Schur complement);
    leaving one out is then a division. A marker is suspect if the others put it further away than
    10 % of the target's diagonal and eight times the median distance. The worst one is taken out
    before the next is judged, and comes back if the rest agrees with it, so that a wrong marker
    does not taint its neighbours. Raises ValueError as `register` does.
    """
    mesh = as_mesh(to_numpy(source), to_numpy(source_faces))
    goal = as_mesh(to_numpy(target), to_numpy(target_faces))
    rows = checked_markers(markers, len(mesh[0]), len(goal[0]))
    system = RegistrationSystem(mesh, goal, rows, smoothness=1.0, identity=1e-3)
    stiffness, load = _reduced(system)
    trusted = np.ones(len(rows), dtype=bool)
    while trusted.sum() > 3:
        distances = _distances(_offsets(stiffness, load, system.values, trusted))
        worst = int(np.where(trusted, distances, 0.0).argmax())
        if distances[worst] <= _limit(distances):
            break
        trusted[worst] = False
    _readmit(stiffness, load, system.values, trusted)
    offsets = _offsets(stiffness, load, system.values, trusted)
    distances = _distances(offsets)
    suspects = np.flatnonzero(~trusted)
    swapped = _swapped(system.values, offsets, suspects)
    return MarkerCheck(
        distances,
        tuple(map(int, suspects)),
        swapped,
        _marker_warnings(rows, distances, suspects, swapped),
    )


def _reduced(system: RegistrationSystem) -> tuple[FloatArray, FloatArray]:
    """Schur complement (K, K) of the system on its markers, and its right-hand side (K, 3)."""
    factor = Factor(system.free_matrix)
    coupling = system.coupling.toarray()
    solved = factor(np.concatenate([coupling, system.right[system.free]], axis=1))
    inner = system.matrix[system.fixed][:, system.fixed].toarray()
    stiffness = inner - coupling.T @ solved[:, :-3]
    return stiffness, system.right[system.fixed] - coupling.T @ solved[:, -3:]


def _offsets(
    stiffness: FloatArray, load: FloatArray, values: FloatArray, trusted: NDArray[np.bool_]
) -> FloatArray:
    """Where the trusted markers other than itself put each marker, minus where it is (K, 3)."""
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


def _distances(offsets: FloatArray) -> FloatArray:
    return np.linalg.norm(offsets, axis=1)


def _limit(distances: FloatArray) -> float:
    return max(SUSPECT_DISTANCE, SUSPECT_RATIO * float(np.median(distances)))


def _readmit(
    stiffness: FloatArray, load: FloatArray, values: FloatArray, trusted: NDArray[np.bool_]
) -> None:
    """Take back, closest first, the markers that the trusted ones agree with."""
    while not trusted.all():
        distances = _distances(_offsets(stiffness, load, values, trusted))
        best = int(np.where(trusted, np.inf, distances).argmin())
        if distances[best] > _limit(distances):
            return
        trusted[best] = True


def _swapped(
    values: FloatArray, offsets: FloatArray, suspects: NDArray[np.int64]
) -> tuple[tuple[int, int], ...]:
    """Pairs of suspects each of which belongs closer to the other's place than to its own."""
    predicted = values[suspects] + offsets[suspects]
    distance = np.linalg.norm(predicted[:, None] - values[suspects][None], axis=2)
    if len(suspects) < 2:
        return ()
    closest = distance.argmin(axis=1)
    return tuple(
        (int(suspects[i]), int(suspects[j]))
        for i, j in enumerate(closest)
        if i < j and closest[j] == i
    )


def _marker_warnings(
    rows: NDArray[np.int32],
    distances: FloatArray,
    suspects: NDArray[np.int64],
    swapped: tuple[tuple[int, int], ...],
) -> tuple[str, ...]:
    partner = {i: j for pair in swapped for i, j in (pair, pair[::-1])}
    warnings = []
    for index in map(int, suspects):
        cure = f"swapped with marker {partner[index]}" if index in partner else "misplaced"
        warnings.append(
            f"marker {index} (source vertex {rows[index, 0]}, target vertex {rows[index, 1]}) is "
            f"{100 * distances[index]:.0f} % of the diagonal from where the others put it: {cure}?"
        )
    return tuple(warnings)
