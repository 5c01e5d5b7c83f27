"""Gradients of a tuning's objective by one batch on one device, and by several batches on two devices, in both modes.

python experiments/tuning/batches.py [--runs 3] [--horizon 300]
"""

import argparse
import json
import os
from functools import partial

import numpy as np

PARAMETERS = ("navigation.gps_noise_m", "attitude_control.bandwidth_rad_s")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--runs", type=int, default=3)
    parser.add_argument("--horizon", type=float, default=300.0)
    options = parser.parse_args()
    if "device_count" not in os.environ.get("XLA_FLAGS", ""):
        os.environ["XLA_FLAGS"] = f"{os.environ.get('XLA_FLAGS', '')} --xla_force_host_platform_device_count=2"
    for mode in ("forward", "reverse"):
        print(json.dumps({mode: differences(mode, options.runs, options.horizon)}), flush=True)


def differences(mode: str, runs: int, horizon_s: float) -> dict[str, float]:
    """Largest differences of two divisions of the runs, relative to the largest number of the first one.

    The first is one batch on one device; in the second two devices take one run each at a time, and the last batch is
    padded if the number of runs is odd.
    """
    whole, divided = (
        gradients(mode, runs, horizon_s, devices, per_device) for devices, per_device in ((1, runs), (2, 1))
    )
    return {
        name: float(np.max(np.abs(values - divided[name])) / np.max(np.abs(values))) for name, values in whole.items()
    }


def gradients(mode: str, runs: int, horizon_s: float, devices: int, per_device: int) -> dict[str, np.ndarray]:
    """Contributions (runs, k) of runs to the gradient of the objective, their sum (k,), and its norm."""
    import jax

    import rpojax
    from rpojax.analysis.gradients import rollout_evaluator
    from rpojax.analysis.gradients.tuning import gradient_descent, tunable_parameters
    from rpojax.analysis.gradients.tuning.tuning_objective import Objective
    from rpojax.simulation.noise import run_keys

    rollout_evaluator.share_runs = lambda *_: (jax.devices()[:devices], per_device)
    gradient_descent.FORWARD_MODE_MAX_INPUTS = {"forward": 2, "reverse": 0}[mode]
    file = rpojax.load("inspection", [f"duration_s={horizon_s}"])
    chosen, objective = tunable_parameters.select_parameters(file, PARAMETERS), Objective(file)
    evaluator = rollout_evaluator.RolloutEvaluator(
        file,
        partial(tunable_parameters.run_values, file, chosen),
        chosen.count,
        objective.metric_names,
        runs,
        cotangent=objective.gradient,
    )
    keys = run_keys(0, np.arange(runs))
    found, of_runs = gradient_descent.run_gradients(evaluator, objective, chosen.initial, keys)
    total, excluded, _ = gradient_descent.clipped_sum(of_runs)
    assert excluded == 0
    return {"metrics": found.metrics, "runs": of_runs, "gradient": total, "norm": np.array(np.linalg.norm(total))}


if __name__ == "__main__":
    main()
