"""Pointing modes of the attitude guidance."""

import enum


class Mode(enum.IntEnum):
    """Pointing mode; a slew to a target whose estimate has jumped counts as search."""

    LOOK = 0
    TURN = 1
    BURN = 2
    TURN_BACK = 3
    SEARCH = 4
