"""Put the tiles of a picture together, in any order, into a film or a picture."""

from __future__ import annotations

import argparse
import sys
from pathlib import Path

from raytracer.commands.render import SUFFIXES
from raytracer.files.replacing import check_replaceable
from raytracer.film.film_file import load_films, save_film
from raytracer.film.film_picture import save_picture
from raytracer.film.parts import describe_endings, merge


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the arguments of `merge`."""
    parser.add_argument("files", nargs="+", metavar="P.npz", help="the films of all tiles, or folders of them")
    parser.add_argument("-o", "--output", required=True, metavar="PICTURE.exr|.npz", help="the file to write")


def run(arguments: argparse.Namespace) -> None:
    """Merge; print the path of what was written."""
    output = Path(arguments.output)
    if output.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{output}: expected a name that ends in {' or '.join(SUFFIXES)}")
    check_replaceable(output)
    films = load_films(arguments.files)
    whole = merge(films)
    for line in describe_endings(films):
        print(line, file=sys.stderr)
    (save_picture if output.suffix.lower() == ".exr" else save_film)(whole, output)
    print(output, flush=True)
