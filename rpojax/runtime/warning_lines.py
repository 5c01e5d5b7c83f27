"""Warnings of one category as plain lines on stderr, for commands."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager


def silence_libraries() -> None:
    """Ignores warnings and logs of libraries, which are for programmers, unless the user asks Python for warnings."""
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        # Without any handler Python prints logs on stderr.
        logging.getLogger().addHandler(logging.NullHandler())


@contextmanager
def warnings_as_lines(category: type[Warning]) -> Iterator[None]:
    """Shows every warning of a category in the body as a line on stderr; others are shown as ever."""
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always", category)
        yield
    for each in caught:
        if issubclass(each.category, category):
            print(f"rpojax: {each.message}", file=sys.stderr)
        else:
            warnings.warn_explicit(each.message, each.category, each.filename, each.lineno)
