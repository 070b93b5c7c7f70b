"""The extension as a user gets it: built, installed into an empty Blender without a network, rendering.

With the bpy module always; with a Blender application where the environment variable BLENDER names one.
"""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tomllib
import zipfile
from pathlib import Path

import numpy as np
import pytest

from raytracer.film.picture_key import VERSION
from tests.addon.engine.engine_fixtures import read_image, save_plane
from tests.folders import ROOT

BLENDER = os.environ.get("BLENDER", "")

# Runs in a process of its own, with only the installed extension: argv holds the .zip, the .blend and the picture.
INSTALL_AND_RENDER = """
import sys, bpy
package, blend, picture = sys.argv[1:]
bpy.ops.extensions.package_install_files(filepath=package, repo="user_default", enable_on_install=True)
import raytracer
from bl_ext.user_default import reference_raytracer
print("raytracer", raytracer.__file__)
print("addon", reference_raytracer.__file__)
bpy.ops.wm.open_mainfile(filepath=blend, load_ui=False)
scene = bpy.context.scene
scene.render.engine = "REFERENCE_RAYTRACER"
scene.render.resolution_x, scene.render.resolution_y = 12, 8
scene.reference_raytracer.samples, scene.reference_raytracer.workers = 2, 2
scene.render.image_settings.file_format, scene.render.filepath = "OPEN_EXR", picture
bpy.ops.render.render(write_still=True)
bpy.ops.preferences.addon_disable(module="bl_ext.user_default.reference_raytracer")
try:
    scene.render.engine = "REFERENCE_RAYTRACER"
except TypeError:
    print("engine gone")
"""


@pytest.fixture(scope="module")
def package(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return the extension's .zip, freshly built."""
    folder = tmp_path_factory.mktemp("dist")
    done = run(sys.executable, ROOT / ".ci" / "build_extension", folder)
    return Path(done.stdout.strip())


@pytest.fixture(scope="module")
def blend(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Return a .blend in which a plane of radiance (0.75, 0.125, 0) fills the camera."""
    return save_plane(tmp_path_factory.mktemp("blend") / "plane.blend")


def run(*command: object, home: Path | None = None) -> subprocess.CompletedProcess[str]:
    """Run a command that must succeed; `home` is the folder of Blender's settings and extensions, kept apart."""
    environment = {**os.environ, "BLENDER_USER_RESOURCES": str(home)} if home else None
    done = subprocess.run(
        [str(part) for part in command], env=environment, cwd=home, capture_output=True, text=True, check=False,
        timeout=600,
    )  # fmt: skip
    assert done.returncode == 0, done.stdout + done.stderr
    return done


def assert_shows_plane(picture: Path) -> None:
    """Assert that a linear picture is filled with the plane's radiance."""
    pixels = read_image(picture)[..., :3]
    np.testing.assert_allclose(pixels, np.full_like(pixels, (0.75, 0.125, 0.0)), rtol=2**-11)  # half precision


def test_manifest_wheel_and_films_agree_on_the_version() -> None:
    manifest = tomllib.loads((ROOT / "addon" / "blender_manifest.toml").read_text(encoding="utf-8"))
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert manifest["version"] == project["version"] == VERSION
    assert manifest["wheels"] == [f"./wheels/raytracer-{project['version']}-py3-none-any.whl"]
    assert manifest["license"] == ["SPDX:GPL-3.0-or-later"]


def test_package_holds_every_module_and_nothing_else(package: Path, tmp_path: Path) -> None:
    with zipfile.ZipFile(package) as archive:
        names = set(archive.namelist())
        wheel = next(name for name in names if name.startswith("wheels/"))
        archive.extract(wheel, tmp_path)
    modules = {path.relative_to(ROOT / "addon").as_posix() for path in (ROOT / "addon").rglob("*.py")}
    assert names == modules - {"__main__.py"} | {"blender_manifest.toml", wheel}
    with zipfile.ZipFile(tmp_path / wheel) as archive:
        carried = {name for name in archive.namelist() if name.endswith(".py")}
    assert carried == {path.relative_to(ROOT).as_posix() for path in (ROOT / "raytracer").rglob("*.py")}


def test_extension_installs_into_the_bpy_module_and_renders(package: Path, blend: Path, tmp_path: Path) -> None:
    script, picture = tmp_path / "script.py", tmp_path / "picture.exr"
    script.write_text(INSTALL_AND_RENDER, encoding="utf-8")
    done = run(sys.executable, script, package, blend, picture, home=tmp_path)
    places = dict(line.split(" ", 1) for line in done.stdout.splitlines() if line.startswith(("raytracer ", "addon ")))
    assert all(Path(place).is_relative_to(tmp_path) for place in places.values()), places
    assert len(places) == 2
    assert "engine gone" in done.stdout
    assert_shows_plane(picture)


UPDATE = """
import sys, bpy
for package in sys.argv[1:]:
    bpy.ops.extensions.package_install_files(filepath=package, repo="user_default", enable_on_install=True)
import raytracer
from bl_ext.user_default.reference_raytracer.engine import engine
print("built", raytracer.__doc__, engine.raytracer is raytracer)
"""


def test_a_newer_build_brings_its_own_ray_tracer(package: Path, tmp_path: Path) -> None:
    """Blender keeps a wheel of the same version, and in an open session the modules of the old one."""
    source, script = tmp_path / "source", tmp_path / "script.py"
    for name in ("addon", "raytracer", ".ci"):
        shutil.copytree(ROOT / name, source / name, ignore=shutil.ignore_patterns("__pycache__"))
    shutil.copy(ROOT / "pyproject.toml", source)
    (source / "raytracer" / "__init__.py").write_text(
        (ROOT / "raytracer" / "__init__.py").read_text(encoding="utf-8") + "\n__doc__ = 'anew'\n", encoding="utf-8"
    )
    newer = run(sys.executable, source / ".ci" / "build_extension", tmp_path / "dist").stdout.strip()
    script.write_text(UPDATE, encoding="utf-8")
    assert "built anew True" in run(sys.executable, script, package, newer, home=tmp_path).stdout


COMPARE_AND_INSPECT = """
import bpy
from bl_ext.user_default.reference_raytracer.compare.window import session
bpy.context.scene.render.engine = "REFERENCE_RAYTRACER"
assert bpy.ops.raytracer.compare_ray_cast(width=16, rays=4) == {"FINISHED"}
print("numbers", session.find_outcome().numbers["ours_wrong"], session.find_outcome().numbers["rays"])
assert bpy.ops.raytracer.inspect_pixel(x=8, y=5) == {"FINISHED"}
print("rays", [ray.name for ray in bpy.context.window_manager.reference_raytracer.rays])
"""


@pytest.mark.skipif(not BLENDER, reason="set BLENDER to a Blender application to test the extension in it")
def test_installed_extension_compares_inspects_and_has_its_command(package: Path, blend: Path, tmp_path: Path) -> None:
    run(BLENDER, "--command", "extension", "install-file", "-r", "user_default", "-e", package, home=tmp_path)
    script, picture = tmp_path / "script.py", tmp_path / "picture.exr"
    script.write_text(COMPARE_AND_INSPECT, encoding="utf-8")
    done = run(BLENDER, "-b", blend, "--python-exit-code", "3", "-P", script, home=tmp_path)
    assert "numbers 0 156" in done.stdout  # 16 x 9 rays of the camera, 3 x 4 others
    assert "rays ['Camera: Plane']" in done.stdout
    command = ("--command", "raytracer", "render", blend, "-o", picture, "--size", "12x8", "--samples", "2")
    assert run(BLENDER, *command, home=tmp_path).stdout.strip().endswith(str(picture))
    assert_shows_plane(picture)


@pytest.mark.skipif(not BLENDER, reason="set BLENDER to a Blender application to test the extension in it")
def test_extension_installs_into_the_application_and_renders(package: Path, blend: Path, tmp_path: Path) -> None:
    run(BLENDER, "--command", "extension", "install-file", "-r", "user_default", "-e", package, home=tmp_path)
    options = (
        "s=__import__('bpy').context.scene; s.render.image_settings.file_format='OPEN_EXR'; s.render.resolution_x=12"
    )
    done = run(
        *(BLENDER, "-b", blend, "-E", "REFERENCE_RAYTRACER", "--python-expr", options),
        *("-o", tmp_path / "picture_", "-f", "1"),
        home=tmp_path,
    )
    assert "Error" not in done.stdout + done.stderr
    assert_shows_plane(tmp_path / "picture_0001.exr")
