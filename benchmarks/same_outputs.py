"""Do two checkouts write the same bytes, and in the same time?

    python -m benchmarks.same_outputs --base CHECKOUT --data DIR [--repeats N] [--only NAME ...]

Runs the command line of another checkout and of this one in turns: the demo, a walk, a scene of two
objects, a transfer and key poses, by the same interpreter, without attachments. Compared are the
bytes of every mesh file and of every value and time sample of a stage, and all entries of the
base's reports and layers' records but seconds, folder and version. Processor times are those of
whole commands, the children's included; the ratio is the median of the pairs. Exit code 1 if any
output differs, 2 if a checkout cannot be run.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import statistics
import subprocess
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from tests.swinging_arm import arm_stage

HERE = Path(__file__).resolve().parents[1]
# What a report holds of the run rather than of its results.
OF_THE_RUN = {"seconds", "folder", "version"}


@dataclass(frozen=True)
class Outcome:
    """How a command ended: exit code, files by name (reports as values), processor seconds."""

    code: int
    files: Mapping[str, Any]
    seconds: float


def commands(data: Path, keys: Path) -> dict[str, list[str]]:
    """The arguments of each command; outputs are relative to its folder."""
    animals = data / "transfer"
    poses = sorted(map(str, (animals / "horse").glob("horse-0*.obj")))
    repair = ["repair", "--rest-contacts", "repair"]
    return {
        "demo": ["demo"],
        "walk": [*repair, f"{data}/humans/walk_male.usdc", "-o", "walk.usdc"],
        "scene": [*repair, f"{data}/scenes/sleeve_on_arm.usdc", "-o", "scene.usdc"],
        "pose": [*repair, f"{data}/humans/human_07_boxing_guard.obj", "-o", "pose.obj"],
        "paper": ["repair", f"{data}/misc/celtic_knot.obj", "--method", "paper", "-o", "paper.obj"],
        "transfer": [
            *("transfer", f"{animals}/horse/horse_ref.obj", f"{animals}/camel/camel_ref.obj"),
            *("--markers", f"{animals}/horse_camel.cons", "--poses", *poses),
            *("--repair", "-o", "transfer.usdc"),
        ],
        "keyposes": ["keyposes", str(keys), "-o", "keyposes.usda", "--samples", "4"],
    }


def run(checkout: Path, arguments: Sequence[str], folder: Path) -> Outcome:
    """Run a command of a checkout in a folder of its own."""
    folder.mkdir(parents=True)
    report = [] if arguments[0] == "demo" else ["--report", "report.json"]
    before = resource.getrusage(resource.RUSAGE_CHILDREN)
    done = subprocess.run(
        [sys.executable, "-m", "dtrepair", *arguments, *report],
        cwd=folder,
        env={**os.environ, "PYTHONPATH": str(checkout)},
        capture_output=True,
    )
    after = resource.getrusage(resource.RUSAGE_CHILDREN)
    seconds = after.ru_utime + after.ru_stime - before.ru_utime - before.ru_stime
    found = (path for path in sorted(folder.rglob("*")) if path.is_file())
    files = {str(path.relative_to(folder)): content(path) for path in found}
    return Outcome(done.returncode, files, seconds)


def content(path: Path) -> Any:
    """The bytes of a file, or of a report what does not depend on the run."""
    if path.suffix == ".json":
        return without_the_run(json.loads(path.read_text(encoding="utf-8")))
    return values_of(path) if path.suffix.startswith(".usd") else path.read_bytes()


def values_of(path: Path) -> dict[str, Any]:
    """All values of a layer's attributes and properties by path, and its own record."""
    from pxr import Sdf

    layer = Sdf.Layer.FindOrOpen(str(path))
    found: dict[str, Any] = {"record": without_the_run(plain(layer.customLayerData))}

    def visit(place: Sdf.Path) -> None:
        spec = layer.GetObjectAtPath(place)
        if isinstance(spec, Sdf.AttributeSpec):
            times = layer.ListTimeSamplesForPath(place)
            samples = {str(time): plain(layer.QueryTimeSample(place, time)) for time in times}
            found[str(place)] = [plain(spec.default), samples]

    layer.Traverse(Sdf.Path.absoluteRootPath, visit)
    return found


def plain(value: Any) -> Any:
    """A value of a layer as one that can be compared: arrays by their bytes."""
    if isinstance(value, dict):
        return {key: plain(item) for key, item in value.items()}
    if type(value).__module__.startswith("pxr") and hasattr(value, "__len__"):
        array = np.array(value)
        return list(value) if array.dtype == object else array.tobytes()
    return value


def without_the_run(value: Any) -> Any:
    """A value of a report without what differs from run to run."""
    if isinstance(value, dict):
        return {key: without_the_run(x) for key, x in value.items() if key not in OF_THE_RUN}
    return [without_the_run(item) for item in value] if isinstance(value, list) else value


def differences(base: Outcome, here: Outcome) -> list[str]:
    """What differs, in words; empty where nothing does."""
    found = [f"exit code {base.code} -> {here.code}"] if base.code != here.code else []
    for name in sorted({*base.files, *here.files}):
        if name not in base.files or name not in here.files:
            found.append(f"{name} only {'here' if name in here.files else 'in the base'}")
        else:
            found += [f"{name}{place}" for place in unlike(here.files[name], base.files[name])]
    return found


def unlike(value: Any, other: Any, place: str = "") -> list[str]:
    """The places where a value is not another one; it may have entries that the other has not."""
    if isinstance(value, dict) and isinstance(other, dict):
        keys = [key for key in other if key not in value]
        both = (unlike(value[key], other[key], f"{place}:{key}") for key in other if key in value)
        return [f"{place}:{key}" for key in keys] + [found for each in both for found in each]
    if isinstance(value, list) and isinstance(other, list) and len(value) == len(other):
        each = zip(value, other, strict=True)
        return [p for k, (a, b) in enumerate(each) for p in unlike(a, b, f"{place}[{k}]")]
    return [] if value == other else [place]


def loads_itself(checkout: Path) -> bool:
    """Whether the interpreter takes the package from a checkout."""
    code = "import dtrepair, usd_io; print(dtrepair.__file__); print(usd_io.__file__)"
    environment = {**os.environ, "PYTHONPATH": str(checkout)}
    with tempfile.TemporaryDirectory() as folder:
        command = [sys.executable, "-c", code]
        done = subprocess.run(command, cwd=folder, env=environment, capture_output=True, text=True)
    homes = [Path(line).resolve().parents[1] for line in done.stdout.split()]
    return homes == [checkout.resolve()] * 2


def main(arguments: Sequence[str] | None = None) -> int:
    """Compare; 1 where something differs."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--base", type=Path, required=True, help="another checkout of dtrepair")
    parser.add_argument("--data", type=Path, required=True, help="folder of shared data")
    parser.add_argument("--repeats", type=int, default=1, help="pairs of runs, for the times")
    parser.add_argument("--only", nargs="+", metavar="NAME", help="of the commands")
    given = parser.parse_args(arguments)
    for checkout in (given.base, HERE):
        if not loads_itself(checkout):
            print(f"same_outputs: {checkout} holds no dtrepair that can be run", file=sys.stderr)
            return 2
    differing = 0
    print("| command | outputs | base s | here s | ratio |\n|---|---|---|---|---|")
    with tempfile.TemporaryDirectory() as top:
        arm_stage(Path(top) / "keys.usda", (1.0, -1.0, -0.8))
        for name, command in commands(given.data.resolve(), Path(top) / "keys.usda").items():
            if given.only and name not in given.only:
                continue
            # Alike folders: outputs may hold their names.
            pairs = []
            for number in range(given.repeats):
                sides = (given.base.resolve(), HERE)
                folders = (Path(top, f"{name}{number}{side}", "out") for side in "ab")
                pairs.append(
                    [run(*each) for each in zip(sides, [command] * 2, folders, strict=True)]
                )
            wrong = differences(*pairs[0])
            differing += bool(wrong)
            base, here = (statistics.median(pair[k].seconds for pair in pairs) for k in (0, 1))
            ratio = statistics.median(pair[1].seconds / pair[0].seconds for pair in pairs)
            told = "; ".join(wrong[:3]) or f"{len(pairs[0][0].files)} same"
            print(f"| {name} | {told} | {base:.1f} | {here:.1f} | {ratio:.2f} |", flush=True)
    return int(differing > 0)


if __name__ == "__main__":
    sys.exit(main())
