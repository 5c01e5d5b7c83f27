"""What each command of the command line prints as its help, at a width of 100 columns."""

import contextlib
import io
import os
import re
from collections.abc import Iterator

_FRAMES = re.compile(r"[│╭╮╰╯─]")


def helps() -> Iterator[tuple[str, str]]:
    """The words of each command, such as `field train`, and its help without frames."""
    from rpojax.cli.main import COMMANDS
    from rpojax.cli.options.arguments import Group

    for name, command in COMMANDS.items():
        inner = [f"{name} {each}" for each in command.commands] if isinstance(command, Group) else [name]
        yield from ((words, help_of(words)) for words in inner)


def help_of(words: str) -> str:
    """Help of a command, such as `field train`, without frames."""
    from rpojax.cli import main

    printed = io.StringIO()
    width = os.environ.get("COLUMNS")
    os.environ["COLUMNS"] = "100"
    try:
        with contextlib.redirect_stdout(printed), contextlib.suppress(SystemExit):
            main.main([*words.split(), "--help"])
    finally:
        os.environ.pop("COLUMNS")
        if width is not None:
            os.environ["COLUMNS"] = width
    lines = [_FRAMES.sub("", line).rstrip() for line in printed.getvalue().splitlines()]
    text = re.sub(r"\n{3,}", "\n\n", "\n".join(lines)).strip("\n")
    return re.sub(r"\x1b\[[0-9;]*m", "", text)
