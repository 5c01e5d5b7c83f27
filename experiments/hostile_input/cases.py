"""Runs many generated hostile cases in this process and counts how they end, by class.

The exit status is 0 if every case was accepted or refused in one line of the package's own errors, within 5 s of
processor time and 1 GiB of memory.
"""

import argparse
import os
import sys
import tempfile
import time
import warnings
from pathlib import Path

TESTS = Path(__file__).parents[2] / "tests"


def main() -> int:
    """Runs the cases and writes the table of their ends."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--cases", type=int, default=100_000)
    parser.add_argument("--seed", type=int, default=1000)
    parser.add_argument("--out", type=Path, required=True, help="text file for the table")
    found = parser.parse_args()
    out = found.out.absolute()
    sys.path[:0] = [str(TESTS), str(TESTS / "hostile")]
    warnings.simplefilter("ignore")
    from hostile_classes import run_all  # pyright: ignore[reportMissingImports]

    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        os.chdir(folder)
        ledger = run_all(found.cases, Path(folder), found.seed)
        os.chdir("/")
    spent = time.process_time() - began
    lines = [*ledger.lines(), "", *ledger.coverage(), ""]
    lines.append(f"{ledger.total} cases in {spent:.0f} s of processor time, {len(ledger.faults)} faults")
    out.write_text("\n".join([*lines, *ledger.faults]) + "\n")
    print("\n".join([*lines, *ledger.faults[:50]]))
    return 1 if ledger.faults else 0


if __name__ == "__main__":
    sys.exit(main())
