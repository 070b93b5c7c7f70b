"""Lights: one of each kind in a cabinet of eight compartments, each with a mirror ball that shows the lamp itself.

Upper row: sun (through a hole in the roof), point, spot, spot with a soft border. Lower row: area lights - square,
rectangle, disk and ellipse.
"""

from __future__ import annotations

from blend_scenes import building

CELL, WALL, DEPTH = 1.0, 0.06, 1.0
SUN_CELL = (0, 1)  # column, row


def build() -> None:
    """Fill the scene: the cabinet, its eight lights, and a ball and a peg in each compartment."""
    building.start_scene()
    building.set_world((0.7, 0.8, 1.0), 0.06)
    add_cabinet()
    ball, peg = building.make_sphere("Mirror ball", 0.17), building.make_cone("Peg", 0.07, 0.07, 0.36)
    ball.materials.append(building.make_shader("Mirror", "Glossy", (0.9, 0.9, 0.9), roughness=0.0))
    peg.materials.append(building.make_shader("Clay", "Diffuse", (0.7, 0.3, 0.16)))
    for number in range(8):
        x, z = cell_origin(number % 4, number // 4)
        building.link_object(f"Mirror ball {number + 1}", ball, (x + 0.2, 0.08, z + 0.17))
        building.link_object(f"Peg {number + 1}", peg, (x - 0.2, -0.02, z))
    add_lights()
    building.add_camera((0, -7.2, 1.65), (0, 0, 1.06), 54)


def cell_origin(column: int, row: int) -> tuple[float, float]:
    """Return the x and z of the middle of a compartment's floor."""
    pitch = CELL + WALL
    return (column - 1.5) * pitch, WALL + row * pitch


def add_cabinet() -> None:
    """Boards of white paint; the roof lets the sun into one compartment."""
    paint = building.make_shader("White paint", "Diffuse", (0.72, 0.71, 0.68))
    pitch, width, height = CELL + WALL, 4 * CELL + 5 * WALL, 2 * CELL + 3 * WALL
    boards = [("Back", (width, WALL, height), (0, DEPTH / 2 + WALL / 2, 0))]
    boards += [(f"Upright {i + 1}", (WALL, DEPTH, height), ((i - 2) * pitch, 0, 0)) for i in range(5)]
    boards += [(f"Shelf {i + 1}", (width, DEPTH, WALL), (0, 0, i * pitch)) for i in range(2)]
    left = cell_origin(*SUN_CELL)[0]
    roof = 2 * pitch
    boards.append(("Roof", (3 * pitch + WALL / 2, DEPTH, WALL), (pitch / 2 + WALL / 4, 0, roof)))
    boards += [(f"Roof slat {i + 1}", (CELL, 0.12, WALL), (left, -0.44 + 0.22 * i, roof)) for i in range(5)]
    for name, size, place in boards:
        building.link_object(name, building.make_box(name, *size), place, materials=[paint])


def add_lights() -> None:
    """One light for each compartment, under its ceiling; the sun is outside, to the right, behind and above."""
    warm = (1.0, 0.86, 0.7)
    building.add_light("Sun", "SUN", 5.0, (1.5, 0.45, 3.3), (0, 0, 0), warm, angle=0.009)
    lamps = (
        ("Point", 1, 1, {"kind": "POINT", "energy": 17, "shadow_soft_size": 0.06}),
        ("Spot", 2, 1, {"kind": "SPOT", "energy": 45, "shadow_soft_size": 0.02, "spot_size": 0.95, "spot_blend": 0.0}),
        (
            "Soft spot",
            3,
            1,
            {"kind": "SPOT", "energy": 60, "shadow_soft_size": 0.02, "spot_size": 1.3, "spot_blend": 1.0},
        ),
        ("Square", 0, 0, {"kind": "AREA", "energy": 7, "shape": "SQUARE", "size": 0.3}),
        ("Rectangle", 1, 0, {"kind": "AREA", "energy": 7, "shape": "RECTANGLE", "size": 0.7, "size_y": 0.1}),
        ("Disk", 2, 0, {"kind": "AREA", "energy": 7, "shape": "DISK", "size": 0.34}),
        ("Ellipse", 3, 0, {"kind": "AREA", "energy": 7, "shape": "ELLIPSE", "size": 0.16, "size_y": 0.6}),
    )
    for name, column, row, settings in lamps:
        x, z = cell_origin(column, row)
        spot = settings["kind"] == "SPOT"
        place, target = (x, -0.45 if spot else -0.1, z + 0.86), (x, 0.5 if spot else -0.0999, z + 0.2 if spot else z)
        building.add_light(name, location=place, target=target, color=warm, **settings)


if __name__ == "__main__":
    build()
    building.save_scene(building.SCENES / "lights.blend")
