"""Characters out of stages: the input by `usd_io`, what a repair wrote by pxr alone."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from pxr import Usd, UsdGeom

import usd_io
from tests.measures.surfaces import Floats, Ints


@dataclass(frozen=True)
class Character:
    """All meshes of a stage as one soup, in the space in which the tool counts.

    That space is the world, or the mesh's own for a single mesh; coordinates are rounded to
    float32 there.

    Attributes:
        path: the stage.
        paths: prim paths of the meshes (P,).
        starts: first vertex of each mesh, and the number of all (P + 1,).
        faces: triangles (F, 3), outward in the world.
        owner: mesh of each vertex (V,).
        rest: bind pose, or local points of meshes without one (V, 3).
        skeleton: for each mesh the path of the skeleton whose bind pose `rest` is, "" without.
        default: points at the default time (V, 3), in the same space.
        times: time codes (T,).
        poses: points (T, V, 3).
        up: up axis of the stage (3,).
        worlds: matrices (T, P, 4, 4) from the meshes to the world.
    """

    path: Path
    paths: tuple[str, ...]
    starts: Ints
    faces: Ints
    owner: Ints
    rest: Floats
    skeleton: tuple[str, ...]
    default: Floats
    times: Floats
    poses: Floats
    up: Floats
    worlds: Floats

    def placed(self, local: list[Floats], frame: int) -> Floats:
        """Local points of each mesh in the common space (V, 3), rounded to float32."""
        if len(local) > 1:
            local = [_moved(own, self.worlds[frame, k]) for k, own in enumerate(local)]
        return np.concatenate(local).astype(np.float32).astype(np.float64)

    def in_world(self, points: Floats, frame: int) -> Floats:
        """Points (V, 3) of the common space in the world, for pictures."""
        return points if len(self.paths) > 1 else _moved(points, self.worlds[frame, 0])


def read_character(path: Path) -> Character:
    """Read a stage at every whole frame of its range, posed by its skeletons."""
    opened = usd_io.open_stage(path)
    meshes = usd_io.read_meshes(opened).meshes
    stage = Usd.Stage.Open(str(path))
    first, last = stage.GetStartTimeCode(), stage.GetEndTimeCode()
    times = np.arange(np.ceil(first), np.floor(last) + 0.5)
    starts = np.cumsum([0, *(len(mesh.rest) for mesh in meshes)])
    worlds = np.array([[usd_io.world_matrix(mesh, time) for mesh in meshes] for time in times])
    skeletons = tuple(_skeleton(mesh) for mesh in meshes)
    rests = [
        _moved(mesh.rest, usd_io.world_matrix(mesh, float(mesh.times[0]))) if bound else mesh.rest
        for mesh, bound in zip(meshes, skeletons, strict=True)
    ]
    character = Character(
        path=path,
        paths=tuple(mesh.path for mesh in meshes),
        starts=starts,
        faces=np.concatenate(
            [
                usd_io.world_faces(mesh, float(times[0])) + start
                for mesh, start in zip(meshes, starts, strict=False)
            ]
        ).astype(np.int64),
        owner=np.repeat(np.arange(len(meshes)), np.diff(starts)),
        rest=np.concatenate(rests),
        skeleton=skeletons,
        default=np.zeros((0, 3)),
        times=times,
        poses=np.zeros((0, 0, 3)),
        up=meshes[0].up,
        worlds=worlds,
    )
    poses = [
        character.placed([_posed(mesh, time) for mesh in meshes], frame)
        for frame, time in enumerate(times)
    ]
    local = [_default(stage, mesh) for mesh in meshes]
    return Character(
        **{**character.__dict__, "poses": np.stack(poses), "default": character.placed(local, 0)}
    )


def _skeleton(mesh: usd_io.AnimatedMesh) -> str:
    """The skeleton whose joints move a mesh, "" for none."""
    skin = mesh.skin
    bound = skin is not None and skin.skinning_query.HasJointInfluences()
    return str(skin.skeleton.GetPath()) if skin is not None and bound else ""


def _posed(mesh: usd_io.AnimatedMesh, time: float) -> Floats:
    points = usd_io.read_frame(mesh, time)
    if points is None:
        raise ValueError(f"{mesh.path}: no points at {time:g}; a benchmark needs every frame")
    return points.astype(np.float64)


def _default(stage: Usd.Stage, mesh: usd_io.AnimatedMesh) -> Floats:
    """Local points at the default time, or those that `usd_io` takes as the rest."""
    value = UsdGeom.Mesh(stage.GetPrimAtPath(mesh.path)).GetPointsAttr().Get()
    usable = value is not None and len(value) == len(mesh.rest)
    return np.array(value, dtype=np.float64) if usable else mesh.rest


def read_repaired(character: Character, layer: Path, frames: Ints) -> Floats:
    """What a written layer holds at some frames (T, V, 3), by pxr alone.

    A mesh that the layer has no points for is as in the input. Raises ValueError where the
    topology is another, or where a mesh with new points is still moved by a skeleton.
    """
    stage, source = Usd.Stage.Open(str(layer)), Usd.Stage.Open(str(character.path))
    root = stage.GetRootLayer()
    attributes: list[Any] = []
    for path in character.paths:
        mesh = UsdGeom.Mesh(stage.GetPrimAtPath(path))
        before = UsdGeom.Mesh(source.GetPrimAtPath(path))
        for name in ("faceVertexIndices", "faceVertexCounts"):
            new, old = (own.GetPrim().GetAttribute(name).Get() for own in (mesh, before))
            if new != old:
                raise ValueError(f"{layer}: {path} has another topology than the input")
        written = root.GetAttributeAtPath(f"{path}.points") is not None
        skinned = mesh.GetPrim().HasAPI("SkelBindingAPI")
        if written and skinned:
            raise ValueError(f"{layer}: {path} has new points and is still bound to its skeleton")
        attributes.append(mesh.GetPointsAttr() if written else None)
    result = []
    for frame in frames:
        time = Usd.TimeCode(float(character.times[frame]))
        cache = UsdGeom.XformCache(time)
        placed = []
        for k, (path, points) in enumerate(zip(character.paths, attributes, strict=True)):
            own = slice(character.starts[k], character.starts[k + 1])
            if points is None:
                placed.append(character.poses[frame, own])
                continue
            local = np.array(points.Get(time), dtype=np.float64)
            world = np.array(cache.GetLocalToWorldTransform(stage.GetPrimAtPath(path)))
            placed.append(_moved(local, world) if len(character.paths) > 1 else local)
        result.append(np.concatenate(placed).astype(np.float32).astype(np.float64))
    return np.stack(result)


def _moved(points: Floats, matrix: Floats) -> Floats:
    moved: Floats = points.astype(np.float64) @ matrix[:3, :3] + matrix[3, :3]
    return moved


@dataclass(frozen=True)
class Worn:
    """One worn thing of a stage: its vertices (mask over all), loops round limbs, centrelines.

    cores: those of the rest pose, then of each frame, several (N, 3) each.
    """

    prim: str
    vertices: Ints
    loops: list[Ints]
    cores: list[list[Floats]]


def read_worn(character: Character) -> list[Worn]:
    """The worn things that the custom data of a layer names; none where it has no such entry."""
    stage = Usd.Stage.Open(str(character.path))
    data = stage.GetRootLayer().customLayerData.get("worn")
    if data is None:
        return []
    content = json.loads(data)
    cores = [[np.array(core) for core in frame] for frame in content["cores"]]
    result = []
    for entry in content["worn"]:
        start = int(character.starts[character.paths.index(entry["prim"])])
        first, end = entry["range"]
        loops = [start + np.array(loop) for loop in entry["loops"]]
        result.append(Worn(entry["prim"], start + np.arange(first, end), loops, cores))
    return result
