"""Run the benchmark's sections and print what they found; called by `python -m addon bench`."""

from __future__ import annotations

import json
import os
import sys

from tqdm import tqdm

from tests.benchmarks.ablation import measure_ablation, measure_memory, measure_workers
from tests.benchmarks.accuracy import Effort, measure_accuracy, measure_spheres
from tests.benchmarks.convergence import measure_convergence
from tests.benchmarks.equal_error import Effort as PictureEffort
from tests.benchmarks.equal_error import measure_equal_error
from tests.benchmarks.peers import find_loaders, load_peers
from tests.benchmarks.speed import measure_cost, measure_speed
from tests.benchmarks.tables import write_tables
from tests.benchmarks.timing import describe_machine

# Options of the command, in the order of equal_error.Effort.
PICTURE_SETTINGS = ("picture_size", "picture_samples", "picture_renders", "scenes")
# One thread each, for libraries that read this when they are loaded.
THREAD_VARIABLES = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def show_progress(iterable, label):
    """Count the steps of a section on stderr; silent where stderr is no terminal."""
    return tqdm(iterable, desc=label, file=sys.stderr, disable=None, leave=False)


def measure_sections(arguments, loaders=None, progress=show_progress):
    """Return all numbers as one JSON object.

    Keys: machine, settings, versions (peer -> version), skipped (peer or scene -> reason), and per section a list of
    rows: accuracy, spheres, cost, speed, builds (with speed), convergence, equal_error, ablation, memory, workers.
    """
    for variable in THREAD_VARIABLES:
        os.environ[variable] = "1"
    numbers = {"machine": describe_machine(), "settings": list_settings(arguments)}
    peers, skipped = load_peers(find_loaders() if loaders is None else loaders)
    rendered = PictureEffort(*(getattr(arguments, name) for name in PICTURE_SETTINGS), keep=arguments.keep)
    effort = Effort(arguments.rays, arguments.speed_rays, arguments.rounds, arguments.seed)
    numbers["versions"] = {peer.name: peer.version for peer in peers}
    numbers["skipped"] = skipped
    if "accuracy" in arguments.sections:
        numbers["accuracy"] = measure_accuracy(peers, effort, progress)
    if "spheres" in arguments.sections:
        numbers["spheres"] = measure_spheres(effort, progress)
    if "cost" in arguments.sections:
        numbers["cost"] = measure_cost(peers, effort, progress)
    if "speed" in arguments.sections:
        numbers["speed"], numbers["builds"], scenes = measure_speed(peers, effort, arguments.large, progress)
        skipped |= scenes
    pictures = {
        "convergence": lambda: measure_convergence(progress),
        "equal_error": lambda: measure_equal_error(rendered, arguments.large, progress),
        "ablation": lambda: measure_ablation(arguments.rounds, progress),
        "memory": lambda: measure_memory(progress),
        "workers": lambda: measure_workers(arguments.rounds, progress),
    }
    numbers |= {name: measure() for name, measure in pictures.items() if name in arguments.sections}
    return numbers


def list_settings(arguments):
    """Return what the run was asked for."""
    names = ("sections", "rays", "speed_rays", "rounds", "seed", "large", *PICTURE_SETTINGS)
    return {name: getattr(arguments, name) for name in names}


def run(arguments):
    """Measure, tell on stderr what was skipped, print JSON or tables."""
    numbers = measure_sections(arguments)
    for name, reason in numbers["skipped"].items():
        print(f"skipped {name}: {reason}", file=sys.stderr)
    print(json.dumps(numbers) if arguments.json else write_tables(numbers), flush=True)
