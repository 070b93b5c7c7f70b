"""Still life: the picture of `make render`. Soft shadow, mirror, glass, and texture made of geometry alone."""

from __future__ import annotations

import math

from blend_scenes import building


def build() -> None:
    """Fill the scene: a table before a sweep, five things on it, one soft light from the left, a dim blue sky."""
    building.start_scene(960, 640)
    building.set_world((0.55, 0.68, 0.9), 0.42)
    clay = building.make_shader("Warm plaster", "Diffuse", (0.6, 0.47, 0.37))
    building.link_object("Backdrop", building.make_backdrop("Backdrop", 12, 1.6, 4, 1.0), materials=[clay])
    add_mirror()
    add_knurled_jar()
    add_fluted_vase()
    add_glasses()
    add_fruit()
    building.add_light(
        "Window", "AREA", 100, (-2.1, -1.1, 2.3), (0.1, 0.2, 0.2), (1.0, 0.93, 0.82), shape="SQUARE", size=1.3
    )
    building.add_light(
        "Rim", "AREA", 30, (1.9, 0.9, 1.5), (0.1, 0.1, 0.3), (0.75, 0.86, 1.0), shape="RECTANGLE", size=0.6, size_y=1.2
    )
    building.add_camera((0.1, -2.75, 0.98), (0.06, 0.1, 0.315), 64)


def add_mirror() -> None:
    """A round mirror that leans at the back and shows the things from behind."""
    silver = building.make_principled("Silvered glass", (0.93, 0.95, 0.94), metallic=1.0, roughness=0.0)
    brass = building.make_principled("Brass", (0.83, 0.58, 0.25), metallic=1.0, roughness=0.22)
    disc = building.make_cone("Mirror disc", 0.36, 0.36, 0.02, segments=128)
    frame = building.make_lathe("Mirror frame", ring_profile(0.372, 0.022), segments=128)
    for mesh, material in ((disc, silver), (frame, brass)):
        building.link_object(mesh.name, mesh, (0.36, 0.62, 0.393), rotation=(88, 0, -22), materials=[material])


def ring_profile(radius: float, thickness: float) -> list[tuple[float, float]]:
    """Return the closed circle whose sweep is a torus."""
    angles = [math.tau * step / 16 for step in range(17)]
    return [(radius + thickness * math.cos(angle), thickness * math.sin(angle)) for angle in angles]


def add_knurled_jar() -> None:
    """A brass jar whose knurling is one diamond-shaped stud, repeated 40 x 14 times by two array modifiers."""
    brass = building.make_principled("Knurled brass", (0.78, 0.5, 0.2), metallic=1.0, roughness=0.28)
    radius, height, columns, rows, place = 0.15, 0.3, 40, 14, (-0.36, 0.16, 0.0)
    half, rise = math.pi / columns, height / (2 * rows)
    corners = [(-half, 0), (0, -rise), (half, 0), (0, rise)]
    vertices = [(radius * math.cos(a), radius * math.sin(a), z) for a, z in corners] + [(radius + 0.011, 0, 0)]
    stud = building.new_mesh("Knurl stud", vertices, [(0, 1, 4), (1, 2, 4), (2, 3, 4), (3, 0, 4)])
    jar = building.link_object("Knurled jar", stud, (place[0], place[1], 0.02 + rise), materials=[brass])
    turn = building.link_object("Knurl turn", None, jar.location, rotation=(0, 0, 360 / columns))
    step = building.link_object("Knurl step", None, jar.location, rotation=(0, 0, 180 / columns))
    step.location.z += rise
    for name, count, offset in (("Around", columns, turn), ("Upwards", 2 * rows - 1, step)):
        building.add_modifier(
            jar, "ARRAY", name, count=count, use_relative_offset=False, use_object_offset=True, offset_object=offset
        )
    smooth = building.make_principled("Polished brass", (0.83, 0.58, 0.25), metallic=1.0, roughness=0.08)
    lid = [(0.0, 0.31), (0.155, 0.31), (0.162, 0.325), (0.155, 0.34), (0.06, 0.362), (0.022, 0.375), (0.03, 0.4)]
    building.link_object("Jar base", building.make_cone("Jar base", 0.156, 0.156, 0.026), place, materials=[smooth])
    building.link_object(
        "Jar lid", building.make_lathe("Jar lid", [*lid, (0.022, 0.424), (0.0, 0.43)]), place, materials=[smooth]
    )


def add_fluted_vase() -> None:
    """A glazed vase: a star-shaped cage of few faces, twisted and then smoothed by modifiers."""
    glaze = building.make_principled("Blue glaze", (0.03, 0.13, 0.33), roughness=0.12)
    outline = [(0.07, 0.0), (0.085, 0.01), (0.15, 0.12), (0.165, 0.24), (0.12, 0.38), (0.062, 0.47), (0.085, 0.53)]
    flutes = 2 * 13
    vertices, faces = [], []
    for ring, (radius, height) in enumerate(outline):
        for spoke in range(flutes):
            angle = math.tau * spoke / flutes
            reach = radius * (1.09 if spoke % 2 else 0.91)
            vertices.append((reach * math.cos(angle), reach * math.sin(angle), height))
            if ring:
                a, b = (ring - 1) * flutes + spoke, (ring - 1) * flutes + (spoke + 1) % flutes
                faces.append((a, b, b + flutes, a + flutes))
    vase = building.link_object(
        "Fluted vase",
        building.new_mesh("Fluted vase", vertices, faces, smooth=True),
        (0.02, 0.42, 0),
        materials=[glaze],
    )
    building.subdivide(vase, 3)
    building.add_modifier(
        vase, "SIMPLE_DEFORM", "Twist", deform_method="TWIST", deform_axis="Z", angle=math.radians(75)
    )
    building.add_modifier(vase, "SOLIDIFY", "Wall", thickness=0.008)


def add_glasses() -> None:
    """A goblet with a wall of its own, and a solid ball."""
    glass = building.make_shader("Clear glass", "Glass", (0.97, 0.99, 0.98), roughness=0.0, ior=1.5)
    outside = [(0.0, 0.0), (0.115, 0.0), (0.117, 0.006), (0.03, 0.02), (0.013, 0.04), (0.012, 0.15), (0.02, 0.19)]
    bowl = [(0.085, 0.235), (0.12, 0.3), (0.125, 0.36), (0.107, 0.44)]
    inside = [(0.1035, 0.44), (0.1205, 0.36), (0.1155, 0.3), (0.08, 0.24), (0.0, 0.205)]
    goblet = building.make_lathe("Goblet", [*outside, *bowl, *inside], segments=32)
    thing = building.link_object("Goblet", goblet, (0.34, -0.02, 0.001), materials=[glass])
    building.subdivide(thing, 2)
    building.link_object(
        "Glass ball", building.make_sphere("Glass ball", 0.105, 80), (-0.1, -0.26, 0.106), materials=[glass]
    )


def add_fruit() -> None:
    """Two oranges with their peel, and a chrome ball among them."""
    peel = building.make_principled("Orange peel", (0.85, 0.27, 0.02), roughness=0.38)
    for name, place, radius in (("Orange", (0.1, -0.04, 0.1), 0.1), ("Small orange", (0.56, 0.2, 0.087), 0.088)):
        orange = building.link_object(name, building.make_sphere(name, radius, 32), place, materials=[peel])
        building.subdivide(orange, 2)
        building.displace(orange, 0.006, "STUCCI", noise_scale=0.011, turbulence=4.0)
    chrome = building.make_shader("Chrome", "Glossy", (0.9, 0.9, 0.92), roughness=0.0)
    building.link_object(
        "Chrome ball", building.make_sphere("Chrome ball", 0.06, 64), (0.22, -0.34, 0.06), materials=[chrome]
    )


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "still_life.blend")
