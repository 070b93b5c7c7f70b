"""Agreement with Cycles on every file of `blend_scenes`: a bar, a table, and the pictures side by side.

    python -m tests.benchmarks.agreement tests/report                  all files: agreement.md and agreement/*.png
    python -m tests.benchmarks.agreement tests/report glass lights     these, leaving the other rows as they are
    python -m tests.benchmarks.agreement tests/report ~/sphere.blend   any file: agreement_files.md, no picture

What is rendered is what `python -m addon compare FILE --with cycles` renders. A row is kept as JSON in a comment of the
table's line, so that a run of some files leaves the others.
"""

from __future__ import annotations

import json
import os
import sys
from contextlib import contextmanager
from pathlib import Path

from tests.benchmarks.pictures import SCENES

# Whole tiles: a tile of few pixels has noise that is not normal.
SIZE = (128, 80)
SAMPLES = 96
# The bar: shares of pixels that fail the test of means and of pixels of a pass that differ, and the share of a tile's
# level by which its mean may be off beyond noise.
Z_BAR, PASSES_BAR, TILE_BAR = 0.0025, 0.001, 0.005

HEAD = f"""# Agreement with Cycles

Every file of `blend_scenes`, {SIZE[0]}x{SIZE[1]} pixels, {SAMPLES} samples in 8 independent batches of each engine,
with the integrator and limits of the file, nothing clamped or blurred, as by
`python -m addon compare FILE --with cycles`.

- *z-test*: share of pixels whose means differ by more than noise explains (Welch's test, Sidak's correction); the bar
  is 0.25%.
- *tile*: the largest difference of the mean of a tile of 16x16 pixels, +- its standard error, in scene-linear units.
  *beyond noise*: the largest share of a tile's level by which it exceeds what noise reaches anywhere in a picture with
  a probability of 1%; the bar is 0.5%.
- *found*: the smallest difference of a tile that would have been found, in 95% of the tiles, with a probability of 90%:
  what is smaller than this the files may hide. A dash: measured before that was told.
- *passes*: the share of differing pixels in the worst of Depth, Position, Normal, UV, Diffuse Color, Emission, Object
  Index, Material Index and Alpha, seen through the pixels' centres; the bar is 0.1%. What lies behind a medium Cycles
  shows by chance, of a path that was not scattered: where it never does, it is asked again, and what it has not shown
  until at most 0.1% are left, or in about a thousand renders, differs.
- *times*: all batches, one thread each, this engine's and Cycles'.

Pictures: ours, Cycles', and FLIP's error between them, at the same noise.

| file | z-test | tile | beyond noise | found | passes | FLIP | ours | Cycles |
|---|---|---|---|---|---|---|---|---|
"""


@contextmanager
def quiet_output():
    """Send what Blender prints to nowhere."""
    sys.stdout.flush()
    kept, nowhere = os.dup(1), os.open(os.devnull, os.O_WRONLY)
    os.dup2(nowhere, 1)
    try:
        yield
    finally:
        os.dup2(kept, 1)
        os.close(kept)
        os.close(nowhere)


# Files of users are many and small.
FILE_SIZE, FILE_SAMPLES = (96, 60), 32
FILES_HEAD = f"""# Agreement with Cycles on users' files

Thirteen files of two public test suites (glTF-Blender-IO, BlenderProc), as they are: {FILE_SIZE[0]}x{FILE_SIZE[1]}
pixels, {FILE_SAMPLES} samples in 8 independent batches of each engine, as by
`python -m addon compare FILE --with cycles`. The columns are those of [agreement.md](agreement.md); *verdict*: what the
comparison says, where a difference of 1% is asked for (undecided: noise would hide it).

| file | z-test | tile | beyond noise | found | passes | FLIP | ours | Cycles | verdict |
|---|---|---|---|---|---|---|---|---|---|
"""


def list_files():
    """Return the names of the files to compare."""
    return sorted(path.stem for path in SCENES.glob("*.blend"))


def compare_file(name, size=SIZE, samples=SAMPLES):
    """Return the CyclesComparison of one file of `blend_scenes`, or of that of a path."""
    import bpy

    import addon
    from addon.compare.cycles.comparison import compare_with_cycles

    if not hasattr(bpy.types.Scene, "reference_raytracer"):
        addon.register()
    bpy.ops.wm.open_mainfile(filepath=str(SCENES / Path(name).with_suffix(".blend")), load_ui=False)
    return compare_with_cycles(bpy.context.scene, bpy.context.view_layer, *size, samples)


def find_worst_pass(numbers):
    """Return the name and the share of the pass that differs most."""
    return max(numbers["passes"].items(), key=lambda item: item[1])


def find_misses(numbers):
    """Return what misses the bar, as words; nothing where all is well."""
    name, share = find_worst_pass(numbers)
    checks = (
        (numbers["z_fail_share"], Z_BAR, "z-test"),
        (numbers["tile_bias"], TILE_BAR, "tile"),
        (share, PASSES_BAR, f"pass {name}"),
    )
    return [f"{label} {value:.4f} > {bar}" for value, bar, label in checks if value > bar]


def format_row(name, numbers, has_picture=True):
    """Return the table's line of a file: with a link to its picture, or with the verdict."""
    worst, share = find_worst_pass(numbers)
    passes = f"{100 * share:.3f}% ({worst})" if share else "0"
    cells = (
        f"[{name}](agreement/{name}.png)" if has_picture else name,
        f"{100 * numbers['z_fail_share']:.3f}%",
        f"{numbers['tile_error']:.4f} +- {numbers['tile_noise']:.4f}",
        f"{100 * numbers['tile_bias']:.2f}%",
        f"{100 * numbers['tile_detectable']:.2g}%" if "tile_detectable" in numbers else "-",
        passes,
        f"{numbers['flip']:.4f}",
        f"{numbers['ours_seconds']:.0f} s",
        f"{numbers['cycles_seconds']:.0f} s",
        *([] if has_picture else [numbers["verdict"]]),
    )
    return f"| {' | '.join(cells)} | <!-- {json.dumps(numbers)} -->"


def read_numbers(path):
    """Return the numbers in the lines of a table by the names of their files."""
    lines = path.read_text(encoding="utf-8").splitlines() if path.exists() else []
    return {line[2:].split(" |")[0].strip("[").split("]")[0]:
            json.loads(line[line.index("<!--") + 4 : line.index("-->")])
            for line in lines if "<!--" in line}  # fmt: skip


def write_table(path, numbers, has_pictures=True):
    """Write the table of name -> numbers."""
    rows = [format_row(name, numbers[name], has_pictures) for name in sorted(numbers)]
    path.write_text((HEAD if has_pictures else FILES_HEAD) + "\n".join(rows) + "\n", encoding="utf-8")


def write_agreement(folder, names):
    """Compare files and write their rows and pictures into `folder`."""
    (folder / "agreement").mkdir(parents=True, exist_ok=True)
    path = folder / "agreement.md"
    for name in names:
        with quiet_output():
            comparison = compare_file(name)
        numbers = comparison.summarise()
        comparison.save_picture(folder / "agreement" / f"{name}.png")
        write_table(path, read_numbers(path) | {name: numbers})
        print(name, ", ".join(find_misses(numbers)) or "within the bar", flush=True)
    return path


def write_files(folder, paths):
    """Compare any .blend files and write their rows into `folder`, by their names alone."""
    path = folder / "agreement_files.md"
    for file in map(Path, paths):
        with quiet_output():
            numbers = compare_file(file.absolute(), FILE_SIZE, FILE_SAMPLES).summarise()
        write_table(path, read_numbers(path) | {file.stem: numbers}, has_pictures=False)
        print(file.stem, numbers["verdict"], flush=True)
    return path


if __name__ == "__main__":
    files = [name for name in sys.argv[2:] if name.endswith(".blend")]
    write = write_files if files else write_agreement
    print(write(Path(sys.argv[1]), files or sys.argv[2:] or list_files()))
