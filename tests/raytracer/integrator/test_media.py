"""Media against closed forms and quadrature.

What is integrated in closed form is exact to TOLERANCE. What is sampled is a mean over 64 pixels of independent noise:
it may be 4 of its standard errors off, which with one seed fails right code in 1 of 16,000 tests, and where a test says
how small the error is, wrong code that differs by twice 4 errors passes as rarely.
"""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer import (
    AreaLight,
    Closure,
    Curves,
    Instances,
    Material,
    Mesh,
    PointLight,
    Scene,
    Spheres,
    SunLight,
    Volume,
    VolumeClosure,
    World,
)
from raytracer.integrator.prepare import prepare
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL
from tests.raytracer.integrator.media_scenes import (
    COLORS,
    DENSITY,
    GREY,
    INTEGRATORS,
    RISING,
    TOLERANCE,
    WHITE,
    absorb,
    decay,
    fill,
    look,
    make_box,
    measure,
    show,
)

# Beer's law ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("integrator", ["direct", "path"])
def test_a_box_absorbs_by_its_thickness(integrator: str) -> None:
    scene = Scene(meshes=make_box((1, 0.75, 1)), materials=fill(absorb()), camera=look(), world=WHITE)
    np.testing.assert_allclose(measure(scene, 1, integrator=integrator)[0], decay(0.7 * 1.5), rtol=TOLERANCE)


def test_a_sphere_absorbs_by_its_chord() -> None:
    camera = look((0.3, -5.0, 0.4))
    scene = Scene(spheres=Spheres([(0, 0, 0)], [1.0]), materials=fill(absorb()), camera=camera, world=WHITE)
    chord = 2.0 * np.sqrt(1.0 - 0.25)
    # The picture is 1e-3 m wide: the chord changes by 1e-4 of it, evenly to both sides.
    np.testing.assert_allclose(measure(scene, 4)[0], decay(0.7 * chord), rtol=1e-5)


def test_nested_and_overlapping_media_add_up() -> None:
    """From -1 to 1 one medium, another one from -0.5 to 0.25 within it, a third one from 0 to 2 across its border."""
    boxes = [make_box(1.0), make_box((0.6, 0.375, 0.6), (0, -0.125, 0), 1), make_box(1.0, (0, 1, 0), 2)]
    materials = [fill(absorb(density)) for density in (0.3, 0.5, 1.1)]
    scene = Scene(meshes=boxes, materials=materials, camera=look(), world=WHITE)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.3 * 2 + 0.5 * 0.75 + 1.1 * 2), rtol=TOLERANCE)


def test_a_camera_may_be_inside_of_several() -> None:
    boxes = [make_box(1.0), make_box(3.0, material=1), make_box(0.2, (0, -4, 0), 2)]
    materials = [fill(absorb(density)) for density in (0.3, 0.5, 9.0)]
    scene = Scene(meshes=boxes, materials=materials, camera=look((0.1, 0.25, 0.2)), world=WHITE)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.3 * 0.75 + 0.5 * 2.75), rtol=TOLERANCE)


def test_a_near_clip_may_begin_inside() -> None:
    camera = look((0.0, -10.0, 0.0))
    camera = raytracer.Camera(camera.world_from_camera, projection="orthographic", ortho_scale=1e-3, clip_start=9.5)
    scene = Scene(meshes=make_box(1.0), materials=fill(absorb()), camera=camera, world=WHITE)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.7 * 1.5), rtol=TOLERANCE)


def test_the_worlds_medium_is_everywhere_and_hides_what_is_far() -> None:
    wall = make_box((2, 0.5, 2), (0, 3.5, 0), 1)
    materials = [fill(absorb(0.5)), Material((Closure("emission", color=1.0),))]
    world = World(1.0, volume=Volume(absorb(0.05)))
    scene = Scene(meshes=[make_box(1.0), wall], materials=materials, camera=look(), world=world)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.05 * 13 + 0.5 * 2), rtol=TOLERANCE)
    scene = Scene(materials=materials, camera=look(), world=World(1.0, volume=Volume(absorb(0.05))))
    assert (measure(scene, 1)[0] == 0.0).all()


def test_instances_scale_their_medium_and_their_density() -> None:
    matrix = np.diag([1.0, 2.0, 1.0, 1.0])
    instances = Instances([0], [matrix], volume_density=[0.5])
    scene = Scene(meshes=make_box(1.0), instances=instances, materials=fill(absorb()), camera=look(), world=WHITE)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.7 * 4 * 0.5), rtol=TOLERANCE)


def test_a_medium_behind_glass_is_entered_by_refraction() -> None:
    """Straight through a slab of index 1.5: both surfaces let (1 - R) through, R = 0.04; twice R is left out here."""
    glass = Material((Closure("refraction", color=1.0, roughness=0.0, ior=1.5),), volume=Volume(absorb()))
    scene = Scene(meshes=make_box(1.0), materials=glass, camera=look(), world=WHITE)
    found = measure(scene, 4, max_bounces=8)[0]
    np.testing.assert_allclose(found / found[2], decay(1.4) / decay(1.4)[2], rtol=1e-4)


def test_strands_have_no_medium_beside_what_has() -> None:
    """A strand that shines before a box, and nothing where it is not."""
    strand = Curves([(0, -4, -1), (0, -4, 1)], [0.5, 0.5], [0, 2], material=1)
    materials = [fill(absorb()), Material((Closure("emission", color=0.5),))]
    for place, expected in ((0.0, 0.5), (0.8, decay(2 * 0.7))):
        scene = Scene(meshes=make_box(), curves=strand, materials=materials, camera=look((place, -10, 0)), world=WHITE)
        np.testing.assert_allclose(measure(scene, 1)[0], np.broadcast_to(expected, 3), rtol=TOLERANCE)


def test_what_shines_within_is_seen_through_what_is_before_it() -> None:
    """e (1 - exp(-x t)) / x of a slab that shines and absorbs, e t of one that is clear."""
    glow = VolumeClosure("coefficients", absorption=(0.5, 2.0, 0.0), emission=(0.3, 0.2, 0.1))
    scene = Scene(meshes=make_box(1.0), materials=fill(glow), camera=look())
    expected = [0.3 * -np.expm1(-1.0) / 0.5, 0.2 * -np.expm1(-4.0) / 2.0, 0.2]
    np.testing.assert_allclose(measure(scene, 1)[0], expected, rtol=TOLERANCE)


@pytest.mark.parametrize("temperature", [1100.0, 3000.0])
def test_a_black_body_shines_by_its_temperature(temperature: float) -> None:
    """Radiance at 1 K times T^4 and a color of luminance 1, along 2 m; of which red heat takes blue light away."""
    hot = VolumeClosure("principled", density=0.0, blackbody=1.0, temperature=temperature, color=0.0)
    found = measure(Scene(meshes=make_box(1.0), materials=fill(hot), camera=look()), 1)[0]
    luminance = 0.2126 * found[0] + 0.7152 * found[1] + 0.0722 * found[2]
    assert luminance == pytest.approx(2 * 5.670373e-14 / np.pi * temperature**4, rel=1e-3)
    assert (found[2] < 0) == (temperature < 1900)


def test_lights_are_seen_and_shine_through_media() -> None:
    """A wall that a sun lights through a box, seen through another one; and an area light seen through it."""
    wall = Mesh(
        positions=[(-5, 3, -5), (5, 3, -5), (5, 3, 5), (-5, 3, 5)], triangles=[(0, 1, 2), (0, 2, 3)], material=1
    )
    white = Material((Closure("diffuse", color=1.0),))
    sun = SunLight((0.0, -1.0, 0.0), np.pi)
    scene = Scene(meshes=[make_box(1.0), wall], materials=[fill(absorb()), white], camera=look(), lights=sun)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.7 * 4), rtol=1e-5)
    lamp = AreaLight((0, 2, 0), (2, 0, 0), (0, 0, -2), np.pi * 4, seen_by=SEEN_BY_ALL)
    scene = Scene(meshes=make_box(1.0), materials=fill(absorb()), camera=look(), lights=lamp)
    np.testing.assert_allclose(measure(scene, 1)[0], decay(0.7 * 2), rtol=1e-5)


@pytest.mark.parametrize("casts", [True, False])
def test_light_that_starts_inside_a_medium_is_dimmed_where_that_throws_shadows(casts: bool) -> None:
    """A wall in the middle of a box, lit by a sun and by a lamp 4 m before it, each as bright as 1."""
    wall = Mesh(
        positions=[(-0.9, 0, -0.9), (0.9, 0, -0.9), (0.9, 0, 0.9), (-0.9, 0, 0.9)],
        triangles=[(0, 1, 2), (0, 2, 3)],
        material=1,
    )
    seen_by = SEEN_BY_ALL if casts else SEEN_BY_ALL - SEEN_BY["shadow"]
    scene = Scene(
        meshes=[make_box(1.0), wall],
        instances=Instances([0, 1], [np.eye(4)] * 2, seen_by=[seen_by, SEEN_BY_ALL]),
        materials=[fill(absorb()), Material((Closure("diffuse", color=1.0),))],
        lights=[SunLight((0.0, -1.0, 0.0), np.pi), PointLight((0.0, -4.0, 0.0), 4.0 * np.pi**2 * 16.0)],
        camera=look(),
    )
    np.testing.assert_allclose(measure(scene, 1)[0], 2.0 * decay(0.7 * (2.0 if casts else 1.0)), rtol=1e-5)


def test_the_border_of_a_medium_is_no_hole() -> None:
    """As in Cycles: what is nothing but a volume has no surface to hold out; what has one is a hole with all of it."""
    for material, expected in ((fill(absorb()), decay(0.7 * 2.0)), (Material(volume=Volume(absorb())), 0.0)):
        instances = Instances([0], [np.eye(4)], holdout=[True])
        scene = Scene(meshes=make_box(1.0), instances=instances, materials=material, camera=look(), world=WHITE)
        np.testing.assert_allclose(measure(scene, 1)[0], np.broadcast_to(expected, 3), rtol=TOLERANCE)


def test_a_camera_inside_a_medium_that_it_does_not_see_is_inside_of_nothing() -> None:
    wall = Mesh(
        positions=[(-5, 3, -5), (5, 3, -5), (5, 3, 5), (-5, 3, 5)], triangles=[(0, 1, 2), (0, 2, 3)], material=1
    )
    materials = [fill(absorb()), Material((Closure("emission", color=1.0),))]
    for hidden, depth in ((0, 1.5), (SEEN_BY["camera"], 0.0)):
        instances = Instances([0, 1], [np.eye(4)] * 2, seen_by=[SEEN_BY_ALL - hidden, SEEN_BY_ALL])
        camera = look((0.0, -0.5, 0.0))
        scene = Scene(meshes=[make_box(1.0), wall], instances=instances, materials=materials, camera=camera)
        np.testing.assert_allclose(measure(scene, 1)[0], decay(0.7 * depth), rtol=TOLERANCE)


def test_light_that_comes_through_a_surface_comes_through_what_is_behind_it() -> None:
    """A translucent sheet with a medium behind it, and a lamp in that, 2 m away: P exp(-2 x) / (4 pi 2^2 pi)."""
    sheet = Mesh(positions=[(-5, 0, -5), (5, 0, -5), (5, 0, 5), (-5, 0, 5)], triangles=[(0, 1, 2), (0, 2, 3)])
    leaf = Material((Closure("translucent", color=1.0),), volume=Volume(absorb()))
    for place, depth in ((2.0, 1.4), (-2.0, 0.0)):
        light = PointLight((0.0, place, 0.0), 10.0)
        closure = leaf if place > 0 else Material((Closure("diffuse", color=1.0),), volume=Volume(absorb()))
        scene = Scene(meshes=sheet, materials=closure, camera=look(), lights=light)
        expected = 10.0 / (16.0 * np.pi**2) * decay(depth)
        np.testing.assert_allclose(measure(scene, 1)[0], expected, rtol=1e-5)


def test_a_transparent_film_counts_what_gets_through() -> None:
    grey = fill(VolumeClosure("absorption", color=0.0, density=0.5))
    scene = Scene(meshes=make_box(1.0), materials=grey, camera=look(), world=WHITE)
    film = show(scene, 1, transparent=True)
    np.testing.assert_allclose(film["Combined"][..., 3], 1.0 - np.exp(-1.0), rtol=TOLERANCE)
    np.testing.assert_allclose(film["Combined"][..., :3], 0.0, atol=TOLERANCE)


def test_borders_are_no_passages_and_are_not_described() -> None:
    boxes = [make_box((1, 0.1, 1), (0, 0.5 * number, 0)) for number in range(6)]
    wall = Mesh(
        positions=[(-5, 5, -5), (5, 5, -5), (5, 5, 5), (-5, 5, 5)], triangles=[(0, 1, 2), (0, 2, 3)], material=1
    )
    materials = [fill(absorb()), Material((Closure("emission", color=1.0),), pass_index=7)]
    scene = Scene(meshes=[*boxes, wall], materials=materials, camera=look())
    film = show(scene, 1, transparent_bounces=1, passes=("Combined", "Depth", "Material Index"))
    np.testing.assert_allclose(film["Combined"][..., :3].mean(axis=(0, 1)), decay(0.7 * 1.2), rtol=TOLERANCE)
    np.testing.assert_allclose(film["Depth"], 15.0, rtol=1e-6)
    assert (film["Material Index"] == 7).all()


# Who sees what --------------------------------------------------------------------------------------------------------


@INTEGRATORS
@pytest.mark.parametrize("what", ["lamp", "world", "object"])
def test_media_scatter_what_scattered_rays_see(what: str, integrator: str) -> None:
    hidden = SEEN_BY_ALL - SEEN_BY["volume"]
    fields: dict[str, Any] = {"meshes": [make_box(1.0)]}
    if what == "lamp":
        fields["lights"] = AreaLight((0, 0, 3), (1, 0, 0), (0, 1, 0), 10.0, seen_by=hidden - SEEN_BY["camera"])
    elif what == "world":
        fields["world"] = World(0.5, seen_by=hidden - SEEN_BY["camera"])
    else:
        fields["meshes"].append(make_box(0.3, (0, 0, 3), 1))
        fields["instances"] = Instances([0, 1], [np.eye(4)] * 2, seen_by=[SEEN_BY_ALL, hidden])
    materials = [GREY, Material((Closure("emission", color=5.0),))]
    seen = measure(Scene(materials=materials, camera=look(), **fields), 4, integrator=integrator)[0]
    assert (seen == 0.0).all()
    for name in ("lights", "world", "instances"):
        fields.pop(name, None) if name == "instances" else None
    if what != "object":
        name = "lights" if what == "lamp" else "world"
        fields[name] = dataclasses.replace(fields[name], seen_by=SEEN_BY_ALL - SEEN_BY["camera"])
    seen = measure(Scene(materials=materials, camera=look(), **fields), 4, integrator=integrator)[0]
    assert (seen > 0.0).all()


@pytest.mark.parametrize("fills_world", [False, True])
def test_lamps_may_light_no_medium(fills_world: bool) -> None:
    """A lamp that lights the second set of objects alone; the world's medium is of the first."""
    closure = VolumeClosure("scatter", density=0.1)
    for light_set, lit in ((0, False), (1, True)):
        world = World(0.0, volume=Volume(closure)) if fills_world else None
        materials = [Material((Closure("diffuse", color=0.0),)) if fills_world else fill(closure)]
        instances = Instances([0], np.eye(4)[np.newaxis] + 0.0, light_set=[light_set])
        sets = 1 << (0 if fills_world and lit else 1)
        light = PointLight((0, 0, 3), 100.0, receivers=sets)
        scene = Scene(
            meshes=make_box(0.5), instances=instances, materials=materials, camera=look(), lights=light, world=world
        )
        assert bool(measure(scene, 4)[0].any()) == lit


def test_groups_of_lights_hold_what_media_shine_with() -> None:
    glow = VolumeClosure("emission", emission=0.25)
    groups = raytracer.LightGroups(["key"], objects=[0])
    scene = Scene(meshes=make_box(1.0), materials=fill(glow), camera=look(), light_groups=groups)
    film = show(scene, 1, passes=("Combined", "Combined_key"))
    np.testing.assert_allclose(film["Combined_key"], 0.5, rtol=TOLERANCE)


def test_guides_of_denoisers_tell_the_albedo_of_what_scatters() -> None:
    thick = fill(VolumeClosure("coefficients", scattering=(30.0, 60.0, 90.0), absorption=(90.0, 60.0, 30.0)))
    scene = Scene(meshes=make_box(1.0), materials=thick, camera=look())
    film = show(scene, 4, passes=("Combined", "Denoising Albedo"))
    np.testing.assert_allclose(film["Denoising Albedo"].mean(axis=(0, 1)), [0.25, 0.5, 0.75], rtol=1e-5)


def test_paths_that_count_below_nothing_go_on(monkeypatch: pytest.MonkeyPatch) -> None:
    """Behind a density beyond its bound light may count below 0: on to a white wall, and what that sees."""
    monkeypatch.setattr("raytracer.media.majorants.SPARE", 0.4)
    smoke = fill(VolumeClosure("absorption", color=COLORS, density=DENSITY), program=RISING)
    room = make_box(8.0, material=1)
    wall = Material((Closure("diffuse", color=1.0), Closure("emission", color=0.25, weight=0.25)))
    scene = Scene(meshes=[make_box(1.0), room], materials=[smoke, wall], camera=look((0, -5, 0)))
    found = measure(scene, 16, max_bounces=4)
    assert np.isfinite(found[0]).all()
    assert (found[1] > 0).all()


# Passes ---------------------------------------------------------------------------------------------------------------


def test_volume_passes_and_the_others_add_up() -> None:
    boxes = [make_box(1.0), make_box((3, 0.5, 3), (0, 2.5, 0), 1)]
    glow = VolumeClosure("coefficients", scattering=(0.4, 0.8, 0.2), absorption=0.1, emission=0.05)
    materials = [fill(glow), Material((Closure("diffuse", color=(0.8, 0.4, 0.2)),))]
    light = PointLight((0.0, -1.0, 3.0), 100.0)
    scene = Scene(meshes=boxes, materials=materials, camera=look(scale=1.0), lights=light, world=World(0.3))
    ways = ("Direct", "Indirect")
    parts = [f"{part} {way}" for part in ("Diffuse", "Glossy", "Transmission") for way in ways]
    volume = [f"Volume {way}" for way in ways]
    colors = ["Diffuse Color", "Glossy Color", "Transmission Color"]
    film = show(scene, 16, passes=("Combined", "Emission", "Environment", *parts, *colors, *volume))
    total = film["Emission"] + film["Environment"] + film[volume[0]] + film[volume[1]]
    for part in ("Diffuse", "Glossy", "Transmission"):
        total = total + (film[f"{part} Direct"] + film[f"{part} Indirect"]) * film[f"{part} Color"]
    np.testing.assert_allclose(total, film["Combined"][..., :3], rtol=1e-5, atol=1e-6)
    assert film["Volume Direct"].mean() > 0.01
    assert film["Volume Indirect"].mean() > 0.001


@pytest.mark.parametrize("most", [0, 1, 2])
def test_scattering_has_a_limit_of_its_own(most: int) -> None:
    """Against all orders of scattering of an isotropic slab: each that may happen adds light."""
    scene = Scene(
        meshes=make_box(1.0),
        materials=fill(VolumeClosure("scatter", color=1.0, density=1.0)),
        camera=look(),
        world=WHITE,
    )
    found = measure(scene, 64, max_bounces=20, volume_bounces=most)
    again = measure(scene, 64, seed=5, max_bounces=most)
    assert (np.abs(found[0] - again[0]) < 4 * np.hypot(found[1], again[1])).all()
    assert (found[0] < 1.0 - 0.02).all()


def test_a_scene_without_media_has_none() -> None:
    scene = Scene(meshes=make_box(1.0), materials=Material((Closure("diffuse"),)), camera=look(), world=WHITE)
    integrator = prepare(scene, raytracer.build(scene), raytracer.Settings(integrator="path"))
    assert integrator.media is None
    assert integrator.dimensions.medium is None
