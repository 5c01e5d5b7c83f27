"""Exceptions of the package. Each message is one line: what, found, expected."""

from typing import Final, Self

from rpojax.printable_text import cut, printable, shown_value

_LONGEST_KEY = 120


class _Missing:
    """What is found where there is nothing."""


MISSING: Final = _Missing()
"""Stands for what is found of a key that is not there."""


class RpojaxError(Exception):
    """Base of all errors that a user can cause and correct.

    Attributes:
        arguments: names of the arguments that cannot be used, with which the message begins; empty if it is about
            something else
    """

    arguments: tuple[str, ...] = ()

    def __init__(self, message: str = "") -> None:
        super().__init__(printable(message))

    @classmethod
    def of_argument(cls, names: str, problem: str) -> Self:
        """Error about an argument, or about several whose `names` are joined by ', '."""
        error = cls(f"{names}: {problem}")
        error.arguments = tuple(names.split(", "))
        return error


class ScenarioError(RpojaxError):
    """A scenario, or an override of it, is invalid."""

    def __init__(self, key: str, found: object, expected: str, is_argument: bool = False) -> None:
        words = "missing" if found is MISSING else f"found {shown_value(found)}"
        super().__init__(f"{cut(key, _LONGEST_KEY)}: {words}, expected {expected}")
        self.key = key
        self.arguments = (key,) if is_argument else ()

    @classmethod
    def of_structure(cls, source: str, error: RpojaxError) -> Self:
        """Error about a text of which `error` says what was found and expected."""
        found = cls(source, "", "")
        found.args = (printable(f"{cut(source, _LONGEST_KEY)}: {error}"),)
        return found


class UnknownKeyError(ScenarioError):
    """A scenario has an unknown key."""

    def __init__(self, key: str, hint: str) -> None:
        RpojaxError.__init__(self, f"{cut(key, _LONGEST_KEY)}: unknown key{hint}")
        self.key = key


class ServicerError(ScenarioError):
    """What differs for one servicer of a team is invalid."""

    def __init__(self, name: str, error: ScenarioError) -> None:
        RpojaxError.__init__(self, f"servicers.{name}.{error}")
        self.key = f"servicers.{name}.{error.key}"


class OutputError(RpojaxError):
    """An output folder or file cannot be written."""


class ResultError(RpojaxError):
    """A campaign folder does not hold the requested results."""


class UnfinishedError(RpojaxError):
    """A campaign could not be completed; finished blocks are kept, and it can be resumed."""


class BatchingError(RpojaxError):
    """A function or its arguments cannot be batched over the last axis; RPOJAX_BATCHING=jax chooses `jax.vmap`."""


class Notice(UserWarning):
    """Something that a user should know and that stops nothing; commands print it as a line."""
