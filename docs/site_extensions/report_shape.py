"""Keys of report.json with their types, from the reports of real campaigns; writes docs/reference/report_shape.json:

python docs/site_extensions/report_shape.py out/*/report.json
"""

import json
import re
import sys
from pathlib import Path
from typing import Any

FILE = Path(__file__).parents[1] / "reference" / "report_shape.json"
_PAGE = FILE.with_name("campaign_folder.md")
_NAMED = {
    "metrics": "METRIC",
    "convergence.metrics": "METRIC",
    "mission.aborts.by_reason": "REASON",
    "failure_causes[].signs": "METRIC",
    "mission.ends": "END",
    "files": "FILE",
}
"""Objects whose keys are names, and not the same in all reports; in the shape the word stands for any of them."""


def shape(*contents: Any) -> dict[str, str]:
    """Path of every value -> its types, merged over reports; `[]` stands for the entries of a list."""
    found: dict[str, set[str]] = {}
    for content in contents:
        _collect(content, "", found)
    return {path: " or ".join(sorted(types)) for path, types in found.items()}


def _collect(value: Any, path: str, found: dict[str, set[str]]) -> None:
    if isinstance(value, dict) and value:
        for key, inner in value.items():
            name = _NAMED.get(path, str(key))
            _collect(inner, f"{path}.{name}" if path else name, found)
    elif isinstance(value, list) and value:
        for inner in value:
            _collect(inner, f"{path}[]", found)
    else:
        found.setdefault(path, set()).add(_TYPES[type(value)])


_TYPES = {
    int: "whole number", float: "number", str: "text", bool: "true or false", type(None): "null",
    dict: "empty object", list: "empty list",
}  # fmt: skip


def purpose(part: str) -> str:
    """What the page on the campaign folder says of a part of report.json."""
    page = _PAGE.read_text(encoding="utf-8").partition("## `report.json`")[2]
    row = re.search(rf"^\| `{part}` \| (.*) \|$", page, re.MULTILINE)
    return row[1].replace("](#", "](campaign_folder.md#") if row else ""


def main() -> None:
    """Merges the reports that are named on the command line."""
    contents = [json.loads(Path(path).read_text(encoding="utf-8")) for path in sys.argv[1:]]
    order = list(contents[0])
    merged = shape(*contents)
    top = {key: order.index(re.split(r"[.\[]", key)[0]) for key in merged}
    FILE.write_text(json.dumps(dict(sorted(merged.items(), key=lambda each: top[each[0]])), indent=1) + "\n")


if __name__ == "__main__":
    main()
