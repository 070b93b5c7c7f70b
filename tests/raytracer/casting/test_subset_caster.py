"""Casting into a part of a scene: hits as of a scene without the rest, numbered as in the whole."""

from dataclasses import replace

import numpy as np
import pytest

import raytracer
from raytracer.casting.subset_caster import SubsetCaster
from raytracer.rendering.watched_caster import CancelledError, WatchedCaster


def make_scene(placed=True):
    """Squares at heights 0, 1, 2, 3 and two groups of spheres between them."""
    corners = [(-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)]
    meshes = [
        raytracer.Mesh([(x, y, height) for x, y, _ in corners], [(0, 1, 2), (0, 2, 3)]) for height in (0, 1, 2, 3)
    ]
    order = [3, 1, 2, 0]
    instances = raytracer.Instances(order, [np.eye(4)] * 4) if placed else None
    spheres = [raytracer.Spheres([(0, 0, height)], [0.25]) for height in (0.5, 2.5)]
    return raytracer.Scene(meshes=meshes, instances=instances, spheres=spheres)


@pytest.mark.parametrize("placed", [True, False])
@pytest.mark.parametrize("present", [(0, 1, 0, 1, 1, 0), (1, 0, 0, 0, 0, 1), (0, 0, 0, 0, 0, 1), (1, 1, 1, 1, 1, 1)])
def test_part_hits_the_nearest_of_what_is_present(placed, present):
    scene = make_scene(placed)
    part = SubsetCaster(raytracer.build(scene), np.array(present, dtype=bool))
    heights = np.array([3.0, 1, 2, 0, 0.75, 2.75] if placed else [0.0, 1, 2, 3, 0.75, 2.75])
    origin, down = (0.1 if not any(present[4:]) else 0.0, 0.0, 5.0), (0.0, 0.0, -1.0)
    hits = part.closest_hit(origin, down)
    expected = np.flatnonzero(present)[np.argmax(heights[np.flatnonzero(present)])]
    assert hits.instance.tolist() == [expected]
    assert hits.distance[0] == 5.0 - heights[expected]
    assert part.any_hit(origin, down).tolist() == [True]
    missed = part.closest_hit((9, 9, 9), down)
    assert missed.instance.tolist() == [-1]


@pytest.mark.parametrize("motion", ["motion", "neighbors"])
def test_a_part_of_a_scene_that_moves_is_as_it_is_now(motion):
    """Motion counts instances, meshes and groups of the whole scene, of which a part has fewer."""
    still = make_scene()
    rising = np.tile(np.eye(4), (2, 1, 1))
    rising[1, 2, 3] = 1.0
    curve = raytracer.Curves([(0, -1, 4), (0, 1, 4)], [0.1, 0.1], [0, 2])
    steps = {"instances": raytracer.InstanceMotion([3], rising[:, np.newaxis])}
    steps["meshes"] = raytracer.MeshMotion(3, np.stack([still.meshes[3].positions] * 2))
    steps["spheres"] = raytracer.SpheresMotion(1, [(0, 0, 2.5)], [0.25], rising)
    steps["curves"] = raytracer.CurvesMotion(0, [curve.points] * 2, [curve.radii] * 2, rising)
    scene = replace(still, curves=[curve], **{motion: raytracer.Motion(**steps)})
    part = SubsetCaster(raytracer.build(scene), np.arange(7) == 2)
    hits = part.closest_hit((0.1, 0.2, 5.0), (0.0, 0.0, -1.0))
    assert (hits.instance.tolist(), hits.distance.tolist()) == ([2], [3.0])


def test_parts_are_watched_and_counted_with_the_whole():
    cancelled = []
    watched = WatchedCaster(raytracer.build(make_scene()), lambda: bool(cancelled))
    part = watched.take_part(np.array([True] + [False] * 5))
    part.any_hit((0, 0, 5), np.tile((0.0, 0, -1), (7, 1)))
    watched.closest_hit((0, 0, 5), (0, 0, -1))
    assert watched.rays == part.rays == 8
    cancelled.append(True)
    with pytest.raises(CancelledError):
        part.closest_hit((0, 0, 5), (0, 0, -1))
