"""Pages of the reference with parts that are written from the code and committed, so that they read without a build.

`python docs/write_reference.py` writes them. A part is between two comments of HTML, which name it.
"""

from collections.abc import Callable, Iterable
from pathlib import Path

from site_extensions import key_table, metric_table, packaged_table, public_names

FOLDER = Path(__file__).parents[1] / "reference"
PARTS: dict[str, Callable[[], Iterable[str]]] = {
    "api.md": public_names.lines,
    "metrics.md": metric_table.lines,
    "packaged_scenarios.md": packaged_table.lines,
    "scenario_keys.md": key_table.lines,
}
"""Page -> lines of Markdown of its written part."""
_BEGIN = "<!-- written by docs/write_reference.py, from here -->"
_END = "<!-- to here -->"


def page(name: str) -> str:
    """Text of a page as it is with its part written anew."""
    before, _, rest = (FOLDER / name).read_text(encoding="utf-8").partition(_BEGIN)
    _, end, after = rest.partition(_END)
    assert end, f"{name}: no comment ends the written part"
    body = "\n".join(PARTS[name]()).strip("\n")
    return f"{before}{_BEGIN}\n\n{body}\n\n{_END}{after}"


def is_current(name: str) -> bool:
    """Whether a page has what the code says now."""
    return (FOLDER / name).read_text(encoding="utf-8") == page(name)
