"""Exit statuses of the command line."""

import enum


class Status(enum.IntEnum):
    """Exit statuses; 1 is left to Python, for errors that nobody expected."""

    DONE = 0
    BAD_INPUT = 2
    SOME_FAILED = 3
    UNFINISHED = 4
    INTERRUPTED = 130
