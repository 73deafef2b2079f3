"""Target vertices held at given positions, on the factor of the free transfer."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from dtrepair.numerics.geometry import FloatArray
from dtrepair.numerics.threads import one_thread
from dtrepair.transfer.arrays import Array, floating_type, like, to_numpy
from dtrepair.transfer.deformation import Transfer
from dtrepair.transfer.gradients import stacked


class Pins:
    """Transfers poses with some target vertices pinned (contact, attachment).

    The pins' Schur complement on the transfer's factor: one back-substitution per pin at set-up,
    a small dense system per frame, never a new factorisation; so contacts may change per frame.
    A piece with a pin goes where its pins are; the others are placed as without pins. The
    transfer's `snap` has no say in a frame with pins.
    """

    @one_thread()
    def __init__(self, transfer: Transfer, vertices: Array) -> None:
        """`vertices` (P,) are target vertices, each once (ValueError otherwise)."""
        self.vertices = to_numpy(vertices)
        count = len(transfer.target)
        if self.vertices.ndim != 1 or not np.issubdtype(self.vertices.dtype, np.integer):
            raise ValueError(
                f"vertices should be integers of shape (P,), got {self.vertices.dtype} of shape "
                f"{self.vertices.shape}"
            )
        outside = self.vertices[(self.vertices < 0) | (self.vertices >= count)]
        if len(outside):
            raise ValueError(f"pins should be target vertices 0..{count - 1}, got {outside[0]}")
        if len(np.unique(self.vertices)) != len(self.vertices):
            raise ValueError("pins should be different vertices, got one twice: remove it")
        self._transfer = transfer
        loads = np.zeros((count, len(self.vertices)))
        loads[self.vertices, np.arange(len(self.vertices))] = 1.0
        self._responses = transfer.back_substitute(loads)
        self._pieces = transfer.placement.labels[self.vertices]

    @one_thread()
    def __call__(self, poses: Array, positions: Array) -> Array:
        """Return target positions (T, Vt, 3) with the pins at `positions` (T, P, 3), target units.

        A pin whose position is NaN is free in that frame. A single pose (Vs, 3) with positions
        (P, 3) gives (Vt, 3). Raises ValueError for other shapes.
        """
        frames, places = to_numpy(poses), np.asarray(to_numpy(positions), dtype=np.float64)
        single = frames.ndim == 2
        batch, wanted = (frames[None], places[None]) if single else (frames, places)
        expected = (len(batch), len(self.vertices), 3)
        if wanted.shape != expected:
            raise ValueError(f"positions should have shape {expected}, got {wanted.shape}")
        if np.isinf(wanted).any():
            raise ValueError("positions should be finite, or NaN for a pin that is free")
        count = len(self._transfer.target)
        result = np.empty((len(batch), count, 3), dtype=floating_type(frames))
        for index, (frame, place) in enumerate(zip(batch, wanted, strict=True)):
            result[index] = self._frame(frame, place)
        return like(result[0] if single else result, poses)

    def _frame(self, frame: NDArray[np.floating], place: FloatArray) -> FloatArray:
        transfer = self._transfer
        pose = transfer.turned(frame)
        stack = stacked(pose, transfer.source_faces)
        points = transfer.solve(stack)
        active = np.flatnonzero(~np.isnan(place).any(axis=1))
        if not len(active):
            return transfer.placed(points, pose, stack)
        points, held = self._hold(points, active, place[active])
        points = transfer.placed(points, pose, stack, held)
        # The dense solve leaves a rounding error; pinned means pinned.
        points[self.vertices[active]] = place[active]
        return points

    def _hold(
        self, points: FloatArray, active: NDArray[np.int64], place: FloatArray
    ) -> tuple[FloatArray, NDArray[np.bool_]]:
        """Return the solution with the active pins at their places, and the pieces they hold.

        x = x0 - Z f + N c with pin forces f that add up to zero on each piece (else the free
        system has no solution) and a translation c of each held piece.
        """
        labels = self._transfer.placement.labels
        vertices = self.vertices[active]
        held, column = np.unique(self._pieces[active], return_inverse=True)
        count = len(active)
        system = np.zeros((count + len(held), count + len(held)))
        system[:count, :count] = self._responses[vertices][:, active]
        system[np.arange(count), count + column] = -1.0
        system[count + column, np.arange(count)] = -1.0
        right = np.zeros((count + len(held), 3))
        right[:count] = points[vertices] - place
        solution = np.linalg.solve(system, right)
        shift = np.zeros((self._transfer.placement.count, 3))
        shift[held] = solution[count:]
        mask = np.zeros(self._transfer.placement.count, dtype=bool)
        mask[held] = True
        return points - self._responses[:, active] @ solution[:count] + shift[labels], mask
