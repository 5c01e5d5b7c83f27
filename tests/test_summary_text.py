"""Short descriptions of results in consoles and notebooks."""

import rpojax
from rpojax.summary_text import Summarised, Summary, counted, number, numbers


class Result(Summarised):
    def _summary(self) -> Summary:
        return Summary("Title <b>", [("runs", "12"), ("metrics", "a & b"), ("metrics", "c\nd")])


def test_lines_have_two_columns_and_a_name_once() -> None:
    assert str(Result()) == repr(Result()) == "Title <b>\n  runs     12\n  metrics  a & b\n           c d"


def test_the_table_of_a_notebook_is_escaped() -> None:
    shown = Result()._repr_html_()
    assert "<strong>Title &lt;b&gt;</strong>" in shown
    assert "a &amp; b" in shown
    assert shown.count("<tr>") == 3


def test_numbers_are_short() -> None:
    assert number(1.234567) == "1.235"
    assert number(None) == number(float("nan")) == "\N{EN DASH}"
    assert numbers([1.0, 0.333333]) == "[1, 0.3333]"
    assert numbers(True) == "True"
    assert (counted(1, "run"), counted(2, "run")) == ("1 run", "2 runs")


def test_a_scenario_says_what_it_is() -> None:
    lines = repr(rpojax.load("vbar_approach")).splitlines()
    assert lines[0].startswith("Scenario vbar_approach: Straight approach")
    assert "  phases     hold_100, approach, hold_12" in lines
    assert any("min_range_m at least 9 m in 99 % of runs" in line for line in lines)
    assert len(lines) < 16
    assert "<table>" in rpojax.load("vbar_approach")._repr_html_()
