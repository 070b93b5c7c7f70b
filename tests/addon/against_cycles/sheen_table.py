"""Measure the sheen of Cycles, and print `raytracer.bsdfs.sheen_table.PACKED`, in a minute.

    python -m tests.addon.against_cycles.sheen_table

Planes of the Sheen BSDF, one for each roughness, are lit by a sun from several directions and seen at each cosine.
What they show is v = R z / pi (a / |(a x + b z, a y, z)|^2)^2, so that sqrt(z / (pi v)) = p (x^2 + y^2) + q x z + r z^2
with p = a / sqrt(R), q = 2 b / sqrt(R), r = (b^2 + 1) / (a sqrt(R)): linear in p, q and r, and R = 1 / (r p - q^2 / 4).
"""

from __future__ import annotations

import math
import textwrap
from typing import Any

import bpy
import numpy as np
from mathutils import Vector
from numpy.typing import NDArray

import addon
from addon.compare.cycles.rendering import CYCLES, Request, matched_settings, render_batches
from blend_scenes import building
from raytracer.bsdfs.sheen_table import SIZE, pack_table
from tests.addon.against_cycles.furnace import make_material, node

SUNS = [(0, 0), (0.6, 0), (-0.6, 0), (0, 0.6), (0.9, 0), (-0.9, 0), (0.5, 0.5), (0.98, 0)]  # x, y of unit directions
STRENGTH = 1e4  # so that nothing is too dark for float32
HEIGHT = 4  # pixels
SMALLEST_COSINE = 0.5 / (SIZE - 1)  # stands for 0, at which a plane is a line


def make_sheet() -> tuple[Any, Any]:
    """Build the planes side by side; return the camera and the sun."""
    building.start_scene(SIZE, HEIGHT)
    for column in range(SIZE):
        left, long = column - SIZE / 2, 200.0
        corners = [(left, -long, 0), (left + 1, -long, 0), (left + 1, long, 0), (left, long, 0)]
        plane = building.new_mesh(f"Plane {column}", corners, [(0, 1, 2, 3)])
        white = node("Sheen", Color=(1, 1, 1, 1))
        building.link_object(plane.name, plane, materials=[make_material(white, column / (SIZE - 1))])
    camera = building.add_camera((0, 0, 1), (0, 0, 0))
    camera.data.type, camera.data.ortho_scale, camera.data.clip_end = "ORTHO", SIZE, 1e4
    sun = building.add_light("Sun", "SUN", STRENGTH, (0, 0, 1), (0, 0, 0))
    sun.data.angle = 0.0
    return camera, sun


def measure(camera: Any, sun: Any, cosine: float) -> NDArray[np.float64]:
    """Return (3, roughnesses) R, a and b at one cosine."""
    sine = math.sqrt(1.0 - cosine**2)
    camera.location, camera.rotation_euler = Vector((0, -sine, cosine)) * 1000, (math.acos(cosine), 0, 0)
    request, rows, shown = Request(SIZE, HEIGHT, 1, 0, through_centre=True), [], []
    for x, y in SUNS:
        z = math.sqrt(1.0 - x * x - y * y)
        sun.rotation_euler = Vector((y, -x, z)).to_track_quat("Z", "Y").to_euler()  # x is towards the view, -y here
        scene = bpy.context.scene
        layer = bpy.context.view_layer
        with matched_settings(scene, layer, request):
            image = render_batches(scene, layer, CYCLES, request).passes["Combined"][0, 1, :, 0].astype(np.float64)
        rows.append((x * x + y * y, x * z, z * z))
        shown.append(image / (STRENGTH * z))
    return np.stack([solve(np.array(rows), values) for values in np.stack(shown, axis=1)], axis=1)


def solve(rows: NDArray[np.float64], values: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return R, a and b of what is shown (suns,) over z; zeros where it is black."""
    if not values.all():
        return np.zeros(3)
    weights = np.sqrt(math.pi * values)
    p, q, r = np.linalg.lstsq(rows * weights[:, np.newaxis], np.ones(len(rows)), rcond=None)[0]
    albedo = 1.0 / (r * p - q * q / 4.0)
    return np.array([albedo, p * math.sqrt(albedo), q * math.sqrt(albedo) / 2.0])


def measure_table() -> NDArray[np.float64]:
    """Return (3, roughness, cosine)."""
    camera, sun = make_sheet()
    cosines = np.maximum(np.arange(SIZE) / (SIZE - 1), SMALLEST_COSINE)
    table = np.stack([measure(camera, sun, cosine) for cosine in cosines], axis=2)
    table[:, :, 0] = 2.0 * table[:, :, 0] - table[:, :, 1]  # Cycles interpolates between its nodes
    table[0] = np.maximum(table[0], 0.0)
    for rough in range(SIZE - 2, -1, -1):  # where nothing is reflected any shape will do
        table[1:, rough] = np.where(table[0, rough] > 0, table[1:, rough], table[1:, rough + 1])
    return table


if __name__ == "__main__":
    addon.register()
    print("\n".join(textwrap.wrap(pack_table(measure_table()), 112, break_on_hyphens=False)))
