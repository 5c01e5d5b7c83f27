"""Texts of users as they are printed."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from rpojax.errors import RpojaxError, ScenarioError
from rpojax.printable_text import cut, escape, escape_lines, printable, shown_value


@pytest.mark.parametrize(
    ("text", "shown"),
    [
        ("plain", "plain"),
        ("a\x1b[31mb", "a\\x1b[31mb"),
        ("a\u202eb", "a\\u202eb"),
        ("\ud800", "\\ud800"),
        ("\U000e0001", "\\U000e0001"),
        ("é µ 🚀", "é µ 🚀"),
    ],
)
def test_what_a_terminal_acts_on_is_escaped(text: str, shown: str) -> None:
    assert escape(text) == shown


@given(st.text(max_size=1000))
def test_any_text_is_one_line_of_limited_length_that_can_be_encoded(text: str) -> None:
    found = printable(text)
    assert len(found) <= 400
    assert found.isprintable()
    found.encode()


def test_a_long_text_keeps_its_ends() -> None:
    assert cut("a" * 50 + "b" * 50, 11) == "aaa...bbbbb"
    assert str(RpojaxError("x" * 1000 + " expected y")).endswith("expected y")
    assert escape_lines("a\n\tb\x07") == "a\n\tb\\x07"


def test_values_that_cannot_be_written_are_described() -> None:
    deep: list[object] = []
    for _ in range(100_000):
        deep = [deep]
    assert shown_value(deep) == "a list that is too deep or too long to show"
    assert shown_value(10**5000) == "a int that is too deep or too long to show"
    assert len(str(ScenarioError("k" * 1000, "v" * 1000, "a value"))) <= 400
