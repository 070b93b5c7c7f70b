"""What the panel asks for and lists, kept with the window manager: of the session, not of the scene."""

from __future__ import annotations

from typing import Any

import bpy
from bpy.props import BoolProperty, CollectionProperty, FloatProperty, IntProperty, PointerProperty, StringProperty

from . import session


def choose_row(state: Any, context: Any) -> None:
    """Inspect the entry that was clicked (Blender's callback)."""
    session.inspect_worst(context, state.worst_index)


def width_property() -> Any:
    """The width of a comparison's pictures; of the panel and of the operators alike, as the next two."""
    return IntProperty(
        name="Width",
        description="Width of both images in pixels, or camera rays per row; "
        "the height follows the scene's aspect ratio",
        default=192,
        min=16,
        soft_max=1920,
        max=16384,
        subtype="PIXEL",
    )


def samples_property() -> Any:
    """The samples of a comparison with Cycles."""
    return IntProperty(
        name="Samples",
        description="Light paths per pixel for each engine; with few, most of the difference is noise",
        default=64,
        min=1,
        soft_max=1024,
    )


def rays_property() -> Any:
    """The rays of a comparison with Scene.ray_cast."""
    return IntProperty(
        name="Extra Rays",
        description="Number of rays in random directions besides the camera's, and as many again aimed at vertices "
        "and at edges each, where ray casters fail first",
        default=4096,
        min=1,
        soft_max=65536,
    )


class ReferenceRaytracerWorst(bpy.types.PropertyGroup):
    """A row of the list of the worst pixels or rays, in the columns of `results.Worst`; `name` is all of it."""

    apart: StringProperty(name="Error", description="How far the two sides are apart")  # type: ignore[valid-type]
    place: StringProperty(name="Place", description="Pixel from the lower left corner, or kind of ray")  # type: ignore[valid-type]
    object: StringProperty(name="Object", description="What is seen there")  # type: ignore[valid-type]
    ours: StringProperty(name="Ours", description="What this ray tracer says")  # type: ignore[valid-type]
    theirs: StringProperty(name="Theirs", description="What the other side says")  # type: ignore[valid-type]


class ReferenceRaytracerComparison(bpy.types.PropertyGroup):
    """Settings and results of comparisons in this session."""

    width: width_property()  # type: ignore[valid-type]
    samples: samples_property()  # type: ignore[valid-type]
    rays: rays_property()  # type: ignore[valid-type]
    is_running: BoolProperty(  # type: ignore[valid-type]
        name="Running", description="Whether a comparison is running"
    )
    progress: FloatProperty(  # type: ignore[valid-type]
        name="Progress", description="Share of the comparison that is finished", min=0.0, max=1.0, subtype="FACTOR"
    )
    worst: CollectionProperty(  # type: ignore[valid-type]
        type=ReferenceRaytracerWorst, name="Worst", description="The pixels or rays with the largest errors"
    )
    worst_index: IntProperty(  # type: ignore[valid-type]
        name="Worst", description="Click a row to see the rays of that pixel", min=0, update=choose_row
    )


CLASSES = (ReferenceRaytracerWorst, ReferenceRaytracerComparison)


def register() -> None:
    """Add them to the window manager."""
    for group in CLASSES:
        bpy.utils.register_class(group)
    bpy.types.WindowManager.reference_raytracer_comparison = PointerProperty(
        type=ReferenceRaytracerComparison, name="Comparison", description="Settings and results of comparisons"
    )


def unregister() -> None:
    """Take them out."""
    del bpy.types.WindowManager.reference_raytracer_comparison
    for group in reversed(CLASSES):
        bpy.utils.unregister_class(group)
