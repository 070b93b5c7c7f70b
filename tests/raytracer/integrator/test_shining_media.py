"""What media shine with, where surfaces reflect it and media scatter it: no sample of light finds it, reflected rays
do, after the last bounce and with the direct integrator as well."""

from __future__ import annotations

import numpy as np
import pytest

from raytracer import AreaLight, Closure, Material, Mesh, Scene, Spheres, VolumeClosure
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from tests.raytracer.integrator.media_scenes import (
    INTEGRATORS,
    assert_close,
    fill,
    look,
    measure,
    sum_midpoints,
)

GLOW = np.array([0.3, 0.2, 0.1])
WALL = Mesh(positions=[(-9, 0, -9), (9, 0, -9), (9, 0, 9), (-9, 0, 9)], triangles=[(0, 1, 2), (0, 2, 3)], material=1)
PAINT = Material((Closure("diffuse", color=0.5),))


def stand(scattering: float = 0.0, wall: bool = True) -> Scene:
    """A glowing ball around the origin, 1 m in radius, before and in a wall."""
    ball = fill(VolumeClosure("coefficients", scattering=scattering, emission=GLOW))
    spheres = Spheres([(0, 0, 0)], [1.0])
    return Scene(meshes=[WALL] if wall else [], spheres=spheres, materials=[ball, PAINT], camera=look())


@INTEGRATORS
@pytest.mark.parametrize("bounces", [0, 3])
def test_a_wall_reflects_what_shines_before_it(integrator: str, bounces: int) -> None:
    """All directions from the middle see the radius: e R / 2 of them is reflected, and e R seen before the wall."""
    seen = measure(stand(), 4, integrator=integrator, max_bounces=bounces)[0]
    # The picture is 1e-3 m wide.
    np.testing.assert_allclose(seen, 1.5 * GLOW, rtol=1e-5)


@INTEGRATORS
def test_a_medium_scatters_its_own_light_once(integrator: str) -> None:
    """Along the ray through the middle, from y to where it leaves at -1: e T, and s T times the mean over directions of
    e (1 - exp(-s l)) / s along chords l from there."""
    s, cosine = 0.8, np.linspace(-1.0, 1.0, 2001)
    cosine = (cosine[1:] + cosine[:-1]) / 2.0

    def measure_light(y: np.ndarray) -> np.ndarray:
        chord = -y[:, np.newaxis] * cosine + np.sqrt(1.0 - y[:, np.newaxis] ** 2 * (1.0 - cosine**2))
        return np.exp(-s * (y + 1.0)) * (1.0 - np.expm1(-s * chord).mean(axis=1))

    expected = sum_midpoints(measure_light, 2000)
    assert_close(measure(stand(s, wall=False), 64, integrator=integrator, max_bounces=0), expected * GLOW)
    if integrator == "direct":
        assert_close(measure(stand(s, wall=False), 64, integrator=integrator, max_bounces=9), expected * GLOW)


def test_lights_light_a_medium_as_much_where_it_shines() -> None:
    """Scattered rays that look for what shines meet lights as well, which the samples leave them a share of: also such
    as the camera does not see."""
    lamp = AreaLight((0, 0, 1.5), (3, 0, 0), (0, 3, 0), 50.0, seen_by=SEEN_BY_ALL - SEEN_BY["camera"])

    def light(emission: float) -> tuple[np.ndarray, np.ndarray]:
        smoke = fill(VolumeClosure("coefficients", scattering=0.6, emission=emission))
        scene = Scene(spheres=Spheres([(0, 0, 0)], [1.0]), materials=[smoke], camera=look(), lights=lamp)
        return measure(scene, 64, integrator="direct")

    plain, shining = light(0.0), light(1e-9)
    assert plain[0].min() > 0
    assert_close((shining[0], np.hypot(plain[1], shining[1])), plain[0])
