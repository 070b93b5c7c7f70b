"""What `inspect_ray` writes down: the rays of a tree, where they end, and their shadow rays, as plain records."""

from __future__ import annotations

from dataclasses import dataclass, field

from raytracer.arrays.types import Floats
from raytracer.casting.geometry import Kind
from raytracer.lecture import Region

CAMERA, REFLECTED, REFRACTED, PASSED = "camera", "reflected", "refracted", "passed"
EMITTERS, WORLD = "emitters", "world"


@dataclass(frozen=True, eq=False)
class Hit:
    """Where a ray ends, in the lecture's terms.

    distance, distance_error : t of o + t d, and the certified bound on its error; NaN where the precision proves none
    lecture_distance : t by the lecture's formula in float64, Cramer's rule or the sphere's distance from the line; NaN
        where that formula rounds to a miss, and of a curve, which the lecture does not have
    kind : of what was hit
    instance, primitive, material : as in `surface.Surface`
    barycentric : (3,) alpha, beta, gamma of a triangle; None for others
    region : INSIDE, or an EDGE or VERTEX no farther away than the error of the position
    position, position_error : metres, world
    geometric_normal, shading_normal : unit, as wound
    front : True where the ray came from the side that the geometric normal points to
    emitted : (3,) radiance of the surface itself
    """

    distance: float
    distance_error: float
    lecture_distance: float
    kind: Kind
    instance: int
    primitive: int
    material: int
    barycentric: Floats | None
    region: Region
    position: Floats
    position_error: float
    geometric_normal: Floats
    shading_normal: Floats
    front: bool
    emitted: Floats


@dataclass(frozen=True, eq=False)
class Shadow:
    """A ray from a hit to a light.

    source : number of the light among the scene's lights, EMITTERS or WORLD
    origin, direction : o + t d is at the light for t = reach, infinite for sun and world
    light : (3,) what it adds to the color of its ray if nothing is in the way
    share : (3,) the share of that which arrives
    blocker, primitive : instance and primitive of what stops the light; -1 = nothing stops all of it
    end : t at which the ray ends, at the blocker or the light
    target : emissive instance, of EMITTERS; else -1
    """

    source: int | str
    origin: Floats
    direction: Floats
    reach: float
    light: Floats
    share: Floats
    blocker: int
    primitive: int
    end: float
    target: int = -1

    @property
    def is_blocked(self) -> bool:
        """True where no light arrives."""
        return not self.share.any()


@dataclass(eq=False)
class TracedRay:
    """One ray of a tree.

    kind : CAMERA, REFLECTED, REFRACTED or PASSED (straight through what is transparent, or
        through a portal)
    parent : number of the ray that it comes from; -1 for the camera's
    origin, direction : o + t d; t of the camera's ray is the depth, all other directions are unit vectors
    weight : (3,) what its color counts in its parent's
    color : (3,) radiance that comes back along it: emission at its end, `shadows`, and its children
    hit : None where it hits nothing
    dark : numbers of the lights that are on, but of which its surface would send nothing back along it
    is_cut : True where rays on from it were left out
    """

    kind: str
    parent: int
    origin: Floats
    direction: Floats
    weight: Floats
    color: Floats
    hit: Hit | None = None
    shadows: list[Shadow] = field(default_factory=list)
    dark: list[int] = field(default_factory=list)
    is_cut: bool = False
