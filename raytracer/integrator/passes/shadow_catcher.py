"""Shadow catchers: objects that stand for surfaces of the footage which the picture will be laid over.

The first catcher that a camera path meets splits it. One half goes on as if the catcher were any object; the other
where there is nothing but catchers, with the lights and the world that belong to the footage. What the one sees over
what the other sees is the factor by which the rest of the scene changes the light of the footage; `shown.show_shadows`
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
from raytracer.integrator.path_passes import Caught, PathPasses, start_passes
from raytracer.integrator.paths import Paths


def start_catching(integrator: Integrator, passes: PathPasses, rays: Rays) -> None:
    """Prepare for what shadow catchers show, where there are some."""
    if integrator.catchers_only is None:
        return
    catchers_only = start_passes(integrator.catchers_only.settings, rays)
    passes.caught = Caught(np.zeros(len(rays), dtype=np.bool_), np.zeros((len(rays), 4)), catchers_only)
    if not integrator.settings.transparent:
        # As in Cycles, what either half sees of the background is behind the shadows.
        passes.backdrop = catchers_only.backdrop = np.zeros((len(rays), 3))


def find_split(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> NDArray[np.intp]:
    """Return the rows of paths that come straight from the camera and here meet their first catcher."""
    if passes.caught is None or integrator.is_catcher is None:
        return np.zeros(0, np.intp)
    return np.flatnonzero(paths.direct & integrator.is_catcher[hits.instance] & ~passes.caught.met[paths.row])


def note_split(integrator: Integrator, passes: PathPasses, paths: Paths) -> None:
    """Write down what paths that meet a catcher have seen till here, and the background that they would see instead."""
    assert passes.caught is not None
    row = paths.row
    passes.caught.met[row] = True
    passes.caught.matte[row, :3] = passes.values["Combined"][row, :3]
    passes.caught.matte[row, 3] = 1.0 - passes.background[row] - mean_column(paths.throughput)
    if passes.backdrop is not None and integrator.background is not None:
        passes.backdrop[row] += see_background(integrator, integrator.background, paths)


def finish_caught(passes: PathPasses) -> None:
    """Divide what was seen among Combined and what `shown.show_shadows` needs besides."""
    if passes.caught is None:
        return
    caught, combined = passes.caught, passes.values["Combined"]
    matte = np.where(caught.met[:, np.newaxis], caught.matte, combined)
    # As in Cycles, what either half finds transparent takes from the shadow.
    opacity = combined[:, 3:] - caught.catchers_only.background[:, np.newaxis]
    backdrop = np.zeros((len(combined), 4))
    if passes.backdrop is not None:
        backdrop[:, :3], backdrop[:, 3] = passes.backdrop, 1.0
        if "Environment" in passes.values:  # as in Cycles, what is behind catchers too
            passes.values["Environment"] = passes.backdrop
    lit = combined[:, :3] - matte[:, :3]
    passes.values[CAUGHT] = np.concatenate(
        [lit, caught.catchers_only.values["Combined"][:, :3], opacity, backdrop], axis=1
    )
    passes.values["Combined"] = matte
