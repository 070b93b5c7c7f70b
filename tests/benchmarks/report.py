"""Write tables and plots from the JSON of `python -m addon bench`.

`python -m tests.benchmarks.report BENCH.json FOLDER`, as `make report` does.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from tests.benchmarks import plots
from tests.benchmarks.tables import describe_run, write_accuracy, write_equal_error, write_pictures, write_speed

ACCURACY_HEAD = """# Accuracy

The same rays for every peer, against an exact oracle (integers, brute force, `tests/oracle/exact_oracle.py`).
Coordinates and directions are float32 numbers, so nobody's input is rounded; "vertex" and "edge" rays go exactly
through one. A primitive counts as right if it is exactly first; the certified mode has to name the lowest of them.
|dt| is in units of the last place of float64 (one of float32 is 5.4e8 of them). `0 (< x)`: none seen, so below x with
95% confidence.

![error against time](error_against_time.png)
![wrong answers](failures.png)
"""
SPEED_HEAD = """# Speed

Processor time on one core, peers taking turns, medians. Blender's casters take one ray a call and are asked in a
Python loop over prebuilt Vectors, up to 16384 of the rays, evenly spread. Its Raycast node takes arrays: timed are the
evaluation of its node tree and reading back; a script cannot limit its threads, so their processor time is added up.
Shadow rays ask for any hit, or the closest where a peer knows no other query; all others ask for the closest.

![speed](speed.png)
"""
EQUAL_ERROR_HEAD = """# Equal error

Both engines compute the same light, of pixels seen through a box filter, with one thread each and processor time. The
error is the root mean square noise over the picture's mean level, told from independent renders. A column is the time
of Cycles over that of ours at the smallest error that both have reached, read off between renders that were made, never
beyond: a dash where they have reached none in common. A few bright pixels can hold most of the noise, so it is also
measured without the noisiest 1% and 5% of each engine's pixels, which one half of the renders tells and the other
measures. +- is one standard error (jackknife over the renders). *path* follows diffuse reflection, *direct* does not.

*Cycles*, *Cycles adaptive*: over our uniform samples; *both adaptive*: both with adaptive sampling; *ours uniform over
adaptive*: what our own brings. Cycles' stops early where it sees little noise; its threshold, 1 / samples, lets it
begin at some 60 samples; the bias of that is not in the noise. Ours is unbiased, and begins at 32 of
a pixel and 2^18 in all. p: error c N^-p over the samples rendered. us / sample: microseconds for one sample of one
pixel; start: seconds of a render without samples; process: seconds of a whole process for one sample. In small pictures
NumPy's calls are a large part of our time.

![equal_error](equal_error.png)

"""
PICTURES_HEAD = """# Pictures

Of pixels seen through a box filter, with one thread and processor time. The error is the root mean square noise over
the picture's mean level, told from independent renders.

"""


def write_report(numbers, folder):
    """Write tables and plots of the sections that were measured into `folder`; return the files."""
    folder.mkdir(parents=True, exist_ok=True)
    machine, settings = numbers["machine"], numbers["settings"]
    caption = f"{machine['date']}, {machine['processor']}, one core, seed {settings['seed']}"
    written = []

    def write(name, lines):
        written.append(folder / name)
        written[-1].write_text("\n".join(lines).rstrip() + "\n", encoding="utf-8")

    def draw(name, plot):
        written.append(folder / name)
        plot(numbers, written[-1], caption)

    if numbers.get("accuracy"):
        draw("error_against_time.png", plots.plot_error_against_time)
        draw("failures.png", plots.plot_failures)
        write("accuracy.md", [ACCURACY_HEAD, *describe_run(numbers), *write_accuracy(numbers)])
    if numbers.get("speed"):
        draw("speed.png", plots.plot_speed)
        bounds = Path(__file__).with_name("speed_bounds.md").read_text(encoding="utf-8")
        write("speed.md", [SPEED_HEAD, *describe_run(numbers), *write_speed(numbers), bounds])
    if numbers.get("equal_error"):
        draw("equal_error.png", plots.plot_equal_error)
        bounds = Path(__file__).with_name("equal_error_bounds.md").read_text(encoding="utf-8")
        write("equal_error.md", [EQUAL_ERROR_HEAD, *describe_run(numbers), *write_equal_error(numbers), bounds])
    if write_pictures(numbers):
        images = []
        if numbers.get("convergence"):
            draw("convergence.png", plots.plot_convergence)
            images = ["![convergence](convergence.png)", ""]
        write("pictures.md", [PICTURES_HEAD, *images, *describe_run(numbers), *write_pictures(numbers)])
    return written


if __name__ == "__main__":
    for path in write_report(json.loads(Path(sys.argv[1]).read_text(encoding="utf-8")), Path(sys.argv[2])):
        print(path)
