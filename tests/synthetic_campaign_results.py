"""Synthetic campaign results with the attributes of a stored campaign, for tests without the simulator."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from rpojax.campaign.execution.teams import joined_history
from rpojax.campaign.storage.campaign_folder import of_servicer
from rpojax.simulation.outcomes import outcome_kinds
from rpojax.simulation.outcomes.outcome_events import OutcomeEvent

_MODE_LOOK, _MODE_TURN, _MODE_BURN, _MODE_TURN_BACK = 0, 1, 2, 3


@dataclass
class SyntheticCampaign:
    directory: Path
    info: dict[str, Any]
    metrics: dict[str, np.ndarray]
    completed: np.ndarray
    failed_at_s: np.ndarray
    failure_reason: np.ndarray
    outcomes: np.ndarray
    drawn: dict[str, np.ndarray]
    trace_time_s: np.ndarray
    traces: dict[str, np.ndarray]
    histories: dict[int, dict[str, np.ndarray]]
    is_judged: np.ndarray
    events: list[OutcomeEvent]
    coverage: dict[str, np.ndarray] = field(default_factory=dict)
    surface: dict[str, np.ndarray] = field(default_factory=dict)
    phases: dict[str, np.ndarray] = field(default_factory=dict)
    phase_names: tuple[str, ...] = ()
    signs: dict[str, np.ndarray] = field(default_factory=dict)
    servicer_names: tuple[str, ...] = ()
    servicer_groups: dict[str, dict[str, np.ndarray]] = field(default_factory=dict)

    @property
    def run_ids(self) -> np.ndarray:
        return np.arange(len(self.completed))

    @property
    def failed(self) -> np.ndarray:
        return outcome_kinds.is_failed(self.outcomes)

    @property
    def reached_end(self) -> np.ndarray:
        return ~outcome_kinds.is_frozen(self.outcomes)

    @property
    def history_ids(self) -> list[int]:
        return list(self.histories)

    def history(self, run_id: int, servicer: int | None = None) -> dict[str, np.ndarray]:
        history = self.histories[run_id]
        return history if servicer is None or not self.servicer_names else of_servicer(history, servicer)

    def servicers(self, group: str) -> dict[str, np.ndarray]:
        return self.servicer_groups.get(group, {})


def synthetic_campaign(
    directory: Path, runs: int = 40, seconds: int = 600, kept: tuple[int, ...] = (0, 1, 2), failed: tuple[int, ...] = ()
) -> SyntheticCampaign:
    """Campaign whose numbers look like those of an inspection; runs in `failed` stop half way."""
    rng = np.random.default_rng(7)
    failed_at = np.full(runs, np.nan)
    failed_at[list(failed)] = seconds // 2
    completed = np.isnan(failed_at)
    time = np.arange(0.0, seconds + 1.0, max(1, seconds // 300))
    mass = rng.normal(24.0, 0.4, runs)
    return SyntheticCampaign(
        directory=directory,
        info=_info(runs, seconds),
        metrics=_metrics(rng, mass, completed),
        completed=completed,
        failed_at_s=failed_at,
        failure_reason=np.where(completed, "", "entered the keep-out sphere"),
        outcomes=np.where(completed, "completed", "keep_out").astype("<U20"),
        drawn={
            "servicer.mass_kg": mass,
            "camera.misalignment_deg": rng.normal(0.0, 0.1, (runs, 3)),
            "gps.noise_m": rng.uniform(1.0, 3.0, runs),
            "thruster.on": np.ones(runs),
        },
        trace_time_s=time,
        traces=_traces(rng, time, failed_at),
        histories={run: _history(rng, seconds, float(failed_at[run])) for run in kept if run < runs},
        is_judged=np.ones(runs, bool),
        events=[],
    )


def synthetic_team(directory: Path, names: tuple[str, ...] = ("near", "far"), **choices: Any) -> SyntheticCampaign:
    """Campaign of servicers side by side, each with the numbers of a campaign of its own that are `number` % greater.

    Metrics of the team are those of the first one, with a news fraction and the distance between servicers.
    """
    campaign = synthetic_campaign(directory, **choices)
    count, runs = len(names), len(campaign.completed)
    factors = 1.0 + 0.01 * np.arange(count)
    own = {name: values[:, None] * factors for name, values in campaign.metrics.items()}
    campaign.servicer_names = names
    campaign.servicer_groups = {
        "metrics": own,
        "status": {"failure": np.zeros((runs, count), np.int8), "failed_at_s": np.full((runs, count), np.nan)},
    }
    campaign.metrics |= {
        f"{name}/{servicer}": values[:, number] for name, values in own.items() for number, servicer in enumerate(names)
    }
    campaign.metrics |= {
        "news_fraction": np.linspace(0.8, 0.9, runs),
        "min_separation_m": np.linspace(20.0, 30.0, runs),
    }
    campaign.histories = {
        run: joined_history([{**history, "rho_H": history["rho_H"] * factor} for factor in factors])
        for run, history in campaign.histories.items()
    }
    campaign.info["scenario"] |= {
        "navigation": {"sharing": "boxes"},
        "servicers": [{"name": name} for name in names],
        "link": {
            "period_s": 2.0,
            "delay_s": 3.0,
            "loss": 0.3,
            "burst_loss": 0.95,
            "burst_interval_s": 300.0,
            "burst_duration_s": 20.0,
            "outages_s": [[100.0, 200.0]],
            "hears": [["near", "far"], ["far", "near"]],
        },
        "gps_differences": {"kind": "carrier", "noise_m": 0.05, "slow_error_m": 0.007},
    }
    return campaign


def _info(runs: int, seconds: int) -> dict[str, Any]:
    return {
        "name": "inspection",
        "description": "A servicer holds 30 m behind an uncooperative target & watches it, camera <visible light>.",
        "scenario": {
            "duration_s": seconds,
            "servicer": {"mass_kg": 24.0},
            "camera": {"model": "geometric", "misalignment_deg": [0.0, 0.0, 0.0]},
            "limits": {"keep_out_m": 10.0},
            "dispersions": [
                {"key": "servicer.mass_kg", "kind": "normal", "sigma": 0.4},
                {"key": "camera.misalignment_deg", "kind": "normal", "sigma": 0.1},
                {"key": "gps.noise_m", "kind": "uniform", "low": 1.0, "high": 3.0},
            ],
            "note": "</script><script>alert(1)</script>",
        },
        "scenario_hash": "3f6c0a9d51e2",
        "seed": 1,
        "runs": runs,
        "block_size": 256,
        "versions": {"rpojax": "0.1.0", "jax": "0.10.2", "numpy": "2.4.6", "python": "3.11.7"},
        "device": "cpu",
        "dtype": "float64",
        "created": "2026-01-01T00:00:00Z",
        "timing": {"compile_s": 21.3, "run_s": 4.2, "run_seconds_per_s": 357142.9, "devices": 2},
    }


def _metrics(rng: np.random.Generator, mass: np.ndarray, completed: np.ndarray) -> dict[str, np.ndarray]:
    runs = len(mass)
    metrics = {
        "formation_error_rms_m": rng.lognormal(np.log(0.42), 0.3, runs) + 0.2 * (mass - 24.0),
        "nav_relative_position_error_rms_m": rng.lognormal(np.log(0.16), 0.25, runs),
        "nav_servicer_position_error_rms_m": rng.lognormal(np.log(1.1), 0.2, runs),
        "nav_target_position_error_rms_m": rng.lognormal(np.log(1.1), 0.2, runs),
        "nees_mean": rng.chisquare(120, runs) / 10.0,
        "nees_relative_mean": rng.chisquare(60, runs) / 10.0,
        "sigma3_coverage": 1.0 - rng.beta(1.0, 200.0, runs),
        "delta_v_m_s": rng.normal(0.32, 0.03, runs) - 0.02 * (mass - 24.0),
        "min_range_m": rng.normal(28.9, 0.4, runs),
        "detection_rate": np.full(runs, 0.95),
        "visible_fraction": rng.beta(90, 10, runs),
        "boxes_rejected": rng.poisson(6, runs).astype(float),
        "time_to_acquire_s": rng.integers(1, 6, runs).astype(float),
        "pointing_error_p95_deg": rng.lognormal(np.log(0.4), 0.2, runs),
        "wheel_speed_peak_fraction": rng.beta(30, 60, runs),
        "good_boxes_rejected_fraction": rng.beta(1, 300, runs),
        "outliers_accepted": np.zeros(runs),
        "look_away_peak_s": np.full(runs, np.nan),
    }
    return {name: np.where(completed, values, np.nan) for name, values in metrics.items()}


def _traces(rng: np.random.Generator, time: np.ndarray, failed_at: np.ndarray) -> dict[str, np.ndarray]:
    runs, steps = len(failed_at), len(time)
    noise = rng.lognormal(0.0, 0.35, (runs, steps))
    level = rng.lognormal(0.0, 0.3, (runs, 1))
    decay = np.exp(-time / (0.12 * time[-1]))
    peaks = 1.0 + 1.2 * (np.mod(time, 200.0) > 165.0)
    traces = {
        "formation_error_m": 20.0 * decay + 0.4 * level * noise,
        "nav_relative_error_m": (3.0 * decay + 0.14 * peaks) * level * noise,
        "nav_relative_sigma3_m": (9.0 * decay + 0.45 * peaks) * level,
        "nav_servicer_error_m": 1.0 * noise,
        "nav_target_error_m": 1.1 * noise,
        "range_m": 30.0 + 20.0 * decay + 0.3 * (level - 1.0) * np.sin(time / 300.0),
        "delta_v_m_s": 0.32 * level**0.2 * np.floor(1.0 + time / 200.0) / np.floor(1.0 + time[-1] / 200.0),
        "nees": rng.chisquare(12, (runs, steps)),
        "nees_relative": rng.chisquare(6, (runs, steps)),
        "wheel_speed_fraction": 0.3 * noise,
    }
    ended = time[None, :] > np.where(np.isnan(failed_at), np.inf, failed_at)[:, None]
    return {name: np.where(ended, np.nan, values).astype(np.float32) for name, values in traces.items()}


def _mode(time: np.ndarray) -> np.ndarray:
    phase = np.mod(time, 200.0)
    mode = np.where((phase >= 165) & (phase < 178), _MODE_TURN, _MODE_LOOK)
    mode = np.where((phase >= 178) & (phase < 183), _MODE_BURN, mode)
    return np.where((phase >= 183) & (phase < 196), _MODE_TURN_BACK, mode)


def _history(rng: np.random.Generator, seconds: int, failed_at_s: float) -> dict[str, np.ndarray]:
    time = np.arange(0.0, seconds + 1.0)
    mode = _mode(time)
    steps, tail = len(time), np.exp(-time / (0.12 * seconds))[:, None]
    wave = 0.3 * np.sin(time[:, None] / np.array([90.0, 130.0, 70.0]))
    rho = np.array([0.0, -30.0, 0.0]) + np.array([3.0, -20.0, 1.0]) * tail + wave
    sigma = np.array([0.03, 0.11, 0.03]) * (1.0 + 20.0 * tail + 1.5 * (mode != _MODE_LOOK)[:, None])
    error = sigma * np.cumsum(rng.normal(size=(steps, 3)), axis=0) / np.sqrt(np.arange(1, steps + 1))[:, None]
    absolute = 0.4 * np.sin(time[:, None] / np.array([400.0, 310.0, 500.0]))
    present = (mode == _MODE_LOOK) & (rng.random(steps) > 0.05)
    outlier = present & (rng.random(steps) > 0.97)
    distance = np.linalg.norm(rho, axis=1)
    spread = np.where(outlier, 0.08, 0.004)[:, None]
    bearing = -rho / distance[:, None] + spread * rng.normal(size=(steps, 3))
    box_range = distance * np.where(outlier, rng.lognormal(0.0, 0.6, steps), rng.normal(1.0, 0.03, steps))
    history = {
        "rho_H": rho,
        "rho_estimate_H": rho + error,
        "range_m": distance.copy(),
        "relative_error_H": error,
        "relative_sigma_H": sigma,
        "servicer_error_H": absolute,
        "servicer_sigma_H": np.full((steps, 3), 0.5),
        "target_error_H": absolute + error,
        "target_sigma_H": np.sqrt(0.25 + sigma**2),
        "nees": rng.chisquare(12, steps),
        "nees_relative": rng.chisquare(6, steps),
        "box_bearing_H": np.where(present[:, None], bearing, np.nan),
        "box_range_m": np.where(present, box_range, np.nan),
        "box_px": np.full((steps, 4), 40.0),
        "pointing_error_deg": np.abs(rng.normal(0.3, 0.1, steps)),
        "wheel_speed_fraction": np.full((steps, 3), 0.2),
        "delta_v_m_s": 0.3 * time / seconds,
        "mass_kg": np.full(steps, 24.0),
    }
    ended = time > failed_at_s
    for values in history.values():
        values[ended] = np.nan
    flags = {"box_present": present, "box_accepted": present & ~outlier, "box_outlier": outlier}
    flags |= {"box_truncated": np.zeros(steps, bool), "observable": np.ones(steps, bool)}
    flags = {name: values & ~ended for name, values in flags.items()}
    return {"time_s": time, "rho_desired_H": np.array([0.0, -30.0, 0.0]), "mode": mode, **history, **flags}
