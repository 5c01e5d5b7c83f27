"""Hostile command lines, in this process: every one ends in a documented status, with JSON where it is asked for."""

import contextlib
import io
import json
from pathlib import Path

from case_ledger import Case, line_problem
from hostile_values import SPECIAL_FILES, TEXTS, special_path
from hypothesis import strategies as st

from rpojax.cli import main as cli
from rpojax.cli.main import main

VERBS = [*cli.COMMANDS]
LIGHT = ("validate", "status", "schema", "detect")
"""Commands that are called with arguments that they may accept; of others only what is refused is tried."""
OPTIONS = ("--set", "--runs", "--seed", "--out", "--json", "--run-id", "--force", "--histories", "--bogus", "-x", "--")


def command_line_cases(folder: Path) -> st.SearchStrategy[Case]:
    """Command lines."""

    @st.composite
    def build(draw: st.DrawFn) -> Case:
        damage = draw(st.sampled_from(("verb", "options", "source", "folder", "overrides")))
        as_json = ["--json"] if draw(st.booleans()) else []
        values = st.one_of(
            st.sampled_from(TEXTS), st.text(max_size=12), st.sampled_from(("-1", "1e9", "nan", "inspection"))
        )
        match damage:
            case "verb":
                verb = draw(st.sampled_from(VERBS))
                at = draw(st.integers(0, len(verb) - 1))
                words = [draw(st.sampled_from((verb[:at] + "q" + verb[at + 1 :], verb + "x", verb[at:] + "z", "")))]
            case "options":
                verb = draw(st.sampled_from(VERBS))
                words = [verb, "--bogus", *draw(st.lists(st.one_of(st.sampled_from(OPTIONS), values), max_size=5))]
            case "source":
                path = special_path(folder, draw(st.sampled_from(SPECIAL_FILES)), draw(st.sampled_from((".toml", ""))))
                words = ["validate", str(path)]
            case "folder":
                path = special_path(folder, draw(st.sampled_from(SPECIAL_FILES)))
                words = ["status", str(path)]
            case _:
                words = ["validate", "inspection", "--set", draw(values) + draw(st.sampled_from(("", "=1", "=\n2")))]
        words = [word for word in words if word not in ("-h", "--help")]
        return Case("command line", damage, words[0][:20], lambda: run(folder, [*words, *as_json]))

    return build()


def run(folder: Path, words: list[str]) -> None:
    """Runs a command line and checks how it ends."""
    out, err, before = io.StringIO(), io.StringIO(), sorted(folder.iterdir())
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        status = main(words)
    assert status in (0, 2), f"status {status}"
    assert sorted(folder.iterdir()) == before, "something was written"
    if status == 0:
        return
    lines = err.getvalue().splitlines()
    assert len(lines) == 1, f"{len(lines)} lines: {lines[:2]}"
    assert lines[0].startswith("rpojax: error: "), lines[0][:80]
    line = lines[0].removeprefix("rpojax: error: ")
    assert not line_problem(line), f"{line_problem(line)}: {line[:80]!r}"
    if "--json" in words:
        assert json.loads(out.getvalue()) == {"error": line}, out.getvalue()[:80]
    else:
        assert out.getvalue() == ""
