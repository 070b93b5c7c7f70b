"""Where a reflected ray finds other light than a light sample of its own direction does.

Cycles weighs both by multiple importance sampling and tells neither of the other: to the program of a light, a sample
is a ray of no kind, and what stands between is met by a shadow ray; a reflected ray is of its kind, in both. With w_l
and w_r the weights, of sum 1, what a surface reflects is then

    integral of f (w_l L_sampled V_shadow + w_r L_reflected V_reflected)

which depends on the weights: no picture is right but by a rule. The rule here is Cycles': diffuse reflection is
followed to what shines, also by the direct integrator; a world that varies is sampled after a map of all its
brightness; and a sample is weighed as if its source were one that is picked of all. Where nothing is told apart the
integral is the same for all weights, and those that make the least noise are taken.

References
----------
Blender, intern/cycles/kernel/light/sample.h: light_sample_shader_eval; integrator/shade_background.h:
integrator_eval_background_shader; svm/light_path.h.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from raytracer.arrays.types import Masks
from raytracer.integrator.features import Features, lets_through
from raytracer.integrator.light_sources import GEOMETRY, LIGHT, WORLD
from raytracer.lights.environment import Environment
from raytracer.lights.lights import has_extent
from raytracer.scene.fields import SEEN_BY
from raytracer.scene.lights import Light
from raytracer.scene.materials import Material
from raytracer.scene.programs import Program
from raytracer.scene.scene import Scene
from raytracer.shading.computed import RADIANCE_FIELDS, TRANSPARENCY_FIELDS
from raytracer.shading.evaluate import find_needed, reads_light_path

# What the Light Path node tells of reflected rays alone.
OF_KIND = (
    *("Is Diffuse Ray", "Is Glossy Ray", "Is Singular Ray", "Is Reflection Ray", "Is Transmission Ray"),
    *("Diffuse Depth", "Glossy Depth", "Transmission Depth"),
)


@dataclass(frozen=True)
class ToldApart:
    """What is not the same for a light sample and a reflected ray of one direction.

    blockers : what stands in the way: objects are seen by some of these rays, or let some of them through
    world : what the world shines with
    emission : what emissive geometry shines with
    """

    blockers: bool = False
    world: bool = False
    emission: bool = False


def find_told_apart(scene: Scene, seen_by: Masks | None) -> ToldApart:
    """Return what a scene tells apart.

    seen_by : (instances + groups,) uint8, the classes of rays that see each; None where all see all
    """
    reflected = SEEN_BY["diffuse"] | SEEN_BY["glossy"] | SEEN_BY["transmission"]
    world = scene.world
    # The world is one bounce further from a reflected ray than from a sample (svm/light_path.h).
    asks = world is not None and _ask(world.program, [world.color], (*OF_KIND, "Ray Depth"))
    return ToldApart(
        blockers=is_seen_by_some(seen_by, reflected | SEEN_BY["shadow"]) or any(map(_stops_some, scene.materials)),
        world=asks,
        emission=any(_asks(material, RADIANCE_FIELDS, OF_KIND) for material in scene.materials),
    )


def list_told_apart(
    apart: ToldApart, features: Features, background: Environment | None, lights: Sequence[Light]
) -> frozenset[int]:
    """Return the kinds of the sources that a scene tells apart: they shine differently, or have other blockers.

    An even world does not count: it is looked for by samples that are told what reflected rays are; nor do lights that
    no ray can meet.
    """
    counts = {
        WORLD: background is not None and not background.is_even and (apart.world or apart.blockers),
        GEOMETRY: features.emission and (apart.emission or apart.blockers),
        LIGHT: apart.blockers and any(map(has_extent, lights)),
    }
    return frozenset(kind for kind, is_apart in counts.items() if is_apart)


def is_seen_by_some(seen_by: Masks | None, classes: int) -> bool:
    """True where an object is met by rays of some of the `classes`, bits of SEEN_BY, but not of all."""
    if seen_by is None:
        return False
    met = seen_by & classes
    return bool(((met != 0) & (met != classes)).any())


def _stops_some(material: Material) -> bool:
    """True for a material that may let reflected rays through where it stops shadow rays, or the other way round."""
    clear = any(map(lets_through, material.closures))
    asks = _asks(material, TRANSPARENCY_FIELDS, (*OF_KIND, "Is Shadow Ray"))
    return clear and (asks or not material.transparent_shadow)


def _asks(material: Material, fields: Mapping[str, Sequence[str]], outputs: Sequence[str]) -> bool:
    """True where some of the `fields` of a material's closures, by their kind, depend on one of the outputs of the
    Light Path node."""
    wanted = [getattr(item, name) for item in material.closures for name in fields.get(item.kind, ())]
    return _ask(material.program, wanted, outputs)


def _ask(program: Program | None, wanted: Sequence[Any], outputs: Sequence[str]) -> bool:
    return program is not None and reads_light_path(program, outputs, find_needed(program, wanted))
