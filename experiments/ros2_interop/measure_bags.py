"""Bags of a run with images: time for replay, rendering and writing, size, and whether two bags are equal.

python experiments/ros2_interop/measure_bags.py --out out/bags
python experiments/ros2_interop/measure_bags.py --out out/bags --campaign out/inspection --run-id 3
"""

import argparse
import hashlib
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TypeVar

import numpy as np

import rpojax
from rpojax.campaign.options.campaign_options import CampaignOptions
from rpojax.campaign.options.history_retention import Retention
from rpojax.campaign.storage import folder_creation
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.campaign.storage.provenance import new_configuration
from rpojax.interop import run_replay
from rpojax.interop.ros2 import mcap_or_sqlite3_writer, message_values, run_bag
from rpojax.interop.ros2.mcap_or_sqlite3_writer import BagFormat
from rpojax.interop.ros2.message_values import RosTickValues
from rpojax.interop.ros2.run_bag import ImageStorage
from rpojax.interop.run_replay import ReplayedRun

T = TypeVar("T")
LONGEST_S = 10.0


@dataclass(frozen=True)
class Duration:
    """Elapsed and processor time [s]."""

    wall_s: float
    cpu_s: float

    def __str__(self) -> str:
        return f"{self.wall_s:.1f} s ({self.cpu_s:.1f} s CPU)"


def timed(work: Callable[[], T]) -> tuple[T, Duration]:
    """Result of `work` and its duration."""
    wall, cpu = time.perf_counter(), time.process_time()
    result = work()
    return result, Duration(time.perf_counter() - wall, time.process_time() - cpu)


def empty_campaign(out: Path, duration_s: float) -> Campaign:
    """A campaign with a rendered camera without any results; an export simulates its run itself."""
    file = rpojax.load("inspection", ["camera.model=rendered", f"duration_s={duration_s}"])
    options = CampaignOptions(8, block_size=1, histories=Retention("none"))
    folder_creation.create_folder(out, new_configuration(file, options), force=True)
    return Campaign(out)


def digest(bag: Path) -> str:
    """Hash of the names and bytes of all files of a bag."""
    sums = [f"{path.name} {hashlib.sha256(path.read_bytes()).hexdigest()}" for path in sorted(bag.iterdir())]
    return hashlib.sha256("\n".join(sums).encode()).hexdigest()


def write_bag(
    run: ReplayedRun[RosTickValues], pictures: list[np.ndarray], out: Path, form: BagFormat, images: ImageStorage
) -> int:
    """Writes a bag; returns the number of messages."""
    messages = run_bag.run_messages(run, images, pictures)
    return mcap_or_sqlite3_writer.write_bag(
        out, form, run_bag.bag_topics(images), messages, run_bag.provenance(run), force=True
    )


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--campaign", type=Path)
    parser.add_argument("--run-id", type=int, default=0)
    parser.add_argument("--duration-s", type=float, default=3000.0)
    options = parser.parse_args()
    found = Campaign(options.campaign) if options.campaign else empty_campaign(options.out / "runs", options.duration_s)

    run, took = timed(lambda: run_replay.replay_servicers(found, options.run_id, message_values.observe_tick)[0])
    agreement = run_replay.compare_with_campaign(run, found)
    print(f"{run.ticks} ticks replayed in {took}, compiling included; {agreement}", flush=True)
    rendered = run.file.camera.model == "rendered"
    pictures, took = timed(lambda: list(run_bag.bag_images(run)) if rendered else [])
    print(f"{len(pictures)} images rendered in {took}, compiling included", flush=True)

    holds = True
    print("| format | images | messages | size [MB] | written in | written again | same bytes |")
    print("|---|---|---|---|---|---|---|")
    for form in BagFormat:
        for images in ImageStorage if rendered else (ImageStorage.NONE,):
            places = [options.out / order / "bag" for order in ("first", "second")]
            results = [timed(partial(write_bag, run, pictures, place, form, images)) for place in places]
            (count, first), (_, second) = results
            size = sum(path.stat().st_size for path in places[0].iterdir())
            equal = digest(places[0]) == digest(places[1])
            holds &= equal and min(first.wall_s, second.wall_s) <= LONGEST_S
            cells = form.value, images.value, count, f"{size / 1e6:.1f}", first, second, "yes" if equal else "**no**"
            print(f"| {' | '.join(map(str, cells))} |", flush=True)
    return 0 if holds else 1


if __name__ == "__main__":
    sys.exit(main())
