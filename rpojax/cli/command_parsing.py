"""Parsing of a command line into a call, with usage errors of one line."""

import contextlib
import difflib
import functools
import io
from collections.abc import Mapping, Sequence

import tyro
from tyro.conf import FlagCreatePairsOff, SuppressFixed

from rpojax.cli.options.arguments import Command, Group
from rpojax.errors import RpojaxError
from rpojax.printable_text import cut

_EDGES = "│| "
_CORNERS = ("╭", "╰", "+-")
_FRAME = _EDGES + "─-"
_LEFT_OUT = ("For full helptext", "Argument helptext")


class UsageError(RpojaxError):
    """A command line cannot be understood."""


def parse(commands: Mapping[str, type[Command] | Group], words: Sequence[str], description: str) -> Command:
    """Options of the command that a command line names.

    Args:
        commands: by name
        words: of the command line
        description: first part of the help

    Raises:
        UsageError: there is no such command, or an option cannot be understood.
        SystemExit: the help was printed.
    """
    _check_names(words, commands)
    app = tyro.extras.SubcommandApp()
    for name, each in commands.items():
        if isinstance(each, Group):
            inner = tyro.extras.SubcommandApp()
            for inner_name, command in each.commands.items():
                inner.command(name=inner_name)(command)
            app.command(inner, name=name, help=each.help)
        else:
            app.command(name=name)(each)
    parsed = functools.partial(
        app.cli, prog="rpojax", description=description, args=words, config=(FlagCreatePairsOff, SuppressFixed)
    )
    if {"--help", "-h"} & set(words):
        return parsed()
    printed = io.StringIO()
    try:
        with contextlib.redirect_stdout(printed), contextlib.redirect_stderr(printed):
            return parsed()
    except SystemExit:
        command = " ".join(["rpojax", *(word for word in words[:1] if word in commands)])
        raise UsageError(f"{_one_line(printed.getvalue())}; see {command} --help") from None


def _check_names(words: Sequence[str], commands: Mapping[str, type[Command] | Group]) -> None:
    """Refuses a command that does not exist, with the nearest one that does."""
    if not words or words[0].startswith("-"):
        return
    _check_name(words[0], list(commands), "command")
    group = commands[words[0]]
    if isinstance(group, Group) and len(words) > 1 and not words[1].startswith("-"):
        _check_name(words[1], list(group.commands), f"command of {words[0]}")


def _check_name(word: str, known: Sequence[str], what: str) -> None:
    if word in known:
        return
    near = difflib.get_close_matches(word[:40], known, n=1, cutoff=0.0)
    raise UsageError(f"{cut(word, 80)}: unknown {what}, did you mean {near[0]!r}?")


def _one_line(text: str) -> str:
    """Sentences in the frame that the parser prints, in one line."""
    parts: list[list[str]] = [[]]
    for line in text.splitlines():
        if line.startswith(_CORNERS):
            continue
        if line.strip(_FRAME):
            parts[-1].append(line.strip(_EDGES))
        else:
            parts.append([])
    sentences = [" ".join(part) for part in parts if part]
    return "; ".join(each for each in sentences if not each.startswith(_LEFT_OUT)) or "found no command"
