"""Cryptomatte against Cycles: the same things under the same hashes, covering as much; and the manifest in the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import CYCLES, Request, exr_output, matched_settings, render_both
from addon.properties import ENGINE
from raytracer.film.mattes import hash_name
from raytracer.film.passes import MATTES, matte_pass
from tests.folders import ROOT

pytestmark = [pytest.mark.blender, pytest.mark.usefixtures("registered_addon")]

NAMES = tuple(matte_pass(kind, number) for kind in MATTES for number in range(3))


def open_scene(name: str) -> Any:
    bpy.ops.wm.open_mainfile(filepath=str(ROOT / "blend_scenes" / f"{name}.blend"), load_ui=False)
    return bpy.context.scene


def measure_cover(passes: dict[str, Any], kind: str) -> dict[float, float]:
    """Return by hash the share of the picture that a thing covers; Cycles sorts no slots but objects'."""
    table = np.concatenate([passes[matte_pass(kind, number)][0] for number in range(3)], axis=2).reshape(-1, 2)
    return {
        float(one): float(table[table[:, 0] == one, 1].sum(dtype=np.float64)) for one in np.unique(table[:, 0]) if one
    }


@pytest.mark.parametrize("name", ["glass", "spheres_point_cloud", "character"])
def test_things_cover_what_they_cover_in_cycles(name: str) -> None:
    scene = open_scene(name)
    if name == "character":  # an asset of its own
        parent = bpy.data.objects.new("Parent", None)
        scene.collection.objects.link(parent)
        next(thing for thing in scene.objects if thing.type == "MESH" and not thing.parent).parent = parent
    size = 32, 20
    request = Request(*size, 32, 2, passes=("Combined", *NAMES))
    ours, cycles = (side.passes for side in render_both(scene, scene.view_layers[0], request))
    for kind in MATTES:
        covered, expected = measure_cover(ours, kind), measure_cover(cycles, kind)
        large = {one for one, share in expected.items() if share > 1.0}
        assert large
        assert large <= set(covered)
        for one in set(covered) | set(expected):
            # In pixels: what the samples of its rim are off, of which a thing has as many as its height and width.
            allowed = 0.4 + 0.1 * np.sqrt(expected.get(one, 0.0))
            assert abs(covered.get(one, 0.0) - expected.get(one, 0.0)) < allowed, (kind, one)


@pytest.mark.parametrize("engine", [ENGINE, CYCLES])
def test_file_names_the_things_of_its_hashes(tmp_path: Path, engine: str) -> None:
    """Both engines write the same fields; the manifest of ours names at least what is seen."""
    scene = open_scene("glass")
    request = Request(16, 10, 1, 1, passes=("Combined", "CryptoObject00", "CryptoMaterial00"))
    with matched_settings(scene, scene.view_layers[0], request), exr_output(scene, tmp_path / "out.exr"):
        scene.render.engine = engine
        bpy.ops.render.render(write_still=True)
    header = (tmp_path / "out.exr").read_bytes()[: 1 << 16]
    for kind in ("Object", "Material"):
        prefix = f"cryptomatte/{hash_name(f'{scene.view_layers[0].name}.Crypto{kind}'):08x}"[:19].encode()
        for field, value in (("hash", b"MurmurHash3_32"), ("conversion", b"uint32_to_float32")):
            assert value in header.split(prefix + b"/" + field.encode() + b"\0", 1)[1][:64]
        text = header.split(prefix + b"/manifest\0string\0", 1)[1]
        size = int.from_bytes(text[:4], "little")
        manifest = json.loads(text[4 : 4 + size])
        assert all(int(value, 16) == hash_name(name) for name, value in manifest.items())
        seen = [thing.name for thing in scene.objects if thing.type == "MESH"] if kind == "Object" else []
        assert set(seen) <= set(manifest)
