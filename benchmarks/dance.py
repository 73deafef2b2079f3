"""Makes clips of a body that dances: limbs swing through the torso and through each other.

    python benchmarks/dance.py REST.obj OUT.usdc [--clip cross|kick|hug] [--frames N] [--speed S]
                               [--depth D] [--samples even|sparse|cut] [--skeleton]

REST.obj is the standing body of the human clips (metres, Y up, looks along +Z). It gets a skeleton
and weights in code (nearest bone, diffused over the surface) and is posed by linear blends, as in
games and films. `--speed 2` dances twice as fast, `--depth 1.3` turns all joints 1.3 times as far;
`--samples sparse` keeps uneven time codes, `cut` jumps to another place and pose after two thirds;
`--skeleton` writes joints and weights in place of points. `benchmarks/animation.py OUT.usdc
REST.obj` measures what a repair makes of it.
"""

from __future__ import annotations

import argparse
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from pxr import Gf, Sdf, Usd, UsdGeom, UsdSkel, Vt
from scipy import sparse
from scipy.spatial.transform import Rotation

from dtrepair.files.mesh_files import read_mesh
from dtrepair.numerics.operators import Factor, uniform_laplacian
from usd_io import AuthoredMesh, write_animation

Floats = NDArray[np.float64]

# Joint: its parent, where it turns, where its bone ends; the left (+X) side, mirrored for "right".
_JOINTS: dict[str, tuple[str, tuple[float, ...], tuple[float, ...]]] = {
    "hips": ("", (0, 0.93, 0.03), (0, 1.05, 0.03)),
    "chest": ("hips", (0, 1.08, 0.03), (0, 1.40, 0.02)),
    "head": ("chest", (0, 1.50, 0.02), (0, 1.70, 0.04)),
    "left_arm": ("chest", (0.18, 1.385, 0.0), (0.36, 1.18, 0.03)),
    "left_forearm": ("left_arm", (0.36, 1.18, 0.03), (0.56, 0.98, 0.33)),
    "left_thigh": ("hips", (0.10, 0.89, 0.02), (0.14, 0.50, 0.02)),
    "left_shin": ("left_thigh", (0.14, 0.50, 0.02), (0.19, 0.03, 0.05)),
}
# Degrees about X, Y, Z at the beats of each clip; the first and the last pose are the rest.
_BEATS: dict[str, list[dict[str, tuple[float, float, float]]]] = {
    "cross": [
        {"left_arm": (15, -30, -58), "right_arm": (10, 25, 52), "left_forearm": (-5, -55, -10),
         "right_forearm": (-5, 45, 10), "chest": (8, 10, 0)},
        {"left_arm": (-30, 20, 30), "right_arm": (0, 40, 60), "chest": (0, -15, 5)},
        {"left_arm": (5, -45, -60), "right_arm": (15, 30, 55), "left_forearm": (-10, -60, 0),
         "left_thigh": (-20, 0, -17), "right_thigh": (0, 0, 8), "chest": (0, 15, 0)},
    ],
    "kick": [
        {"left_thigh": (-15, 0, -24), "left_shin": (10, 0, 0), "right_thigh": (0, 0, 14),
         "right_arm": (15, 20, 58), "left_arm": (0, 0, 30)},
        {"right_thigh": (-18, 0, 26), "right_shin": (20, 0, 0), "left_thigh": (0, 0, -10),
         "left_arm": (10, -30, -60), "left_forearm": (0, -40, 0)},
        {"left_thigh": (-105, 0, -8), "left_shin": (70, 0, 0), "right_arm": (-10, 40, 50),
         "left_arm": (10, -20, -45), "chest": (35, 0, 0)},
    ],
    "hug": [
        {"left_arm": (15, -35, -62), "right_arm": (15, 35, 62), "left_forearm": (5, -75, -10),
         "right_forearm": (5, 75, 10), "chest": (15, 0, 0), "head": (10, 0, 0)},
        {"left_arm": (0, -50, -60), "right_arm": (20, 25, 64), "left_forearm": (0, -60, 0),
         "right_forearm": (10, 75, 10), "chest": (20, 20, 0)},
    ],
}  # fmt: skip
# Steps of diffusion that blend the weights of two bones, in mean edges.
_BLEND = 60.0


class Dancer:
    """A rest pose (V, 3) with joints and weights (V, J)."""

    def __init__(self, rest: Floats, faces: NDArray[np.int32]) -> None:
        """Bind the surface to the joints."""
        self.rest, self.faces = rest, faces
        mirror = {
            name.replace("left", "right"): (parent.replace("left", "right"), _flip(a), _flip(b))
            for name, (parent, a, b) in _JOINTS.items()
            if name.startswith("left")
        }
        self.joints = {**_JOINTS, **mirror}
        distance = np.stack([_distance(rest, a, b) for _, a, b in self.joints.values()], axis=1)
        # Bones of the trunk lie deep: they win what is nearer to them than twice a limb.
        deep = [0.6 if name in ("hips", "chest", "head") else 1.0 for name in self.joints]
        nearest = (distance * np.array(deep)).argmin(axis=1)
        hard = np.eye(len(self.joints))[nearest]
        matrix = sparse.eye(len(rest)) + _BLEND * uniform_laplacian(faces, len(rest))
        weights = np.clip(Factor(sparse.csc_matrix(matrix))(hard), 0.0, None)
        self.weights = weights / weights.sum(axis=1, keepdims=True)

    def transforms(self, turns: dict[str, Floats]) -> Floats:
        """Transforms (J, 4, 4) of the joints in the body's space, for column vectors."""
        found: dict[str, Floats] = {}
        for name, (parent, pivot, _) in self.joints.items():
            turn = np.eye(4)
            turn[:3, :3] = Rotation.from_euler("xyz", turns[name], degrees=True).as_matrix()
            turn[:3, 3] = np.asarray(pivot) - turn[:3, :3] @ np.asarray(pivot)
            found[name] = found[parent] @ turn if parent else turn
        return np.stack(list(found.values()))

    def turns(self, clip: str, time: float, depth: float) -> dict[str, Floats]:
        """Angles of each joint at a part 0 ... 1 of a clip, `depth` times as large as its beats.

        They ease in and out at each beat.
        """
        beats = [{}, *_BEATS[clip], {}]
        place = np.clip(time, 0.0, 1.0) * (len(beats) - 1)
        before = min(int(place), len(beats) - 2)
        share = place - before
        share = share * share * (3.0 - 2.0 * share)
        one, two = beats[before], beats[before + 1]
        return {
            name: depth * (1 - share) * np.array(one.get(name, (0, 0, 0)))
            + depth * share * np.array(two.get(name, (0, 0, 0)))
            for name in self.joints
        }

    def pose(self, transforms: Floats) -> Floats:
        """The surface (V, 3) moved by transforms (J, 4, 4): linear blends."""
        points = np.c_[self.rest, np.ones(len(self.rest))]
        surface: Floats = np.einsum("vj,jab,vb->va", self.weights, transforms, points)[:, :3]
        return surface


def _flip(point: tuple[float, ...]) -> tuple[float, ...]:
    return (-point[0], *point[1:])


def _distance(points: Floats, start: tuple[float, ...], end: tuple[float, ...]) -> Floats:
    """Distance of points (V, 3) to a segment."""
    a, along = np.asarray(start), np.subtract(end, start)
    part = np.clip((points - a) @ along / (along @ along), 0.0, 1.0)
    distances: Floats = np.linalg.norm(points - a - part[:, None] * along, axis=1)
    return distances


def sampled(samples: str, frames: int) -> tuple[Floats, Floats, Floats]:
    """Time codes (T,), parts of the clip (T,) and places (T, 3) of a kind of samples."""
    codes = np.arange(1.0, frames + 1.0)
    if samples == "sparse":
        steps = np.random.default_rng(0).choice([1.0, 1.0, 2.0, 3.0, 4.0], frames)
        codes = 1.0 + np.cumsum(steps) * frames / steps.sum()
    parts = (codes - codes[0]) / (codes[-1] - codes[0])
    places = np.zeros((frames, 3))
    if samples == "cut":
        later = np.arange(frames) >= 2 * frames // 3
        parts = np.where(later, (parts + 0.45) % 1.0, parts)
        places[later] = (0.9, 0.0, -0.4)
    return codes, parts, places


def write_skeleton(
    output: Path, dancer: Dancer, faces: NDArray[np.int32], codes: Floats, moved: Floats
) -> None:
    """Write a skinned mesh moved by transforms (T, J, 4, 4)."""
    stage = Usd.Stage.CreateNew(str(output))
    UsdGeom.SetStageUpAxis(stage, UsdGeom.Tokens.y)
    stage.SetStartTimeCode(codes[0])
    stage.SetEndTimeCode(codes[-1])
    root = UsdSkel.Root.Define(stage, "/Character")
    stage.SetDefaultPrim(root.GetPrim())
    paths: dict[str, str] = {}
    for name, (parent, _, _) in dancer.joints.items():
        paths[name] = f"{paths[parent]}/{name}" if parent else name
    names = list(dancer.joints)
    skeleton = UsdSkel.Skeleton.Define(stage, "/Character/Skeleton")
    skeleton.CreateJointsAttr(list(paths.values()))
    pivots = [dancer.joints[name][1] for name in names]
    bind = [Gf.Matrix4d().SetTranslate(Gf.Vec3d(*pivot)) for pivot in pivots]
    skeleton.CreateBindTransformsAttr(Vt.Matrix4dArray(bind))
    above = [
        names.index(dancer.joints[name][0]) if dancer.joints[name][0] else -1 for name in names
    ]
    rest = [bind[j] * bind[k].GetInverse() if k >= 0 else bind[j] for j, k in enumerate(above)]
    skeleton.CreateRestTransformsAttr(Vt.Matrix4dArray(rest))
    animation = UsdSkel.Animation.Define(stage, "/Character/Skeleton/Dance")
    animation.CreateJointsAttr(list(paths.values()))
    animation.CreateScalesAttr(Vt.Vec3hArray(len(names), Gf.Vec3h(1, 1, 1)))
    turned, shifted = animation.CreateRotationsAttr(), animation.CreateTranslationsAttr()
    for code, transforms in zip(codes, moved, strict=True):
        here = [bind[j] * Gf.Matrix4d(transforms[j].T.tolist()) for j in range(len(names))]
        local = [here[j] * here[k].GetInverse() if k >= 0 else here[j] for j, k in enumerate(above)]
        turned.Set(Vt.QuatfArray([Gf.Quatf(m.ExtractRotationQuat()) for m in local]), code)
        shifted.Set(Vt.Vec3fArray([Gf.Vec3f(m.ExtractTranslation()) for m in local]), code)
    mesh = UsdGeom.Mesh.Define(stage, "/Character/Body")
    mesh.CreatePointsAttr(Vt.Vec3fArray.FromNumpy(dancer.rest.astype(np.float32)))
    mesh.CreateFaceVertexCountsAttr([3] * len(faces))
    mesh.CreateFaceVertexIndicesAttr(faces.ravel().tolist())
    binding = UsdSkel.BindingAPI.Apply(mesh.GetPrim())
    binding.CreateSkeletonRel().SetTargets([skeleton.GetPath()])
    binding.CreateAnimationSourceRel().SetTargets([animation.GetPath()])
    UsdSkel.BindingAPI.Apply(skeleton.GetPrim()).CreateAnimationSourceRel().SetTargets(
        [Sdf.Path("/Character/Skeleton/Dance")]
    )
    strongest = np.argsort(-dancer.weights, axis=1)[:, :4]
    weights = np.take_along_axis(dancer.weights, strongest, axis=1)
    weights /= weights.sum(axis=1, keepdims=True)
    binding.CreateJointIndicesPrimvar(False, 4).Set(strongest.ravel().tolist())
    binding.CreateJointWeightsPrimvar(False, 4).Set(weights.ravel().tolist())
    stage.Save()


def motion(
    dancer: Dancer, clip: str, frames: int, *, speed: float, depth: float, samples: str
) -> tuple[Floats, Floats]:
    """Time codes (T,) and transforms (T, J, 4, 4) of the joints of a clip."""
    codes, parts, places = sampled(samples, frames)
    parts = np.where(parts < 1.0, (parts * speed) % 1.0, 1.0)
    moved = np.stack([dancer.transforms(dancer.turns(clip, part, depth)) for part in parts])
    moved[:, :, :3, 3] += places[:, None]
    return codes, moved


def main() -> None:
    """Make a clip and write it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("rest", type=Path)
    parser.add_argument("output", type=Path)
    parser.add_argument("--clip", choices=sorted(_BEATS), default="cross")
    parser.add_argument("--frames", type=int, default=48)
    parser.add_argument("--speed", type=float, default=1.0)
    parser.add_argument("--depth", type=float, default=1.0)
    parser.add_argument("--samples", choices=("even", "sparse", "cut"), default="even")
    parser.add_argument("--skeleton", action="store_true")
    asked = parser.parse_args()
    mesh = read_mesh(asked.rest)
    dancer = Dancer(mesh.points, mesh.faces())
    options = {"speed": asked.speed, "depth": asked.depth, "samples": asked.samples}
    codes, moved = motion(dancer, asked.clip, asked.frames, **options)
    if asked.skeleton:
        write_skeleton(asked.output, dancer, mesh.faces(), codes, moved)
        return
    poses = [dancer.pose(transforms) for transforms in moved]
    body = AuthoredMesh("/Character/Body", faces=mesh.faces(), points=poses, rest=mesh.points)
    write_animation(asked.output, body, times=codes)


if __name__ == "__main__":
    main()
