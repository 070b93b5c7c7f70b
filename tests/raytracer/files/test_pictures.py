"""Pictures that are cut short anywhere are told from whole ones."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from raytracer.files.pictures import check_picture

WIDTH, HEIGHT = 7, 5


@pytest.fixture
def png(tmp_path: Path) -> Path:
    path = tmp_path / "a.PNG"
    values = np.random.default_rng(1).integers(0, 256, (HEIGHT, WIDTH, 3), dtype=np.uint8)
    Image.fromarray(values).save(path)
    return path


def test_a_whole_png_passes_and_its_size_is_known(png: Path) -> None:
    check_picture(png, WIDTH, HEIGHT)
    with pytest.raises(ValueError, match="expected a picture of 5 x 7 pixels, got 7 x 5"):
        check_picture(png, HEIGHT, WIDTH)


def test_a_png_that_is_cut_short_goes_on_or_is_changed_is_refused(png: Path) -> None:
    whole = png.read_bytes()
    changed = [whole[:k] + bytes([whole[k] ^ 1]) + whole[k + 1 :] for k in range(len(whole))]
    for content in (*(whole[:length] for length in range(len(whole))), whole + b"\0", *changed):
        png.write_bytes(content)
        with pytest.raises(ValueError, match="picture"):
            check_picture(png, WIDTH, HEIGHT)
