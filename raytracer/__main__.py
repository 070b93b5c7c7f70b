"""Entry of `python -m raytracer`."""

import sys

from raytracer.commands.command_line import main

if __name__ == "__main__":
    sys.exit(main())
