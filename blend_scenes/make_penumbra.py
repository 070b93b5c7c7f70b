"""Penumbra: the shadow of a long lamp, sharp where a thing touches the ground and softer the higher it floats."""

from __future__ import annotations

from blend_scenes import building


def build() -> None:
    """Fill the scene: a stair of floating bars and a rake of posts under one large area light."""
    building.start_scene()
    building.set_world((0.6, 0.7, 0.9), 0.15)
    paper = building.make_shader("Paper", "Diffuse", (0.8, 0.78, 0.74))
    building.link_object("Backdrop", building.make_backdrop("Backdrop", 40, 4.5, 9, 2.5), materials=[paper])
    for number in range(7):
        hue = number / 6
        paint = building.make_shader(
            f"Paint {number + 1}", "Diffuse", (0.75 - 0.6 * hue, 0.22 + 0.1 * hue, 0.08 + 0.6 * hue)
        )
        bar = building.make_box(f"Bar {number + 1}", 0.42, 1.5, 0.08)
        place = (-2.7 + 0.9 * number, 0.4, 0.02 + 0.28 * number)
        building.link_object(f"Floating bar {number + 1}", bar, place, materials=[paint])
        post = building.make_cone(f"Post {number + 1}", 0.07, 0.07, 0.35 + 0.28 * number, 24)
        building.link_object(f"Post {number + 1}", post, (-2.7 + 0.9 * number, 2.3, 0), materials=[paint])
    building.add_light(
        "Long lamp",
        "AREA",
        900,
        (-3.4, -2.2, 6.2),
        (0, 0.8, 0),
        (1.0, 0.93, 0.84),
        shape="RECTANGLE",
        size=3.2,
        size_y=0.6,
    )
    building.add_camera((0.2, -8.4, 4.3), (0.1, 0.9, 0.65), 46)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "penumbra.blend")
