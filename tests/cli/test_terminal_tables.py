"""Tables of a terminal: whole numbers at every width, names shortened, columns left out with a word."""

import io

import pytest
from rich.console import Console
from rich.text import Text

from rpojax.cli.terminal_tables import print_table, shortened

HEADINGS = ("input", "trend [m/s]", "sigma", "most of one run", "kind")
ROWS = [
    ("initial.relative_position_m[0]", "0.0001234", "1.235e-12", "100%", Text("better", style="green")),
    ("initial.relative_position_m[1]", "\N{EN DASH}", "12.35", "3%", ""),
]
NUMBERS = ("0.0001234", "1.235e-12", "100%", "12.35", "better")


def printed(width: int, boxed: bool) -> list[str]:
    stream = io.StringIO()
    console = Console(file=stream, width=width, highlight=False)
    print_table(console, HEADINGS, ROWS, title="a [b] c", words=("kind",), optional=("most of one run",), boxed=boxed)
    return stream.getvalue().splitlines()


@pytest.mark.parametrize("boxed", [True, False])
@pytest.mark.parametrize("width", [20, 40, 50, 60, 70, 80, 90, 120])
def test_no_number_is_cut_and_what_is_left_out_is_said(width: int, boxed: bool) -> None:
    lines = printed(width, boxed)
    text = "\n".join(lines)
    left_out = "no place for the column most of one run" in text
    assert left_out == ("100%" not in text)
    for number in NUMBERS:
        assert number in text or (left_out and number == "100%")
    assert "a [b] c" in text
    assert "[m/s]" in text
    table = [line for line in lines if "no place" not in line]
    assert width < 60 or max(map(len, table)) <= width


def test_names_are_shortened_before_a_column_is_left_out() -> None:
    widths = (120, 80, 60, 48)
    texts = {width: "\n".join(printed(width, boxed=False)) for width in widths}
    assert [ROWS[0][0] in texts[width] for width in widths] == [True, True, False, False]
    assert ["no place" in texts[width] for width in widths] == [False, False, False, True]
    for width in widths:
        rows = [line for line in texts[width].splitlines() if line.startswith("init")]
        assert len({row.split()[0] for row in rows}) == 2


@pytest.mark.parametrize(
    ("length", "expected"),
    [(9, "abcdefghi"), (8, "abcd\N{HORIZONTAL ELLIPSIS}ghi"), (7, "abc\N{HORIZONTAL ELLIPSIS}ghi")],
)
def test_a_name_keeps_both_ends(length: int, expected: str) -> None:
    assert shortened("abcdefghi", length) == expected
    assert len(expected) == length
