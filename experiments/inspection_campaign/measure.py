"""Figures of the inspection mission: errors, consistency, outliers, look-aways, wheels; prints one Markdown table.

python experiments/inspection_campaign/measure.py --out out/measure [--runs 2000] [--outlier-runs 500]

The exit status is 1 if a row of the table does not hold.
"""

import argparse
import os
from pathlib import Path

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.analysis.statistics.tolerance_bounds import quantile_upper_bound
from rpojax.campaign.storage.campaign_folder import Campaign
from rpojax.flight.guidance.pointing_modes import Mode

HISTORIES = 64
SETTLED_S = 1000.0
"""Start of the interval of the navigation metrics."""


def campaign(scenario: str, overrides: list[str], runs: int, out: Path) -> Campaign:
    """Campaign of a scenario with overrides; an existing one is resumed."""
    if (out / "campaign.json").exists():
        return rpojax.resume_campaign(out)
    file = rpojax.load(scenario, overrides)
    return rpojax.run_campaign(file, runs, out, seed=0, histories=range(min(runs, HISTORIES)))


_failed_rows: list[str] = []


def row(what: str, bar: str, value: str, holds: bool) -> None:
    """Prints a row of the table and records it if its bound is not met."""
    if not holds:
        _failed_rows.append(what)
    print(f"| {what} | {bar} | {value} | {'yes' if holds else '**no**'} |", flush=True)


def errors(name: str, result: Campaign, medians: dict[str, float], formation_p99: float) -> None:
    """Rows for the navigation and formation errors."""
    for metric, bar in medians.items():
        median = float(np.nanmedian(result.metrics[metric]))
        row(f"{name}: median of `{metric}`", f"<= {bar} m", f"{median:.3f} m", median <= bar)
    formation = result.metrics["formation_error_rms_m"]
    # A failed run has no value, and counts as worse than any other.
    bound = quantile_upper_bound(np.where(result.completed, formation, np.inf), 0.99, 0.95)
    p99 = float(np.nanpercentile(formation, 99))
    shown = f"{p99:.2f} m, one-sided 95 % bound {bound:.2f} m" if bound is not None else f"{p99:.2f} m"
    row(f"{name}: p99 of `formation_error_rms_m`", f"<= {formation_p99} m", shown, (bound or p99) <= formation_p99)
    failed = int((~result.completed).sum())
    row(f"{name}: failed runs", "reported", f"{failed} of {result.completed.size}", True)


def consistency(result: Campaign) -> None:
    coverage = float(np.nanmean(result.metrics["sigma3_coverage"]))
    row("`sigma3_coverage`", "97 to 99.95 %", f"{100 * coverage:.2f} %", 0.97 <= coverage <= 0.9995)
    nees = float(np.nanmean(result.metrics["nees_mean"])) / 12.0
    row("mean `nees_mean` over 12", "0.7 to 1.5", f"{nees:.2f}", 0.7 <= nees <= 1.5)
    longest = float(np.nanmax(result.metrics["longest_unseen_s"]))
    row("longest time without an accepted box, any run", "no run loses the target", f"{longest:.0f} s", longest < 200.0)
    growth = np.array([pair for run in result.history_ids for pair in look_away_growth(result.history(run))])
    settled = growth[:, 0] >= SETTLED_S * result.file.rates.camera_hz
    uncertainty_row("every look-away", growth[:, 1:])
    uncertainty_row(f"look-aways after {SETTLED_S:.0f} s", growth[settled, 1:])


def uncertainty_row(which: str, growth: np.ndarray) -> None:
    """Row on the bearing uncertainty over look-aways, from its factors while blind and in the minute after."""
    grown, fallen = growth[:, 0] > 1.0, growth[:, 1] < 1.0
    row(
        f"bearing uncertainty over {which} ({len(growth)}): grows, then falls",
        "every one",
        f"grows in {100 * grown.mean():.1f} % (median x{np.median(growth[:, 0]):.2f}), "
        f"falls in {100 * fallen.mean():.1f} % (median x{np.median(growth[:, 1]):.2f} within 60 s)",
        bool(grown.all() and fallen.all()),
    )


def look_away_growth(history: dict[str, np.ndarray]) -> list[tuple[float, float, float]]:
    """For each look-away its tick, and the factors of the uncertainty while blind and in the minute after."""
    sigma = history["relative_sigma_H"]
    bearing = np.hypot(sigma[:, 0], sigma[:, 2]) / np.linalg.norm(history["rho_estimate_H"], axis=1)
    seen = np.flatnonzero(history["box_accepted"])
    starts = np.flatnonzero((history["mode"][1:] == Mode.TURN) & (history["mode"][:-1] != Mode.TURN)) + 1
    pairs = []
    for start in starts:
        before, after = seen[seen < start + 3], seen[seen > start + 10]
        if before.size and after.size and after[0] + 60 < sigma.shape[0]:
            blind_end = after[0] - 1
            pairs.append(
                (start, bearing[blind_end] / bearing[before[-1]], bearing[blind_end + 60] / bearing[blind_end])
            )
    return pairs


def outliers(gated: Campaign, clean: Campaign, open_gate: Campaign) -> None:
    formation = "formation_error_rms_m"
    with_outliers, without = (float(np.nanmedian(c.metrics[formation])) for c in (gated, clean))
    ratio = with_outliers / without
    row("median formation error, outliers and gate, over that without outliers", "<= 1.5", f"{ratio:.2f}", ratio <= 1.5)
    loose = float(np.nanmedian(open_gate.metrics[formation])) / without
    row("the same with outliers and no gate", ">= 1.5", f"{loose:.0f}", loose >= 1.5)
    wrong = float(np.nanmean(gated.metrics["good_boxes_rejected_fraction"]))
    row("good boxes wrongly rejected", "<= 1 %", f"{100 * wrong:.3f} %", wrong <= 0.01)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=2000)
    parser.add_argument("--outlier-runs", type=int, default=500)
    options = parser.parse_args()
    out, few = options.out, options.outlier_runs

    warm = campaign("inspection", [], options.runs, out / "inspection")
    print("| figure | bar | measured | holds |\n|---|---|---|---|")
    position = {
        "nav_relative_position_error_rms_m": 1.3,
        "nav_servicer_position_error_rms_m": 3.0,
        "nav_target_position_error_rms_m": 3.0,
    }
    errors("inspection", warm, {"formation_error_rms_m": 1.3, **position}, 6.0)
    cold = campaign("inspection_cold", [], options.runs, out / "inspection_cold")
    errors("inspection_cold", cold, {"formation_error_rms_m": 2.0}, 10.0)
    consistency(warm)
    away = float(np.nanmax(warm.metrics["look_away_peak_s"]))
    row("longest look-away in any 200 s", "<= 110 s", f"{away:.0f} s", away <= 110.0)
    wheels = float(np.nanmax(warm.metrics["wheel_speed_peak_fraction"]))
    row("wheel speed peak over its limit, any run", "< 80 %", f"{100 * wheels:.0f} %", wheels < 0.8)
    clean = campaign("inspection", ["camera.outlier_probability=0.0"], few, out / "no_outliers")
    open_gate = campaign("inspection", ['navigation.gating="none"'], few, out / "no_gate")
    outliers(warm, clean, open_gate)
    return 1 if _failed_rows else 0


if __name__ == "__main__":
    raise SystemExit(main())
