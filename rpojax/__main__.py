"""`python -m rpojax` is the command `rpojax`."""

import sys

from rpojax.runtime import signal_handling


def main() -> int:
    """Runs the command line of the process and returns the exit status; signals count from the first moment on."""
    signal_handling.interrupt_at_signals()
    from rpojax.cli.main import main as run

    return signal_handling.leave_if_signalled(run())


if __name__ == "__main__":
    sys.exit(main())
