"""Records of curves: what they refuse, and that files and digests know them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import raytracer
from raytracer.scene.scene_digest import digest_scene

POINTS = [(0, 0, 0), (0, 0, 1), (0, 1, 2), (1, 0, 0), (1, 0, 2)]


def make_curves(**fields: Any) -> raytracer.Curves:
    return raytracer.Curves(**{"points": POINTS, "radii": [0.1] * 5, "strands": [0, 3, 5], "name": "Fur", **fields})


def test_curves_count_strands_and_segments() -> None:
    curves = make_curves()
    assert (len(curves), curves.segment_count) == (2, 3)
    alone = make_curves(strands=[0, 1, 2, 3, 4, 5])
    assert (len(alone), alone.segment_count) == (5, 0)
    nothing = raytracer.Curves(np.zeros((0, 3)), [], [0])
    assert (len(nothing), nothing.segment_count) == (0, 0)


@pytest.mark.parametrize(
    ("fields", "message"),
    [
        ({"points": [(0, 0, 0)] * 4 + [(0, 0, 1e39)]}, r"Curves 'Fur': points: expected numbers from -3.40282e\+38 to"),
        ({"radii": [0.1] * 4}, r"Curves 'Fur': radii: expected shape \(5,\) float64, got \(4,\)"),
        ({"radii": [0.1] * 4 + [-1e-9]}, r"Curves 'Fur': radii: expected numbers from 0 to 3.40282e\+38, got -1e-09"),
        ({"strands": [0, 3]}, r"Curves 'Fur': strands: expected ascending numbers from 0 to 5, got \[0, 3\]"),
        ({"strands": [1, 5]}, r"Curves 'Fur': strands: expected ascending numbers from 0 to 5, got \[1, 5\]"),
        ({"strands": [0, 3, 3, 5]}, r"Curves 'Fur': strands: expected ascending numbers from 0 to 5"),
        ({"strands": []}, r"Curves 'Fur': strands: expected ascending numbers from 0 to 5, got \[\]"),
        ({"shape": "square"}, r"Curves 'Fur': shape: expected one of ribbon, thick, got 'square'"),
        ({"material": [0, 1, 2]}, r"Curves 'Fur': material: expected shape \(2,\) int32, got \(3,\)"),
        ({"uvs": np.zeros((5, 2))}, r"Curves 'Fur': uvs: expected shape \(2, 2\) float64, got \(5, 2\)"),
        ({"attributes": {"a": np.zeros((2, 1))}}, r"Curves 'Fur': attribute 'a': expected shape \(5, k\)"),
        ({"strand_attributes": {"a": np.zeros((5, 1))}}, r"Curves 'Fur': attribute 'a': expected shape \(2, k\)"),
        ({"strand_attributes": [1]}, r"Curves 'Fur': strand_attributes: expected a table, got list"),
        (
            {"attributes": {"a": np.zeros((5, 1))}, "strand_attributes": {"a": np.zeros((2, 1))}},
            r"Curves 'Fur': attribute 'a': expected values of points or of strands, got both",
        ),
        ({"world_from_object": np.ones((4, 4))}, r"Curves 'Fur': world_from_object: expected \(0, 0, 0, 1\) as the"),
        ({"seen_by": 64}, r"Curves 'Fur': seen_by: expected numbers from 0 to 63, got 64"),
        ({"light_set": 63}, r"Curves 'Fur': light_set: expected numbers from 0 to 62, got 63"),
    ],
)
def test_curves_refuse_what_does_not_fit(fields: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make_curves(**fields)


def test_a_scene_numbers_curves_after_spheres_and_checks_their_materials() -> None:
    drops = raytracer.Spheres([(0, 0, 0)], [1.0])
    scene = raytracer.Scene(spheres=drops, curves=make_curves())
    assert scene.groups == (drops, scene.curves[0])
    with pytest.raises(ValueError, match=r"Curves 'Fur': material: expected indices below the scene's 1 materials"):
        raytracer.Scene(curves=make_curves(material=[0, 1]))
    with pytest.raises(ValueError, match=r"Scene: curves: expected Curves records, got Spheres"):
        raytracer.Scene(curves=[drops])


def test_curves_come_back_from_a_file(tmp_path: Path) -> None:
    curves = make_curves(
        shape="thick",
        material=[0, 0],
        uvs=[(0, 1), (0.5, 0.5)],
        attributes={"heat": np.arange(5.0)[:, None]},
        strand_attributes={"tint": np.eye(2, 4)},
        properties={"OBJECT a": (1, 2, 3, 4)},
        seen_by=3,
    )
    raytracer.save(raytracer.Scene(curves=curves), tmp_path / "hair.npz")
    again = raytracer.load(tmp_path / "hair.npz").curves[0]
    for name in ("points", "radii", "strands", "material", "uvs", "color", "world_from_object"):
        assert np.array_equal(getattr(again, name), getattr(curves, name)), name
    assert (again.shape, again.name, again.seen_by) == ("thick", "Fur", 3)
    assert again.attributes["heat"].tolist() == curves.attributes["heat"].tolist()
    assert again.strand_attributes["tint"].tolist() == curves.strand_attributes["tint"].tolist()


def test_digests_tell_curves_apart() -> None:
    def digest(curves: raytracer.Curves) -> str:
        return digest_scene(raytracer.Scene(curves=curves))["curves"]

    curves = make_curves()
    assert digest(curves) == digest(replace(curves, name="Other"))
    others = ({"shape": "thick"}, {"radii": [0.2] * 5}, {"strand_attributes": {"a": np.ones((2, 1))}})
    assert len({digest(curves), *(digest(replace(curves, **fields)) for fields in others)}) == 4
