"""Entry of `python -m addon`."""

import sys

try:
    from .commands.command_line import main

    code = main()
except KeyboardInterrupt:  # before `main` listens
    sys.stderr.write("error: interrupted\n")
    code = 130
if signal := sys.modules.get("signal"):
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # all is done; Python and Blender only clean up after themselves
# After a KeyboardInterrupt that went through an exec of text, as each dataclass is made by one, Python would end by the
# signal in place of the code; the next exec lets it forget.
exec("")
sys.exit(code)
