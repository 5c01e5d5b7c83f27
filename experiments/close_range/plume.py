"""Plumes of the twelve thrusters on the target: impulse, and how far its rotation differs from that without them.

python experiments/close_range/plume.py --out DIR [--scenario final_approach] [--runs 32] [--seed 0]

Every run is simulated with and without the plume, from the same random numbers.
"""

import argparse
import sys
from pathlib import Path

import numpy as np

import rpojax


def main() -> int:
    """Simulates both campaigns and prints what their runs show."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--scenario", default="final_approach")
    parser.add_argument("--runs", type=int, default=32)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    rpojax.prepare_process()
    found = {
        name: rpojax.run_campaign(
            rpojax.load(options.scenario, [f"effects.plume={name}"]),
            runs=options.runs,
            out=options.out / name,
            seed=options.seed,
            histories="all",
        )
        for name in ("true", "false")
    }
    _print_impulse(found["true"])
    with_plume, without = (np.stack([_last_rate(each, run) for run in range(options.runs)]) for each in found.values())
    _print("size of the target's rate, change by the plume [mdeg/s]", 1e3 * (_size(with_plume) - _size(without)))
    _print("vector of the target's rate, size of the change [mdeg/s]", 1e3 * _size(with_plume - without))
    for metric in ("final_lateral_error_m", "final_range_error_m", "nees_relative_mean", "delta_v_m_s"):
        for name, campaign in found.items():
            _print(f"{metric}, plume {name}", campaign.metrics[metric])
    return 0


def _print_impulse(campaign: rpojax.Campaign) -> None:
    _print("plume_impulse_n_s", campaign.metrics["plume_impulse_n_s"])
    shares = []
    for run in range(len(campaign.outcomes)):
        history = campaign.history(run)
        impulse = history["plume_impulse_n_s"]
        shares.append(1.0 - np.max(impulse[history["range_m"] > 10.0]) / impulse[-1])
    _print("share of it within 10 m", np.array(shares))


def _last_rate(campaign: rpojax.Campaign, run: int) -> np.ndarray:
    """Mean rate of the target over the last second of a run, in its own axes [deg/s]."""
    before, after = campaign.history(run)["q_TN"][-2:].astype(np.float64)
    # The vector part of after * conj(before), of which the rotation of a second is twice the negative.
    vector = before[0] * after[1:] - after[0] * before[1:] + np.cross(before[1:], after[1:])
    return np.rad2deg(-2.0 * vector)


def _size(vectors: np.ndarray) -> np.ndarray:
    return np.linalg.norm(vectors, axis=-1)


def _print(name: str, values: np.ndarray) -> None:
    values = values[np.isfinite(values)]
    p50, p95 = np.percentile(values, [50, 95])
    ends = f"{values.min():.4g} to {values.max():.4g}"
    print(f"{name}: mean {values.mean():.4g}, median {p50:.4g}, p95 {p95:.4g}, {ends}")


if __name__ == "__main__":
    sys.exit(main())
