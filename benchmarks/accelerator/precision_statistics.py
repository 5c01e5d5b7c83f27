"""Statistics of runs in single precision on this device against the same runs in double precision on the CPU.

python -m benchmarks.accelerator.precision_statistics FILE RUNS DURATION_S writes the metrics of the latter.
"""

import os
import subprocess
import sys
import tempfile
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.accelerator.sizes import Sizes

_SEED = 5
_PERCENTILES = (50.0, 95.0)


def measure(sizes: Sizes) -> Iterator[dict[str, Any]]:
    """One entry: largest differences of means and percentiles, and the differences of every metric."""
    with tempfile.TemporaryDirectory() as folder:
        stored = Path(folder) / "double.npz"
        words = [str(stored), str(sizes.compared_runs), str(sizes.compared_duration_s)]
        # The CPU works while the programs for the device are compiled.
        partner = subprocess.Popen(
            [sys.executable, "-m", "benchmarks.accelerator.precision_statistics", *words],
            env={**os.environ, "JAX_PLATFORMS": "cpu"},
            stdout=subprocess.DEVNULL,
        )
        single = simulate("single", sizes.compared_runs, sizes.compared_duration_s)
        if partner.wait():
            raise subprocess.CalledProcessError(partner.returncode, "simulation in double precision on the CPU")
        with np.load(stored) as double:
            yield {
                "runs": sizes.compared_runs,
                "duration_s": sizes.compared_duration_s,
                **compare(dict(double), single),
            }


def simulate(precision: str, runs: int, duration_s: float) -> dict[str, np.ndarray]:
    """Metrics of runs of the nominal mission, and `failed`."""
    from rpojax.analysis.gradients.tuning import tune
    from rpojax.scenario.loading import scenario_loader

    file = scenario_loader.load("inspection", [f"duration_s={duration_s}", f"precision={precision}"])
    found = tune.simulate_runs(file, _SEED, runs)
    return {**found.metrics, "failed": found.failed}


def compare(double: Mapping[str, np.ndarray], single: Mapping[str, np.ndarray]) -> dict[str, Any]:
    """Differences of single from double precision: of means in standard errors, of percentiles in deviations.

    Metrics that are the same in all runs are left out, and single runs in which a metric is undefined in either.
    """
    metrics = {name: found for name in sorted(double) if (found := _differences(double[name], single[name]))}

    def largest(figure: str) -> dict[str, Any]:
        name = max(metrics, key=lambda name: metrics[name][figure])
        return {f"largest_{figure}": metrics[name][figure], f"largest_{figure}_of": name}

    return {
        "failed_differently": int(np.sum(double["failed"] != single["failed"])),
        **(largest("mean_difference_in_standard_errors") if metrics else {}),
        **(largest("percentile_difference_in_deviations") if metrics else {}),
        "metrics": metrics,
    }


def _differences(double: np.ndarray, single: np.ndarray) -> dict[str, float]:
    defined = np.isfinite(double) & np.isfinite(single)
    one, other = double[defined].astype(np.float64), single[defined].astype(np.float64)
    if len(one) < 2 or (spread := float(np.std(one, ddof=1))) == 0.0:
        return {}
    percentiles = np.abs(np.percentile(other, _PERCENTILES) - np.percentile(one, _PERCENTILES))
    return {
        "mean_difference_in_standard_errors": abs(float(np.mean(other - one))) * float(np.sqrt(len(one))) / spread,
        "percentile_difference_in_deviations": float(np.max(percentiles)) / spread,
        "defined_differently": int(np.sum(np.isfinite(double) != np.isfinite(single))),
    }


def main() -> None:
    """Simulates in double precision and stores the metrics."""
    from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

    prepare_jax(cache=False)
    set_loop_fusion_flag(rendered=False)
    np.savez(sys.argv[1], **simulate("double", int(sys.argv[2]), float(sys.argv[3])))  # pyright: ignore[reportArgumentType]


if __name__ == "__main__":
    main()
