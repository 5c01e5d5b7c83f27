"""False alarms and missed detections of the health tests on board; prints one Markdown table.

python experiments/unseen_missions/navigation_health.py --out out/navigation_health [--runs 64]

The exit status is 1 if a packaged mission has false alarms for more than a hundredth of its time, or if a run with a
wrong size enters the keep-out sphere.
"""

import math
from collections.abc import Iterator

import mission_campaigns
import numpy as np
from filter_table import TUMBLE, station, wrong_size
from mission_campaigns import Case, Variant, mean, percent

import rpojax
from rpojax.flight.navigation_health import TESTS
from rpojax.metrics.navigation_health import BAD_ERROR, BAD_NEES
from rpojax.simulation.outcomes.outcome_kinds import Outcome

PACKAGED = [Case(name, name) for name in ("inspection", "inspection_cold", "inspection_eclipse")]
SOUND = {
    "10 m": Variant(station(0.0, -10.0, 0.0, 4.0)),
    "200 m": Variant(station(0.0, -200.0, 0.0)),
    "30 m cross-track": Variant(station(0.0, 0.0, 30.0)),
    "no tumble": Variant({TUMBLE: 0.0}),
    "5 deg/s": Variant({TUMBLE: 5.0}),
    "edge noise 2 px believed 1.5": Variant({"camera.edge_noise_px": 2.0, "navigation.edge_noise_px": 1.5}),
    "size 1.5 of the belief, sigma 0.5": Variant(wrong_size(1.5, 0.5)),
    "size 1/1.5 of the belief, sigma 0.5": Variant(wrong_size(1.0 / 1.5, 0.5)),
    "geostationary radius": Variant({"orbit.semi_major_axis_m": 42164172.0}),
    "e = 0.1, a = 7.8e6 m": Variant({"orbit.semi_major_axis_m": 7.8e6, "orbit.eccentricity": 0.1}),
    "GPS noise tenfold": Variant({"gps.noise_m": 20.0}),
}
WRONG_SIZE = {
    f"size believed {text} times": Variant({"navigation.target_size_m": 1.063 * factor})
    for text, factor in (("1/3", 1.0 / 3.0), ("1/2", 0.5), ("1/1.5", 1.0 / 1.5), ("1.5", 1.5), ("2", 2.0), ("3", 3.0))
}
WRONG_BURNS = {
    "mass 90 kg believed 30": Variant({"servicer.mass_kg": 90.0}),
    "mass 45 kg believed 30": Variant({"servicer.mass_kg": 45.0}),
    "mass 20 kg believed 30": Variant({"servicer.mass_kg": 20.0}),
    "thrust 0.7 of the belief": Variant({"thruster.force_scale": 0.7}),
    "thrust 1.4 of the belief": Variant({"thruster.force_scale": 1.4}),
    "thrust direction off by 3 deg": Variant({"thruster.misalignment_deg": (0.0, 3.0, 0.0)}),
    "thrust direction off by 10 deg": Variant({"thruster.misalignment_deg": (0.0, 10.0, 0.0)}),
}
WRONG_CAMERA = {
    "edge noise 4 px believed 1": Variant({"camera.edge_noise_px": 4.0}),
    "camera direction off by 1 deg": Variant({"camera.misalignment_deg": (0.0, 1.0, 0.0)}),
    "30 % outliers, 50 % misses": Variant({"camera.outlier_probability": 0.3, "camera.miss_probability": 0.5}),
}
MOST_FALSE_ALARMS = 0.01
HISTORIES = 8
"""Runs of a mission from whose histories the ranges are, and what is missed without the test of control effort."""
EFFORT = TESTS.index("control_effort")
REGAIN = 0.7
"""`health.regain` of all these missions."""


def main() -> int:
    options = mission_campaigns.parser(__doc__, runs=64).parse_args()
    mission_campaigns.header(
        "mission",
        "confident",
        "false alarms",
        "missed",
        "missed without the test of control effort",
        "range at the first loss of confidence, median",
        "least range after it",
        "range at the end, median and largest",
        "keep-out",
    )
    failed = False
    for name, campaign, rows in _missions(options):
        metrics = {key: values[rows] for key, values in campaign.metrics.items()}
        entered = int((campaign.outcomes[rows] == Outcome.KEEP_OUT).sum())
        false_alarms = mean(metrics["health_false_alarm_fraction"])
        failed |= name in {case.name for case in PACKAGED} and false_alarms > MOST_FALSE_ALARMS
        failed |= name in WRONG_SIZE and entered > 0
        mission_campaigns.row(
            name,
            percent(mean(metrics["confident_fraction"])),
            percent(false_alarms, 2),
            percent(mean(metrics["health_missed_fraction"])),
            *from_histories([campaign.history(run) for run in range(rows.start, rows.start + HISTORIES)]),
            f"{entered} of {options.runs}",
        )
    return int(failed)


def _missions(options: mission_campaigns.Options) -> Iterator[tuple[str, rpojax.Campaign, slice]]:
    """Name of each mission, the campaign that holds it, and its runs there."""
    for case, campaign in mission_campaigns.campaigns(PACKAGED, options, HISTORIES):
        yield case.name, campaign, slice(0, options.runs)
    variants = {**SOUND, **WRONG_SIZE, **WRONG_BURNS, **WRONG_CAMERA}
    yield from mission_campaigns.variant_campaigns(variants, options, HISTORIES)


def from_histories(histories: list[dict[str, np.ndarray]]) -> list[str]:
    """Missed detections without the test of control effort, and ranges where confidence was lost and after it."""
    missed, at_loss, least, end = [], [], [], []
    for history in histories:
        distance = history["range_m"]
        error = np.linalg.norm(history["relative_error_H"], axis=1)
        wrong = (history["nees_relative"] > BAD_NEES) | (error > BAD_ERROR * distance)
        missed.append(mean(confidence_without_effort(history["health_ratios"])[wrong].astype(float)))
        lost = np.flatnonzero(~history["nav_confident"])
        at_loss.append(distance[lost[0]] if lost.size else math.nan)
        least.append(distance[lost[0] :].min() if lost.size else math.nan)
        end.append(distance[-1])
    if not np.isfinite(at_loss).any():
        return [percent(mean(np.array(missed))), "-", "-", f"{np.median(end):.0f} m, {np.max(end):.0f} m"]
    return [
        percent(mean(np.array(missed))),
        f"{np.nanmedian(at_loss):.0f} m",
        f"{np.nanmin(least):.0f} m",
        f"{np.median(end):.0f} m, {np.max(end):.0f} m",
    ]


def confidence_without_effort(ratios: np.ndarray) -> np.ndarray:
    """Confidence at every tick by the other tests of the relative estimate, on the same histories."""
    worst = np.delete(ratios, EFFORT, axis=1)[:, 1:].max(axis=1)
    confident = np.empty(len(worst), dtype=bool)
    now = True
    for tick, value in enumerate(worst):
        now = bool(value < (1.0 if now else REGAIN))
        confident[tick] = now
    return confident


if __name__ == "__main__":
    raise SystemExit(main())
