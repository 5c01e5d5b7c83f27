"""Filter and formation over missions that nobody tuned for, with one tuning: one table campaign a group of variants.

python experiments/unseen_missions/filter_table.py --out DIR [--runs 256] [--seed 11] [--only NAME ...]
"""

import argparse
import json
import math
import os
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

os.environ.setdefault("XLA_FLAGS", f"--xla_force_host_platform_device_count={os.cpu_count()}")

import numpy as np

import rpojax
from rpojax.scenario.loading import scenario_loader

DISPERSED = "dispersed"
"""In place of a value: drawn for each run as `inspection` declares."""
CHECKED_HISTORIES = 4
"""Runs of a variant whose formation error is recomputed from their histories."""

NOMINAL: dict[str, Any] = {
    "formation.desired_position_m": (0.0, -30.0, 0.0),
    "limits.keep_out_m": 10.0,
    "target.tumble_rate_deg_s": DISPERSED,
    "target.scale": 1.0,
    "navigation.target_size_sigma": 0.0,
    "camera.edge_noise_px": 1.0,
    "navigation.edge_noise_px": 1.0,
    "orbit.semi_major_axis_m": 6878137.0,
    "orbit.eccentricity": 0.001,
    "orbit.inclination_deg": 97.4,
    "orbit.raan_deg": 77.0,
}
"""Values of a run without changes, by key."""


@dataclass(frozen=True)
class Variant:
    """A mission: its changes to `inspection`, and whether the bars of the filter apply to it."""

    changes: Mapping[str, Any] = field(default_factory=dict)
    epoch_utc: str = "2026-03-20T14:46:00"
    is_barred: bool = True

    @property
    def values(self) -> dict[str, Any]:
        """Value of every key."""
        return {**NOMINAL, **self.changes}


def station(x_m: float, y_m: float, z_m: float, keep_out_m: float = 10.0) -> dict[str, Any]:
    """Changes for another station."""
    return {"formation.desired_position_m": (x_m, y_m, z_m), "limits.keep_out_m": keep_out_m}


def wrong_size(factor: float, sigma: float) -> dict[str, Any]:
    """Changes for a true size that is the believed one times a factor."""
    return {"target.scale": factor, "navigation.target_size_sigma": sigma}


TUMBLE = "target.tumble_rate_deg_s"
VARIANTS: dict[str, Variant] = {
    "30 m": Variant(),
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
    """Simulates the variants and writes the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--runs", type=int, default=256)
    parser.add_argument("--seed", type=int, default=11)
    parser.add_argument("--only", nargs="*", choices=VARIANTS, default=list(VARIANTS))
    options = parser.parse_args()
    rows: dict[str, dict[str, float]] = {}
    for epoch in dict.fromkeys(VARIANTS[name].epoch_utc for name in options.only):
        names = [name for name in options.only if VARIANTS[name].epoch_utc == epoch]
        file = table_scenario(names, options.runs, options.seed)
        folder = options.out / epoch[:10]
        first = np.arange(len(names)) * options.runs
        kept = (first[:, None] + np.arange(min(CHECKED_HISTORIES, options.runs))).ravel().tolist()
        campaign = rpojax.run_campaign(file, len(names) * options.runs, folder, options.seed, histories=kept)
        for place, name in enumerate(names):
            rows[name] = summary(campaign, slice(place * options.runs, (place + 1) * options.runs), name)
    (options.out / "table.json").write_text(json.dumps({"seed": options.seed, "runs": options.runs, "rows": rows}))
    print(markdown(rows, options.runs, options.seed))


def table_scenario(names: Sequence[str], runs: int, seed: int) -> rpojax.ScenarioFile:
    """`inspection` with one row of a table for every run of the variants."""
    tables = rpojax.load("inspection").model_dump(mode="json")
    rates = next(each for each in tables["dispersions"] if each["key"] == TUMBLE)
    tables["dispersions"] = [each for each in tables["dispersions"] if each["key"] != TUMBLE]
    tables["epoch_utc"] = VARIANTS[names[0]].epoch_utc
    rng = np.random.default_rng(seed)
    columns: dict[str, list[float]] = {}
    for name in names:
        drawn = rng.uniform(rates["low"], rates["high"], runs).tolist()
        for key, value in VARIANTS[name].values.items():
            if isinstance(value, tuple):
                for index, component in enumerate(value):
                    columns.setdefault(f"{key}[{index}]", []).extend([component] * runs)
            else:
                columns.setdefault(key, []).extend(drawn if value == DISPERSED else [value] * runs)
    tables["design"] = {"kind": "table", "values": columns}
    return scenario_loader.validate(tables)


def summary(campaign: rpojax.Campaign, rows: slice, name: str) -> dict[str, float]:
    """Figures of one variant."""
    metrics = {key: values[rows] for key, values in campaign.metrics.items()}
    outcomes = campaign.outcomes[rows]
    target = np.array(VARIANTS[name].values["formation.desired_position_m"])
    coverage, nees = metrics["sigma3_coverage"], metrics["nees_relative_mean"] / 6.0
    defined = np.isfinite(coverage)
    formation = float(np.nanmedian(metrics["formation_error_rms_m"]))
    return {
        "formation_error_m": formation,
        "of_range_percent": 100.0 * formation / float(np.linalg.norm(target)),
        "recomputed_difference_m": recomputed_difference(campaign, rows, target),
        "coverage_percent": 100.0 * float(np.mean(coverage[defined])),
        "low_runs_percent": 100.0 * float(np.mean(coverage[defined] < 0.95)),
        "nees_over_6": float(np.mean(nees[defined])),
        "navigation_error_m": float(np.nanmedian(metrics["nav_relative_position_error_rms_m"])),
        "completed": int(np.sum(outcomes == "completed")),
        **{kind: int(np.sum(outcomes == kind)) for kind in sorted(set(outcomes.tolist()) - {"completed"})},
    }


def recomputed_difference(campaign: rpojax.Campaign, rows: slice, target: np.ndarray) -> float:
    """Largest difference of the recorded formation error from that of the kept histories [m]."""
    differences = [0.0]
    for run in range(rows.start, rows.start + CHECKED_HISTORIES):
        if run in campaign.history_ids and np.isfinite(campaign.metrics["formation_error_rms_m"][run]):
            rho_H = np.asarray(campaign.history(run)["rho_H"], dtype=np.float64)[-1000:]
            error = math.sqrt(np.mean(np.sum((rho_H - target) ** 2, axis=1)))
            differences.append(abs(error - float(campaign.metrics["formation_error_rms_m"][run])))
    return max(differences)


def markdown(rows: Mapping[str, Mapping[str, float]], runs: int, seed: int) -> str:
    """Table of all variants; what misses a bar is in bold."""
    lines = [
        f"{runs} runs each, seed {seed}.",
        "",
        "| mission | formation error, median | of the range | recorded less recomputed | 3-sigma coverage "
        "| runs below 95 % | relative NEES / 6 | navigation error, median | outcomes |",
        "|---|---|---|---|---|---|---|---|---|",
    ]
    for name, row in rows.items():
        others = {kind: row[kind] for kind in row if isinstance(row[kind], int) and kind != "completed"}
        outcomes = ", ".join([f"{row['completed']} completed", *(f"{count} {kind}" for kind, count in others.items())])
        cells = [
            name,
            f"{row['formation_error_m']:.3f} m",
            _marked(f"{row['of_range_percent']:.2f} %", row["of_range_percent"] <= 4.0),
            f"{row['recomputed_difference_m']:.1e} m",
            _marked(f"{row['coverage_percent']:.2f} %", row["coverage_percent"] >= 97.0),
            _marked(f"{row['low_runs_percent']:.1f} %", row["low_runs_percent"] <= 5.0),
            _marked(f"{row['nees_over_6']:.2f}", 0.45 <= row["nees_over_6"] <= 1.5),
            f"{row['navigation_error_m']:.3f} m",
            outcomes,
        ]
        lines.append(f"| {' | '.join(cells)} |")
    return "\n".join(lines)


def _marked(text: str, is_good: bool) -> str:
    return text if is_good else f"**{text}**"


if __name__ == "__main__":
    main()
