"""Tables of a terminal in which no number is ever cut: names are shortened, and a column is left out with a word."""

from collections.abc import Sequence

from rich.cells import cell_len
from rich.console import Console
from rich.table import Table
from rich.text import Text

_LEAST_NAME = 16
"""Characters of names below which a column is left out rather than names shortened further."""

Row = Sequence[str | Text]


def print_table(
    console: Console,
    headings: Sequence[str],
    rows: Sequence[Row],
    *,
    title: str = "",
    words: Sequence[str] = (),
    optional: Sequence[str] = (),
    boxed: bool = True,
) -> None:
    """Prints a table whose first column has names, within the width of the terminal if numbers have place in it.

    Args:
        console: to print on
        headings: of the columns
        rows: cells of each row, in the order of the headings
        title: above the table
        words: headings of further columns of words, which begin at the left as names do
        optional: headings of columns to leave out where the rest has no place, the first one first
        boxed: whether columns have lines between them
    """
    names, widths = _fitted(console.width, headings, rows, boxed)
    if names is None and optional:
        shown = [i for i, heading in enumerate(headings) if heading != optional[0]]
        kept = [[row[i] for i in shown] for row in rows]
        narrower, less = [headings[i] for i in shown], optional[1:]
        print_table(console, narrower, kept, title=title, words=words, optional=less, boxed=boxed)
        console.print(f"no place for the column {optional[0]}, which --json has", soft_wrap=True, markup=False)
        return
    table = Table(title=Text(title) if title else None, title_justify="center" if boxed else "left")
    if not boxed:
        table.box, table.padding = None, (0, 1, 0, 0)
    for heading, width in zip(headings, widths, strict=True):
        is_left = heading in (headings[0], *words)
        table.add_column(Text(heading), width=width, justify="left" if is_left else "right", overflow="fold")
    for row, name in zip(rows, names or [str(row[0]) for row in rows], strict=True):
        table.add_row(Text(name), *(Text(cell) if isinstance(cell, str) else cell for cell in row[1:]))
    # A line that is too long for the terminal is continued there, in place of a number that is cut.
    wide = Console(
        file=console.file, highlight=False, width=max(console.width, sum(widths) + _between(len(widths), boxed))
    )
    (console if wide.width == console.width else wide).print(table)


def _between(columns: int, boxed: bool) -> int:
    """Characters of a line beside its cells."""
    return 3 * columns + 1 if boxed else columns


def _fitted(
    width: int, headings: Sequence[str], rows: Sequence[Row], boxed: bool
) -> tuple[list[str] | None, list[int]]:
    """Names as they have place, None if they have not, and widths of the columns, headings on one line if possible."""
    cells = [[cell_len(str(row[i])) for row in rows] for i in range(len(headings))]
    place = width - _between(len(headings), boxed)
    for words in ([[heading] for heading in headings], [heading.split() for heading in headings]):
        widths = [max([*map(cell_len, part), *column]) for part, column in zip(words, cells, strict=True)]
        if sum(widths) <= place:
            return [str(row[0]) for row in rows], widths
    rest = place - sum(widths[1:])
    names = [shortened(str(row[0]), rest) for row in rows] if rest >= _LEAST_NAME else []
    if not names or len(set(names)) < len({str(row[0]) for row in rows}):
        return None, widths
    return names, [rest, *widths[1:]]


def shortened(name: str, length: int) -> str:
    """A name without its middle, so that it is no longer than `length` characters."""
    if len(name) <= length:
        return name
    end = (length - 1) // 2
    return f"{name[: length - 1 - end]}\N{HORIZONTAL ELLIPSIS}{name[len(name) - end :]}"
