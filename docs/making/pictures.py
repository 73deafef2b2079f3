"""Draws the pictures of the documentation: runs `dtrepair repair` on meshes made in code.

    python -m docs.making.pictures [--compare] [NAME ...]

Each picture is a row: the input, then one result for each list of options; what intersects is red.
Those of the bounds of a repair are made of shapes that no repair has touched, see `bounds`.
"""

from __future__ import annotations

import argparse
import subprocess
import sys
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from PIL import Image as Images

import usd_io
from docs.making import bounds, stages
from dtrepair.display.colours import Colours
from dtrepair.display.render import RenderOptions, View, make_view, render, save_pictures
from dtrepair.intersect.detector import Detector

Floats = NDArray[np.float64]
FOLDER = Path(__file__).parents[1] / "pictures"
# The objects of a scene, in their order: skin, shirt and trousers of a character.
COLOURS = Colours(
    surface=(0.80, 0.71, 0.64),
    objects=((0.52, 0.66, 0.74), (0.62, 0.63, 0.55)),
    back=(0.36, 0.46, 0.54),
)
# Mean difference, of 255, of pictures that show the same.
MOST_DIFFERENCE = 1.5


@dataclass(frozen=True, kw_only=True)
class Row:
    """One picture: a stage, what is run on it, and from where it is looked at.

    results: caption and options of each result; `{folder}` is that of the stage,
        `{time}` the frame.
    looks: frames, each with the azimuth in degrees that it is looked at from.
    first: caption of the input. above: the height below which nothing need be shown.
    """

    make: Callable[[Path], Path]
    results: Sequence[tuple[str, str]]
    looks: Sequence[tuple[float, float]] = ((1.0, 0.0),)
    elevation: float = 12.0
    size: int = 360
    columns: int | None = None
    first: str = "input"
    above: float = -np.inf


# The stages of the method after those that push parts out of each other.
DRAWN_BACK = " ".join(f"--skip-stage {name}" for name in ("pull-back", "relax", "edges", "unbend"))
BEFORE_AND_AFTER = partial(
    Row, results=[("repaired", "")], first="frame {time:g}", size=420, columns=4
)
ROWS = {
    "dressed": BEFORE_AND_AFTER(make=stages.dressed, looks=((5.0, 25.0), (10.0, 25.0))),
    "sleeves": BEFORE_AND_AFTER(make=stages.sleeves, looks=((12.0, 25.0), (12.0, 80.0))),
    "skirt": BEFORE_AND_AFTER(make=stages.skirt, looks=((7.0, 25.0), (7.0, 80.0))),
    "cape": BEFORE_AND_AFTER(make=stages.cape, looks=((5.0, 25.0), (5.0, 80.0))),
    "avatar": Row(
        make=stages.avatar,
        results=[
            ("--rest-contacts repair", "--rest-contacts repair --at-any-cost"),
            ("by default", ""),
        ],
        looks=((1.0, -25.0),),
        size=480,
    ),
    "how_it_works": Row(
        make=stages.hugging,
        results=[
            ("2. pushed apart, filled", DRAWN_BACK),
            ("3. drawn back, counted", ""),
        ],
        looks=((1.0, 20.0),),
        above=0.75,
        first="1. found: red",
    ),
    "mistake": Row(
        make=stages.mistake,
        results=[
            ("taken as modelled", ""),
            ("--rest apart.usda", "--rest {folder}/apart.usda"),
        ],
    ),
    "attached": Row(
        make=stages.knob,
        results=[
            ("modelled: it stays", ""),
            ("--rest-contacts repair", "--rest-contacts repair"),
        ],
    ),
    "collider": Row(
        make=stages.arm_and_ball,
        results=[
            ("both give way", ""),
            ("--collider", "--collider /Scene/Ball"),
            ("--collider --pin", "--collider /Scene/Ball --pin ends"),
        ],
    ),
    "clearance": Row(
        make=stages.arm_and_ball,
        results=[
            ("--clearance 0", "--collider /Scene/Ball"),
            ("--clearance 0.05", "--collider /Scene/Ball --clearance 0.05"),
        ],
    ),
    "rigid": Row(
        make=stages.sword,
        results=[("both give way", ""), ("--rigid", "--rigid /Scene/Sword")],
    ),
}


@dataclass(frozen=True)
class Shown:
    """All objects of a stage at one time: points, triangles, and the object of each triangle."""

    points: Floats
    faces: NDArray[np.int32]
    objects: NDArray[np.int64]

    @property
    def intersecting(self) -> NDArray[np.bool_]:
        """Which triangles intersect others."""
        found = np.zeros(len(self.faces), dtype=bool)
        found[Detector(self.points, self.faces)(self.points).ravel()] = True
        return found


def read(path: Path, time: float) -> Shown:
    """Read all meshes of a stage; none of those drawn here has a transform."""
    meshes = usd_io.read_meshes(usd_io.open_stage(path)).meshes
    points = [np.asarray(next(iter(usd_io.read_points(mesh, [time])))) for mesh in meshes]
    starts = np.cumsum([0, *map(len, points)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts[:-1], strict=True)]
    objects = np.repeat(np.arange(len(faces)), [len(own) for own in faces])
    return Shown(np.concatenate(points), np.concatenate(faces).astype(np.int32), objects)


def drawn(shown: Shown, view: View, size: int) -> NDArray[np.uint8]:
    """Draw objects in their colours, and what intersects in red."""
    return render(
        shown.points,
        shown.faces,
        view=view,
        intersecting=shown.intersecting,
        objects=shown.objects,
        size=size,
        options=RenderOptions(colours=COLOURS),
    )


def cropped(images: Sequence[NDArray[np.uint8]], margin: int = 12) -> list[NDArray[np.uint8]]:
    """Leave out the rows of pixels above and below what any of the pictures shows."""
    empty = images[0][0, 0]
    used = np.flatnonzero(np.any([(image != empty).any(axis=(1, 2)) for image in images], axis=0))
    low, high = max(used[0] - margin, 0), used[-1] + margin
    return [image[low:high] for image in images]


def repaired(stage: Path, options: str, output: Path) -> Path:
    """Run the command; 0 and 1 (something is left, which the picture shows) are fine."""
    words = options.format(folder=stage.parent).split()
    command = [sys.executable, "-m", "dtrepair", "repair", "-q", str(stage), *words]
    code = subprocess.run([*command, "-o", str(output)]).returncode
    if code not in (0, 1):
        raise SystemExit(f"{' '.join(command)}: exit code {code}")
    return output


def draw(name: str, row: Row, folder: Path) -> Path:
    """Run what a row asks for, and write FOLDER/NAME.png."""
    with tempfile.TemporaryDirectory() as temporary:
        stage = row.make(Path(temporary))
        paths = [(row.first, stage)]
        for number, (caption, options) in enumerate(row.results):
            output = Path(temporary) / f"result{number}.usdc"
            paths.append((caption, repaired(stage, options, output)))
        images, captions = [], []
        for time, azimuth in row.looks:
            seen = [(caption, read(path, time)) for caption, path in paths]
            view = make_view(
                [shown.points[shown.points[:, 1] > row.above] for _, shown in seen],
                azimuth=azimuth,
                elevation=row.elevation,
            )
            for caption, shown in seen:
                images.append(drawn(shown, view, row.size))
                captions.append(caption.format(time=time))
    path = folder / f"{name}.png"
    save_pictures(path, cropped(images), captions=captions, columns=row.columns)
    # Refined colours: else the few red pixels get that of their surroundings.
    Images.open(path).quantize(256, kmeans=2).save(path, optimize=True)
    return path


def draw_bounds(name: str, folder: Path) -> Path:
    """Write FOLDER/NAME.png of the examples of some bounds, a row for each."""
    images, captions = bounds.rows(name)
    path = folder / f"{name}.png"
    save_pictures(path, images, captions=captions, columns=3)
    # A palette would show as rings on eyes and folds; every fourth shade is as small, and unseen.
    pixels = np.asarray(Images.open(path).convert("RGB"))
    Images.fromarray(pixels // 4 * 4 + 2).save(path, optimize=True)
    return path


DRAWINGS: dict[str, Callable[[Path], Path]] = {
    **{name: partial(draw, name, row) for name, row in ROWS.items()},
    **{name: partial(draw_bounds, name) for name in bounds.EXAMPLES},
}


def differ(first: Path, second: Path) -> bool:
    """Whether two pictures show different things; edges may be off by a pixel on other machines."""
    one, other = (
        np.asarray(Images.open(path).convert("RGB"), dtype=float) for path in (first, second)
    )
    return one.shape != other.shape or float(np.abs(one - other).mean()) > MOST_DIFFERENCE


def main() -> None:
    """Draw all pictures, or those that are named; with --compare, say which are out of date."""
    parser = argparse.ArgumentParser(description=str(__doc__).splitlines()[0])
    parser.add_argument("names", nargs="*", metavar="NAME")
    parser.add_argument(
        "--compare", action="store_true", help="write nothing, exit with 1 if other"
    )
    chosen = parser.parse_args()
    old = []
    for name in chosen.names or DRAWINGS:
        if not chosen.compare:
            print(DRAWINGS[name](FOLDER), flush=True)
            continue
        with tempfile.TemporaryDirectory() as temporary:
            other = differ(DRAWINGS[name](Path(temporary)), FOLDER / f"{name}.png")
        print(f"{name}: {'is out of date' if other else 'as it is'}", flush=True)
        old += [name] if other else []
    if old:
        raise SystemExit(f"draw again: python -m docs.making.pictures {' '.join(old)}")


if __name__ == "__main__":
    main()
