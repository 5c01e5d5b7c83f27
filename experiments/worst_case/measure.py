"""Cost of the worst-case search for a violation that one run in a thousand has; prints one table per metric.

The limit of each metric is the value that one run in a thousand of a sampled campaign is beyond. Every search has
another seed: other runs, other noise, other random starts.

python experiments/worst_case/measure.py --out out/worst [--metric NAME]... [--seeds 10] [--starts 4] [--budget 250]
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", "--xla_force_host_platform_device_count=1")
os.environ.setdefault("JAX_COMPILATION_CACHE_DIR", str(Path.home() / ".cache" / "rpojax" / "jax"))

import numpy as np

import rpojax
from rpojax.analysis.gradients.rollout_evaluator import RolloutEvaluator
from rpojax.analysis.reliability import worst_case
from rpojax.analysis.reliability.search_settings import SearchSettings
from rpojax.analysis.reliability.simulated_limit_state import (
    EvaluationCosts,
    MetricLimit,
    make_evaluator,
    measure_costs,
)
from rpojax.analysis.reliability.worst_case import WorstCase
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.metrics.metric_catalogue import METRICS as CATALOGUE
from rpojax.metrics.metric_catalogue import UNITS
from rpojax.scenario.dispersed_numbers import standard_normal_space
from rpojax.scenario.dispersed_numbers.standard_normal_space import StandardNormalSpace

METRICS = ("nav_relative_position_error_rms_m", "formation_error_rms_m", "min_range_m", "delta_v_m_s")
SETTINGS = ["duration_s=2000.0"]
RUNS, SEED, RATE = 4096, 4242, 1e-3


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--metric", action="append")
    parser.add_argument("--seeds", type=int, default=10)
    parser.add_argument("--starts", type=int, default=4)
    parser.add_argument("--screened", type=int, default=16)
    parser.add_argument("--budget", type=float, default=250.0)
    parser.add_argument("--no-flight", action="store_true", help="do not simulate the worst cases")
    given = parser.parse_args()
    file = rpojax.load("inspection", SETTINGS)
    sampled = campaign(given.out / "campaign")
    space = standard_normal_space.make_space(file)
    evaluator = make_evaluator(space, given.metric or METRICS, given.starts)
    costs = measure_costs(evaluator)
    print(
        f"gradient {costs.gradient_s:.3f} s, run {costs.run_s:.3f} s in batches of {costs.batch_size}: "
        f"{costs.gradient_s / costs.run_s:.1f}, counted as {costs.gradient_run_equivalents}; compiled in "
        f"{evaluator.compile_s:.0f} s",
        flush=True,
    )
    settings = SearchSettings(starts=given.starts, screening_points=given.screened, budget=given.budget)
    for metric in given.metric or METRICS:
        limit = rare_limit(sampled, metric)
        rate = np.mean([limit.is_violated(value) for value in sampled.metrics[metric]])
        print(
            f"\n`{metric}` {limit.bound} {limit.limit:.4g} {UNITS[metric]}, {1000 * rate:.2f} of 1000 runs break it\n"
        )
        table(given.out / metric, given.seeds, space, limit, settings, evaluator, costs, sampled, not given.no_flight)


def campaign(folder: Path) -> Campaign:
    """Sampled runs that the limits are taken from, made where they are not there."""
    if not folder.exists():
        file = rpojax.load("inspection", SETTINGS)
        rpojax.run_campaign(file, RUNS, folder, seed=SEED, histories=[])
    return Campaign(folder)


def rare_limit(sampled: Campaign, metric: str) -> MetricLimit:
    """The limit that one sampled run in a thousand is beyond, half-way to the next run."""
    values = np.sort(sampled.metrics[metric])
    beyond = round(RATE * len(values))
    if CATALOGUE[metric].low_is_bad:
        return MetricLimit(metric, "at least", float(values[beyond - 1 : beyond + 1].mean()))
    return MetricLimit(metric, "at most", float(values[len(values) - beyond - 1 : len(values) - beyond + 1].mean()))


def table(
    folder: Path,
    seeds: int,
    space: StandardNormalSpace,
    limit: MetricLimit,
    settings: SearchSettings,
    evaluator: RolloutEvaluator,
    costs: EvaluationCosts,
    sampled: Campaign,
    check: bool,
) -> None:
    """One row for each seed, and the means."""
    print(
        "| seed | to the first violation | its distance | in all | nearest | alignment | simulated | random sampling |"
    )
    print("|---|---|---|---|---|---|---|---|")
    first, random = [], []
    for seed in range(seeds):
        worst = worst_case.search_worst_case(space, limit, settings, seed, evaluator, costs)
        confirmed = confirmation(worst, folder / str(seed)) if check else "-"
        random.append(to_first(sampled, limit, seed * len(sampled.run_ids) // seeds))
        found = worst.search
        if found.first_violation is None or found.nearest_violation is None:
            closest = found.smallest_margin
            missed = f"{worst.limit.value_at_margin(closest.margin):.4g} at {closest.distance:.2f}"
            print(f"| {seed} | none | | {found.cost:.0f} | {missed} | | {confirmed} | {random[-1]} |", flush=True)
            continue
        first.append(found.first_violation.cost)
        alignment = "-" if found.alignment is None else f"{found.alignment:.2f}"
        print(
            f"| {seed} | {found.first_violation.cost:.0f} | {found.first_violation.distance:.2f} | {found.cost:.0f} | "
            f"{found.nearest_violation.distance:.2f} | {alignment} | {confirmed} | {random[-1]} |",
            flush=True,
        )
    mean = f"{np.mean(first):.0f}" if first else "-"
    print(f"| mean of {len(first)} | **{mean}** | | | | | | {np.mean(random):.0f} |", flush=True)


def confirmation(worst: WorstCase, folder: Path) -> str:
    """Metric of the worst case as `rpojax run` simulates it, and whether it violates the limit."""
    value = worst_case.simulate_worst_case(worst, folder)
    broken = not np.isfinite(value) or worst.limit.is_violated(value)
    return f"{value:.4g}, {'broken' if broken else 'kept'}"


def to_first(sampled: Campaign, limit: MetricLimit, start: int) -> int:
    """Sampled runs from one of them on until one is beyond the limit."""
    values = np.roll(sampled.metrics[limit.metric], -start)
    return int(np.argmax([limit.is_violated(value) for value in values])) + 1


if __name__ == "__main__":
    main()
