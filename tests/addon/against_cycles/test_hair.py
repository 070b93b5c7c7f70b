"""Hair shaders against Cycles.

On surfaces Cycles 5.0 lets Principled Hair scatter to half of all directions only, by a test of bumps that takes the
closure's axis for its normal; the Hair BSDF it shows whole.
"""

from __future__ import annotations

import pytest

from blend_scenes import building
from tests.addon.against_cycles import furnace
from tests.addon.against_cycles.furnace import node
from tests.addon.against_cycles.test_pictures import add_lamp, assert_pictures_agree, make_stage

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

# Around the strand no wider than where Cycles' own two ways of sampling agree (bsdfs.hair_cauchy).
CAUCHY = {
    "reflection": node("Hair", "RoughnessU", RoughnessU=0.3, RoughnessV=0.4),
    "transmission": node("Hair", "RoughnessU", RoughnessU=0.3, RoughnessV=0.5, component="Transmission"),
}


@pytest.mark.parametrize("name", CAUCHY)
def test_hair_bsdfs_on_surfaces_agree(name: str) -> None:
    """A sheet and a ball under lamps without size, before and behind."""
    scene = make_stage()
    for side in (-1, 1):
        lamp = add_lamp("POINT", {"shadow_soft_size": 0.0}, (0.5, 1.5 * side, 2.0), power=150.0)
        lamp.data.color = (1.0, 0.7, 0.4) if side < 0 else (0.3, 0.6, 1.0)
    made = furnace.make_material(CAUCHY[name])
    sheet = building.make_plane("Sheet", 2.0, 1.6)
    building.link_object("Sheet", sheet, (-1.1, 0, 1.0), rotation=(75, 0, 15), materials=[made])
    building.link_object("Ball", building.make_sphere("Ball", 0.9, 24), (1.2, 0, 1.0), materials=[made])
    assert_pictures_agree(scene, samples=16)
