"""Campaign on a disk that fills up, resumed once there is room, compared with an uninterrupted campaign.

The disk is a small file system in memory, mounted in a namespace of the script (`unshare`, without privileges).

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

import campaign_processes as processes

SHAPE = (12, 2, "--histories", "9,")


def fill(out: Path) -> int:
    """Runs in the namespace: fills the disk during a campaign, makes room, resumes, compares."""
    disk = out / "disk"
    subprocess.run(["mount", "-t", "tmpfs", "-o", "size=32m", "tmpfs", str(disk)], check=True)
    folder, filler = disk / "runs", disk / "filler"
    process = processes.start(processes.campaign(folder, *SHAPE))
    while not (folder / "manifest" / "000001.json").exists() and process.poll() is None:
        time.sleep(0.01)
    with contextlib.suppress(OSError), filler.open("wb", buffering=0) as stream:
        while stream.write(bytes(4096)):
            pass
    print(process.communicate()[1].strip().splitlines()[-1])
    kept = len(list((folder / "manifest").glob("*.json")))
    print(f"exit status {process.returncode}; blocks kept: {kept} of 6", flush=True)
    filler.unlink()
    resumed = processes.start(processes.command("resume", folder))
    resumed.communicate()
    unequal = processes.different(out / "reference", folder)
    left = processes.partial_files(folder)
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
    processes.start(processes.campaign(options.out / "reference", *SHAPE)).communicate()
    command = ["unshare", "--map-root-user", "--mount", sys.executable, __file__, "--out", str(options.out)]
    return subprocess.run([*command, "--inside"], env=os.environ, check=False).returncode


if __name__ == "__main__":
    raise SystemExit(main())
