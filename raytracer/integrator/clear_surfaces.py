"""What is seen through surfaces that are not half opaque is the background: then nothing of them is told.

References
----------
Cycles' passes of data, by measurement in Blender 4.2 and 5.0: a clear pane, or a portal, before the background has the
background's Depth, Position and indices (`tests/addon/against_cycles/test_portals.py`).
"""

from __future__ import annotations

import numpy as np

from raytracer.casting.rays import Hits
from raytracer.film.passes import find_pass
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.path_passes import PathPasses
from raytracer.integrator.paths import Paths


def forget_clear_surfaces(integrator: Integrator, passes: PathPasses, paths: Paths, hits: Hits) -> None:
    """Give the passes of the surface that is seen what they have without one, where a path passed straight through all
    that it met; `describe_surface` has told of the last of them."""
    names = [name for name in integrator.settings.passes if name in passes.values and find_pass(name).from_centre]
    if not names:
        return
    rows = paths.row[np.flatnonzero(~hits.hit & paths.direct & (paths.passages > 0))]
    rows = rows[~passes.found[rows]]
    for name in names if len(rows) else ():
        passes.values[name][rows] = find_pass(name).miss
