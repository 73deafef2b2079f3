"""Pictures of what a repair may do to a shape: before, just within a bound, and just beyond it.

What is within and beyond is what `SceneRepairer.strains` says. The place is yellow within the
bound, and red beyond it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from docs.making import bound_joints, bound_shapes
from docs.making.bound_shapes import CHARACTER, Example, Floats, Mask
from dtrepair.diagnosis import Strain
from dtrepair.display.colours import Colour, Colours
from dtrepair.display.render import RenderOptions, View, make_view, render
from dtrepair.intersect.detector import Detector
from dtrepair.numerics.attachments import Reference
from dtrepair.repair.repairer import SceneRepairer
from dtrepair.repair.scene.bodies import Body
from dtrepair.repair.strain.bounds import Excess, StrainOptions
from dtrepair.repair.strain.meter import StrainMeter

Image = NDArray[np.uint8]
# The examples of each picture, a row for each.
EXAMPLES: dict[str, tuple[Callable[[], Example], ...]] = {
    "bounds_of_joints": (
        bound_joints.drifting_hem,
        bound_joints.sliding_sleeve,
        bound_joints.sliding_eye,
    ),
    "bounds_of_shapes": (
        bound_shapes.crushed_edges,
        bound_shapes.swollen_belly,
        bound_shapes.pinched_arm,
        bound_shapes.turned_corner,
    ),
}
WITHIN: Colour = (0.96, 0.74, 0.10)
BEYOND: Colour = (0.90, 0.09, 0.07)
# SKIN, CLOTH, DARK_SKIN, DARK_CLOTH, WHITE, DARK.
COLOURS = Colours(
    surface=(0.80, 0.71, 0.64),
    objects=(
        (0.52, 0.66, 0.74),
        (0.71, 0.62, 0.55),
        (0.45, 0.58, 0.66),
        (0.93, 0.92, 0.90),
        (0.25, 0.30, 0.33),
    ),
    back=(0.36, 0.46, 0.54),
)
# Width of a panel in pixels, what is left free beside and above it, and its height over it.
SIZE, GAP, HEIGHT = 420, 7, 0.6
# How near to its bound a value is: this part of it, or the bound is this part of the value.
NEAR = 0.8
_BOUNDS = StrainOptions()
# Seven tenths of the bounds: beyond them the meter tells what is within the bounds, too.
TIGHT = replace(
    _BOUNDS,
    edges=int(0.7 * _BOUNDS.edges),
    drift=0.7 * _BOUNDS.drift,
    slide=0.7 * _BOUNDS.slide,
    joint=0.7 * _BOUNDS.joint,
    volume=0.7 * _BOUNDS.volume,
    limb=0.7 * _BOUNDS.limb,
    patch=0.7 * _BOUNDS.patch,
)


class Judge:
    """Measures the shapes of an example by the bounds of a repair."""

    def __init__(self, example: Example) -> None:
        self.example = example
        meshes = [*example.meshes, CHARACTER]
        starts = np.cumsum([0, *(len(points) for points, _ in meshes)])
        shifted = [faces + start for (_, faces), start in zip(meshes, starts, strict=False)]
        faces = np.concatenate(shifted).astype(np.int32)
        self.faces = faces[: len(example.paint)]
        self.before = [points for points, _ in meshes]
        rest = np.concatenate(self.before)
        self.repairer = SceneRepairer(
            [Body(*mesh) for mesh in meshes],
            references=[Reference(rest, Detector(rest, faces)(rest))],
        )

    def after(self, harm: float) -> list[Floats]:
        """The points of all meshes after some harm."""
        return [*self.example.pose(harm), CHARACTER[0]]

    def strains(self, harm: float) -> tuple[Strain, ...]:
        """What some harm strains beyond the bounds."""
        return self.repairer.strains(self.before, self.after(harm))

    def measured(self, harm: float) -> list[Excess]:
        """What is measured of the kind of the example where it is beyond the bound or near it."""
        meter = self.repairer.scene.strain_meter
        strict = StrainMeter(
            meter.parts, references=meter.references, rest=meter.rest, options=TIGHT
        )
        poses = (np.concatenate(points) for points in (self.before, self.after(harm)))
        return [excess for excess in strict(*poses) if excess.kind == self.example.kind]

    def marked(self, harm: float) -> Mask:
        """The triangles that show where the harm is."""
        if self.example.marked is not None:
            return self.example.marked(self.before[:-1], self.after(harm)[:-1])
        mask = np.zeros(self.faces.max() + 1, dtype=bool)
        for excess in self.measured(harm):
            mask[excess.vertices] = True
        return np.asarray(mask[self.faces].all(axis=1))


def checked(judge: Judge) -> tuple[float, Strain]:
    """The value within the bound, and the strain beyond it.

    ValueError: the first is strained, the second not by just what is meant, or either is far off.
    """
    example = judge.example
    if found := judge.strains(example.within):
        raise ValueError(f"{example.row}: expected no strain within the bound, got {found}")
    found = judge.strains(example.beyond)
    if [strain.kind for strain in found] != [example.kind]:
        raise ValueError(f"{example.row}: expected {example.kind} alone, got {found}")
    value, beyond = max(own.value for own in judge.measured(example.within)), found[0]
    if not NEAR * beyond.bound < value <= beyond.bound < beyond.value < beyond.bound / NEAR:
        raise ValueError(f"{example.row}: {value} and {beyond.value} are not near {beyond.bound}")
    return value, beyond


def captions(judge: Judge) -> list[str]:
    """What stands below the three panels of an example; raises as `checked`."""
    example, (value, beyond) = judge.example, checked(judge)
    told = [(example.caption, beyond.bound)]
    told += [(f"within: {example.value}", value), (f"beyond: {example.value}", beyond.value)]
    size = 100.0 * (beyond.size or 0.0)
    return [words.format(number, number * size) for words, number in told]


def panels(judge: Judge) -> list[Image]:
    """An example before, within and beyond its bound, as pictures."""
    example = judge.example
    none = np.zeros(len(judge.faces), dtype=bool)
    images = [_panel(judge, judge.before, none, WITHIN)]
    for harm, colour in ((example.within, WITHIN), (example.beyond, BEYOND)):
        images.append(_panel(judge, judge.after(harm), judge.marked(harm), colour))
    return images


def _panel(judge: Judge, points: list[Floats], marked: Mask, colour: Colour) -> Image:
    """One of them, with what is marked in a colour."""
    example = judge.example
    azimuth, elevation = example.look
    rotation = make_view([np.eye(3)], azimuth=azimuth, elevation=elevation).rotation
    image = render(
        np.concatenate(points),
        judge.faces,
        view=View(rotation, rotation @ np.array(example.centre), example.wide),
        intersecting=marked,
        objects=example.paint,
        size=SIZE,
        options=RenderOptions(colours=replace(COLOURS, intersecting=colour)),
    )
    low = round(0.5 * (1.0 - HEIGHT) * SIZE)
    framed = np.full_like(image[low:-low], np.round(255.0 * np.array(COLOURS.background)))
    framed[GAP:, GAP:-GAP] = image[low + GAP : -low, GAP:-GAP]
    return framed


def rows(name: str) -> tuple[list[Image], list[str]]:
    """The panels of the examples of a picture, three each, and what stands below them."""
    judges = [Judge(make()) for make in EXAMPLES[name]]
    words = [text for judge in judges for text in captions(judge)]
    return [image for judge in judges for image in panels(judge)], words
