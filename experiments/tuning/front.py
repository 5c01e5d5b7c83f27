"""Formation error against velocity change: LQR weights and burn schedule tuned for several prices of velocity change.

    python experiments/tuning/front.py --out out/front [--runs 32] [--steps 12] [--horizon 4000] [--judge 300]

Each point starts where the one before it ended. All points and the packaged gains are validated on the same full runs
of an unseen seed.
"""

import argparse
import dataclasses
import json
from pathlib import Path
from typing import TYPE_CHECKING

from rpojax.runtime.jax_environment import prepare_jax, set_loop_fusion_flag

if TYPE_CHECKING:
    from rpojax.analysis.statistics.paired_comparison import RunMetrics

PRICES = (0.05, 0.15, 0.4, 0.8, 1.5, 2.5)
"""Weights of the logarithm of the velocity change beside 1 for that of the formation error."""
PARAMETERS = ("formation.position_weight", "schedule")
"""The other weights of the control law are fixed: only ratios matter, and the velocity weights have little effect."""
ONLY = [f"tuning.{name}=0" for name in ("innovations", "estimate", "consistency", "navigation", "pointing")]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--scenario", default="inspection")
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=32)
    parser.add_argument("--steps", type=int, default=12)
    parser.add_argument("--horizon", type=float, default=4000.0)
    parser.add_argument("--judge", type=int, default=300)
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    prepare_jax(cache=True)
    set_loop_fusion_flag(rendered=False)
    options.out.mkdir(parents=True, exist_ok=True)
    points = tune_all(options)
    found = validate_all(options, points)
    (options.out / "front.json").write_text(json.dumps(found, indent=2))
    show(found)
    draw(found, options.out / "front.png")


def tune_all(options: argparse.Namespace) -> list[dict]:
    """Tuned scenarios from the lowest price to the highest; existing results are kept."""
    import rpojax
    from rpojax.analysis.gradients.tuning import tune
    from rpojax.scenario.loading import scenario_loader

    file = rpojax.load(options.scenario, [*ONLY, "tuning.formation=1"])
    points = []
    for number, price in enumerate(PRICES):
        kept = options.out / f"point_{number}.json"
        if not kept.exists():
            tables = file.model_dump(mode="json")
            tables["tuning"]["delta_v"] = price
            seed = 1000 * options.seed + number
            tuned = tune.tune(
                scenario_loader.validate(tables),
                PARAMETERS,
                runs=options.runs,
                steps=options.steps,
                horizon_s=options.horizon,
                validation_runs=0,
                seed=seed,
            )
            steps = [dataclasses.asdict(step) for step in tuned.result.steps]
            content = {"price": price, "values": tuned.values, "steps": steps}
            kept.write_text(json.dumps(content))
        points.append(json.loads(kept.read_text()))
        file = tune.tuned_scenario(file, points[-1]["values"])
        print(f"price {price:g}: objective {points[-1]['steps'][-1]['objective']:.3f}", flush=True)
    return points


def validate_all(options: argparse.Namespace, points: list[dict]) -> dict:
    """Means over unseen full runs, and ratios to the packaged gains with intervals from resampled runs."""
    import rpojax
    from rpojax.analysis.gradients.tuning import tune

    packaged = rpojax.load(options.scenario)
    seed = 777_000 + options.seed
    first = tune.simulate_runs(packaged, seed, options.judge)
    rows = [{"price": None, "values": {}, **ratios(first, first)}]
    for point in points:
        runs = tune.simulate_runs(tune.tuned_scenario(packaged, point["values"]), seed, options.judge)
        rows.append({"price": point["price"], "values": point["values"], **ratios(first, runs)})
        print(f"validated price {point['price']:g}", flush=True)
    return {"runs": options.judge, "seed": seed, "points": rows}


def ratios(first: "RunMetrics", other: "RunMetrics") -> dict:
    """Formation error and velocity change of runs, and their ratios to those of the same runs with packaged gains."""
    from rpojax.analysis.gradients.tuning import tune

    means = tune.compare_means(first, other)
    found: dict = {"failed": int(other.failed.sum())}
    for name in ("formation_error_rms_m", "delta_v_m_s"):
        found[name] = means[name].second
        found[f"{name}_ratio"] = means[name].ratio
        found[f"{name}_ratio_95"] = means[name].ratio_95
    return found


def show(found: dict) -> None:
    print("| price | formation error | to packaged | velocity change | to packaged | failed |")
    print("|---|---|---|---|---|---|")
    for row in found["points"]:
        cells = ["packaged" if row["price"] is None else f"{row['price']:g}"]
        for name, unit in (("formation_error_rms_m", "m"), ("delta_v_m_s", "m/s")):
            low, high = row[f"{name}_ratio_95"]
            cells += [f"{row[name]:.3f} {unit}", f"{row[f'{name}_ratio']:.3f} ({low:.3f} to {high:.3f})"]
        print(f"| {' | '.join([*cells, str(row['failed'])])} |")


def front(points: list[dict]) -> list[dict]:
    """Pareto-optimal points, by velocity change."""
    found: list[dict] = []
    for point in sorted(points, key=lambda point: point["delta_v_m_s"]):
        if not found or point["formation_error_rms_m"] < found[-1]["formation_error_rms_m"]:
            found.append(point)
    return found


def places(points: list[dict]) -> list[list[float]]:
    """Velocity changes and formation errors."""
    return [[point[name] for point in points] for name in ("delta_v_m_s", "formation_error_rms_m")]


def draw(found: dict, path: Path) -> None:
    """Plots the front and the packaged gains."""
    import matplotlib

    matplotlib.use("Agg")
    import matplotlib.pyplot as plt

    packaged, *points = found["points"]
    figure, axes = plt.subplots(figsize=(6.4, 4.2), constrained_layout=True)
    axes.plot(*places(points), "o", color="#1b6ca8", mfc="white", label="tuned, and another point beats it")
    axes.plot(*places(front(points)), "o-", color="#1b6ca8", label="tuned: the front")
    for point in points:
        place = (point["delta_v_m_s"], point["formation_error_rms_m"])
        axes.annotate(f"{point['price']:g}", place, textcoords="offset points", xytext=(6, 5), fontsize=8)
    axes.plot(packaged["delta_v_m_s"], packaged["formation_error_rms_m"], "s", color="#c8553d", label="packaged")
    axes.set_xlabel("velocity change over a run [m/s]")
    axes.set_ylabel("formation error RMS [m]")
    axes.set_title(f"{found['runs']} unseen runs; numbers: price of velocity change", fontsize=10)
    axes.legend()
    axes.grid(alpha=0.3)
    figure.savefig(path, dpi=130)


if __name__ == "__main__":
    main()
