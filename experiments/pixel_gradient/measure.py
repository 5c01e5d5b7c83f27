"""Derivatives of the navigation error through the picture, against central differences of the same soft program.

    python experiments/pixel_gradient/measure.py check --runs 8 --seconds 120
    python experiments/pixel_gradient/measure.py cost --runs 8 --seconds 120

`check` computes pictures and networks, which are in single precision in the loop, in double precision: differences of
single precision are too coarse. `cost` is of the program as it is.
"""

import argparse
import json
import resource
import time
import types
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

METRIC = "nav_relative_position_error_rms_m"
INPUTS = (
    ("imaging.exposure", None, 1e-6),
    ("imaging.detector.first.out.bias", 1, 1e-6),
    ("imaging.detector.second.out_quality.bias", 0, 1e-6),
    ("imaging.field.network.2.bias", 1, 1e-6),
    ("navigation.edge_noise_px", None, 1e-6),
)
"""Keys, components of tensors, and steps of the differences."""


def in_double_precision() -> None:
    """Makes pictures and networks of this process double; before rpojax is imported."""
    single = types.SimpleNamespace(**vars(jnp))
    setattr(jnp, "float32", jnp.float64)
    from rpojax.core import random_streams
    from rpojax.scenario.trained import trained_files
    from rpojax.vision.radiance_field import field_file

    def double(tree: Any) -> Any:
        return jax.tree.map(lambda x: x.astype(jnp.float64) if x.dtype == np.float32 else x, tree)

    # Random numbers stay those of the loop, which are made from bits of single precision.
    setattr(random_streams, "jnp", single)
    occupied, load = field_file.with_occupancy, trained_files.load_networks
    setattr(field_file, "with_occupancy", lambda field: occupied(double(field)))
    setattr(trained_files, "load_networks", lambda *tables: double(load(*tables)))


def evaluator_of(runs: int, seconds: float, temperature: float) -> Any:
    """Evaluator of runs of `inspection` as a function of shifts of the inputs (k,)."""
    import rpojax
    from rpojax.analysis.gradients import scenario_gradient
    from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator

    file = rpojax.load("inspection", ["camera.model=rendered", f"duration_s={seconds:g}"])
    nominal = scenario_gradient._nominals_of(file, [key for key, _, _ in INPUTS])
    shifted = scenario_gradient._shifted_values(file, nominal)
    rows = []
    for key, component, _ in INPUTS:
        row = {name: np.zeros(value.size) for name, value in nominal.items()}
        row[key][component or 0] = 1.0
        rows.append(np.concatenate(list(row.values())))
    matrix = np.array(rows)
    return RolloutEvaluator(
        file, lambda x, key: shifted(x @ matrix, key), len(INPUTS), [METRIC], runs, temperature=temperature
    )


def check(runs: int, seconds: float, seed: int, temperature: float) -> dict[str, Any]:
    """Derivatives and central differences of runs, by input."""
    from rpojax.simulation.noise import run_keys

    evaluator, keys = evaluator_of(runs, seconds, temperature), run_keys(seed, np.arange(runs))
    here = evaluator.jacobian(np.zeros((runs, len(INPUTS))), keys)
    found: dict[str, Any] = {"metric": here.metrics[:, 0].tolist(), "completed": int((~here.failed).sum())}
    for index, (key, component, step) in enumerate(INPUTS):
        shift = np.zeros((runs, len(INPUTS)))
        shift[:, index] = step
        ahead, back = evaluator.evaluate(shift, keys), evaluator.evaluate(-shift, keys)
        central = (ahead.metrics[:, 0] - back.metrics[:, 0]) / (2.0 * step)
        derivative = here.jacobian[:, 0, index]
        same = (ahead.events == here.events) & (back.events == here.events)
        name = key if component is None else f"{key}[{component}]"
        found[name] = {
            "derivative": derivative.tolist(),
            "central": central.tolist(),
            "same_events": int(same.sum()),
            "mean_relative_error": float(abs(derivative.mean() / central.mean() - 1.0)),
            "norm_relative_error": float(np.linalg.norm(derivative - central) / np.linalg.norm(central)),
        }
        print(json.dumps({name: found[name]}), flush=True)
    return found


def cost(runs: int, seconds: float, seed: int, temperature: float) -> dict[str, Any]:
    """Time to compile and to run, and memory, of values and of derivatives in both modes."""
    from rpojax.simulation.noise import run_keys

    found: dict[str, Any] = {}
    keys, zero = run_keys(seed, np.arange(runs)), np.zeros((runs, len(INPUTS)))
    works = {
        "values": lambda each: each.evaluate(zero, keys),
        "forward": lambda each: each.jacobian(zero, keys),
        "reverse": lambda each: each.gradient(zero, keys, np.ones((runs, 1))),
    }
    for name, work in works.items():
        each = evaluator_of(runs, seconds, temperature)
        begin = time.perf_counter()
        work(each)
        found[name] = {
            "compile_s": round(each.compile_s, 1),
            "run_s": round(time.perf_counter() - begin - each.compile_s, 1),
            "program_memory_mb": round(each.program_memory_bytes / 1e6),
            "peak_memory_of_process_mb": round(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1e3),
        }
        print(json.dumps({name: found[name]}), flush=True)
    return found


def main() -> None:
    """Command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("work", choices=("check", "cost"))
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seconds", type=float, default=120.0)
    parser.add_argument("--seed", type=int, default=5)
    parser.add_argument("--temperature", type=float, default=0.25)
    asked = parser.parse_args()
    if asked.work == "check":
        in_double_precision()
    work = check if asked.work == "check" else cost
    print(json.dumps(work(asked.runs, asked.seconds, asked.seed, asked.temperature), indent=1))


if __name__ == "__main__":
    main()
