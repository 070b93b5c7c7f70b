"""Renders on a Dask cluster, two workers as processes on this computer: the same bits, also where one is killed.

`pip install raytracer[dask]` brings what they need.
"""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from tests.portable import kill
from tests.raytracer.rendering.rendering_fixtures import make_lit_scene, same

distributed = pytest.importorskip("distributed", reason="Dask is not installed: the extra [dask] brings it")

# What Dask itself warns of is not ours to mend.
pytestmark = pytest.mark.filterwarnings("ignore")

SETTINGS: dict[str, Any] = {"passes": ("Combined", "Normal", "Depth"), "seed": 2}


@pytest.fixture(scope="module")
def client() -> Iterator[Any]:
    options = {"host": "127.0.0.1", "dashboard_address": None, "processes": True}
    with (
        distributed.LocalCluster(n_workers=2, threads_per_worker=1, **options) as cluster,
        distributed.Client(cluster) as client,
    ):
        yield client


def expect(samples: int = 3) -> raytracer.Film:
    return raytracer.render(make_lit_scene(), 40, 30, samples, **SETTINGS)


def test_render_takes_the_workers_of_a_cluster(client: Any) -> None:
    pool = raytracer.DaskPool(client)
    assert len(pool) == 2
    for _ in range(2):  # what is loaded the second time takes the place of the first
        film = raytracer.render(make_lit_scene(), 40, 30, 3, workers=pool, block_size=300, **SETTINGS)
        assert same(film, expect())


def test_a_client_that_is_not_the_default_will_do(client: Any) -> None:
    """Results were waited for through the default client: of another cluster, or none."""
    address = client.scheduler_info()["address"]
    other = distributed.Client(address, set_as_default=False)
    before = distributed.client._global_clients.copy()
    distributed.client._global_clients.clear()
    try:
        with ThreadPoolExecutor(1) as thread:  # where the fixture's client is not the current one
            settings = {"workers": raytracer.DaskPool(other), **SETTINGS}
            film = thread.submit(raytracer.render, make_lit_scene(), 40, 30, 3, **settings).result()
    finally:
        distributed.client._global_clients.update(before)
        other.close()
    assert same(film, expect())


def test_render_on_a_cluster_gives_the_same_film_from_a_file_and_from_a_scene(client: Any, tmp_path: Path) -> None:
    raytracer.save(make_lit_scene(), tmp_path / "scene.npz")
    for scene in (tmp_path / "scene.npz", str(tmp_path / "scene.npz"), make_lit_scene()):
        film = raytracer.render_on(client, scene, 40, 30, 3, tiles=7, **SETTINGS)
        assert same(film, expect())
        assert film.statistics.rays == expect().statistics.rays
        assert (film.near_misses, film.ended_by) == (expect().near_misses, expect().ended_by)


def test_a_file_is_rendered_with_the_settings_that_it_was_saved_with(client: Any, tmp_path: Path) -> None:
    saved = {"width": 9, "height": 9, "samples": 100, "integrator": "path", "max_bounces": 2, "seed": 5, **SETTINGS}
    raytracer.save(make_lit_scene(), tmp_path / "scene.npz", saved)
    film = raytracer.render_on(client, tmp_path / "scene.npz", 40, 30, 3, tiles=2, max_bounces=1)
    chosen = {"integrator": "path", "max_bounces": 1, **SETTINGS}
    assert same(film, raytracer.render(make_lit_scene(), 40, 30, 3, **chosen))
    assert not same(film, expect())


@pytest.mark.parametrize("way", ["pool", "tiles"])
def test_with_one_of_two_workers_killed_the_bits_are_the_same(client: Any, way: str) -> None:
    samples = 150 if way == "pool" else 900  # a while longer than until then
    process_ids = list(client.run(os.getpid).values())

    def kill_one() -> None:
        time.sleep(0.7)
        kill(process_ids[0])

    killing = threading.Thread(target=kill_one)
    killing.start()
    if way == "pool":
        film = raytracer.render(
            make_lit_scene(), 40, 30, samples, workers=raytracer.DaskPool(client), block_size=3000, **SETTINGS
        )
    else:
        film = raytracer.render_on(client, make_lit_scene(), 40, 30, samples, tiles=15, **SETTINGS)
    assert not killing.is_alive()
    assert same(film, expect(samples))
    client.wait_for_workers(2)
    assert process_ids[0] not in client.run(os.getpid).values()


def test_a_number_of_tiles_that_makes_no_sense_is_refused() -> None:
    for tiles in (0, -3, 2.5):
        with pytest.raises(ValueError, match="render_on: tiles: expected a whole number"):
            raytracer.render_on(None, make_lit_scene(), 40, 30, tiles=tiles)


def test_a_failure_on_the_cluster_is_one_sentence(client: Any, tmp_path: Path) -> None:
    pool = raytracer.DaskPool(client)
    pool.load(len)
    with pytest.raises(raytracer.WorkerError, match="a worker of the cluster failed: TypeError"):
        list(pool.run([1]))


def test_a_cancelled_render_ends_and_the_pool_goes_on(client: Any) -> None:
    pool, done = raytracer.DaskPool(client), []
    film = raytracer.render(
        make_lit_scene(), 40, 30, 10**5, workers=pool, block_size=600, on_progress=done.append,
        is_cancelled=lambda: len(done) >= 3,
    )  # fmt: skip
    assert film.cancelled
    assert list(pool.run([])) == []


def test_blocks_of_rays_are_cast_where_they_lie(client: Any) -> None:
    import dask.array

    rng = np.random.default_rng(0)
    origins, directions = rng.normal(size=(1000, 3)) + np.array([0, 0, 3]), rng.normal(size=(1000, 3))
    caster = raytracer.build(make_lit_scene())
    expected = caster.closest_hit(origins, directions).distance
    blocks = (dask.array.from_array(rays, chunks=(300, 2)) for rays in (origins, directions))
    distances = raytracer.cast_blocks(caster, *blocks)
    assert distances.shape == (1000,)
    for cast in (distances, raytracer.cast_blocks(caster, origins, directions)):
        np.testing.assert_array_equal(client.compute(cast).result(), expected)
