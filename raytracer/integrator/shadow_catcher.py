"""Shadow catchers: objects that stand for surfaces of the footage which the picture will be laid over.

The first catcher that a camera path meets splits it. One half goes on as if the catcher were any object; the other
where there is nothing but catchers, with the lights and the world that belong to the footage. What the one sees over
what the other sees is the factor by which the rest of the scene changes the light of the footage; `film.show_shadows`
turns it into a picture. Whatever meets a catcher later, such as a reflection in a mirror, sees an ordinary object.

References
----------
Blender, intern/cycles/kernel: integrator/shadow_catcher.h, film/light_passes.h, film/read.h.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from raytracer.arrays.rows import mean_column
from raytracer.casting.rays import Hits, Rays
from raytracer.film.passes import CAUGHT
from raytracer.integrator.contributions import see_background
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.paths import Caught, Paths, Record, start_record


def start_catching(integrator: Integrator, record: Record, rays: Rays) -> None:
    """Prepare a record for what shadow catchers show, where there are some."""
    if integrator.alone is None:
        return
    alone = start_record(integrator.alone.settings, rays)
    record.caught = Caught(np.zeros(len(rays), dtype=np.bool_), np.zeros((len(rays), 4)), alone)
    if not integrator.settings.transparent:
        # As in Cycles, what either half sees of the background is behind the shadows.
        record.backdrop = alone.backdrop = np.zeros((len(rays), 3))


def find_split(integrator: Integrator, record: Record, paths: Paths, hits: Hits) -> NDArray[np.intp]:
    """Return the rows of paths that come straight from the camera and here meet their first catcher."""
    if record.caught is None or integrator.is_catcher is None:
        return np.zeros(0, np.intp)
    return np.flatnonzero(paths.direct & integrator.is_catcher[hits.instance] & ~record.caught.met[paths.row])


def note_split(integrator: Integrator, record: Record, paths: Paths) -> None:
    """Write down what paths that meet a catcher have seen till here, and the background that they would see instead."""
    assert record.caught is not None
    row = paths.row
    record.caught.met[row] = True
    record.caught.matte[row, :3] = record.passes["Combined"][row, :3]
    record.caught.matte[row, 3] = 1.0 - record.background[row] - mean_column(paths.throughput)
    if record.backdrop is not None and integrator.background is not None:
        record.backdrop[row] += see_background(integrator, integrator.background, paths)


def finish_caught(record: Record) -> None:
    """Divide what was seen among Combined and what `film.show_shadows` needs besides."""
    if record.caught is None:
        return
    caught, combined = record.caught, record.passes["Combined"]
    matte = np.where(caught.met[:, np.newaxis], caught.matte, combined)
    # As in Cycles, what either half finds transparent takes from the shadow.
    opacity = combined[:, 3:] - caught.alone.background[:, np.newaxis]
    backdrop = np.zeros((len(combined), 4))
    if record.backdrop is not None:
        backdrop[:, :3], backdrop[:, 3] = record.backdrop, 1.0
    lit = combined[:, :3] - matte[:, :3]
    record.passes[CAUGHT] = np.concatenate([lit, caught.alone.passes["Combined"][:, :3], opacity, backdrop], axis=1)
    record.passes["Combined"] = matte
