"""Dressed characters made in code, in the form that `benchmarks.characters` reads and measures.

    python -m benchmarks.dressed FOLDER [--pictures FOLDER]
    python -m benchmarks.characters --data FOLDER

Writes FOLDER/worn/skirt.usdc (an open skirt over two legs that swing through it, 24 frames),
cape.usdc (a hat and an open cape on a body that bows, 12 frames) and FOLDER/characters/sleeves.usdc
(a body with arms, shirt and sleeves as six parts of one mesh, whose arms come down, 12 frames).
`--pictures` repairs them and draws the worst frame of each before and after, for
docs/characters.md.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
from pxr import Usd, UsdGeom

from benchmarks.dressed_shapes import Dressed, Faces, Floats, cape, joined, skirt, sleeves
from dtrepair.display.render import make_view, render, save_pictures
from dtrepair.intersect.detector import Detector
from dtrepair.pipeline import repair_stage
from usd_io import AuthoredMesh, write_animation

STAGES: dict[str, tuple[str, Callable[[], Dressed]]] = {
    "skirt": ("worn", skirt),
    "cape": ("worn", cape),
    "sleeves": ("characters", sleeves),
}


def write(made: Dressed, path: Path) -> None:
    """Write a stage; its custom data tell the independent measures what is worn round what."""
    path.parent.mkdir(parents=True, exist_ok=True)
    count = len(next(iter(made.meshes.values()))[0])
    meshes = [
        AuthoredMesh(f"/Hero/{name}", faces, points=poses, rest=poses[0])
        for name, (poses, faces) in made.meshes.items()
    ]
    write_animation(path, meshes, times=np.arange(1.0, count + 1.0))
    worn = [
        {"prim": f"/Hero/{name}", "range": [0, made.meshes[name][0].shape[1]], "loops": loops}
        for name, loops in made.loops.items()
    ]
    if worn:
        lines = [[core.tolist() for core in frame] for frame in (made.cores[0], *made.cores)]
        stage = Usd.Stage.Open(str(path))
        content = json.dumps({"worn": worn, "cores": lines})
        stage.SetMetadataByDictKey("customLayerData", "worn", content)
        stage.Save()


def draw(stage: Path, repaired: Path, folder: Path) -> Path:
    """Write FOLDER/NAME.png: the frame with most intersections, before and after, two views."""
    before, after = (_points(path) for path in (stage, repaired))
    faces = joined([(points[0], triangles) for points, triangles in before])
    pairs = []
    for poses in (before, after):
        points = np.concatenate([own for own, _ in poses], axis=1)
        detector = Detector(points[0], faces)
        pairs.append((points, [detector(pose) for pose in points]))
    worst = int(np.argmax([len(found) for found in pairs[0][1]]))
    shown = [points[worst] for points, _ in pairs]
    images, captions = [], []
    for azimuth in (25.0, 80.0):
        view = make_view(shown, azimuth=azimuth)
        for (_, found), points in zip(pairs, shown, strict=True):
            hit = np.zeros(len(faces), dtype=bool)
            hit[found[worst].ravel()] = True
            images.append(render(points, faces, view=view, intersecting=hit, size=420))
            captions.append(f"frame {worst + 1}: {len(found[worst])} pairs, joints included")
    folder.mkdir(parents=True, exist_ok=True)
    path = folder / f"{stage.stem}.png"
    save_pictures(path, images, captions=captions, columns=4)
    return path


def _points(path: Path) -> list[tuple[Floats, Faces]]:
    """Poses (T, V, 3) and triangles of the meshes of a stage, read by pxr alone."""
    stage = Usd.Stage.Open(str(path))
    found = []
    for prim in stage.Traverse():
        if prim.IsA(UsdGeom.Mesh):
            mesh = UsdGeom.Mesh(prim)
            times = range(int(stage.GetStartTimeCode()), int(stage.GetEndTimeCode()) + 1)
            poses = np.stack([np.asarray(mesh.GetPointsAttr().Get(t), float) for t in times])
            corners = np.asarray(mesh.GetFaceVertexIndicesAttr().Get(), np.int32)
            found.append((poses, corners.reshape(-1, 3)))
    return found


def main() -> None:
    """Write the stages, and the figure."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the stages go")
    parser.add_argument("--pictures", type=Path, help="repair all, and draw them into this folder")
    given = parser.parse_args()
    for name, (kind, make) in STAGES.items():
        stage = given.folder / kind / f"{name}.usdc"
        write(make(), stage)
        print(stage)
        if given.pictures is not None:
            repaired = given.folder / f"{name}_repaired.usdc"
            repair_stage(str(stage), str(repaired))
            print(draw(stage, repaired, given.pictures))


if __name__ == "__main__":
    main()
