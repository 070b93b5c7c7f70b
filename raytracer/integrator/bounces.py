"""Bounces: of which kinds they are, how many of each a path may take, and which paths are cut short by chance.

A bounce is reflection or transmission, and diffuse, glossy or singular (by a perfect mirror or clear glass); what
passes straight through a transparent surface is none. A path that has used up its bounces still sees emission at its
end, for light sampling leaves it a share of that.

References
----------
Blender, intern/cycles/kernel/integrator/path_state.h: which bounces count as what, and when paths end.
J. Arvo, D. Kirk, "Particle Transport and Image Synthesis", SIGGRAPH 1990: Russian roulette.
"""

from __future__ import annotations

import numpy as np

from raytracer.arrays.rows import sum_columns
from raytracer.arrays.types import Booleans, Counts, Floats, Kinds, Masks
from raytracer.bsdfs.bounce_kinds import COUNTED, DIFFUSE, SCATTERED, STRAIGHT, TRANSMITTED
from raytracer.integrator.integrator import Integrator
from raytracer.integrator.paths import Paths
from raytracer.integrator.settings import Settings
from raytracer.scene.fields import SEEN_BY, SEEN_BY_ALL

# So many bounces of a path are not left to chance.
CERTAIN_BOUNCES = 1


def find_ended(counts: Counts, settings: Settings) -> Booleans:
    """Return (n,) True for paths that have taken one bounce more than any limit allows: they only see emission."""
    ended: Booleans = sum_columns(counts) > settings.max_bounces
    for column, name in enumerate(COUNTED):
        most = getattr(settings, f"{name}_bounces")
        if most < settings.max_bounces:
            ended |= counts[:, column] > most
    return ended


def find_finished(integrator: Integrator, paths: Paths) -> Booleans:
    """Return (n,) True for paths that have used up their bounces; the direct integrator's diffuse reflections, and
    what media scatter, where they are followed, only look for what shines."""
    ended = find_ended(paths.bounces, integrator.settings)
    if integrator.looks_around and integrator.settings.integrator == "direct":
        ended |= (paths.kind & (DIFFUSE | TRANSMITTED)) == DIFFUSE
        ended |= (paths.kind & SCATTERED) > 0
    return ended


def find_closed(integrator: Integrator, paths: Paths) -> Booleans:
    """Return (n,) True for paths that have gone straight as often as they may: they see emission, and end."""
    return paths.passages >= max(integrator.settings.transparent_bounces, 1)


def survival_probability(throughput: Floats) -> Floats:
    """Return the probability (n,) with which paths of a throughput (n, 3) shall go on.

    The root of the brightest channel, as in Cycles: what a picture shows is nearer to even in the root of light. Below
    0, as behind media that are denser than their bounds, the size counts.
    """
    red, green, blue = np.abs(throughput).T
    return np.minimum(np.sqrt(np.maximum(np.maximum(red, green), blue)), 1.0)


def _class_of_kind(kind: int) -> int:
    if kind == STRAIGHT:
        return SEEN_BY["camera"]
    if kind & SCATTERED:
        return SEEN_BY["volume"]
    if kind & TRANSMITTED:
        return SEEN_BY["transmission"]
    return SEEN_BY["diffuse" if kind & DIFFUSE else "glossy"]


CLASS_OF_KIND = np.array([_class_of_kind(kind) for kind in range(17)], dtype=np.uint8)


def classify_rays(kind: Kinds) -> Masks:
    """Return the class (n,), a bit of SEEN_BY, of rays whose last bounce was of a `kind` (n,)."""
    return CLASS_OF_KIND[kind]


# Rays of each kind meet lights and the world if those are seen by all these classes: unlike objects, Cycles hides them
# from diffusely transmitted rays by either flag (kernel/light/common.h).
CLASSES_OF_KIND = np.array(
    [_class_of_kind(kind) | (SEEN_BY["diffuse"] if kind & DIFFUSE else 0) for kind in range(17)], dtype=np.uint8
)


def meet_lights(kind: Kinds, seen_by: int) -> Booleans:
    """Return (n,) True for rays, by the `kind` (n,) of their last bounce, that meet a light or the world of `seen_by`,
    bits of SEEN_BY."""
    met: Booleans = (CLASSES_OF_KIND[kind] & np.uint8(SEEN_BY_ALL - seen_by)) == 0
    return met
