"""Render a scene with the command line and check the picture: `python -m tests.digest.command_line OUT.png`.

For systems whose Blender module cannot run pytest's own processes in any bearable time, such as Windows' under Wine.
"""

from __future__ import annotations

import json
import subprocess
import sys
from pathlib import Path

from tests.folders import ROOT

SIZE = 48, 32


def main(picture: Path) -> None:
    """Render, and exit with a sentence if anything is wrong."""
    picture.unlink(missing_ok=True)
    size = "x".join(map(str, SIZE))
    command = [sys.executable, "-m", "addon", "render", "blend_scenes/hard_shadows.blend", "-o", str(picture)]
    done = subprocess.run(
        [*command, "--size", size, "--samples", "1", "--workers", "2", "--json"],
        cwd=ROOT,
        capture_output=True,
        encoding="utf-8",
        check=False,
    )
    if done.returncode or not picture.is_file():
        sys.exit(f"command line: exit code {done.returncode}: {done.stderr}")
    values = json.loads(done.stdout)
    from PIL import Image

    with Image.open(picture) as image:
        if (values["width"], values["height"]) != SIZE or image.size != SIZE or not image.getbbox():
            sys.exit(f"command line: not the picture that was asked for: {values}")
    print(f"command line: {picture}, {values['total_seconds']:.1f} s")


if __name__ == "__main__":
    main(Path(sys.argv[1]))
