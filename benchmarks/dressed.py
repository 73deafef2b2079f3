"""Dressed characters made in code, in the form that `benchmarks.characters` reads and measures.

    python -m benchmarks.dressed FOLDER
    python -m benchmarks.characters --data FOLDER

Writes FOLDER/worn/skirt.usdc (an open skirt over two legs that swing through it, 24 frames),
cape.usdc (a hat and an open cape on a body that bows, 12 frames) and FOLDER/characters/sleeves.usdc
(a body with arms, shirt and sleeves as six parts of one mesh, whose arms come down, 12 frames).
`python -m docs.making.pictures` draws them for docs/characters.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Usd

from benchmarks.dressed_shapes import Dressed, cape, skirt, sleeves
from usd_io import AuthoredMesh, write_animation

STAGES: dict[str, tuple[str, Callable[[], Dressed]]] = {
    "skirt": ("worn", skirt),
    "cape": ("worn", cape),
    "sleeves": ("characters", sleeves),
}


def write(name: str, folder: Path) -> Path:
    """Write FOLDER/NAME.usdc; its custom data tell the measures what is worn round what."""
    made, path = STAGES[name][1](), folder / f"{name}.usdc"
    folder.mkdir(parents=True, exist_ok=True)
    count = len(next(iter(made.meshes.values()))[0])
    meshes = [
        AuthoredMesh(f"/Hero/{mesh}", faces, points=poses, rest=poses[0])
        for mesh, (poses, faces) in made.meshes.items()
    ]
    write_animation(path, meshes, times=np.arange(1.0, count + 1.0))
    worn = [
        {"prim": f"/Hero/{mesh}", "range": [0, made.meshes[mesh][0].shape[1]], "loops": loops}
        for mesh, loops in made.loops.items()
    ]
    if worn:
        lines = [[core.tolist() for core in frame] for frame in (made.cores[0], *made.cores)]
        stage = Usd.Stage.Open(str(path))
        content = json.dumps({"worn": worn, "cores": lines})
        stage.SetMetadataByDictKey("customLayerData", "worn", content)
        stage.Save()
    return path


def main() -> None:
    """Write the stages."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the stages go")
    given = parser.parse_args()
    for name, (kind, _) in STAGES.items():
        print(write(name, given.folder / kind))


if __name__ == "__main__":
    main()
