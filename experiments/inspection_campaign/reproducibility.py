"""Differences of one run between campaigns of other sizes, block sizes and devices; prints a Markdown table.

python experiments/inspection_campaign/reproducibility.py
"""

import os
import tempfile
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=2")

import jax
import numpy as np

import rpojax
from rpojax.campaign.storage.campaign_folder import Campaign

RUN = 17


def metrics_of(result: Campaign) -> dict[str, float]:
    place = int(np.flatnonzero(result.run_ids == RUN)[0])
    return {name: float(values[place]) for name, values in result.metrics.items()}


def largest_difference(a: dict[str, float], b: dict[str, float]) -> float:
    """Largest relative difference of any metric."""
    return max(abs(a[name] - b[name]) / max(abs(a[name]), 1e-12) for name in a if np.isfinite(a[name]))


def main() -> None:
    file = rpojax.load("inspection")
    devices = jax.devices()
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder)
        reference = metrics_of(rpojax.run_campaign(file, 500, out / "500", seed=0, histories=[]))
        others = {
            "in a batch of 64, recorded block size": rpojax.run_campaign(file, 64, out / "64", seed=0, histories=[]),
            "alone, recorded block size": rpojax.run_campaign(file, 1, out / "1", seed=0, first_run=RUN, histories=[]),
            "one device instead of two": rpojax.run_campaign(file, 64, out / "d1", histories=[], devices=devices[:1]),
            "alone, block size 1": rpojax.run_campaign(
                file, 1, out / "b1", seed=0, first_run=RUN, block_size=1, histories=[]
            ),
        }
        print(f"run {RUN} of `inspection`, against the same run in a campaign of 500 on {len(devices)} devices")
        print("| case | largest relative difference of any metric |\n|---|---|")
        for name, result in others.items():
            difference = largest_difference(reference, metrics_of(result))
            print(f"| {name} | {'bit-equal' if difference == 0.0 else f'{difference:.1e}'} |", flush=True)


if __name__ == "__main__":
    main()
