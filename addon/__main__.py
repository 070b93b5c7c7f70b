"""Entry of `python -m addon`."""

import sys

from .commands.command_line import main

sys.exit(main())
