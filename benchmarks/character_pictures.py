"""Before and after of the frame that moved most: the whole figure and a close-up of the place."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from benchmarks.character_measures import Input
from dtrepair.display.render import View, best_view, make_view, render, save_pictures
from tests.measures.motion import moves
from tests.measures.surfaces import Floats, Ints, Mask

CLOSE = 0.12  # half size of the close-up, over the diagonal
SIZE = 560  # pixels of a picture


def draw(known: Input, after: Floats, frames: Ints, folder: Path) -> Path:
    """Write FOLDER/NAME.png: four pictures, triangles of contacts that are not modelled red."""
    character = known.character
    largest = [
        moves(character.poses[frame], points).max()
        for points, frame in zip(after, frames, strict=True)
    ]
    worst = int(np.argmax(largest))
    frame = int(frames[worst])
    before, points = character.poses[frame], after[worst]
    pairs = known.pairs_of(points)
    red = [
        _mask(known, known.pairs[frame][known.real[frame]]),
        _mask(known, pairs[~known.zones.modelled(pairs)]),
    ]
    shown = [character.in_world(own, frame) for own in (before, points)]
    whole = make_view(shown, up=character.up)
    views = [whole, _close(known, shown, moves(before, points))]
    faces = character.faces.astype(np.int32)
    images = []
    for view in views:
        for own, mask in zip(shown, red, strict=True):
            seen = _near(own, faces, view)
            images.append(render(own, faces[seen], view=view, intersecting=mask[seen], size=SIZE))
    time, far = character.times[frame], largest[worst]
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{character.path.stem}.png"
    captions = [
        f"frame {time:g}: {int(known.real[frame].sum())} pairs",
        f"after: {int((~known.zones.modelled(pairs)).sum())} pairs",
        "where it moved most, before",
        f"after: moved {far:.3f}",
    ]
    save_pictures(path, images, captions=captions, columns=2)
    return path


def _mask(known: Input, pairs: Ints) -> Mask:
    mask = np.zeros(len(known.character.faces), dtype=bool)
    mask[pairs] = True
    return mask


def _near(points: Floats, faces: NDArray[np.int32], view: View) -> Mask:
    """Triangles whose centre is near the middle of a view, so that nothing hides what it shows."""
    away = points[faces].mean(axis=1) @ view.rotation.T - view.centre
    return np.asarray(np.linalg.norm(away, axis=1) < 2.0 * view.half_size)


def _close(known: Input, shown: list[Floats], far: Floats) -> View:
    """Look at the vertex that moved most, before and after, from where most of the place is seen.

    far: how much each vertex (V,) moved.
    """
    place, faces = int(np.argmax(far)), known.character.faces.astype(np.int32)
    middle = (shown[0][place] + shown[1][place]) / 2
    apart = float(np.linalg.norm(shown[0][place] - shown[1][place]))
    half = max(CLOSE * float(np.linalg.norm(np.ptp(shown[0], axis=0))), 0.8 * apart)
    close = np.linalg.norm(shown[0][faces].mean(axis=1) - middle, axis=1) < 2.0 * half
    moved = far[faces].mean(axis=1)[close] > 0.5 * far[place]
    up = known.character.up
    rotation = best_view(shown[0], faces[close], moved, up=up).rotation
    return View(rotation, rotation @ middle, half)
