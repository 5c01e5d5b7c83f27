"""Effect of an offset between the centre of the target's outline and its centre of mass; prints one Markdown table.

python experiments/inspection_campaign/outline_offset.py [--runs 256]
"""

import argparse
import os
import tempfile
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax

OFFSETS_M = (0.0, 0.03)
FILTER_SIGMAS_M = (0.005, 0.02)


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=256)
    runs = parser.parse_args().runs
    print("| offset | `navigation.center_sigma_m` | formation error RMS, median | NEES / 12 | 3-sigma coverage |")
    print("|---|---|---|---|---|")
    hull = np.array(rpojax.load("inspection").target.hull_m)
    for offset in OFFSETS_M:
        moved = (hull + np.array([offset, 0.0, 0.0])).round(6).tolist()
        for sigma in FILTER_SIGMAS_M:
            file = rpojax.load("inspection", [f"target.hull_m={moved}", f"navigation.center_sigma_m={sigma}"])
            with tempfile.TemporaryDirectory() as folder:
                metrics = rpojax.run_campaign(file, runs, Path(folder) / "out", seed=0, histories=[]).metrics
            formation = np.nanmedian(metrics["formation_error_rms_m"])
            nees = np.nanmean(metrics["nees_mean"]) / 12.0
            coverage = 100.0 * np.nanmean(metrics["sigma3_coverage"])
            figures = f"{formation:.2f} m | {nees:.2f} | {coverage:.1f} %"
            print(f"| {100 * offset:.0f} cm | {sigma} | {figures} |", flush=True)


if __name__ == "__main__":
    main()
