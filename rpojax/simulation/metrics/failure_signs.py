"""Signs of what goes wrong in a run, counted in intervals of time: camera, gate, light, health tests, star tracker.

Names of arrays are those of the group `signs` of a campaign.
"""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.flight.mission.mission_state import AbortReason
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.schema import ScenarioFile
from rpojax.simulation.metrics.recorded_metrics import outside_sigmas

MAX_INTERVALS: Final = 64
"""Most intervals of a run. A choice: 140 s of `vbar_approach`, in 3 % of the disk of its traces."""
LEAST_INTERVAL_S: Final = 30.0
"""Shortest interval [s]."""
LENS_CHANNEL: Final = "wide_lens"
"""Lens of a camera that has two."""
REQUIRED_CHANNELS: Final = (
    "box_present",
    "box_accepted",
    "box_outlier",
    "box_truncated",
    "observable",
    "mode",
    "pointing_error_deg",
    "nav_confident",
    "failed_tests",
    "star_tracker_present",
    "relative_error_H",
    "relative_sigma_H",
    "running",
)
"""Channels that the signs are made of."""
COUNTS: Final = (
    "ticks",
    "dark",
    "looking",
    "in_view",
    "out_of_view",
    "good_boxes",
    "cut",
    "false_boxes",
    "good_rejected",
    "false_accepted",
    "unconfident",
    "no_star_tracker",
    "outside_3_sigma",
)
"""Signs that are numbers of ticks: all; without light; with light while the camera looks at the target or searches it;
with light and the target before the lens; of those that look the ones without it there; of those with it there the ones
with a box of it, and with one that the frame cuts; false boxes of those that look; true boxes rejected and false ones
accepted by the gate; without confidence; without star tracker; with an axis outside of 3 sigma."""
FAILED_TESTS: Final = "failed_tests"
"""Sign that is a set of bits: the health tests of `rpojax.flight.navigation_health.TESTS` that failed in a tick."""


def interval_ticks(ticks: int, tick_s: float) -> int:
    """Ticks of an interval, from those of a run and their length [s]."""
    return max(1, -(-ticks // MAX_INTERVALS), round(LEAST_INTERVAL_S / tick_s))


def evaluate(
    file: ScenarioFile, records: Mapping[str, np.ndarray], varied: Mapping[str, np.ndarray]
) -> dict[str, np.ndarray]:
    """Signs (runs, intervals) from channels (runs, ticks, ...), up to an abort or a freeze; empty without them.

    What comes after the tick in which flight software decides to abort is a consequence; a commanded abort is planned.
    `varied` holds the values (runs, ...) of the keys that vary from run to run, in their units.
    """
    if not all(name in records for name in REQUIRED_CHANNELS):
        return {}
    running = records["running"] & ~_after_abort(records)
    every = interval_ticks(running.shape[1], 1.0 / file.rates.camera_hz)
    starts = np.arange(0, running.shape[1], every)
    present, outlier, accepted = (records[f"box_{name}"] & running for name in ("present", "outlier", "accepted"))
    lit = records["observable"] & running
    looking = lit & np.isin(records["mode"], (Mode.LOOK, Mode.SEARCH))
    least_side = min(file.camera.width_px, file.camera.height_px) / file.camera.width_px
    field_of_view_deg = values_of_runs(varied, "camera.field_of_view_deg", file.camera.field_of_view_deg)
    half_deg = _half_angle_deg(least_side, field_of_view_deg)[:, None]
    if file.wide_lens is not None and LENS_CHANNEL in records:
        wide_deg = values_of_runs(varied, "wide_lens.field_of_view_deg", file.wide_lens.field_of_view_deg)
        half_deg = np.where(records[LENS_CHANNEL], _half_angle_deg(least_side, wide_deg)[:, None], half_deg)
    in_view = lit & (records["pointing_error_deg"] <= half_deg)
    good = present & ~outlier & in_view
    flags = {
        "ticks": running,
        "dark": running & ~records["observable"],
        "looking": looking,
        "in_view": in_view,
        "out_of_view": looking & ~in_view,
        "good_boxes": good,
        "cut": good & records["box_truncated"],
        "false_boxes": outlier & looking,
        "good_rejected": good & ~accepted,
        "false_accepted": outlier & accepted,
        "unconfident": running & ~records["nav_confident"],
        "no_star_tracker": running & ~records["star_tracker_present"],
        "outside_3_sigma": running & outside_sigmas(records).any(axis=2),
    }
    counts = {name: _counted(flags[name], starts) for name in COUNTS}
    tests = np.where(running, records[FAILED_TESTS], 0).astype(np.int16)
    return {**counts, FAILED_TESTS: np.bitwise_or.reduceat(tests, starts, axis=1)}


def _half_angle_deg(least_side: float, field_of_view_deg: np.ndarray) -> np.ndarray:
    """Half of the angle that a lens sees along the shorter side, `least_side` of the frame's width [deg]."""
    return np.degrees(np.arctan(least_side * np.tan(np.radians(0.5 * field_of_view_deg))))


def _after_abort(records: Mapping[str, np.ndarray]) -> NDArray[np.bool_]:
    """Flags (runs, ticks) of what comes after the tick of an abort that was not commanded; none without phases."""
    after = np.zeros(records["running"].shape, bool)
    if "abort_reason" in records:
        after[:, 1:] = ~np.isin(records["abort_reason"][:, :-1], (AbortReason.NONE, AbortReason.COMMAND))
    return after


def _counted(flags: NDArray[np.bool_], starts: NDArray[np.integer]) -> NDArray[np.int32]:
    """Number of raised flags (runs, ticks) in each interval (runs, intervals)."""
    return np.add.reduceat(flags, starts, axis=1, dtype=np.int32)
