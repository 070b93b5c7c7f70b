"""Where things are, for tests that read files of the project."""

from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
# The scenes of the gallery, by name.
SCENES = sorted((ROOT / "blend_scenes").glob("*.blend"))
