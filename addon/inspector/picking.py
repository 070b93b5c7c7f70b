"""From the mouse to a pixel of the picture, or to a ray of the 3D view."""

from __future__ import annotations

from typing import Any, NamedTuple

from ..engine.output import read_border


class Place(NamedTuple):
    """What lies under the mouse: the area, its main region, and the mouse in the region, pixels from its lower left."""

    area: Any
    region: Any
    x: float
    y: float


def find_place(window: Any, x: int, y: int) -> Place | None:
    """Return the image editor or 3D view at a point of a window, pixels from its lower left corner, or None."""
    for area in window.screen.areas:
        if area.type not in ("IMAGE_EDITOR", "VIEW_3D"):
            continue
        for region in area.regions:
            inside = region.x <= x < region.x + region.width and region.y <= y < region.y + region.height
            if inside and region.type != "WINDOW" and region.alignment != "NONE":
                break  # a toolbar or the sidebar that lies over it
            if inside and region.type == "WINDOW":
                return Place(area, region, x - region.x, y - region.y)
    return None


def find_pixel(place: Place, resolution: tuple[int, int], settings: Any) -> tuple[int, int] | None:
    """Return column and row, from the lower left corner of the full picture, of the image's pixel under the mouse.

    An image of another size, such as the heat map of a comparison, shows the whole picture.

    resolution : width and height of the full picture; settings : Scene.render
    """
    u, v = place.region.view2d.region_to_view(place.x, place.y)  # 0 to 1 over the image
    if not (0 <= u < 1 and 0 <= v < 1):
        return None
    border = read_border(settings, *resolution)
    image = place.area.spaces.active.image
    if settings.use_border and settings.use_crop_to_border and tuple(image.size) == (border.width, border.height):
        return border.x_min + int(u * border.width), border.y_min + int(v * border.height)
    return int(u * resolution[0]), int(v * resolution[1])


def find_view_ray(place: Place) -> tuple[Any, Any]:
    """Return origin and unit direction of the 3D view's ray under the mouse, world space."""
    from bpy_extras import view3d_utils

    view, point = place.area.spaces.active.region_3d, (place.x, place.y)
    origin = view3d_utils.region_2d_to_origin_3d(place.region, view, point)
    return origin, view3d_utils.region_2d_to_vector_3d(place.region, view, point)
