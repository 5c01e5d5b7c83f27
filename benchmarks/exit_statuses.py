"""Exit status of a benchmark that is run as a program."""

import sys
from collections.abc import Callable

from rpojax.cli.exit_status import Status
from rpojax.errors import RpojaxError


def exit_status(program: str, run: Callable[[], int]) -> int:
    """Exit status of `run`; an error of the user, and an interruption, give one line on stderr and their own status."""
    try:
        return run()
    except RpojaxError as error:
        print(f"{program}: {error}", file=sys.stderr)
        return Status.BAD_INPUT
    except KeyboardInterrupt:
        print(f"{program}: interrupted", file=sys.stderr)
        return Status.INTERRUPTED
