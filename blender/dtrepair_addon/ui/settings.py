"""What the artist chooses, and what was found; both belong to the scene."""

# Blender reads annotations that are calls, and its classes carry no types.
# mypy: allow-subclassing-any, disable-error-code="valid-type"

from typing import Any

import bpy

from ..host.runs import parse_frames


class DTREPAIR_contact(bpy.types.PropertyGroup):
    """A pair of objects, or one and itself, that intersects in a frame."""

    frame: bpy.props.IntProperty()
    first: bpy.props.StringProperty()
    second: bpy.props.StringProperty()
    pairs: bpy.props.IntProperty()
    centre: bpy.props.FloatVectorProperty(subtype="XYZ")
    size: bpy.props.FloatProperty()


class DTREPAIR_settings(bpy.types.PropertyGroup):
    """Choices and findings."""

    span: bpy.props.EnumProperty(
        name="Frames",
        items=(
            ("CURRENT", "Current", "The current frame"),
            ("SCENE", "Scene", "All frames of the scene"),
            ("CHOSEN", "Chosen", "The frames below"),
        ),
    )
    frames: bpy.props.StringProperty(
        name="Frames", default="1:24", description="Such as 7, 1:20 or 1:20x5,30"
    )
    modelled: bpy.props.BoolProperty(
        name="Leave what was modelled",
        default=True,
        description="Contacts of different parts that the rest pose has are no faults",
    )
    clearance: bpy.props.FloatProperty(
        name="Clearance", min=0.0, subtype="DISTANCE", description="How far contacts stay apart"
    )
    result: bpy.props.EnumProperty(
        name="Result",
        items=(
            ("KEYS", "Shape keys", "Keyed shape keys, which may be turned down and edited"),
            ("CACHE", "Mesh cache", "A USD file, read by a modifier: exact at every frame"),
        ),
    )
    caches: bpy.props.StringProperty(
        name="Caches", default="//dtrepair", subtype="DIR_PATH", description="Folder of mesh caches"
    )
    alone: bpy.props.BoolProperty(
        name="Each frame for itself",
        description="Clean frames keep every bit, but the correction may jitter",
    )
    colliders: bpy.props.PointerProperty(
        type=bpy.types.Collection,
        name="Colliders",
        description="Its meshes take part, selected or not, and never move",
    )
    ignored: bpy.props.PointerProperty(
        type=bpy.types.Collection,
        name="Ignored together",
        description="Contacts between any two of its meshes do not count",
    )
    pin: bpy.props.StringProperty(
        name="Pins", description="Vertex group of what stays: weight 1 is fixed, 0 free"
    )
    direction: bpy.props.StringProperty(
        name="Led", description="Vertex group of what is led along the direction below"
    )
    towards: bpy.props.FloatVectorProperty(
        name="Direction", subtype="DIRECTION", default=(0.0, 0.0, 1.0), description="In the world"
    )
    contacts: bpy.props.CollectionProperty(type=DTREPAIR_contact)
    active: bpy.props.IntProperty()
    progress: bpy.props.FloatProperty(min=0.0, max=1.0)
    state: bpy.props.StringProperty()


def chosen_frames(scene: Any) -> list[int]:
    """Return the frames asked for. Raises ValueError for a text that names none."""
    settings = scene.dtrepair
    if settings.span == "CURRENT":
        return [scene.frame_current]
    if settings.span == "SCENE":
        return list(range(scene.frame_start, scene.frame_end + 1))
    return parse_frames(settings.frames)
