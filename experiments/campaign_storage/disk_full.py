"""A campaign on a disk that fills up: one line, finished blocks intact, and a resume does the rest once there is room.

The disk is a small file system in memory, mounted in a name space of the script's own (`unshare`, no rights needed).

python experiments/campaign_storage/disk_full.py --out out/disk_full
"""

import argparse
import os
import shutil
import subprocess
import sys
from pathlib import Path

import common

SHAPE = (12, 2, "--histories", "9,")


def fill(out: Path, size: str) -> int:
    """In the name space: fills the disk, makes it larger, resumes, compares."""
    disk = out / "disk"
    subprocess.run(["mount", "-t", "tmpfs", "-o", f"size={size}", "tmpfs", str(disk)], check=True)
    folder = disk / "runs"
    process = common.start(common.campaign(folder, *SHAPE))
    print(f"disk of {size}: {process.communicate()[1].strip().splitlines()[-1]}")
    kept = len(list((folder / "manifest").glob("*.json")))
    found = "there" if folder.exists() else "not there"
    print(f"exit status {process.returncode}; folder {found}, blocks kept: {kept} of 6", flush=True)
    subprocess.run(["mount", "-o", "remount,size=100m", str(disk)], check=True)
    words = common.command("resume", folder) if folder.exists() else common.campaign(folder, *SHAPE)
    again = common.start(words)
    again.communicate()
    unequal = common.different(out / "whole", folder)
    left = common.partial_files(folder)
    print(f"again with room: exit status {again.returncode}; partial files {left}; arrays not equal: {len(unequal)}")
    subprocess.run(["umount", str(disk)], check=True)
    return int(process.returncode not in (2, 4) or again.returncode != 0 or bool(unequal))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--inside", help="size of the disk; used by the script itself")
    options = parser.parse_args()
    if options.inside:
        return fill(options.out, options.inside)
    shutil.rmtree(options.out, ignore_errors=True)
    (options.out / "disk").mkdir(parents=True)
    common.start(common.campaign(options.out / "whole", *SHAPE)).communicate()
    here = ["unshare", "--map-root-user", "--mount", sys.executable, __file__, "--out", str(options.out)]
    sizes = ("1500k", "20k")
    return max(subprocess.run([*here, "--inside", size], env=os.environ, check=False).returncode for size in sizes)


if __name__ == "__main__":
    raise SystemExit(main())
