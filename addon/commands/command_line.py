"""What the commands of `python -m addon` share: errors in one line, a silent Blender, opening a file.

bpy is imported where it is used, so that `--help` answers at once and without it.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import os
import shutil
import sys
from collections.abc import Iterator, Sequence
from importlib import import_module
from pathlib import Path
from typing import IO, Any, NoReturn

from .. import interrupts

# A command's module offers add_arguments(parser) and run(arguments); its first line of documentation is its help.
COMMANDS = {
    "render": ".render",
    "export": ".export",
    "merge": ".merge",
    "compare": ".compare",
    "bench": ".bench",
}
# Those that need no more than the installed extension.
INSTALLED_COMMANDS = ("render", "export", "merge", "compare")
PROGRAM = "python -m addon"

# First bytes of a .blend: plain, compressed by gzip (before Blender 3.0) and by Zstandard.
BLEND_SIGNATURES = (b"BLENDER", b"\x1f\x8b", b"\x28\xb5\x2f\xfd")


class CommandError(Exception):
    """Something the user can put right; the message is one sentence.

    code : the exit code
    """

    def __init__(self, message: str, code: int = 1) -> None:
        super().__init__(message)
        self.code = code


class _Parser(argparse.ArgumentParser):
    def error(self, message: str) -> NoReturn:
        """Print one line instead of argparse's usage and line."""
        self.exit(2, f"{self.prog}: error: {message} (see {self.prog} --help)\n")


def build_parser(program: str = PROGRAM, names: Sequence[str] = tuple(COMMANDS)) -> argparse.ArgumentParser:
    """Return the parser of the commands `names`; program : what the user has typed before them."""
    parser = _Parser(prog=program, description="The Reference Ray Tracer on the command line.")
    commands = parser.add_subparsers(dest="command", required=True, metavar="COMMAND")
    for name in names:
        module = import_module(COMMANDS[name], __package__)
        summary = (module.__doc__ or "").splitlines()[0]
        command = commands.add_parser(name, help=summary, description=summary)
        module.add_arguments(command)
        command.set_defaults(run=module.run)
    return parser


def add_file(parser: argparse.ArgumentParser, text: str) -> None:
    """Add the .blend, with its help, and whether its scripts run; see `open_blend`."""
    parser.add_argument("file", metavar="FILE.blend", help=text)
    parser.add_argument(
        "--scripts", action="store_true", help="run the file's Python, such as drivers; default: as the preferences say"
    )


def join_frames(argv: Sequence[str]) -> list[str]:
    """Return arguments in which --frames and the frames are one: argparse takes -5--1 for an option."""
    joined: list[str] = []
    for text in argv:
        if joined and joined[-1] == "--frames":
            joined[-1] = f"--frames={text}"
        else:
            joined.append(text)
    return joined


def main(argv: Sequence[str] | None = None, program: str = PROGRAM, names: Sequence[str] = tuple(COMMANDS)) -> int:
    """Run one command of `names`; return the exit code, 0 only on success."""
    try:
        with interrupts.listen(), interrupts.tidying(remove_blender_files):
            arguments = build_parser(program, names).parse_args(join_frames(sys.argv[1:] if argv is None else argv))
            silence_blender()
            interrupts.tell_through(sys.stderr.fileno())
            arguments.run(arguments)
    except KeyboardInterrupt:
        return _print_error("interrupted", interrupts.EXIT_CODE)
    except OSError as error:
        from raytracer.commands.command_line import is_output_lost  # all of the ray tracer: not where nothing fails

        place = error.filename or ("standard output" if is_output_lost() else None)
        return _print_error(f"{place}: {error.strerror}" if place else str(error))
    except CommandError as error:
        return _print_error(str(error), error.code)
    except Exception as error:
        if sys.flags.dev_mode:  # python -X dev -m addon ...: for developers, with the traceback
            raise
        known = isinstance(error, ValueError | MemoryError)
        return _print_error(str(error) if known else f"internal error, {type(error).__name__}: {error}")
    return 0


def _print_error(reason: str, code: int = 1) -> int:
    print(f"error: {' '.join(reason.split())}", file=sys.stderr)
    return code


def silence_blender() -> None:
    """Let what Blender prints vanish, for the rest of the process: only Python's own streams still reach the user.

    Blender prints from C++ to the file descriptors 1 and 2, into buffers that are written at any later time; so the
    descriptors themselves lead nowhere, and `sys.stdout` and `sys.stderr` go on with copies of the old ones.
    """
    for stream in filter(None, (sys.stdout, sys.stderr)):
        stream.flush()
    sys.stdout = _reopen(sys.stdout)
    sys.stderr = _reopen(sys.stderr)
    with open(os.devnull, "wb") as nowhere:
        os.dup2(nowhere.fileno(), 1)
        os.dup2(nowhere.fileno(), 2)


def _reopen(stream: Any) -> IO[str]:
    """Return a stream to where `stream` leads, or nowhere; a name that its encoding lacks letters for has escapes."""
    if stream is None:
        return open(os.devnull, "w", encoding="utf-8")
    return os.fdopen(os.dup(stream.fileno()), "w", encoding=stream.encoding, errors="backslashreplace", buffering=1)


def first_line(message: str) -> str:
    """Return the first line of what an operator reported, without its 'Error: '."""
    return message.strip().splitlines()[0].removeprefix("Error: ")


@contextlib.contextmanager
def hide_python_output() -> Iterator[None]:
    """Hide what scripts of Blender's print through Python."""
    with contextlib.redirect_stdout(io.StringIO()), contextlib.redirect_stderr(io.StringIO()):
        yield


def open_blend(path: str, scripts: bool = False) -> Any:
    """Open a .blend with the render engine registered; return bpy.

    scripts : True runs those of the file, else the preferences decide; a module of bpy has none that allow it

    Raises
    ------
    CommandError
        If there is no such file, or it is not a .blend.
    """
    file = Path(path)
    check_blend(file)
    with interrupts.hold():
        import bpy

        from ..registration import register

        if not hasattr(bpy.types.Scene, "reference_raytracer"):  # inside the application it is there already
            register()
        try:
            with hide_python_output():
                allowed = {"use_scripts": True} if scripts else {}
                # Not resolved: what lies beside a link to a file counts as beside the file, as for `blender -b`.
                bpy.ops.wm.open_mainfile(filepath=str(file.absolute()), load_ui=False, **allowed)
        except RuntimeError as error:
            raise CommandError(f"{path}: {first_line(str(error))}") from None
    return bpy


def list_blocked(bpy: Any) -> list[str]:
    """Return a sentence for the first script of the open file that Blender did not run, if any."""
    if not bpy.app.autoexec_fail:
        return []
    return [
        f"scripts of the file are not run, and what they set shows otherwise: {bpy.app.autoexec_fail_message}; "
        "--scripts allows them"
    ]


def warn_blocked(bpy: Any) -> None:
    """Say on standard error which script of the open file Blender did not run, if any."""
    for blocked in list_blocked(bpy):
        print(f"warning: {blocked}", file=sys.stderr)


def remove_blender_files() -> None:
    """Remove Blender's own temporary files, where it cannot do so itself any more."""
    if "bpy" in sys.modules:
        shutil.rmtree(sys.modules["bpy"].app.tempdir, ignore_errors=True)


def check_blend(file: Path) -> None:
    """Raise CommandError unless `file` exists and begins as a .blend does."""
    if not file.exists():
        raise CommandError(f"{file}: no such file")
    if not file.is_file():
        raise CommandError(f"{file}: not a file")
    with file.open("rb") as content:
        if not content.read(8).startswith(BLEND_SIGNATURES):
            raise CommandError(f"{file}: not a .blend file")


def check_replaceable_picture(path: Path) -> None:
    """Raise CommandError, or OSError, where a picture could not be written to `path` after a long render."""
    if path.is_dir():
        raise CommandError(f"{path}: is a folder")
    if not path.parent.is_dir():
        raise CommandError(f"{path.parent}: no such folder")
    from raytracer.files.replacing import check_replaceable  # with it all of the ray tracer, so not for --help

    check_replaceable(path)
