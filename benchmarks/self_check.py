"""Do the benchmarks measure what they say?

    python -m benchmarks.self_check [--data DIR]

Every module is imported; results.md must be what its figures give; the check for machines with a
GPU runs on the CPU, and must notice forces that are wrong; the objects of each stage that is made
in code must meet, and be clean for themselves; the time of a repair must be that of its parts.
`--data` looks at the shared scenes, too. Exit code 1 if something does not hold.
"""

from __future__ import annotations

import argparse
import io
import sys
import tempfile
import time
import traceback
from collections.abc import Callable
from contextlib import redirect_stderr, redirect_stdout
from functools import partial
from importlib import import_module
from pathlib import Path
from typing import Any
from unittest import mock

import numpy as np
import torch

from benchmarks import gpu_check, results
from benchmarks.method_parts import PARTS, Shares, functions_of
from benchmarks.scene_files import read_world, write_stage
from benchmarks.scene_stages import STAGES
from benchmarks.scenes import SHARED, count_dirty, find_pairs
from dtrepair import Repairer
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.metrics import volume
from dtrepair.repair.paper.gpu_operators import Forces
from tests.meshes import elbow

SMALL = ["--cpu", "--triangles", "800", "--frames", "3"]
# What only `requirements.txt` of this folder installs.
PEERS = {"detection"}


def modules_can_be_imported() -> None:
    """Every command is at least a module that loads."""
    for path in sorted(Path(__file__).parent.glob("*.py")):
        if path.stem not in PEERS:
            import_module(f"benchmarks.{path.stem}")


def results_are_rendered() -> None:
    """The page is what `benchmarks.results render` gives, and files come back as they were."""
    files = sorted(results.FOLDER.glob("*.json"))
    found = {path.stem: results.read_result(path) for path in files}
    assert results.PAGE.read_text(encoding="utf-8") == results.page(found), "render it anew"
    table = results.Block(columns=("mesh", "s"), rows=(("knot", "0.1"),))
    assert results.blocks_of("Two\nlines.\n\n| mesh | s |\n|---|---|\n| knot | 0.1 |\n") == (
        results.Block(text="Two lines."),
        table,
    )
    with tempfile.TemporaryDirectory() as folder:
        for result in found.values():
            results.write_result(Path(folder) / "again.json", result)
            assert results.read_result(Path(folder) / "again.json") == result


def printed(arguments: list[str]) -> tuple[int, str]:
    """The exit code of gpu_check, and what it prints."""
    out = io.StringIO()
    with redirect_stdout(out), redirect_stderr(out):
        code = gpu_check.main(arguments)
    return code, out.getvalue()


def gpu_check_holds_on_the_cpu() -> None:
    """All nineteen checks hold, and the times are told."""
    code, out = printed(SMALL)
    assert code == 0 and "All checks hold." in out, out
    assert out.count("| yes |") == 19 and "| 60 iterations |" in out, out


def gpu_check_notices_wrong_forces() -> None:
    """Forces that are off by a thousandth fail, and so do the repairs."""
    right = Forces.__call__

    def wrong(self: Forces, *own: Any) -> torch.Tensor:
        return 1.001 * right(self, *own)

    with (
        mock.patch.object(Forces, "__call__", wrong),
        mock.patch.object(gpu_check, "timings", lambda *_: [("60 iterations", 1.0)]),
    ):
        code, out = printed(SMALL)
    assert code == 1 and "checks failed" in out, out
    assert "| forces, conical | NO | 1.0e-03 relative |" in out, out
    assert "| repairs: points | NO |" in out, out


def gpu_check_tells_what_to_do_without_a_gpu() -> None:
    """Where there is none, it says so."""
    if not torch.cuda.is_available():
        code, out = printed([])
        assert code == 2 and "PyTorch sees 0 CUDA devices" in out, out


def time_of_a_repair_has_its_parts() -> None:
    """Every part is there, each second belongs to one, and functions are put back."""
    for part, _, places in PARTS:
        assert all(list(functions_of(place)) for place in places), part
    (rest, faces), (bent, _) = elbow(0.0, 24, 8), elbow(2.9, 24, 8)
    shares, before = Shares(), Repairer.__call__
    with shares.watching():
        start = time.process_time()
        Repairer(rest, faces)(bent)
        shares.switch()
        spent = time.process_time() - start
    assert {"detection: tree and pairs", "factors", "push"} <= set(shares.seconds)
    assert abs(sum(shares.seconds.values()) - spent) < 0.01 + 0.01 * spent
    assert Repairer.__call__ is before and not hasattr(Detector.__call__, "__wrapped__")


def objects_meet_and_are_clean_for_themselves(name: str) -> None:
    """What a stage of `scene_stages` promises."""
    stage = STAGES[name]()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "stage.usda"
        write_stage(stage, path)
        world = read_world(path)
    assert [own.split("/")[2] for own in world.paths] == [part.name for part in stage.parts]
    assert set(stage.stiff.split()) <= {part.name for part in stage.parts}
    for points, faces in zip(world.points, world.faces, strict=True):
        assert len(find_pairs(points[0], faces, np.arange(len(points[0]), dtype=np.int32))) == 0
        # Outside is out, under mirroring parents as well; the floor is open.
        assert name == "ball_on_floor" or volume(points[0], faces) > 0.0
    assert count_dirty(world, world.weld(), "", find_pairs) > 0


def shared_scenes_hold_what_is_named(data: Path) -> None:
    """The prims that `scenes.SHARED` tells of are in the files."""
    for file, (objects, stiff) in SHARED.items():
        world = read_world(data / "scenes" / file)
        assert all(any(path.startswith(own) for path in world.paths) for own in objects), file
        assert set(stiff) <= set(objects), file


def main() -> int:
    """Run all checks; 1 if one failed."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--data", type=Path, help="folder of shared data")
    data: Path | None = parser.parse_args().data
    checks: dict[str, Callable[[], None]] = {
        "results.md is made of results/*.json": results_are_rendered,
        "modules can be imported": modules_can_be_imported,
        "gpu_check holds on the CPU": gpu_check_holds_on_the_cpu,
        "gpu_check notices wrong forces": gpu_check_notices_wrong_forces,
        "gpu_check without a GPU": gpu_check_tells_what_to_do_without_a_gpu,
        "time of a repair has its parts": time_of_a_repair_has_its_parts,
        **{name: partial(objects_meet_and_are_clean_for_themselves, name) for name in STAGES},
    }
    if data is not None:
        checks["shared scenes"] = partial(shared_scenes_hold_what_is_named, data)
    failed = 0
    for name, check in checks.items():
        try:
            check()
            print(f"ok: {name}")
        except Exception:
            failed += 1
            print(f"FAILED: {name}")
            traceback.print_exc()
    return 1 if failed else 0


if __name__ == "__main__":
    sys.exit(main())
