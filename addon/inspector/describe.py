"""The rays of a tree as lines of text for the sidebar, with units."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from raytracer.casting.geometry import Kind
from raytracer.integrator.traced_rays import CAMERA, Hit, Shadow, TracedRay
from raytracer.lecture import Region

from .names import Names

Line = tuple[str, tuple[str, ...]]  # name, and one value or three

# Of primitives, and what the lecture's formula of their distance is called: it has none for strands of hair.
PRIMITIVE_NAMES = {Kind.TRIANGLE: "Polygon", Kind.SPHERE: "Point", Kind.CURVE: "Segment"}
LECTURE_NAMES = {Kind.TRIANGLE: "Cramer's t", Kind.SPHERE: "Lecture's t"}
KIND_NAMES = {"reflected": "Reflected", "refracted": "Refracted", "passed": "Straight on"}
GREEK = "\N{GREEK SMALL LETTER ALPHA}, \N{GREEK SMALL LETTER BETA}, \N{GREEK SMALL LETTER GAMMA}"
REGION_NAMES = {Region.INSIDE: "inside", Region.EDGE: "on an edge", Region.VERTEX: "on a vertex"}


def find_depth(tree: Sequence[TracedRay], number: int) -> int:
    """Return how many rays lie between a ray and the camera's."""
    depth = 0
    while tree[number].parent >= 0:
        number, depth = tree[number].parent, depth + 1
    return depth


def order_rays(tree: Sequence[TracedRay]) -> list[int]:
    """Return the numbers of all rays, each followed by those that come from it."""
    children: dict[int, list[int]] = {}
    for number, ray in enumerate(tree):
        children.setdefault(ray.parent, []).append(number)
    order, waiting = [], children.get(-1, [])[::-1]
    while waiting:
        order.append(waiting.pop())
        waiting += children.get(order[-1], [])[::-1]
    return order


def title_ray(ray: TracedRay, names: Names, first: str = "Camera") -> str:
    """Return a ray in a few words, such as 'Reflected: Floor'; first : what a tree's first ray is called."""
    return f"{first if ray.kind == CAMERA else KIND_NAMES[ray.kind]}: {names.name_target(ray)}"


def describe_ray(ray: TracedRay) -> Iterator[Line]:
    """Yield what there is to say of a ray itself."""
    yield "Origin (m)", format_vector(ray.origin)
    yield "Direction", format_vector(ray.direction)
    if ray.kind != CAMERA:
        yield "Weight", format_vector(ray.weight)
    yield "Color", format_vector(ray.color)


def describe_hit(ray: TracedRay, hit: Hit, names: Names) -> Iterator[Line]:
    """Yield the lecture's quantities where a ray ends."""
    yield "Object", (names.objects[hit.instance],)
    yield PRIMITIVE_NAMES[hit.kind], (str(names.find_polygon(hit)),)
    yield "Material", (names.materials[hit.material],)
    yield "t", (f"{hit.distance:.12g}",)
    yield "Error of t", (format_error(hit.distance_error),)
    if hit.kind in LECTURE_NAMES:
        yield LECTURE_NAMES[hit.kind], (format_lecture(hit),)
    yield "Distance", (f"{hit.distance * float(np.linalg.norm(ray.direction)):.6g} m",)
    if hit.barycentric is not None:
        yield GREEK, format_vector(hit.barycentric)
        yield "Point is", (REGION_NAMES[hit.region],)
    yield "Point (m)", format_vector(hit.position)
    yield "Normal", format_vector(hit.geometric_normal)
    yield "Shading n.", format_vector(hit.shading_normal)
    yield "Seen from", ("the front" if hit.front else "the back",)
    if hit.emitted.any():
        yield "Emits", format_vector(hit.emitted)


def describe_shadow(shadow: Shadow, names: Names) -> str:
    """Return whether a light is seen, in a sentence that begins with its name."""
    source = names.name_source(shadow)
    if shadow.is_blocked and shadow.blocker >= 0:
        return f"{source}: blocked by {names.objects[shadow.blocker]}"
    if shadow.is_blocked:
        return f"{source}: blocked"
    if (shadow.share < 1).any():
        return f"{source}: {100 * shadow.share.mean():.3g} % arrive"
    return f"{source}: visible"


def describe_dark(ray: TracedRay, names: Names) -> str:
    """Return which lights no shadow ray goes to: they are behind the surface, or it reflects nothing of them."""
    return f"{', '.join(names.lights[number] for number in ray.dark)}: no light this way"


def format_lecture(hit: Hit) -> str:
    """Return how far t in float64 by the lecture's formula is from the certified one."""
    if np.isnan(hit.lecture_distance):
        return "a miss, by rounding"
    return f"t {hit.lecture_distance - hit.distance:+.1e}"


def format_error(error: float) -> str:
    """Return a bound on an error."""
    return "not proven" if np.isnan(error) else f"at most {error:.1e}"


def format_vector(vector: Any) -> tuple[str, ...]:
    """Return three numbers of four digits each; 0 has no sign."""
    return tuple(f"{number:.4f}" if abs(number) < 10 else f"{number:.4g}" for number in np.asarray(vector) + 0.0)
