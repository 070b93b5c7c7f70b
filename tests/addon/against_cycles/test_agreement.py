"""The bar of agreement with Cycles, on every file of blend_scenes: pixels, tiles beyond their noise, all passes."""

import pytest

from tests.benchmarks import agreement

pytestmark = pytest.mark.blender


@pytest.mark.slow
@pytest.mark.parametrize("name", agreement.list_files())
def test_a_file_agrees_with_cycles(name, record_property):
    numbers = agreement.compare_file(name).summarise()
    record_property("numbers", numbers)
    assert agreement.find_misses(numbers) == []


def test_misses_of_the_bar_are_named():
    numbers = {"z_fail_share": 0.003, "tile_bias": 0.004, "passes": {"Depth": 0.0, "Normal": 0.002}}
    assert agreement.find_misses(numbers) == ["z-test 0.0030 > 0.0025", "pass Normal 0.0020 > 0.001"]


def test_rows_of_a_table_are_found_again(tmp_path):
    numbers = dict.fromkeys(("z_fail_share", "tile_error", "tile_noise", "tile_bias", "flip"), 0.0)
    numbers |= {"passes": {"Depth": 0.5}, "ours_seconds": 1.0, "cycles_seconds": 2.0}
    rows = {"glass": numbers | {"tile_detectable": 0.0123}, "lights": numbers}
    path = tmp_path / "agreement.md"
    agreement.write_table(path, rows)
    assert agreement.read_numbers(path) == rows
    found, before = path.read_text(encoding="utf-8").splitlines()[-2:]
    assert "| 0.00% | 1.2% | 50.000% (Depth) |" in found
    assert "| 0.00% | - | 50.000% (Depth) |" in before
    path = tmp_path / "agreement_files.md"
    files = {"02_any": {**next(iter(rows.values())), "verdict": "agrees"}}
    agreement.write_table(path, files, has_pictures=False)
    assert agreement.read_numbers(path) == files
    assert path.read_text(encoding="utf-8").splitlines()[-1].startswith("| 02_any | ")
