"""Gradients of the closed loop to every tunable number against central differences, with events off and on.

    python experiments/tuning/gradients.py [--runs 8] [--horizon 600] [--parameters A,B,...] [--json FILE]

Events off: no false boxes, no dead band, no gate; a run counts for a number only where no box and no mode changes
within the step, since a difference would include the jump. Events on: the packaged scenario, all runs.
"""

import argparse
import json
from functools import partial
from pathlib import Path

import numpy as np

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

STEPS = (1e-4, 1e-3, 1e-2, 1e-1)
"""Steps in coordinates: the relative change of a number. Weak dependences need a longer one because of rounding."""
STENCIL = {1: 8.0 / 12.0, 2: -1.0 / 12.0}
"""Weights of fourth-order central differences by the number of steps."""
CALM = ["camera.outlier_probability=0.0", "formation.dead_band_mm_s=0.0", "navigation.gating=none"]
SPEED_WEIGHTS = "formation.velocity_weight=[1e3, 1e3, 1e3]"


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="inspection")
    parser.add_argument("--runs", type=int, default=8)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--horizon", type=float, default=600.0)
    parser.add_argument("--parameters", help="groups or numbers; all of them by default")
    parser.add_argument("--json", type=Path)
    options = parser.parse_args()
    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    found = {
        name: compare(options.scenario, [f"duration_s={options.horizon}", SPEED_WEIGHTS, *overrides], options)
        for name, overrides in (("off", CALM), ("on", []))
    }
    show(found)
    if options.json:
        options.json.write_text(json.dumps(found, indent=2))


def compare(source: str, overrides: list[str], options: argparse.Namespace) -> dict[str, dict[str, float]]:
    """Largest relative differences by number: forward, reverse, and the share of runs without an event in the step."""
    import rpojax
    from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
    from rpojax.analysis.gradients.tuning import tunable_parameters
    from rpojax.analysis.gradients.tuning.tuning_objective import Objective
    from rpojax.simulation.noise import run_keys

    file = rpojax.load(source, [*overrides, "tuning.estimate=1.0"])
    names = options.parameters.split(",") if options.parameters else list(tunable_parameters.GROUPS)
    chosen, objective = tunable_parameters.select_parameters(file, names), Objective(file)
    evaluator = RolloutEvaluator(
        file, partial(tunable_parameters.run_values, file, chosen), chosen.count, objective.metric_names, options.runs
    )
    keys = run_keys(options.seed, np.arange(options.runs))
    x = np.tile(chosen.initial, (options.runs, 1))
    # One random combination of the metrics, each over its own spread, represents all of them.
    plain = evaluator.evaluate(x, keys)
    rng = np.random.default_rng(0)
    weights = np.tile(rng.standard_normal(len(objective.metric_names)) / plain.metrics.std(axis=0), (options.runs, 1))
    forward, reverse = evaluator.jacobian(x, keys), evaluator.gradient(x, keys, weights)
    assert forward.jacobian is not None and reverse.gradient is not None
    along = np.einsum("rf,rfk->rk", weights, forward.jacobian)
    rows = {}
    for index, name in enumerate(chosen.names):
        differences, quiet = [], []
        for step in STEPS:
            move = step * np.eye(chosen.count)[index]
            difference, calm = np.zeros(options.runs), np.ones(options.runs, dtype=bool)
            for steps, weight in STENCIL.items():
                up, down = (evaluator.evaluate(x + sign * steps * move, keys) for sign in (1.0, -1.0))
                difference += weight * ((up.metrics - down.metrics) * weights).sum(axis=1) / step
                calm &= (up.events == plain.events) & (down.events == plain.events)
            differences.append(difference)
            quiet.append(calm)
        rows[name] = worst(along[:, index], reverse.gradient[:, index], differences, quiet)
    return rows


def worst(
    forward: np.ndarray, reverse: np.ndarray, differences: list[np.ndarray], quiet: list[np.ndarray]
) -> dict[str, float]:
    """Relative differences at the best of the steps, over the runs without an event."""
    size = max(np.abs(forward).max(), 1e-300)
    found = [
        [
            float(np.abs(mode - difference)[calm].max() / size) if calm.any() else float("nan")
            for mode in (forward, reverse)
        ]
        for difference, calm in zip(differences, quiet, strict=True)
    ]
    best = int(np.nanargmin([pair[0] for pair in found]))
    return {
        "forward": found[best][0],
        "reverse": found[best][1],
        "step": STEPS[best],
        "quiet_share": float(quiet[best].mean()),
        "all_runs": float(np.abs(forward - differences[best]).max() / size),
    }


HEADINGS = (
    "number",
    "forward, events off",
    "reverse, events off",
    "step",
    "runs without event",
    "events on: runs without event",
    "events on: all runs",
)


def show(found: dict[str, dict[str, dict[str, float]]]) -> None:
    print(f"| {' | '.join(HEADINGS)} |\n{'|---' * len(HEADINGS)}|")
    for name, row in found["off"].items():
        other = found["on"].get(name)
        share = f"{100.0 * row['quiet_share']:.0f} %"
        cells = [f"{row['forward']:.1e}", f"{row['reverse']:.1e}", f"{row['step']:g}", share]
        cells += ["held" if other is None else f"{other[key]:.1e}" for key in ("forward", "all_runs")]
        print(f"| `{name}` | {' | '.join(cells)} |")


if __name__ == "__main__":
    main()
