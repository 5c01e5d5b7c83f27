"""Builds the documentation site, with warnings as errors and without the network, from current pages:

python docs/build.py --out out/site

The files of the gallery (a report, a PDF, a film, a recording) are made first if they are not there: some minutes, with
Chromium. `--without-gallery` builds the pages alone, in a minute.
"""

import argparse
import subprocess
import sys
from pathlib import Path

ROOT = Path(__file__).parents[1]
MADE = ROOT / "docs" / "made"
FILES = ("report.html", "brief.html", "brief.pdf", "film.mp4", "run.rrd")


def main() -> int:
    """Makes what is missing and builds; returns the exit status of Sphinx."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "out" / "site", help="folder of the site")
    parser.add_argument("--without-gallery", action="store_true", help="no files of the gallery")
    arguments = parser.parse_args()
    if not arguments.without_gallery and not all((MADE / name).exists() for name in FILES):
        made = subprocess.run([sys.executable, ROOT / "docs" / "make_gallery.py", "files", "--out", MADE], check=False)
        if made.returncode:
            return made.returncode
    current = subprocess.run([sys.executable, ROOT / "docs" / "write_reference.py", "--check"], check=False)
    if current.returncode:
        return current.returncode
    options = ["-D", "gallery_files="] if arguments.without_gallery else []
    command = [
        sys.executable,
        "-m",
        "sphinx",
        "-q",
        "-W",
        "--keep-going",
        "-c",
        ROOT / "docs",
        *options,
        ROOT,
        arguments.out,
    ]
    status = subprocess.run(command, check=False).returncode
    if status == 0:
        print(f"site: {arguments.out / 'index.html'}")
    return status


if __name__ == "__main__":
    sys.exit(main())
