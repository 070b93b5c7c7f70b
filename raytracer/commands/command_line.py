"""What the commands of `python -m raytracer` share: arguments, errors in one line, exit codes."""

from __future__ import annotations

import argparse
import io
import os
import sys
from collections.abc import Sequence
from typing import NoReturn

from raytracer.commands import info, merge, render
from raytracer.processes.workers import WorkerError

# A command's module offers add_arguments(parser) and run(arguments); its first line of documentation is its help.
COMMANDS = {"render": render, "merge": merge, "info": info}
PROGRAM = "python -m raytracer"


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Print one line instead of argparse's usage and line."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def build_parser() -> argparse.ArgumentParser:
    """Return the parser of all commands."""
    parser = _Parser(prog=PROGRAM, description="The ray tracer on the command line, without Blender.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name, module in COMMANDS.items():
        summary = (module.__doc__ or "").splitlines()[0]
        command = commands.add_parser(name, help=summary, description=summary)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def main(argv: Sequence[str] | None = None) -> int:
    """Run one command; return the exit code, 0 only on success."""
    if isinstance(sys.stdout, io.TextIOWrapper):  # a name that its encoding lacks letters for is no error
        sys.stdout.reconfigure(errors="backslashreplace")
    arguments = build_parser().parse_args(argv)
    try:
        arguments.run(arguments)
    except KeyboardInterrupt:
        return print_error("interrupted")
    except OSError as error:
        place = error.filename or ("standard output" if is_output_lost() else None)
        return print_error(f"{place}: {error.strerror}" if place else str(error))
    except MemoryError:
        return print_error("not enough memory")
    except (ValueError, WorkerError) as error:
        return print_error(str(error))
    return 0


def is_output_lost() -> bool:
    """Return whether standard output takes no more (a full disk, a pipe whose reader has gone); it leads nowhere then,
    so that Python does not fail once more on what waits in its buffer when it ends."""
    if sys.stdout is None:  # it was closed before this process began
        return False
    try:
        sys.stdout.flush()
    except OSError:
        with open(os.devnull, "wb") as nowhere:
            os.dup2(nowhere.fileno(), sys.stdout.fileno())
        return True
    return False


def print_error(reason: str) -> int:
    """Print one line, where there is a place for it; return the exit code."""
    if sys.stderr is not None:  # or it would come out among the results
        print(f"error: {' '.join(reason.split())}", file=sys.stderr)
    return 1
