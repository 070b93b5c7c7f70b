"""Pictures and rays on a Dask cluster.

`render(..., workers=DaskPool(client))` moves the scene once, and every sample of every pixel back, or from some workers
on sums of several (`block_plan.GATHERED`): good for some tens of workers on a quick network. `render_on` moves a tile's
film back once: 40 bytes for each pixel of Combined, however many samples it has. Workers are lost and come back as
they like: the bits are the same.
"""

from __future__ import annotations

import os
from functools import lru_cache
from pathlib import Path
from typing import Any

import numpy as np

from raytracer.casting.caster import Caster, build
from raytracer.casting.rays import Hits
from raytracer.film.film import Film
from raytracer.film.parts import merge
from raytracer.film.picture_key import describe_difference, restore_key
from raytracer.integrator.settings import Settings, check_integer, check_known
from raytracer.processes.dask_pool import take_result
from raytracer.processes.workers import WorkerError
from raytracer.rendering.render import prepare_film, render
from raytracer.scene.scene import Scene
from raytracer.scene.scene_digest import digest_scene
from raytracer.scene.scene_file import load, load_with_settings

# Tiles for each thread of the cluster: what is lost with a worker is one of them, and the last ones do not keep others
# waiting for long.
TILES_PER_THREAD = 4
# Settings of a file that `render_on` has arguments for.
OWN_ARGUMENTS = ("width", "height", "samples", "tile", "workers")


def render_on(
    client: Any,
    scene: str | Path | Scene,
    width: int,
    height: int,
    samples: int = 64,
    *,
    tiles: int | None = None,
    **settings: Any,
) -> Film:
    """Render on the workers of a cluster, a tile at a time; the same film as `render` gives, bit for bit.

    Parameters
    ----------
    client : `distributed.Client`
    scene : a Scene, which is sent to the workers, or the path of a file that all of them can read, with the settings
        that it was saved with, but for its size and samples
    tiles : how many; None takes four for each thread of the cluster
    settings : the other fields of `Settings` by name; they come before a file's

    Raises
    ------
    WorkerError
        If a tile could not be rendered, which the sentence says the reason of, or is of another picture, as where a
        worker reads another file, or has another version.
    ValueError
        If a setting does not fit.
    """
    if tiles is not None:
        check_integer(tiles, 1, None, "render_on: tiles")
    if "tile" in settings:
        raise ValueError(f"render_on: tile: all of them are rendered, got {settings['tile']}; `border` is a part")
    if isinstance(scene, str | Path):
        whole, found = load_with_settings(scene)
        check_known(found, str(scene))
        settings = {name: value for name, value in found.items() if name not in OWN_ARGUMENTS} | settings
    else:
        whole = scene
    chosen = Settings(samples=samples, **settings)
    empty, window = prepare_film(whole, width, height, chosen)
    threads = max(1, sum(client.nthreads().values()))
    count = min(tiles or TILES_PER_THREAD * threads, window.height)
    sent = str(scene) if isinstance(scene, str | Path) else client.scatter(scene, broadcast=True, hash=False)
    futures = [
        client.submit(render_tile, sent, width, height, samples, (number, count), settings, pure=False)
        for number in range(1, count + 1)
    ]
    films = []
    for future in futures:
        film = take_result(future)
        assert film.key is not None
        assert empty.key is not None
        difference = describe_difference(film.key, empty.key)
        if difference:
            raise WorkerError(f"a worker of the cluster has rendered another picture: {difference}")
        films.append(film)
        future.release()
    return merge(films)


def render_tile(
    scene: str | Scene, width: int, height: int, samples: int, tile: tuple[int, int], settings: dict[str, Any]
) -> Film:
    """Render a tile in a process of the cluster; return its film, with all that it knows of its error."""
    opened = load_once(scene, os.stat(scene).st_mtime_ns) if isinstance(scene, str) else scene
    caster = build_once(opened, settings.get("precision", Settings.precision))
    film = render(opened, width, height, samples, caster=caster, **{**settings, "tile": tile})
    assert film.key is not None
    film.key = restore_key(film.key.choices, digest_once(opened))
    return film


@lru_cache(maxsize=1)
def load_once(path: str, written: int) -> Scene:
    """Return the scene of a file, read once for all tiles; written : when the file was."""
    return load(path)


@lru_cache(maxsize=1)
def build_once(scene: Scene, precision: str) -> Caster:
    """Return a scene's caster, which all tiles of this process use."""
    return build(scene, precision)


@lru_cache(maxsize=1)
def digest_once(scene: Scene) -> dict[str, str]:
    """Return what tells a scene from others, computed once for all tiles."""
    return digest_scene(scene)


def cast_blocks(caster: Caster, origins: Any, directions: Any) -> Any:
    """Cast dask arrays of rays, (n, 3) each; return the distances, a dask array (n,) of the same blocks.

    What is no dask array becomes one (`dask.array.asarray`). The caster goes to each worker once; inf is a miss, as in
    `Caster.closest_hit`.
    """
    import dask.array
    from dask import delayed

    origins, directions = (dask.array.asarray(rays).rechunk({1: 3}) for rays in (origins, directions))
    origins = origins.rechunk({0: directions.chunks[0]})
    # As one task beside the blocks, and not in each of them.
    sent = delayed(caster, pure=False, traverse=False)
    blocks = [
        dask.array.from_delayed(delayed(measure_distances)(sent, *pair), (size,), np.float64)
        for *pair, size in zip(
            origins.to_delayed()[:, 0], directions.to_delayed()[:, 0], directions.chunks[0], strict=True
        )
    ]
    return dask.array.concatenate(blocks)


def measure_distances(caster: Caster, origins: Any, directions: Any) -> Any:
    """Return the distances (n,) to the closest hits of rays."""
    hits: Hits = caster.closest_hit(origins, directions)
    return hits.distance
