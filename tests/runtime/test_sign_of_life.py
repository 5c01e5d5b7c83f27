"""Signs of life of nested works: the innermost speaks, those around it before and after."""

import time

import pytest

from rpojax.runtime import sign_of_life
from rpojax.runtime.sign_of_life import SignOfLife


def wait_for_another(lines: list[str]) -> str:
    """The next line, however long it takes on a busy machine."""
    count, end = len(lines), time.monotonic() + 60.0
    while len(lines) == count and time.monotonic() < end:
        time.sleep(0.01)
    return lines[count]


def test_the_innermost_work_speaks_and_the_outer_one_says_after_what_it_is(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sign_of_life, "INTERVAL_S", 0.02)
    lines: list[str] = []
    with SignOfLife(lines.append, "starting"):
        assert wait_for_another(lines).startswith("starting, ")
        with SignOfLife(lines.append, "compiling"):
            before = len(lines)
            for _ in range(3):
                wait_for_another(lines)
            assert {line.partition(",")[0] for line in lines[before:]} == {"compiling"}
        assert wait_for_another(lines).startswith("after compiling, ")
        with sign_of_life.display():
            time.sleep(0.03)  # a line that was under way
            count = len(lines)
            time.sleep(0.2)
            assert len(lines) == count
        assert wait_for_another(lines).startswith("after the last stage, ")
    count = len(lines)
    time.sleep(0.1)
    assert len(lines) == count
