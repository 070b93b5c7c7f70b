"""From the tracer's numbers back to Blender's names, for the rays of one tree."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from raytracer.integrator.traced_rays import EMITTERS, Hit, Shadow, TracedRay

from ..extract.scene import Extraction


@dataclass(frozen=True)
class Names:
    """What the rays of a tree met.

    objects : by instance; polygons : of the evaluated mesh, by instance and primitive
    materials, lights : by number
    """

    objects: dict[int, str]
    polygons: dict[tuple[int, int], int]
    materials: dict[int, str]
    lights: dict[int, str]

    def name_target(self, ray: TracedRay) -> str:
        """Return what a ray hits."""
        return self.objects[ray.hit.instance] if ray.hit else "nothing"

    def name_source(self, shadow: Shadow) -> str:
        """Return the light that a shadow ray goes to."""
        if isinstance(shadow.source, int):
            return self.lights[shadow.source]
        return self.objects[shadow.target] if shadow.source == EMITTERS else "World"

    def find_polygon(self, hit: Hit) -> int:
        """Return the polygon that was hit, or the point of a point cloud."""
        return self.polygons[hit.instance, hit.primitive]


def find_names(extraction: Extraction, tree: Sequence[TracedRay]) -> Names:
    """Return the names of all that the rays of a tree met; the extraction itself can go."""
    scene = extraction.scene
    hits = [ray.hit for ray in tree if ray.hit]
    shadows = [shadow for ray in tree for shadow in ray.shadows]
    met = [(hit.instance, hit.primitive) for hit in hits]
    met += [(shadow.blocker, shadow.primitive) for shadow in shadows if shadow.blocker >= 0]
    shining = [shadow.target for shadow in shadows if shadow.target >= 0]
    return Names(
        objects={instance: extraction.objects[instance].name for instance in [*(one for one, _ in met), *shining]},
        polygons={key: find_polygon(extraction, *key) for key in met},
        materials={hit.material: scene.materials[hit.material].name for hit in hits},
        lights={number: light.name for number, light in enumerate(scene.lights)},
    )


def find_polygon(extraction: Extraction, instance: int, primitive: int) -> int:
    """Return Blender's polygon of a triangle; a point of a point cloud has its own number."""
    instances = extraction.scene.instances
    if instances is None or instance >= len(instances.mesh):
        return primitive
    return int(extraction.polygons[instances.mesh[instance]][primitive])
