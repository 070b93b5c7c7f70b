"""The first look at a picture, in large pixels."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import raytracer
from addon.engine import first_look
from addon.engine.output import Border

WIDTH, HEIGHT = 64, 48


class Screen:
    """Stands for a RenderOutput: keeps what is shown."""

    def __init__(self) -> None:
        self.pictures: list[Any] = []

    def write(self, passes: Any) -> None:
        self.pictures.append(passes["Combined"])

    def show(self) -> None:
        pass


@pytest.fixture
def scene() -> raytracer.Scene:
    """A wall, black at the left and shining at the right, that fills the picture."""
    quads = [[(x, -9, 0), (x + 9, -9, 0), (x + 9, 9, 0), (x, 9, 0)] for x in (-9, 0)]
    triangles = [(0, 1, 2), (0, 2, 3)]
    dark, bright = (
        raytracer.Material((raytracer.Closure("emission", color=np.full(3, value)),)) for value in (0.0, 1.0)
    )
    meshes = [raytracer.Mesh(corners, triangles, material=number) for number, corners in enumerate(quads)]
    above = np.eye(4)
    above[2, 3] = 5.0
    return raytracer.Scene(meshes=meshes, materials=[dark, bright], camera=raytracer.Camera(above))


@pytest.mark.parametrize("border", [Border(0, 0, WIDTH, HEIGHT), Border(5, 7, 43, 40)])
def test_first_look_shows_each_part_at_its_place(
    scene: raytracer.Scene, border: Border, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(first_look, "SMALLEST_PICTURE", 1)
    screen, settings = Screen(), {"samples": 64, "passes": ("Combined", "Depth"), "border": border, "workers": 2}
    look = first_look.show_first_look
    look(screen, scene, raytracer.build(scene), (WIDTH, HEIGHT), border, settings, lambda: False)
    assert len(screen.pictures) == len(first_look.FACTORS)
    for picture, factor in zip(screen.pictures, first_look.FACTORS, strict=True):
        assert picture.shape == (border.height, border.width, 4)
        edge = WIDTH // 2 - border.x_min  # a sample of a coarse pixel lies within the filter's reach around it
        assert not picture[:, : max(edge - 2 * factor, 0), :3].any()
        assert (picture[:, edge + 2 * factor :, :3] == 1).all()


def test_first_look_ends_with_escape_and_is_left_out_where_a_sweep_is_short(scene: raytracer.Scene) -> None:
    screen, caster = Screen(), raytracer.build(scene)
    large = Border(0, 0, 640, 480)
    first_look.show_first_look(screen, scene, caster, (640, 480), large, {}, lambda: True)
    first_look.show_first_look(screen, scene, caster, (64, 48), Border(0, 0, 64, 48), {}, lambda: False)
    assert not screen.pictures
