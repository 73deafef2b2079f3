"""Characters as they are built, and things that are worn: repaired as a user would, then measured.

    python -m benchmarks.characters --data DIR [--only NAME ...] [--frames SPEC] [--jobs N]
        [--out FOLDER] [--no-repair] [--timeout SECONDS] [--json FILE] [--pictures FOLDER] [--where]

Every stage of DIR/characters and DIR/worn goes through `dtrepair repair STAGE -o OUT` with default
options, in a process of its own that is ended after --timeout processor seconds (default: 150, or
what the bar allows for the frames if that is more). The written layer is opened with pxr alone and
measured by `tests/measures`, which shares no code with the repair; pairs are counted by CGAL in
float32 coordinates. Values are those of the worst frame:

real pairs      pairs of triangles that share no vertex and are not modelled, before -> after
modelled        pairs that the bind pose has too, near where it has them, before -> after; where
                something is worn, those that the points at the default time have
drift           change of the offset between a vertex of an overlap and the point of the other part
                that was nearest to it in the bind pose, over the diagonal: 95 % of them / the most
edges over 4    edges that became four times longer or shorter
volume          largest change of the volume of a closed part
move            of any vertex, over the diagonal; its bar from the deepest unwanted penetration of
                the input, whose measure `tests/measures/penetration.py` tells
worn in         frames in which every loop goes round the limb as often as in the rest pose
inside          vertices of the worn thing inside the closed body, before -> after (newly inside)
jitter          rms second difference of the displacement, over the diagonal
s a frame       processor seconds of the whole command over the frames

`miscounted` frames are those in which the report counts other pairs than CGAL, modelled ones
included. (!) marks a bar that is missed; the exit code is 1 if there is one. --frames is
passed on; `worst:N` takes the N frames in a row with most real pairs. --no-repair measures what an
earlier run left in --out.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.character_measures import (
    Figures,
    Input,
    deepest_window,
    input_figures,
    measure_character,
    measure_worn,
    study,
)
from benchmarks.character_pictures import draw
from benchmarks.character_places import lines, places
from benchmarks.character_run import Run, earlier, files, repair
from benchmarks.character_stages import read_character, read_repaired, read_worn
from benchmarks.character_table import (
    CHARACTER_BARS,
    CHARACTER_COLUMNS,
    WORN_BARS,
    WORN_COLUMNS,
    character_row,
    heading,
    line,
    seconds_bar,
    worn_row,
)
from tests.measures.surfaces import Ints
from usd_io import FrameSpecError, parse_frames

LIMIT = 150.0  # processor seconds
SUFFIXES = (".usd", ".usda", ".usdc", ".usdz")


@dataclass(frozen=True)
class Order:
    """What the command line asked for."""

    out: Path
    frames: str | None
    jobs: int | None
    timeout: float | None
    again: bool
    pictures: Path | None


def main(arguments: list[str] | None = None) -> int:
    """Print both tables; 1 if a bar is missed."""
    parser = _parser()
    given = parser.parse_args(arguments)
    if given.no_repair and given.out is None:
        parser.error("--no-repair measures what an earlier run wrote: give its folder as --out")
    names = {path.stem for kind in ("characters", "worn") for path in _stages(given.data, kind)}
    missing = sorted(set(given.only or ()) - names)
    if missing or not names:
        known = ", ".join(sorted(names)) or "none"
        parser.error(f"no stage {', '.join(missing)} in {given.data}; there are: {known}")
    out = given.out or Path(tempfile.mkdtemp(prefix="characters-"))
    order = Order(out, given.frames, given.jobs, given.timeout, not given.no_repair, given.pictures)
    found: dict[str, dict[str, Figures]] = {"characters": {}, "worn": {}}
    kept = True
    for kind, columns, bars in (
        ("characters", CHARACTER_COLUMNS, CHARACTER_BARS),
        ("worn", WORN_COLUMNS, WORN_BARS),
    ):
        stages = [
            path
            for path in _stages(given.data, kind)
            if given.only is None or path.stem in given.only
        ]
        if stages:
            print(heading(columns, bars), flush=True)
        for path in stages:
            figures = measure(path, kind, order)
            found[kind][path.stem] = figures
            row = (character_row if kind == "characters" else worn_row)(path.stem, figures)
            kept &= all(cell.kept for cell in row)
            print(line(row), flush=True)
            if given.json:
                given.json.write_text(json.dumps(found, indent=1))
        for name, figures in found[kind].items() if given.where else ():
            if "places" in figures:
                print(f"\n{name}\n{lines(figures['places'])}")
        print(flush=True)
    return 0 if kept else 1


def _stages(data: Path, kind: str) -> list[Path]:
    """The stages of a kind, `characters` or `worn`, in the folder of data, by name."""
    return [path for path in sorted((data / kind).glob("*")) if path.suffix in SUFFIXES]


def measure(path: Path, kind: str, order: Order) -> Figures:
    """Repair one stage, or take what is there, and measure it."""
    character = read_character(path)
    # Baked characters show their bind pose at the default time, if at all.
    known = study(character, at_rest=kind == "worn" or not any(character.skeleton))
    frames, options = _frames(known, order.frames)
    if order.jobs is not None:
        options += ["--jobs", str(order.jobs)]
    result = input_figures(known, frames)
    limit = order.timeout
    if limit is None:
        limit = max(LIMIT, seconds_bar(result) * len(frames))
    run = repair(path, order.out, options, limit) if order.again else earlier(path, order.out)
    if not order.again and run.statuses and set(run.statuses) != set(result["times"]):
        raise SystemExit(
            f"{path.stem}: the run in {order.out} was of other frames; give its --frames"
        )
    layer = files(path, order.out)[0]
    if not layer.exists():
        return {**result, **_nothing(run, len(frames))}
    after = read_repaired(character, layer, frames)
    if order.pictures is not None:
        draw(known, after, frames, order.pictures)
    if kind == "worn":
        return {**result, **measure_worn(known, read_worn(character), after, frames, run)}
    result["places"] = places(known, after, frames)
    return {**result, **measure_character(known, after, frames, run)}


def _frames(known: Input, spec: str | None) -> tuple[Ints, list[str]]:
    """Numbers of the frames of a specification, and the options that ask the tool for them."""
    times = known.character.times
    if spec is None:
        return np.arange(len(times)), []
    if spec.startswith("worst:"):
        frames = deepest_window(known, int(spec.removeprefix("worst:")))
        return frames, ["--frames", f"{times[frames[0]]:g}:{times[frames[-1]]:g}"]
    return np.flatnonzero(parse_frames(spec).select(times)), ["--frames", spec]


def _spec(text: str) -> str:
    """A specification of frames, if it is one."""
    if text.startswith("worst:"):
        number = text.removeprefix("worst:")
        if not number.isdecimal() or int(number) == 0:
            raise argparse.ArgumentTypeError(f"worst:N takes a whole number from 1, got {number!r}")
        return text
    try:
        parse_frames(text)
    except FrameSpecError as error:
        raise argparse.ArgumentTypeError(str(error)) from error
    return text


def _nothing(run: Run, frames: int) -> Figures:
    """Figures of a run that wrote nothing."""
    told = f"nothing written, exit {run.code}"
    if run.code is None:
        told = f"no output in {run.limit:g} processor s"
    seconds = run.seconds / max(frames, 1)
    return {"code": run.code, "told": told, "seconds_per_frame": seconds, "errors": run.errors}


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--data", type=Path, required=True, help="folder of shared data")
    parser.add_argument("--only", nargs="+", help="names of stages, without their endings")
    parser.add_argument("--frames", type=_spec, help="frames of every stage, or worst:N")
    parser.add_argument("--jobs", type=int, help="passed on to the tool")
    parser.add_argument("--out", type=Path, help="folder of the layers and reports")
    parser.add_argument("--no-repair", action="store_true", help="measure what is in --out")
    parser.add_argument("--timeout", type=float, help="processor seconds a stage")
    parser.add_argument("--json", type=Path, help="write all figures here")
    parser.add_argument("--where", action="store_true", help="name the worst parts of each row")
    parser.add_argument("--pictures", type=Path, help="folder of before/after pictures")
    return parser


if __name__ == "__main__":
    sys.exit(main())
