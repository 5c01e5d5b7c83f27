"""The exceptions that the project raises on purpose. Each message is one line: what, found, expected."""


class RpojaxError(Exception):
    """Base of all errors that a user can cause and mend."""


class ScenarioError(RpojaxError):
    """A scenario, or an override of it, is not acceptable."""

    def __init__(self, key: str, found: object, expected: str) -> None:
        super().__init__(f"{key}: found {found!r}, expected {expected}")
        self.key = key


class UnknownKeyError(ScenarioError):
    """A scenario has a key that no scenario has."""

    def __init__(self, key: str, hint: str) -> None:
        RpojaxError.__init__(self, f"{key}: unknown key{hint}")
        self.key = key


class OutputError(RpojaxError):
    """An output folder or file cannot be used as asked."""


class ResultError(RpojaxError):
    """A campaign folder does not hold what was asked for."""


class UnfinishedError(RpojaxError):
    """A campaign could not be completed; what is finished of it is kept, and it can be resumed."""
