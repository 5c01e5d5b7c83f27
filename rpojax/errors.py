"""Exceptions of the package. Each message is one line: what, found, expected."""


class RpojaxError(Exception):
    """Base of all errors that a user can cause and correct."""


class ScenarioError(RpojaxError):
    """A scenario, or an override of it, is invalid."""

    def __init__(self, key: str, found: object, expected: str) -> None:
        super().__init__(f"{key}: found {found!r}, expected {expected}")
        self.key = key


class UnknownKeyError(ScenarioError):
    """A scenario has an unknown key."""

    def __init__(self, key: str, hint: str) -> None:
        RpojaxError.__init__(self, f"{key}: unknown key{hint}")
        self.key = key


class OutputError(RpojaxError):
    """An output folder or file cannot be written."""


class ResultError(RpojaxError):
    """A campaign folder does not hold the requested results."""


class UnfinishedError(RpojaxError):
    """A campaign could not be completed; finished blocks are kept, and it can be resumed."""


class BatchingError(RpojaxError):
    """A function or its arguments cannot be batched over the last axis; RPOJAX_BATCHING=jax chooses `jax.vmap`."""
