"""The process of a comparison: it stands as the window does, and where it cannot begin or end, that is said."""

from __future__ import annotations

import errno
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import bpy
import numpy as np
import pytest

from addon.compare.cycles.rendering import exr_output
from addon.compare.window import job, operators, session
from tests.addon.compare import test_window
from tests.addon.engine.engine_fixtures import WIDTH

stage = test_window.stage


@pytest.mark.parametrize("allows", [True, False])
def test_drivers_stand_in_the_comparison_as_in_the_window(
    stage: Any, tmp_path: Path, capfd: pytest.CaptureFixture[str], allows: bool
) -> None:
    """They counted as 0 without a word; where the window alone may run them, as for this file once, it is said."""
    driver = stage.objects["Plane"].driver_add("location", 0).driver
    driver.type, driver.expression = "SCRIPTED", "float(str(1000))"
    path = str(tmp_path / "driven.blend")
    bpy.ops.wm.save_as_mainfile(filepath=path, check_existing=False)
    bpy.ops.wm.open_mainfile(filepath=path, load_ui=False, use_scripts=True)
    assert bpy.context.scene.objects["Plane"].matrix_world.translation.x == 1000.0
    filepaths = bpy.context.preferences.filepaths
    filepaths.use_scripts_auto_execute = allows
    try:
        assert bpy.ops.raytracer.compare_ray_cast(width=WIDTH, rays=1) == {"FINISHED"}
    finally:
        filepaths.use_scripts_auto_execute = False
    outcome = session.find_outcome()
    assert outcome is not None
    assert any(entry.x >= 0 and entry.object == "Plane" for entry in outcome.worst) == (not allows)
    assert ("without scripts" in capfd.readouterr().out) == (not allows)


@pytest.mark.parametrize("name", ["heat.npy", "outcome.json"])
@pytest.mark.parametrize("content", [b"", b"cut", None])
def test_an_outcome_that_cannot_be_read_is_a_failure_in_words(
    stage: Any, tmp_path: Path, name: str, content: bytes | None
) -> None:
    """The child's disk was full: a traceback took the place of the operator's error."""
    running = object.__new__(job.Running)
    running.folder, running._process = tmp_path, SimpleNamespace(returncode=0)  # type: ignore[assignment]
    plain = '{"kind": "cycles", "numbers": {}, "worst": [], "blocked": ""}'
    (tmp_path / "outcome.json").write_text(plain, encoding="utf-8")
    np.save(tmp_path / "heat.npy", np.zeros((2, 2), np.float32))
    assert running.read_outcome().heat.shape == (2, 2)
    (tmp_path / name).unlink()
    if content is not None:
        (tmp_path / name).write_bytes(content)
    with pytest.raises(job.ComparisonError, match="the outcome cannot be read: "):
        running.read_outcome()


def test_a_comparison_without_a_temporary_folder_says_why(stage: Any, monkeypatch: pytest.MonkeyPatch) -> None:
    """It ended in a traceback."""

    def fail(prefix: str) -> str:
        raise OSError(errno.ENOSPC, "No space left on device", prefix)

    monkeypatch.setattr(tempfile, "mkdtemp", fail)
    with pytest.raises(RuntimeError, match=r"^Error: .*No space left on device"):
        bpy.ops.raytracer.compare_ray_cast(width=16, rays=1)
    assert operators._running is None


def test_a_temporary_folder_with_braces_in_its_name_holds_the_pictures(stage: Any, tmp_path: Path) -> None:
    """They are templates to Blender 5, which wrote elsewhere, or nothing."""
    path = tmp_path / "{a}.exr"
    with exr_output(stage, path):
        bpy.ops.render.render(write_still=True, scene=stage.name)
    assert path.is_file()
