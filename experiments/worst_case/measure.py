"""How soon a search by derivatives meets a violation that one run in a thousand has; prints one table per metric.

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
from rpojax.analysis.gradients.evaluation_log import Effort
from rpojax.analysis.gradients.run_derivatives import Flights
from rpojax.analysis.reliability import worst_case
from rpojax.analysis.reliability.metric_limit import Bound
from rpojax.analysis.reliability.worst_case import Costs, Worst
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.dispersions import standard_normal
from rpojax.dispersions.standard_normal import NormalSpace
from rpojax.scenario.metric_catalogue import LOW_IS_BAD, UNITS

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
    parser.add_argument("--no-flight", action="store_true", help="do not fly what is found")
    given = parser.parse_args()
    file = rpojax.load("inspection", SETTINGS)
    sampled = campaign(given.out / "campaign")
    space = standard_normal.make(file)
    flights = worst_case.flights_of(space, given.metric or METRICS, given.starts)
    costs = worst_case.measure(flights)
    print(
        f"gradient {costs.gradient_s:.3f} s, flight {costs.flight_s:.3f} s a run in batches of {costs.batch}: "
        f"{costs.gradient_s / costs.flight_s:.1f}, counted as {costs.gradient_flights}; compiled in "
        f"{flights.compile_s:.0f} s",
        flush=True,
    )
    effort = Effort(starts=given.starts, screened=given.screened, budget=given.budget)
    for metric in given.metric or METRICS:
        bound = bound_of(sampled, metric)
        rate = np.mean([bound.broken(value) for value in sampled.metrics[metric]])
        print(
            f"\n`{metric}` {bound.bound} {bound.limit:.4g} {UNITS[metric]}, {1000 * rate:.2f} of 1000 runs break it\n"
        )
        table(given.out / metric, given.seeds, space, bound, effort, flights, costs, sampled, not given.no_flight)


def campaign(folder: Path) -> Campaign:
    """Sampled runs that the limits are taken from, made where they are not there."""
    if not folder.exists():
        file = rpojax.load("inspection", SETTINGS)
        rpojax.run_campaign(file, RUNS, folder, seed=SEED, histories=[])
    return Campaign(folder)


def bound_of(sampled: Campaign, metric: str) -> Bound:
    """The limit that one sampled run in a thousand is beyond, half-way to the next run."""
    values = np.sort(sampled.metrics[metric])
    beyond = round(RATE * len(values))
    if metric in LOW_IS_BAD:
        return Bound(metric, "at least", float(values[beyond - 1 : beyond + 1].mean()))
    return Bound(metric, "at most", float(values[len(values) - beyond - 1 : len(values) - beyond + 1].mean()))


def table(
    folder: Path,
    seeds: int,
    space: NormalSpace,
    bound: Bound,
    effort: Effort,
    flights: Flights,
    costs: Costs,
    sampled: Campaign,
    check: bool,
) -> None:
    """One row for each seed, and the means."""
    print("| seed | to the first violation | its distance | in all | nearest | alignment | flown | random sampling |")
    print("|---|---|---|---|---|---|---|---|")
    first, random = [], []
    for seed in range(seeds):
        worst = worst_case.search(space, bound, effort, seed, flights, costs)
        flown = flown_text(worst, folder / str(seed)) if check else "-"
        random.append(to_first(sampled, bound, seed * len(sampled.run_ids) // seeds))
        found = worst.found
        if found.first is None or found.nearest is None:
            missed = f"{worst.bound.value(found.closest.margin):.4g} at {found.closest.distance:.2f}"
            print(f"| {seed} | none | | {found.spent:.0f} | {missed} | | {flown} | {random[-1]} |", flush=True)
            continue
        first.append(found.first.spent)
        alignment = "-" if found.alignment is None else f"{found.alignment:.2f}"
        print(
            f"| {seed} | {found.first.spent:.0f} | {found.first.distance:.2f} | {found.spent:.0f} | "
            f"{found.nearest.distance:.2f} | {alignment} | {flown} | {random[-1]} |",
            flush=True,
        )
    mean = f"{np.mean(first):.0f}" if first else "-"
    print(f"| mean of {len(first)} | **{mean}** | | | | | | {np.mean(random):.0f} |", flush=True)


def flown_text(worst: Worst, folder: Path) -> str:
    """The metric that `rpojax run` has at the point, and whether it breaks the limit."""
    flown = worst_case.fly(worst, folder, force=True)
    broken = not np.isfinite(flown) or worst.bound.broken(flown)
    return f"{flown:.4g}, {'broken' if broken else 'kept'}"


def to_first(sampled: Campaign, bound: Bound, start: int) -> int:
    """Sampled runs from one of them on until one is beyond the bound."""
    values = np.roll(sampled.metrics[bound.metric], -start)
    return int(np.argmax([bound.broken(value) for value in values])) + 1


if __name__ == "__main__":
    main()
