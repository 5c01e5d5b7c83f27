"""Short descriptions of results, which consoles show as lines of text and notebooks as a table."""

import html
from dataclasses import dataclass, field

from rpojax.printable_text import printable


@dataclass(frozen=True)
class Summary:
    """What a reader asks first of a result.

    Attributes:
        title: one line
        rows: name and value of each further line; equal names in a row are shown once
    """

    title: str
    rows: list[tuple[str, str]] = field(default_factory=list)

    @property
    def text(self) -> str:
        """Lines of text: the title, then names and values in two columns."""
        width = max((len(name) for name, _ in self.rows), default=0)
        lines = [f"  {name:<{width}}  {printable(value)}" for name, value in self._named_once()]
        return "\n".join([printable(self.title), *lines])

    @property
    def html(self) -> str:
        """A table of HTML without scripts and styles of its own but the alignment."""
        rows = "".join(
            f'<tr><th style="text-align:left">{html.escape(name)}</th>'
            f'<td style="text-align:left">{html.escape(printable(value))}</td></tr>'
            for name, value in self._named_once()
        )
        caption = f"<div><strong>{html.escape(printable(self.title))}</strong></div>"
        return f"<div>{caption}<table>{rows}</table></div>" if rows else f"<div>{caption}</div>"

    def _named_once(self) -> list[tuple[str, str]]:
        """Rows, of which those with the name of the one before have an empty one."""
        before = ["", *(name for name, _ in self.rows)]
        return [("" if name == last else name, value) for (name, value), last in zip(self.rows, before, strict=False)]


class Summarised:
    """A result that consoles and notebooks show by its summary."""

    def _summary(self) -> Summary:
        """What a reader asks first."""
        raise NotImplementedError

    def __repr__(self) -> str:
        return self._summary().text

    def __str__(self) -> str:
        return self._summary().text

    def _repr_html_(self) -> str:
        """Table for a notebook."""
        return self._summary().html


def number(value: float | None) -> str:
    """A number with four significant digits, a dash where there is none."""
    return "\N{EN DASH}" if value is None or value != value else f"{value:.4g}"


def numbers(values: object) -> str:
    """A number, or a list of numbers, with four significant digits each; other values as they are."""
    if isinstance(values, list | tuple):
        return f"[{', '.join(map(numbers, values))}]"
    return number(values) if isinstance(values, float | int) and not isinstance(values, bool) else str(values)


def counted(count: int, noun: str) -> str:
    """A count with its noun in singular or plural."""
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
