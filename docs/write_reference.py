"""Writes the parts of the reference that come from the code into the committed pages:

python docs/write_reference.py

metrics, scenario keys, packaged scenarios and the Python interface. `--check` writes nothing, and fails if a page is
not current; the build of the site does so, too.
"""

import argparse
import sys
from pathlib import Path

sys.path[:0] = [str(Path(__file__).parents[1]), str(Path(__file__).parent)]

from site_extensions import written_reference  # noqa: E402


def main() -> int:
    """Writes or checks the pages; returns the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--check", action="store_true", help="write nothing, and fail if a page is not current")
    arguments = parser.parse_args()
    stale = [name for name in written_reference.PARTS if not written_reference.is_current(name)]
    for name in stale:
        if arguments.check:
            print(f"docs/reference/{name}: not current, run: python docs/write_reference.py", file=sys.stderr)
        else:
            (written_reference.FOLDER / name).write_text(written_reference.page(name), encoding="utf-8", newline="\n")
            print(f"written: docs/reference/{name}")
    return int(arguments.check and bool(stale))


if __name__ == "__main__":
    sys.exit(main())
