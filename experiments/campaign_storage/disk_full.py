"""A campaign on a disk that fills up: one line, finished blocks intact, and a resume does the rest once there is room.

The disk is a small file system in memory, mounted in a name space of the script's own (`unshare`, no rights needed).

python experiments/campaign_storage/disk_full.py --out out/disk_full
"""

import argparse
import contextlib
import os
import shutil
import subprocess
import sys
import time
from pathlib import Path

import common

SHAPE = (12, 2, "--histories", "9,")


def fill(out: Path) -> int:
    """In the name space: fills the disk while blocks are being done, makes room, resumes, compares."""
    disk = out / "disk"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(disk)], check=True)
    folder, filler = disk / "runs", disk / "filler"
    process = common.start(common.campaign(folder, *SHAPE))
    while not (folder / "manifest" / "000001.json").exists() and process.poll() is None:
        time.sleep(0.01)
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as stream:
        while stream.write(bytes(4096)):
            pass
    print(process.communicate()[1].strip().splitlines()[-1])
    kept = len(list((folder / "manifest").glob("*.json")))
    print(f"exit status {process.returncode}; blocks kept: {kept} of 6", flush=True)
    filler.unlink()
    resumed = common.start(common.command("resume", folder))
    resumed.communicate()
    unequal = common.different(out / "whole", folder)
    left = common.partial_files(folder)
    print(f"resume with room: exit status {resumed.returncode}; partial files {left}; arrays not equal: {len(unequal)}")
    subprocess.run(["umount", str(disk)], check=True)
    return int(process.returncode != 4 or resumed.returncode != 0 or bool(unequal))


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--inside", action="store_true", help="used by the script itself")
    options = parser.parse_args()
    if options.inside:
        return fill(options.out)
    shutil.rmtree(options.out, ignore_errors=True)
    (options.out / "disk").mkdir(parents=True)
    common.start(common.campaign(options.out / "whole", *SHAPE)).communicate()
    here = ["unshare", "--map-root-user", "--mount", sys.executable, __file__, "--out", str(options.out)]
    return subprocess.run([*here, "--inside"], env=os.environ, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
