"""Printed command lines are understood by a shell, and allow the plugin that they need."""

import shlex
import subprocess
from pathlib import Path

import pytest

from rpojax.scenario.plugins.command_lines import command_line


@pytest.mark.parametrize("name", ["plain", "two words", "Anna's", "$HOME", "a;b", "-x", "*", "ä"])
def test_a_shell_reads_the_words_that_were_given(name: str) -> None:
    text = command_line("resume", Path(name), "--out", "a b", plugin=None)
    heard = subprocess.run(
        ["sh", "-c", f'printf "%s\\n" {text.removeprefix("rpojax ")}'], capture_output=True, text=True, check=True
    )
    place = f"./{name}" if name.startswith("-") else name
    assert heard.stdout.splitlines() == ["resume", place, "--out", "a b"]


def test_a_plugin_file_is_allowed_and_one_from_python_is_not() -> None:
    assert shlex.split(command_line("field train", "x", plugin="/a b/mine.py:setup"))[-1] == "--allow-plugin"
    for plugin in (None, "python"):
        assert command_line("field train", "x", plugin=plugin) == "rpojax field train x"
