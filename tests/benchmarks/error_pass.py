"""The Error pass beside the true error: `python -m tests.benchmarks.error_pass FOLDER OUT.png [SCENE ...]`.

FOLDER is what `tests.digest.export` wrote. A row for each scene: the picture, its Error pass, and the root mean
square error of independent pictures like it, told from all of them. Black is none; white, printed for each scene, is
what 5% of the true errors are above, so that both passes have one scale and nothing is all white.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

import numpy as np
from PIL import Image

import raytracer

WIDTH, HEIGHT, SAMPLES, SEEDS = 96, 64, 16, 12
SCENES = ("penumbra", "interior", "still_life")
WHITE = 0.95
# Pixels of the file for each of the picture.
SCALE = 4


def measure(folder: Path, name: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return a picture (h, w, 3), its Error pass and the true error (h, w), both over the mean level."""
    scene = raytracer.load(folder / f"{name}.npz")
    settings = json.loads((folder / f"{name}.json").read_text(encoding="utf-8"))
    caster = raytracer.build(scene)
    options = {**settings, "caster": caster, "passes": ("Combined", "Error")}
    films = [raytracer.render(scene, WIDTH, HEIGHT, SAMPLES, **{**options, "seed": seed}) for seed in range(SEEDS)]
    pictures = np.stack([film["Combined"][..., :3] for film in films]).astype(np.float64)
    level = pictures.mean()
    truth = np.sqrt(pictures.var(axis=0, ddof=1).mean(axis=-1)) / level
    told = films[0]["Error"][..., 0] / level
    print(f"{name}: true error {np.sqrt((truth**2).mean()):.4f}, told {films[0].error:.4f}", films[0].error_interval)
    return pictures[0], told, truth


def draw_row(picture: np.ndarray, told: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return (h, 3 w, 3) uint8."""
    shown = np.clip(picture, 0.0, 1.0) ** (1 / 2.2)
    white = np.quantile(truth, WHITE)
    print(f"white: {white:.0%} of the mean level")
    errors = [
        np.repeat(np.sqrt(np.clip(error / white, 0.0, 1.0))[..., np.newaxis], 3, axis=2) for error in (told, truth)
    ]
    return (np.concatenate([shown, *errors], axis=1) * 255.0).astype(np.uint8)


def main(folder: Path, out: Path, *names: str) -> None:
    """Draw the rows."""
    rows = [draw_row(*measure(folder, name)) for name in names or SCENES]
    Image.fromarray(np.concatenate(rows).repeat(SCALE, axis=0).repeat(SCALE, axis=1)).save(out)


if __name__ == "__main__":
    main(Path(sys.argv[1]), Path(sys.argv[2]), *sys.argv[3:])
