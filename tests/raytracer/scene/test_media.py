"""Records of volumes: what they take, what they refuse, and that files and digests know them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import raytracer
from raytracer import (
    Closure,
    Grid,
    Instances,
    Material,
    Mesh,
    Program,
    Register,
    Scene,
    Step,
    Volume,
    VolumeClosure,
    World,
)
from raytracer.scene.scene_digest import digest_scene

TRIANGLE = {"positions": [(0, 0, 0), (1, 0, 0), (0, 1, 0)], "triangles": [(0, 1, 2)]}
SMOKE = Volume(
    (VolumeClosure("scatter", color=0.9, density=Register(0, "Fac"), anisotropy=0.3),),
    Program((Step("ATTRIBUTE Fac", settings={"name": "density"}),)),
)


def make_scene(**changes: object) -> Scene:
    grid = Grid(np.arange(24.0).reshape(2, 3, 4), np.diag([0.5, 0.5, 0.5, 1.0]), **changes)  # type: ignore[arg-type]
    return Scene(
        meshes=Mesh(**TRIANGLE, grids={"density": grid}),  # type: ignore[arg-type]
        instances=Instances([0], np.eye(4)[np.newaxis], volume_density=[2.0]),
        materials=Material(volume=SMOKE, only_volume=True),
        world=World(volume=Volume(VolumeClosure("absorption", density=0.1))),
    )


def test_a_volume_comes_back_from_a_file(tmp_path: Path) -> None:
    scene = make_scene()
    raytracer.save(scene, tmp_path / "scene.npz")
    again = raytracer.load(tmp_path / "scene.npz")
    assert digest_scene(again) == digest_scene(scene)
    assert again.meshes[0].grids["density"].values.tolist() == np.arange(24.0).reshape(2, 3, 4).tolist()
    assert again.materials[0].only_volume
    assert again.materials[0].closures[0].kind == "transparent"


def test_digests_tell_volumes_apart() -> None:
    one, other = digest_scene(make_scene()), digest_scene(make_scene(interpolation="cubic"))
    assert [name for name in one if one[name] != other[name]] == ["meshes"]


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: VolumeClosure("fog"), "VolumeClosure: kind"),
        (lambda: VolumeClosure("scatter", phase="hg"), "phase"),
        (lambda: VolumeClosure("scatter", density=-1.0), "density"),
        (lambda: VolumeClosure("scatter", anisotropy=1.0), "anisotropy"),
        (lambda: Volume(VolumeClosure("scatter", density=Register(0, "Fac"))), "Volume: scatter: density"),
        (lambda: Material(volume=Volume, name="m"), "Material 'm': volume: expected a Volume"),  # type: ignore[arg-type]
        (lambda: Material((Closure("diffuse"),), only_volume=True), "expected none"),
        (lambda: Grid(np.zeros((2, 2)), np.eye(4)), "Grid: values"),
        (lambda: Grid(np.zeros((2, 2, 0)), np.eye(4)), "one voxel"),
        (lambda: Grid(np.zeros((2, 2, 2)), np.zeros((4, 4))), "affine"),
        (lambda: Grid(np.zeros((2, 2, 2)), np.eye(4), "none"), "interpolation"),
        (lambda: Mesh(**TRIANGLE, grids={"density": np.zeros((2, 2, 2))}), "expected a Grid"),  # type: ignore[arg-type]
    ],
)
def test_what_is_no_volume_is_refused(make: object, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()  # type: ignore[operator]
