"""Filter and formation over missions that nobody tuned for, with one tuning: one table campaign an epoch.

python experiments/unseen_missions/filter_table.py --out DIR [--runs 256] [--seed 11] [--only NAME ...]
"""

import math
from typing import Any

import mission_campaigns
import numpy as np
from mission_campaigns import Variant, mean, percent

import rpojax

CHECKED_HISTORIES = 4
"""Runs of a variant whose formation error is recomputed from their histories."""
STATION = "formation.desired_position_m"
TUMBLE = "target.tumble_rate_deg_s"


def station(x_m: float, y_m: float, z_m: float, keep_out_m: float = 10.0) -> dict[str, Any]:
    """Changes for another station."""
    return {STATION: (x_m, y_m, z_m), "limits.keep_out_m": keep_out_m}


def wrong_size(factor: float, sigma: float) -> dict[str, Any]:
    """Changes for a true size that is the believed one times a factor."""
    return {"target.scale": factor, "navigation.target_size_sigma": sigma}


VARIANTS: dict[str, Variant] = {
    "30 m": Variant(station(0.0, -30.0, 0.0)),
    "10 m": Variant(station(0.0, -10.0, 0.0, 4.0)),
    "20 m": Variant(station(0.0, -20.0, 0.0, 4.0)),
    "60 m": Variant(station(0.0, -60.0, 0.0)),
    "100 m": Variant(station(0.0, -100.0, 0.0)),
    "200 m": Variant(station(0.0, -200.0, 0.0)),
    "30 m cross-track": Variant(station(0.0, 0.0, 30.0)),
    "no tumble": Variant({TUMBLE: 0.0}),
    "no tumble, 10 m": Variant({**station(0.0, -10.0, 0.0, 4.0), TUMBLE: 0.0}),
    "5 deg/s": Variant({TUMBLE: 5.0}),
    "5 deg/s, 10 m": Variant({**station(0.0, -10.0, 0.0, 4.0), TUMBLE: 5.0}),
    "5 deg/s, 200 m": Variant({**station(0.0, -200.0, 0.0), TUMBLE: 5.0}),
    "edge noise 2 px believed 1.5": Variant({"camera.edge_noise_px": 2.0, "navigation.edge_noise_px": 1.5}),
    "size 1.2 of the belief, sigma 0.2": Variant(wrong_size(1.2, 0.2)),
    "size 1/1.2 of the belief, sigma 0.2": Variant(wrong_size(1.0 / 1.2, 0.2)),
    "size 1.5 of the belief, sigma 0.5": Variant(wrong_size(1.5, 0.5)),
    "size 1/1.5 of the belief, sigma 0.5": Variant(wrong_size(1.0 / 1.5, 0.5)),
    "geostationary radius": Variant({"orbit.semi_major_axis_m": 42164172.0}),
    "e = 0.1, a = 7.8e6 m": Variant({"orbit.semi_major_axis_m": 7.8e6, "orbit.eccentricity": 0.1}),
    # At the solstice the Sun is 63 deg out of this plane; above 1200 km that is enough for an orbit without shadow.
    "inclination 140 deg, no eclipse": Variant(
        {"orbit.inclination_deg": 140.0, "orbit.raan_deg": 0.0, "orbit.semi_major_axis_m": 7.6e6},
        epoch_utc="2026-06-21T08:24:00",
    ),
}
"""Missions by name."""


def main() -> None:
    """Simulates the variants and prints the table; what misses a bar is in bold."""
    parser = mission_campaigns.parser(__doc__, runs=256)
    parser.add_argument("--only", nargs="*", choices=VARIANTS, default=list(VARIANTS))
    options = parser.parse_args()
    print(f"{options.runs} runs each, seed {options.seed}.\n")
    mission_campaigns.header(
        "mission",
        "formation error, median",
        "of the range",
        "recorded less recomputed",
        "3-sigma coverage",
        "runs below 95 %",
        "relative NEES / 6",
        "navigation error, median",
        "outcomes",
    )
    variants = {name: VARIANTS[name] for name in options.only}
    for name, campaign, rows in mission_campaigns.variant_campaigns(variants, options, CHECKED_HISTORIES):
        mission_campaigns.row(
            name, *cells(campaign, rows, np.asarray(VARIANTS[name].changes.get(STATION, (0, -30, 0))))
        )


def cells(campaign: rpojax.Campaign, rows: slice, station_H: np.ndarray) -> list[str]:
    """Figures of one variant."""
    metrics = {key: values[rows] for key, values in campaign.metrics.items()}
    formation = float(np.nanmedian(metrics["formation_error_rms_m"]))
    of_range = formation / float(np.linalg.norm(station_H))
    coverage = metrics["sigma3_coverage"][np.isfinite(metrics["sigma3_coverage"])]
    low_runs, nees = float(np.mean(coverage < 0.95)), mean(metrics["nees_relative_mean"]) / 6.0
    return [
        f"{formation:.3f} m",
        _marked(percent(of_range, 2), of_range <= 0.04),
        f"{recomputed_difference(campaign, rows, station_H):.1e} m",
        _marked(percent(mean(coverage), 2), mean(coverage) >= 0.97),
        _marked(percent(low_runs), low_runs <= 0.05),
        _marked(f"{nees:.2f}", 0.45 <= nees <= 1.5),
        f"{np.nanmedian(metrics['nav_relative_position_error_rms_m']):.3f} m",
        mission_campaigns.outcome_counts(campaign.outcomes[rows]),
    ]


def recomputed_difference(campaign: rpojax.Campaign, rows: slice, station_H: np.ndarray) -> float:
    """Largest difference of the recorded formation error from that of the kept histories [m]."""
    differences = [0.0]
    for run in range(rows.start, rows.start + CHECKED_HISTORIES):
        if run in campaign.history_ids and np.isfinite(campaign.metrics["formation_error_rms_m"][run]):
            rho_H = np.asarray(campaign.history(run)["rho_H"], dtype=np.float64)[-1000:]
            error = math.sqrt(np.mean(np.sum((rho_H - station_H) ** 2, axis=1)))
            differences.append(abs(error - float(campaign.metrics["formation_error_rms_m"][run])))
    return max(differences)


def _marked(text: str, is_good: bool) -> str:
    return text if is_good else f"**{text}**"


if __name__ == "__main__":
    main()
