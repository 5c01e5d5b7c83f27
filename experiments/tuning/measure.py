"""A filter with noises wrong by a factor of ten, tuned back, and the packaged filter tuned further.

    python experiments/tuning/measure.py up|down|packaged --out out/tuning [--steps 80] [--runs 64] [--horizon 2000]
    python experiments/tuning/measure.py table --out out/tuning
    python experiments/tuning/measure.py memory --out out/tuning

`up` and `down` start with every noise and sigma of the orbit filter ten times too large or too small. `table` compares
the tuned filters with the packaged one on the same runs. `memory` makes two steps of 512 runs of 3000 s and prints the
peak memory of the process.
"""

import argparse
import json
import subprocess
import sys
from pathlib import Path

NOISES = {
    "gps_noise_m": 2.0,
    "gps_error_sigma_m": 1.2,
    "edge_noise_px": 1.0,
    "center_sigma_m": 0.005,
    "scale_sigma": (0.065, 0.14),
    "bearing_bias_sigma_deg": 0.03,
    "acceleration_noise_m_s2_sqrt_hz": 1e-6,
    "relative_acceleration_noise_m_s2_sqrt_hz": 8e-6,
}
"""Packaged values of the numbers that are made wrong."""
FACTORS = {"up": 10.0, "down": 0.1}
SHOWN = ("nees_mean", "nees_relative_mean", "nav_relative_position_error_rms_m", "nav_servicer_position_error_rms_m")
NEES_BAND = (0.8 * 12.0, 1.2 * 12.0)
ERROR_RATIO = 1.1


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("what", choices=[*FACTORS, "packaged", "table", "memory"])
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=64)
    parser.add_argument("--steps", type=int, default=80)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--horizon", type=float, default=2000.0)
    parser.add_argument("--judge", type=int, default=500)
    options = parser.parse_args()
    options.out.mkdir(parents=True, exist_ok=True)
    if options.what == "table":
        return table(options)
    if options.what == "memory":
        return memory(options)
    return tune(options)


def tune(options: argparse.Namespace) -> int:
    """`rpojax tune`, as a user calls it."""
    command = ["tune", "inspection", "--parameters", "navigation", "--runs", str(options.runs), "--judge", "0"]
    command += ["--steps", str(options.steps), "--seed", str(options.seed), "--force"]
    command += ["--horizon", f"{options.horizon:g}"]
    command += ["--out", str(options.out / f"{options.what}.toml")]
    if options.what in FACTORS:
        command += ["--set", *(f"navigation.{key}={times(value, options.what)}" for key, value in NOISES.items())]
    return subprocess.call([sys.executable, "-m", "rpojax", *command])


def times(value: float | tuple[float, ...], name: str) -> str:
    """A packaged value made wrong, in TOML."""
    parts = [f"{FACTORS[name] * part:.6g}" for part in (value if isinstance(value, tuple) else (value,))]
    return f"[{', '.join(parts)}]" if isinstance(value, tuple) else str(float(parts[0]))


def table(options: argparse.Namespace) -> int:
    """Packaged, wrong and tuned filters on the same unseen runs; status 1 if a bar is missed."""
    from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    import numpy as np

    import rpojax
    from rpojax.analysis.gradients.tuning import tune

    cases = {"packaged": rpojax.load("inspection")}
    for name in [*FACTORS, "packaged"]:
        path = options.out / f"{name}.toml"
        if path.exists():
            cases[f"tuned from {name}"] = rpojax.load(path)
    seed = 888_000 + options.seed
    print(f"{options.judge} full runs, seed {seed}\n")
    print(f"| filter | failed | {' | '.join(SHOWN)} | holds |\n|---|---|{'---|' * 5}")
    found, status = {}, 0
    for name, file in cases.items():
        runs = tune.simulate_runs(file, seed, options.judge)
        means = {metric: float(np.nanmean(runs.metrics[metric])) for metric in SHOWN}
        found[name] = {"failed": int(runs.failed.sum()), **means}
        close = means[SHOWN[2]] <= ERROR_RATIO * found["packaged"][SHOWN[2]]
        holds = NEES_BAND[0] <= means["nees_mean"] <= NEES_BAND[1] and close
        status |= int(name != "packaged" and not holds)
        cells = [str(found[name]["failed"]), *(f"{means[metric]:.3f}" for metric in SHOWN)]
        print(
            f"| {name} | {' | '.join(cells)} | {'-' if name == 'packaged' else 'yes' if holds else '**no**'} |",
            flush=True,
        )
    (options.out / "table.json").write_text(
        json.dumps({"seed": seed, "runs": options.judge, "filters": found}, indent=2)
    )
    return status


def memory(options: argparse.Namespace) -> int:
    """Two steps of a large tuning; peak memory of the process and of the programs."""
    import resource

    from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    import rpojax
    from rpojax.analysis.gradients.tuning import tune

    tuned = tune.tune(rpojax.load("inspection"), runs=512, steps=2, horizon_s=3000.0, validation_runs=0).result
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss * 1024 / 1e9
    step = tuned.steps[-1].run_s
    print(f"512 runs of 3000 s: at most {peak:.2f} GB, programs {tuned.memory_bytes / 1e9:.2f} GB, {step:.0f} s a step")
    return int(peak > 8.0)


if __name__ == "__main__":
    sys.exit(main())
