"""Say what a film's file holds: which part of which picture, and how far it is."""

from __future__ import annotations

import argparse

from raytracer.commands.render import describe_progress
from raytracer.film.error import format_error, format_interval
from raytracer.film.film import Film
from raytracer.film.film_file import load_film
from raytracer.film.parts import LIMITS


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `info`."""
    parser.add_argument("files", nargs="+", metavar="P.npz", help="films")


def run(arguments: argparse.Namespace) -> None:
    """Print a few lines for each film."""
    for path in arguments.files:
        print("\n".join(describe(load_film(path))), flush=True)


def describe(film: Film) -> list[str]:
    """Return what there is to say of a film, a line for each thing."""
    assert film.key is not None
    choices = film.key.choices
    right, top = film.left + film.width, film.bottom + film.height
    part = f"columns {film.left} to {right - 1}, rows {film.bottom} to {top - 1} from below"
    settings = ", ".join(f"{name} {value}" for name, value in choices.items() if name not in ("width", "height"))
    progress = describe_progress(film) + (f", ended by {film.ended_by}" if film.ended_by in LIMITS else "")
    error = []
    if "Combined" in film.arrays:
        known = film.measure_error()
        told = f"{format_error(known.error)} ({format_interval(known.interval)})"
        error = [f"  error: {', '.join(filter(None, (told, known.note)))}"]
    return [
        f"{film.label}: {progress}, {film.statistics.trace_seconds:.1f} s, {film.statistics.rays} rays",
        *error,
        f"  picture: {choices['width']} x {choices['height']}, {part}",
        f"  passes: {', '.join(film.names)}",
        f"  settings: {settings}",
        f"  key: {film.key.digest}",
    ]
