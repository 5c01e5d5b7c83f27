"""Usage errors are one line, with the nearest command, and JSON where it is asked for."""

import json
import pkgutil
from typing import get_type_hints

import pytest

from rpojax.cli import standard_streams
from rpojax.cli.main import COMMANDS, main
from rpojax.cli.options.arguments import Group


@pytest.mark.parametrize(
    ("words", "expected"),
    [
        (["campain", "inspection"], "did you mean 'campaign'?"),
        (["field", "trian"], "did you mean 'train'?"),
        (["campaign", "inspection"], "--runs: missing"),
        (["resume"], "DIR"),
        (["run", "inspection", "--out", "x", "--seed"], "--seed"),
        (["campaign", "inspection", "--runs", "x", "--out", "y"], "'x'"),
        (["validate", "inspection", "--bogus"], "--bogus"),
        ([], "Expected one of {run"),
    ],
)
def test_a_usage_error_is_one_line(capsys: pytest.CaptureFixture[str], words: list[str], expected: str) -> None:
    assert main(words) == 2
    out, err = capsys.readouterr()
    assert out == ""
    [line] = err.splitlines()
    assert line.startswith("rpojax: error: ")
    assert expected in line
    assert main([*words, "--json"]) == 2
    out, err = capsys.readouterr()
    assert err.removeprefix("rpojax: error: ").rstrip("\n") == json.loads(out)["error"]


def test_there_is_one_json_document_even_if_an_error_follows_the_result(capsys: pytest.CaptureFixture[str]) -> None:
    standard_streams.prepare_streams()
    standard_streams.print_json({"a": 1})
    standard_streams.print_problem("unfinished", "b", as_json=True)
    out, err = capsys.readouterr()
    assert json.loads(out) == {"a": 1}
    assert err == "rpojax: unfinished: b\n"


def test_the_help_of_every_command_is_printed(capsys: pytest.CaptureFixture[str]) -> None:
    for words in (["--help"], ["report", "--help"], ["field", "--help"], ["field", "train", "--help"]):
        with pytest.raises(SystemExit) as ended:
            main(words)
        assert ended.value.code == 0
        assert "usage: rpojax" in capsys.readouterr().out


def test_a_second_line_of_an_override_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    for text in ("duration_s=600\nx=2", "name=a\nb"):
        assert main(["validate", "inspection", "--set", text]) == 2
        assert "line" in capsys.readouterr().err


def test_the_work_of_every_command_takes_its_options() -> None:
    groups = [each.commands.values() if isinstance(each, Group) else [each] for each in COMMANDS.values()]
    for command in (command for group in groups for command in group):
        work = pkgutil.resolve_name(f"rpojax.cli.commands.{command.work}")
        assert get_type_hints(work) == {"asked": command, "return": int}
