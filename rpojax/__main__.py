"""`python -m rpojax` is the command `rpojax`."""

import sys

from rpojax.cli.main import main

sys.exit(main())
