"""What the world writes to passes that a scene names itself (AOVs), where it is seen."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

from raytracer.arrays.types import Floats
from raytracer.arrays.vectors import normalize
from raytracer.lights.environment import make_sky_site, make_sky_tables
from raytracer.scene.camera import Camera
from raytracer.scene.lights import World
from raytracer.scene.programs import Program, Register
from raytracer.shading.aovs import select_aovs, spread_written
from raytracer.shading.evaluate import evaluate, find_needed
from raytracer.shading.light_path import LightPath
from raytracer.shading.site_tables import SiteTables


@dataclass(frozen=True, eq=False)
class SkyAovs:
    """What the world writes to the passes asked for, by name; other fields as of `environment.Environment`."""

    values: dict[str, Any]
    program: Program
    needed: tuple[int, ...]
    tables: SiteTables


def make_sky_aovs(
    world: World | None, names: Sequence[str], camera: Camera | None, resolution: tuple[int, int]
) -> SkyAovs | None:
    """Return what the world writes to the passes `names`; None where it writes nothing."""
    values = select_aovs(world.aovs, names) if world is not None else {}
    if world is None or world.aovs is None or not values:
        return None
    program = world.aovs.program or Program()
    return SkyAovs(values, program, find_needed(program, values.values()), make_sky_tables(program, camera, resolution))


def list_written_by_sky(aovs: SkyAovs, directions: Floats, path: LightPath) -> Iterator[tuple[str, Floats]]:
    """Yield the passes that the world writes to where it is seen in directions (k, 3), and values (k, 1) or (k, 3)."""
    site = make_sky_site(aovs.tables, normalize(directions), path)
    outputs = evaluate(aovs.program, site, aovs.needed)
    for name, value in aovs.values.items():
        yield name, spread_written(name, outputs[value] if isinstance(value, Register) else value, len(directions))
