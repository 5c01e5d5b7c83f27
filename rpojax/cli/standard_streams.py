"""Standard streams of the process: present, able to print any text, and silent where their reader has gone."""

import io
import json
import os
import re
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, Final

from rpojax.errors import RpojaxError
from rpojax.printable_text import escape_lines, printable

_SEQUENCE: Final = re.compile("(\x1b\\[[0-9;?]*[A-Za-z])")


def prepare_streams() -> None:
    """Begins a command: closed streams lead to the null device, letters that cannot be encoded become escapes."""
    _Documents.printed = 0
    for number, name in enumerate(("stdin", "stdout", "stderr")):
        try:
            os.fstat(number)
        except OSError:
            # Otherwise the next file that is opened would be the standard stream.
            os.open(os.devnull, os.O_RDWR)
            stream = os.fdopen(number, "r" if number == 0 else "w", closefd=False)
            setattr(sys, name, stream)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="backslashreplace")


class PrintableStream:
    """A stream on which control and direction characters of printed texts appear as escapes.

    On a terminal the sequences by which tables are coloured and bars are moved pass.
    """

    def __init__(self, stream: Any) -> None:
        self._stream = stream
        self._is_terminal = bool(stream.isatty())

    def write(self, text: str) -> int:
        """Writes a text, of which what a terminal would act on is escaped."""
        parts = _SEQUENCE.split(text) if self._is_terminal else [text]
        # Parts of odd index are the sequences. All at once, so that a line that is drawn again does not flicker.
        self._stream.write("".join(part if index % 2 else escape_lines(part) for index, part in enumerate(parts)))
        return len(text)

    def __getattr__(self, name: str) -> Any:
        """Everything else is that of the stream."""
        return getattr(self._stream, name)


@contextmanager
def printable_streams() -> Iterator[None]:
    """Standard output and standard error show the texts of users as `PrintableStream` does, in the body."""
    before = sys.stdout, sys.stderr
    sys.stdout, sys.stderr = PrintableStream(before[0]), PrintableStream(before[1])
    try:
        yield
    finally:
        sys.stdout, sys.stderr = before


def silence_output() -> None:
    """Leads standard output to the null device, so that what is buffered does not fail again at exit."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 1)


class OutputFailure(RpojaxError):
    """Standard output cannot be written to."""


def flush_output() -> None:
    """Writes what is buffered for standard output.

    Raises:
        BrokenPipeError: its reader has gone.
        OutputFailure: it cannot be written.
    """
    try:
        sys.stdout.flush()
    except BrokenPipeError:
        raise
    except OSError as error:
        raise output_failure(error) from None


def output_failure(error: OSError) -> OutputFailure:
    """Error of a command whose output cannot be written."""
    reason = (error.strerror or str(error)).lower()
    return OutputFailure(f"standard output: found {reason}, expected room for what is printed; files are written")


class _Documents:
    """How many documents in JSON were printed: there is one, be it the result or the error."""

    printed = 0


def print_json(content: object) -> None:
    """Prints a result in JSON on stdout."""
    print(json.dumps(content, indent=2, allow_nan=False))
    _Documents.printed += 1


def print_problem(kind: str, text: str, as_json: bool) -> None:
    """Prints a line on stderr, and with `as_json` also `{"error": ...}` on stdout if no result was printed there."""
    line = printable(text)
    print(f"rpojax: {kind}: {line}" if kind else f"rpojax: {line}", file=sys.stderr)
    if as_json and not _Documents.printed:
        print(json.dumps({"error": line}))
