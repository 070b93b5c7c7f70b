"""Text and curves: objects that only become meshes when they are rendered - text, a bevelled Bezier curve, metaballs
and a NURBS surface.
"""

from __future__ import annotations

import math

import bpy

from blend_scenes import building


def build() -> None:
    """Fill the scene: one object of each kind on a pale ground."""
    building.start_scene()
    building.set_world((0.75, 0.85, 1.0), 0.4)
    paper = building.make_shader("Paper", "Diffuse", (0.74, 0.72, 0.68))
    building.link_object("Backdrop", building.make_backdrop("Backdrop", 40, 5.0, 8, 2.5), materials=[paper])
    add_text()
    add_ribbon()
    add_metaballs()
    add_surface()
    building.add_light(
        "Softbox", "AREA", 480, (-3.4, -3.2, 4.6), (0, 0, 0.5), (1.0, 0.94, 0.86), shape="SQUARE", size=1.8
    )
    building.add_camera((0.1, -8.0, 2.6), (0.0, 0.1, 0.92), 45)


def add_text() -> None:
    """Blender's own font, extruded and bevelled, standing upright."""
    curve = bpy.data.curves.new("Text", "FONT")
    curve.body = "p = v + td"
    curve.align_x = "CENTER"
    curve.size, curve.extrude, curve.bevel_depth, curve.bevel_resolution = 1.15, 0.1, 0.018, 2
    blue = building.make_principled("Blue enamel", (0.03, 0.12, 0.42), roughness=0.15)
    building.link_object("Line equation", curve, (0, 0.3, 1.02), rotation=(90, 0, 0), materials=[blue])


def add_ribbon() -> None:
    """A closed Bezier curve, a tube by its bevel depth, that waves behind the text."""
    curve = bpy.data.curves.new("Ribbon", "CURVE")
    curve.dimensions = "3D"
    curve.bevel_depth, curve.bevel_resolution, curve.resolution_u = 0.07, 6, 16
    spline = curve.splines.new("BEZIER")
    count = 12
    spline.bezier_points.add(count - 1)
    spline.use_cyclic_u = True
    for number, point in enumerate(spline.bezier_points):
        angle = math.tau * number / count
        point.co = (2.9 * math.cos(angle), 1.8 + 0.9 * math.sin(angle), 0.95 + 0.8 * (-1) ** number)
        point.handle_left_type = point.handle_right_type = "AUTO"
    copper = building.make_principled("Copper", (0.9, 0.42, 0.25), metallic=1.0, roughness=0.25)
    building.link_object("Bezier tube", curve, materials=[copper])


def add_metaballs() -> None:
    """Five metaballs that flow together."""
    family = bpy.data.metaballs.new("Droplets")
    family.resolution = family.render_resolution = 0.05
    for x, y, z, radius in (
        (0, 0, 0.38, 0.6),
        (0.5, 0.12, 0.3, 0.45),
        (-0.42, 0.1, 0.3, 0.42),
        (0.1, -0.1, 0.82, 0.42),
        (0.9, -0.1, 0.22, 0.34),
    ):
        element = family.elements.new()
        element.co, element.radius = (x, y, z), radius
    lime = building.make_principled("Lime gel", (0.38, 0.62, 0.05), roughness=0.1)
    building.link_object("Metaballs", family, (-1.5, -0.9, 0), materials=[lime])


def add_surface() -> None:
    """A NURBS torus; Blender makes surface patches by an operator only."""
    bpy.ops.surface.primitive_nurbs_surface_torus_add(radius=0.55, location=(1.4, -0.9, 0.48), rotation=(0.6, 0.3, 0))
    torus = bpy.context.object
    torus.name = torus.data.name = "NURBS torus"
    torus.data.resolution_u = torus.data.resolution_v = 8
    torus.data.materials.append(building.make_principled("Coral", (0.85, 0.2, 0.13), roughness=0.3))


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "text_and_curves.blend")
