"""Calls with those named arguments that a function declares."""

from collections.abc import Callable
from functools import partial
from typing import Any

import pytest

from rpojax.core import named_arguments
from rpojax.errors import RpojaxError


def model(self: object, *, gain: float, deviation: float, time: float) -> float:
    """The signature that functions are checked against."""
    raise AssertionError


class Law:
    """A callable object."""

    def __call__(self, deviation: float) -> float:
        return deviation


def weighted(weight: float, gain: float) -> float:
    return weight * gain


@pytest.mark.parametrize(
    ("function", "expected"),
    [
        (lambda: 7.0, 7.0),
        (lambda time: time, 3.0),
        (lambda deviation, gain: (gain, deviation), (1.0, 2.0)),
        (lambda gain, **others: (gain, others), (1.0, {"deviation": 2.0, "time": 3.0})),
        (lambda gain, scale=5.0: scale * gain, 5.0),
        (Law(), 2.0),
        (partial(weighted, weight=4.0), 4.0),
        (partial(weighted, weight=4.0, gain=2.0), 8.0),  # the bound gain, not that of the call
        (partial(lambda gain, **others: (gain, sorted(others)), gain=9.0), (9.0, ["deviation", "time"])),
    ],
)
def test_a_function_gets_the_arguments_that_it_declares(function: Callable[..., Any], expected: object) -> None:
    named_arguments.check("law", function, model)
    assert named_arguments.call(function, gain=1.0, deviation=2.0, time=3.0) == expected


@pytest.mark.parametrize(
    ("function", "shown"),
    [
        (lambda speed: speed, "'speed'"),
        (lambda *numbers: 0.0, "'\\*numbers'"),
        (lambda gain, /: gain, "'gain'"),
        (lambda tiem=None: 0.0, "'tiem=None'"),
    ],
)
def test_other_arguments_are_refused(function: Callable[..., Any], shown: str) -> None:
    expected = rf"^law: found the argument {shown}, expected a function of some of gain, deviation, time, by name$"
    with pytest.raises(RpojaxError, match=expected):
        named_arguments.check("law", function, model)


def test_what_is_no_function_is_refused() -> None:
    with pytest.raises(RpojaxError, match=r"^law: found 3\.0, expected a function of some of gain"):
        named_arguments.check("law", 3.0, model)
