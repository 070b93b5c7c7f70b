"""Cornell box: an emissive mesh as the only lamp, in the room that everybody knows.

Proportions after Goral, Torrance, Greenberg and Battaile, "Modeling the interaction of light between diffuse
surfaces", 1984, in units of the room's width. Only direct light is computed: the walls do not color one another,
and a dim world that enters through the open front stands for the missing interreflection.
"""

from __future__ import annotations

from blend_scenes import building


def build() -> None:
    """Fill the scene: five walls, a lamp, a matte short box and a mirroring tall one."""
    building.start_scene(480, 480, view_transform="Standard")
    building.set_world((1.0, 0.95, 0.9), 0.25)
    add_room()
    white = building.make_shader("White", "Diffuse", (0.73, 0.73, 0.73))
    mirror = building.make_principled("Mirror", (0.9, 0.9, 0.9), metallic=1.0, roughness=0.0)
    short = building.make_box("Short box", 0.6, 0.6, 0.6)
    tall = building.make_box("Tall box", 0.6, 0.6, 1.2)
    building.link_object("Short box", short, (0.35, -0.38, 0), rotation=(0, 0, 17), materials=[white])
    building.link_object("Tall box", tall, (-0.33, 0.32, 0), rotation=(0, 0, -18), materials=[mirror])
    lamp = building.make_shader("Lamp", "Emission", (1.0, 0.78, 0.5), strength=17.0)
    building.link_object(
        "Ceiling lamp",
        building.make_plane("Ceiling lamp", 0.5, 0.4),
        (0, 0, 1.995),
        rotation=(180, 0, 0),
        materials=[lamp],
    )
    building.add_camera((0, -4.85, 1), (0, 0, 1), 66)


def add_room() -> None:
    """A room of 2 x 2 x 2 metres, open to the camera, with a red wall on the left and a green one on the right."""
    white = building.make_shader("White wall", "Diffuse", (0.73, 0.73, 0.73))
    red = building.make_shader("Red wall", "Diffuse", (0.63, 0.06, 0.05))
    green = building.make_shader("Green wall", "Diffuse", (0.14, 0.45, 0.09))
    walls = (
        ("Floor", (0, 0, 0), (0, 0, 0), white),
        ("Ceiling", (0, 0, 2), (180, 0, 0), white),
        ("Back wall", (0, 1, 1), (90, 0, 0), white),
        ("Left wall", (-1, 0, 1), (0, 90, 0), red),
        ("Right wall", (1, 0, 1), (0, -90, 0), green),
    )
    for name, place, rotation, material in walls:
        building.link_object(name, building.make_plane(name, 2, 2), place, rotation=rotation, materials=[material])


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "cornell_box.blend")
