"""Normals beside written points: recomputed, those of the input, or none."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from pxr import Sdf, UsdGeom, Vt

from usd_io.read.mesh import AnimatedMesh
from usd_io.values import create_attribute, vec3f_array
from usd_io.write.atomic_layer import AtomicLayer
from usd_io.write.normals_sources import NormalsSource, normals_sources

# What is done with the normals of a mesh whose points change.
MODES = ("recompute", "keep", "drop")


class NormalsOutput:
    """The normals of one mesh in an output layer.

    recompute: follow the points, as smooth and hard as those of the input; face-varying ones are
    indexed where corners share them. keep: nothing is written; the input's stay. Those of a skinned
    mesh belong to its bind pose, and are recomputed. drop: blocked; clients compute their own.
    """

    def __init__(self, file: AtomicLayer, path: Sdf.Path, mesh: AnimatedMesh, mode: str) -> None:
        """Look at the input's normals; `mode` is one of MODES."""
        self._file, self._path, self._mesh = file, path, mesh
        sources = normals_sources(mesh)
        if mode == "drop":
            for source in sources:
                self._block(source.name)
        left_alone = mode == "drop" or (mode == "keep" and not mesh.skinned)
        self._sources = [] if left_alone else sources
        for source in self._sources:
            self._author_slots(source)

    def put(self, time: float, changed: NDArray[np.float32] | None) -> list[str]:
        """Author normals of changed points (V, 3); without points, those of the input.

        Returns the names of normals that cannot follow, and are blocked now.
        """
        blocked = []
        for source in list(self._sources):
            old = source.value(self._mesh, time)
            new = old if changed is None else source.recomputed(self._mesh, time, changed)
            if old is None:
                self._set(source, time, Sdf.ValueBlock())
            elif new is None:
                self._block(source.written_name)
                self._sources.remove(source)
                blocked.append(source.name)
            else:
                self._set(source, time, vec3f_array(source.stored(new)))
        return blocked

    def put_block(self, time: float) -> None:
        """Author that there are no normals at a time, as there are no points."""
        for source in self._sources:
            self._set(source, time, Sdf.ValueBlock())

    def _set(self, source: NormalsSource, time: float, value: object) -> None:
        """Author one sample."""
        assert self._file.layer is not None
        path = create_attribute(self._file.layer, self._path, source.written_name)
        self._file.set_sample(path, time, value)

    def _author_slots(self, source: NormalsSource) -> None:
        """Author which corner has which normal, where they are indexed."""
        layer = self._file.layer
        if source.slots is None or layer is None:
            return
        path = create_attribute(layer, self._path, source.written_name)
        layer.GetAttributeAtPath(path).SetInfo("interpolation", UsdGeom.Tokens.faceVarying)
        indices = create_attribute(layer, self._path, f"{source.written_name}:indices")
        layer.GetAttributeAtPath(indices).default = Vt.IntArray.FromNumpy(source.slots.numbers)
        if source.name != source.written_name:
            self._block(source.name)

    def _block(self, name: str) -> None:
        """Block normals at all times; clients then compute their own, or take others."""
        assert self._file.layer is not None
        path = create_attribute(self._file.layer, self._path, name)
        attribute = self._file.layer.GetAttributeAtPath(path)
        attribute.ClearInfo("timeSamples")
        attribute.default = Sdf.ValueBlock()
