"""Warnings as plain lines on stderr, for commands."""

import logging
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

from rpojax.errors import Notice


def silence_libraries() -> None:
    """Ignores warnings and logs of libraries, which are for programmers, unless the user asks Python for warnings.

    Notices are shown, each as a line.
    """
    if not sys.warnoptions:
        warnings.simplefilter("ignore")
        warnings.simplefilter("always", Notice)
        show_others = warnings.showwarning

        def show(message: Warning | str, category: type[Warning], *where: Any, **further: Any) -> None:
            if issubclass(category, Notice):
                print(f"rpojax: {message}", file=sys.stderr)
            else:
                show_others(message, category, *where, **further)

        warnings.showwarning = show
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
