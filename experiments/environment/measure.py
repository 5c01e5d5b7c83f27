"""Measures speed, accuracy, eclipses and faults with the full environment; prints Markdown tables.

The exit status is 1 if a row fails.

python experiments/environment/measure.py --out out/environment [--runs 500]
"""

import argparse
import os
import sys
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.benchmark import closed_loop_speed
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.physics.equipment_faults import KINDS

ROUNDS = 7
BATCH = 512


class Table:
    """Markdown table of measured values against limits; `holds` is whether all of them are met."""

    def __init__(self) -> None:
        self.holds = True
        print("| quantity | limit | measured | holds |\n|---|---|---|---|")

    def add_row(self, quantity: str, limit: str, value: str, holds: bool) -> None:
        """Prints one row."""
        self.holds &= holds
        print(f"| {quantity} | {limit} | {value} | {'yes' if holds else '**no**'} |", flush=True)


def run_or_resume(scenario: str, runs: int, out: Path) -> Campaign:
    """Campaign of a scenario; an existing one is resumed."""
    if (out / "campaign.json").exists():
        return rpojax.resume_campaign(out)
    return rpojax.run_campaign(rpojax.load(scenario), runs, out, seed=0, histories=range(8))


def speed(table: Table) -> None:
    """Closed-loop speed with all effects relative to J2 alone, measured alternately."""
    engines = {
        name: closed_loop_speed.compile_engine(rpojax.load(name, ["duration_s=200"]), BATCH)
        for name in ("inspection", "inspection_full")
    }
    times = {name: [] for name in engines}
    for _ in range(ROUNDS):
        for name, engine in engines.items():
            times[name].append(closed_loop_speed.time_pass(engine).wall_s)
    rates = {name: BATCH * 200.0 / min(values) for name, values in times.items()}
    ratio = float(np.median(np.array(times["inspection"]) / np.array(times["inspection_full"])))
    shown = ", ".join(f"{name} {rate:,.0f}" for name, rate in rates.items())
    compiled = ", ".join(f"{engine.compile_s:.0f} s" for engine in engines.values())
    table.add_row(
        "speed with everything on over speed with J2 alone",
        ">= 0.5",
        f"{ratio:.2f} (run-s/s: {shown}; compilation {compiled})",
        ratio >= 0.5,
    )


def median(result: Campaign, metric: str) -> float:
    """Median of a metric over the runs in which it is defined."""
    return float(np.nanmedian(result.metrics[metric]))


def accuracy(table: Table, full: Campaign) -> None:
    """Accuracy, consistency and failures with all effects."""
    limits = {
        "formation_error_rms_m": 1.3,
        "nav_relative_position_error_rms_m": 1.3,
        "nav_servicer_position_error_rms_m": 3.0,
        "nav_target_position_error_rms_m": 3.0,
    }
    for metric, limit in limits.items():
        value = median(full, metric)
        table.add_row(f"`inspection_full`: median `{metric}`", f"<= {limit} m", f"{value:.3f} m", value <= limit)
    p99 = float(np.nanpercentile(full.metrics["formation_error_rms_m"], 99))
    table.add_row("`inspection_full`: p99 `formation_error_rms_m`", "<= 6 m", f"{p99:.2f} m", p99 <= 6.0)
    nees = float(np.nanmean(full.metrics["nees_mean"])) / 12.0
    table.add_row("`inspection_full`: mean `nees_mean` over 12", "0.7 to 1.5", f"{nees:.2f}", 0.7 <= nees <= 1.5)
    coverage = float(np.nanmean(full.metrics["sigma3_coverage"]))
    shown = f"{100 * coverage:.2f} %"
    table.add_row("`inspection_full`: `sigma3_coverage`", "97 to 99.95 %", shown, 0.97 <= coverage <= 0.9995)
    failed = int((~full.completed).sum())
    table.add_row("`inspection_full`: failed runs", "0", f"{failed} of {full.completed.size}", failed == 0)


def eclipse(table: Table, result: Campaign) -> None:
    """Lost runs, coverage and reacquisition times with eclipses."""
    lost_target = (result.metrics["reacquisition_peak_s"] > 200.0) | (result.metrics["longest_unseen_s"] > 2500.0)
    lost = int((lost_target | ~result.completed).sum())
    table.add_row("`inspection_eclipse`: lost or failed runs", "0", f"{lost} of {result.completed.size}", lost == 0)
    coverage = float(np.nanmean(result.metrics["sigma3_coverage"]))
    table.add_row("`inspection_eclipse`: `sigma3_coverage`", ">= 97 %", f"{100 * coverage:.2f} %", coverage >= 0.97)
    waits = result.metrics["reacquisition_peak_s"]
    longest = float(np.nanmax(waits))
    shown = f"at most {longest:.0f} s, median {np.nanmedian(waits):.0f} s, in all runs"
    table.add_row("`inspection_eclipse`: from the end of the eclipse to a box", "<= 60 s", shown, longest <= 60.0)
    for metric in ("formation_error_rms_m", "nav_relative_position_error_rms_m", "nees_mean"):
        values = result.metrics[metric]
        shown = f"median {np.nanmedian(values):.2f}, p99 {np.nanpercentile(values, 99):.2f}"
        table.add_row(f"`inspection_eclipse`: `{metric}`", "reported", shown, True)


def faults(result: Campaign) -> bool:
    """Prints a table by kind of fault; true if no run failed."""
    kinds = np.round(result.used["faults.fault.kind"]).astype(int)
    print("\n| fault | runs | failed | formation error median, p95 [m] | smallest range [m] | 3-sigma coverage |")
    print("|---|---|---|---|---|---|")
    for code in sorted(set(kinds)):
        chosen = kinds == code
        formation, closest, coverage = (
            result.metrics[name][chosen] for name in ("formation_error_rms_m", "min_range_m", "sigma3_coverage")
        )
        cells = [
            f"`{KINDS[code]}`",
            f"{chosen.sum()}",
            f"{(~result.completed[chosen]).sum()}",
            f"{np.nanmedian(formation):.2f}, {np.nanpercentile(formation, 95):.1f}",
            f"{np.nanmin(closest):.1f}",
            f"{100 * np.nanmean(coverage):.1f} %",
        ]
        print(f"| {' | '.join(cells)} |")
    return bool(result.completed.all())


def main() -> None:
    """Runs all measurements."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=500)
    options = parser.parse_args()
    table = Table()
    speed(table)
    full = run_or_resume("inspection_full", options.runs, options.out / "full")
    accuracy(table, full)
    eclipse(table, run_or_resume("inspection_eclipse", options.runs, options.out / "eclipse"))
    safe = faults(run_or_resume("inspection_faults", options.runs, options.out / "faults"))
    sys.exit(0 if table.holds and safe else 1)


if __name__ == "__main__":
    main()
