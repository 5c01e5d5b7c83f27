"""Captures of a rendered campaign beside those of a statistical one: quantiles, and whether both can be of one law."""

import argparse
from pathlib import Path

import numpy as np
from scipy.stats import fisher_exact, ks_2samp

import rpojax

METRICS = (
    "capture_lateral_m",
    "capture_angle_deg",
    "capture_speed_m_s",
    "docking_axis_error_deg",
    "target_attitude_error_deg",
    "nees_pose_mean",
    "nees_relative_mean",
    "nav_relative_position_error_rms_m",
)


def main() -> None:
    """Prints a row for each metric."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("rendered", type=Path)
    parser.add_argument("statistical", type=Path)
    asked = parser.parse_args()
    rendered, statistical = (rpojax.open_campaign(folder) for folder in (asked.rendered, asked.statistical))
    print(f"{'metric':36s} runs        median              95 %                within  Kolmogorov-Smirnov p")
    for name in METRICS:
        one, other = (np.asarray(each[name], dtype=float) for each in (rendered, statistical))
        one, other = one[np.isfinite(one)], other[np.isfinite(other)]
        within = np.mean((one >= other.min()) & (one <= other.max()))
        middle = f"{np.median(one):.3g}, {np.median(other):.3g}"
        tail = f"{np.quantile(one, 0.95):.3g}, {np.quantile(other, 0.95):.3g}"
        p = float(np.asarray(ks_2samp(one, other))[1])
        print(f"{name:36s} {len(one):3d}, {len(other):4d}   {middle:18s}  {tail:18s}  {within:5.2f}   {p:.3f}")
    came = [np.isfinite(np.asarray(each[METRICS[0]], dtype=float)) for each in (rendered, statistical)]
    table = [[int(each.sum()), int((~each).sum())] for each in came]
    shares = [f"{row[0]} of {sum(row)}" for row in table]
    print(f"came to the port: {shares[0]}, {shares[1]}, p {float(np.asarray(fisher_exact(table))[1]):.3f}")


if __name__ == "__main__":
    main()
