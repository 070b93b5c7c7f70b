"""Photometric data: tables laid on the sphere, the cubic between them, and files that are none."""

import numpy as np
import pytest

from raytracer.textures.ies import WATTS_PER_CANDELA, Luminaire, find_intensity, read_ies

FILE = """IESNA:LM-63-2002
[TEST] none
TILT=NONE
1 1000 2 3 {count} {kind} 2 0 0 0
1 0.5 50
0 45 90
{angles}
{values}
"""


def make(kind: int, angles: list[float]) -> str:
    values = " ".join(str(100 * k + j) for k in range(len(angles)) for j in range(3))
    return FILE.format(count=len(angles), kind=kind, angles=" ".join(map(str, angles)), values=values)


def test_values_are_candela_times_multiplier_and_ballast():
    table = read_ies(make(1, [0, 120, 240, 360]))
    np.testing.assert_allclose(table.intensity[2], WATTS_PER_CANDELA * np.array([200, 201, 202]))
    np.testing.assert_allclose(np.degrees(table.vertical), [0, 45, 90])


@pytest.mark.parametrize(
    ("angles", "columns"),
    [
        ([0, 45, 90], [0, 1, 2, 1, 0, 1, 2, 1, 0]),
        ([0, 90, 180], [0, 1, 2, 1, 0]),
        ([90, 180, 270], [0, 1, 2, 1, 0]),
        ([0, 90, 180, 270], [0, 1, 2, 3, 0]),
        ([0], [0, 0]),
    ],
)
def test_what_is_symmetric_is_mirrored_to_go_round(angles, columns):
    table = read_ies(make(1, angles))
    np.testing.assert_allclose(table.intensity[:, 0] / WATTS_PER_CANDELA, 100.0 * np.array(columns))
    np.testing.assert_allclose(np.degrees(table.horizontal), np.linspace(0, 360, len(columns)))


def test_the_cubic_goes_through_the_table_and_is_exact_for_parabolas(rng):
    """Catmull and Rom's slopes are central differences, which are exact for quadratic functions of even steps."""
    horizontal, vertical = np.linspace(0.0, 2.0 * np.pi, 9), np.linspace(0.1, 2.9, 8)
    grid = np.meshgrid(horizontal, vertical, indexing="ij")
    table = Luminaire(horizontal, vertical, 5.0 + (grid[0] - 3.0) ** 2 + 0.5 * grid[1] ** 2 + grid[0] * grid[1])
    around, down = rng.uniform(horizontal[1], horizontal[-2], 500), rng.uniform(vertical[1], vertical[-2], 500)
    true = 5.0 + (around - 3.0) ** 2 + 0.5 * down**2 + around * down
    np.testing.assert_allclose(find_intensity(table, around, down), true, rtol=1e-12)
    corners = find_intensity(table, grid[0][:-1, :-1].ravel(), grid[1][:-1, :-1].ravel())
    np.testing.assert_allclose(corners, table.intensity[:-1, :-1].ravel(), rtol=1e-12)
    assert (find_intensity(table, around, np.full(500, 3.0)) == 0).all()
    assert (find_intensity(table, around, np.full(500, 0.05)) == 0).all()


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "TILT="),
        ("TILT=NONE\n1 2 3", "13 numbers"),
        (make(4, [0, 90]), "photometric type"),
        (make(1, [0, 90])[:-8], "expected 24 numbers"),
        (make(1, [0, 90]).replace("3 2 1 2", "0 2 1 2"), "angles"),
    ],
)
def test_what_is_no_photometric_data_is_refused(text, words):
    with pytest.raises(ValueError, match=words):
        read_ies(text)
