"""All figures of one accelerator in one sitting of at most eight minutes.

python -m benchmarks.accelerator [--out FILE] [--json]
"""

import argparse
import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from benchmarks.accelerator import result_table, sitting
from benchmarks.accelerator.section_list import SECTIONS
from benchmarks.accelerator.sitting import Sitting
from benchmarks.exit_statuses import exit_status
from rpojax.cli import output_paths
from rpojax.cli.exit_status import Status
from rpojax.errors import RpojaxError


def main(argv: Sequence[str] | None = None) -> int:
    """Exit status: 0, 2 for a bad option, 3 if a section failed."""
    return exit_status("accelerator", lambda: measure(parse_options(argv)))


def parse_options(argv: Sequence[str] | None = None) -> argparse.Namespace:
    """Checked command-line options.

    Raises:
        RpojaxError: a value is out of range, or the file exists.
    """
    names = [section.name for section in SECTIONS]
    parser = argparse.ArgumentParser(
        prog="python -m benchmarks.accelerator", description=(__doc__ or "").partition("\n")[0]
    )
    parser.add_argument("--out", type=Path, metavar="FILE", help="write all figures to a new JSON file as they come")
    parser.add_argument("--json", action="store_true", help="print JSON in place of the table")
    parser.add_argument("--budget-s", type=float, default=480.0, metavar="T", help="wall-clock time [s] (default: 480)")
    parser.add_argument("--small", action="store_true", help="small sizes, as on a CPU")
    parser.add_argument("--only", nargs="+", choices=names, default=names, metavar="SECTION", help=", ".join(names))
    options = parser.parse_args(argv)
    if not options.budget_s > 0.0:
        raise RpojaxError(f"--budget-s: found {options.budget_s:g}, expected a time above 0")
    if options.out is not None:
        if options.out.exists():
            raise RpojaxError(f"--out: found {options.out}, expected a file that does not exist yet")
        output_paths.claim(options.out, force=False)
    return options


def measure(options: argparse.Namespace) -> int:
    """Runs the sections, keeps the file up to date and prints the results."""

    def on_change(content: dict[str, Any]) -> None:
        if options.out is not None:
            write(options.out, content)
        latest = content["sections"][-1]
        state = latest["status"] or f"{len(latest['entries'])} entries"
        print(f"accelerator: {content['elapsed_s']:.0f} s, {latest['name']}: {state}", file=sys.stderr, flush=True)

    wanted = [section for section in SECTIONS if section.name in options.only]
    content = Sitting(options.budget_s, on_change, sitting.run_in_process).run(wanted, options.small)
    if options.out is not None:
        write(options.out, content)
    if options.json:
        print(json.dumps(content, indent=2, allow_nan=False))
    else:
        from rich.console import Console

        Console(highlight=False).print(result_table.table(content))
    statuses = [content["platform"].get("status", ""), *(section["status"] for section in content["sections"])]
    return Status.SOME_FAILED if any(status.startswith("failed") for status in statuses) else Status.DONE


def write(path: Path, content: dict[str, Any]) -> None:
    """Writes the results so far, whole or not at all."""
    path.parent.mkdir(parents=True, exist_ok=True)
    partial = path.with_name(f"{path.name}.part")
    partial.write_text(json.dumps(content, indent=2, allow_nan=False) + "\n", encoding="utf-8")
    partial.replace(path)


if __name__ == "__main__":
    sys.exit(main())
