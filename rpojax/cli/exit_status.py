"""Exit statuses of the command line."""

import enum


class Status(enum.IntEnum):
    """Exit statuses; 1 is Python's own for unexpected errors."""

    DONE = 0
    BAD_INPUT = 2
    SOME_FAILED = 3
    UNFINISHED = 4
    INTERRUPTED = 130
    TERMINATED = 143
