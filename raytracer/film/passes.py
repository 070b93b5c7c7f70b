"""The passes of a film: how many channels each has, and what it holds where nothing was hit.

`integrator/contributions.py` fills them, `loop.add_direct_light` the light that is sampled; what Blender calls and
stores them as is the add-on's `passes.py`.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass


@dataclass(frozen=True)
class Pass:
    """What a pass holds.

    channels : numbers per pixel
    from_centre : True where the value is that of the ray through the pixel's centre, not a mean over samples
    miss : what each channel holds where that ray hits nothing
    needs_light : True where it takes more than the first surface to know it
    is_derived : True where it is no path's to say: it tells of the samples of other passes
    is_index : True where values are names of things, of which no two can be averaged or compared by size
    """

    channels: int
    from_centre: bool = False
    miss: float = 0.0
    needs_light: bool = False
    is_derived: bool = False
    is_index: bool = False


PASSES = {
    "Combined": Pass(4, needs_light=True),  # linear RGB, already multiplied by alpha (premultiplied)
    "Depth": Pass(1, from_centre=True, miss=1e10),  # metres along the camera's viewing axis
    "Position": Pass(3, from_centre=True),  # metres, world
    "Normal": Pass(3),  # shading normal, world, towards the ray
    "UV": Pass(3),  # u, v, 1; 0 on what has no uvs
    "Object Index": Pass(1, from_centre=True, is_index=True),
    "Material Index": Pass(1, from_centre=True, is_index=True),
    "Diffuse Color": Pass(3, needs_light=True),
    "Emission": Pass(3, needs_light=True),
    "Shadow": Pass(3, needs_light=True),  # share of the direct light that reaches the surface
    "Error": Pass(1, needs_light=True, is_derived=True),  # standard error of Combined, the root mean square of R, G, B
    "Sample Count": Pass(1, is_derived=True),
}


# Kept beside Combined where a scene has shadow catchers, which then is what is seen in front of them. Of the paths that
# met one: what they saw (3), what they would see where there is nothing but catchers (3), how much of that is opaque
# (1), and the background behind it all with its alpha (4).
CAUGHT = "Caught"


# Beside Combined where samples are adaptive: how many casts the path of a sample took.
LENGTH = "Path Length"

STORED = {**PASSES, CAUGHT: Pass(11)}


def select_passes(names: Iterable[str], from_centre: bool) -> tuple[str, ...]:
    """Return those of the passes that come from the pixel's centre, or what the others are made of.

    Examples
    --------
    >>> select_passes(["Depth", "Error", "Normal"], from_centre=False)
    ('Combined', 'Normal')
    """
    made_of = dict.fromkeys("Combined" if name == "Error" else name for name in names)
    return tuple(name for name in made_of if PASSES[name].from_centre == from_centre and not PASSES[name].is_derived)
