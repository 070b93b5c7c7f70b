"""Entry of `python -m addon`."""

import sys

from .command_line import main

sys.exit(main())
