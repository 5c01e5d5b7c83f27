"""`python -m rpojax` is the command `rpojax`."""

import sys

from rpojax.cli import main

sys.exit(main())
