"""Error budgets of pointing and navigation after ECSS-E-ST-60-10C, from the histories of a campaign."""

from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from typing import Any, Final

import numpy as np

from rpojax.analysis.statistics.error_budgets import (
    INDICES,
    KNOWLEDGE,
    PERFORMANCE,
    BudgetWindows,
    budget_line,
    error_indices,
)
from rpojax.analysis.statistics.tolerance_bounds import runs_for_bound
from rpojax.campaign.options.history_retention import Retention
from rpojax.report import drawn_scenarios
from rpojax.report.campaign_results import CampaignResults, runs_are_independent
from rpojax.report.labels import format_number
from rpojax.simulation.metrics.recorded_metrics import is_settled

History = Mapping[str, np.ndarray]
Tables = Mapping[str, Any] | None
Sizes = dict[str, list[np.ndarray]]
PROBABILITY: Final = 0.95
"""Share of the time, of the runs, or of both, for which the sizes hold."""
CONFIDENCE: Final = 0.95
"""Confidence of the bound over runs."""
_WINDOW_S: Final = 60.0
"""Window of a mean [s], or an eighth of an observation period if that is less."""
_MOST_RUNS: Final = 100
"""Runs whose histories are read, the first ones: a report should take seconds, and 59 are enough for a bound."""


@dataclass(frozen=True)
class BudgetedError:
    """Error with a budget: its title and unit, whether of knowledge or performance, channels, and value (ticks, k)."""

    name: str
    title: str
    unit: str
    is_knowledge: bool
    channels: tuple[str, ...]
    value: Callable[[History, Tables], np.ndarray | None]


def pointing_error(history: History, tables: Tables) -> np.ndarray | None:
    """Angles (ticks, 2) from the boresight to the target about the camera's axes [deg]; None without a scenario.

    NaN unless target pointing is commanded and settled, as in the metrics of pointing.
    """
    if tables is None:
        return None
    line_N = -np.asarray(history["r_ST_N"], dtype=np.float64)
    line_B = np.einsum("tij,tj->ti", drawn_scenarios.attitude_matrices(history["q_BN"]), line_N)
    line_K = line_B @ drawn_scenarios.camera_axes(tables).T
    if "wide_lens" in history:
        wide_K = line_B @ drawn_scenarios.camera_axes(tables, through_wide_lens=True).T
        line_K = np.where(np.asarray(history["wide_lens"], dtype=bool)[:, None], wide_K, line_K)
    across = np.linalg.norm(line_K[:, :2], axis=1, keepdims=True)
    angle = np.rad2deg(np.arctan2(across, line_K[:, 2:]))
    error = line_K[:, :2] * angle / np.maximum(across, np.finfo(np.float64).tiny)
    settle_ticks = np.round(tables["pointing"]["settle_time_s"] / _step_s(history))
    settled = is_settled(np.asarray(history["mode"])[None], np.array([settle_ticks]))[0]
    return np.where(settled[:, None], error, np.nan)


def _itself(name: str) -> Callable[[History, Tables], np.ndarray]:
    return lambda history, _: history[name]


ERRORS: Final = (
    BudgetedError("pointing", "Pointing error", "deg", False, ("r_ST_N", "q_BN", "mode"), pointing_error),
    BudgetedError(
        "formation",
        "Formation error",
        "m",
        False,
        ("rho_H", "rho_desired_H"),
        lambda history, _: history["rho_H"] - history["rho_desired_H"],
    ),
    BudgetedError(
        "relative_navigation",
        "Relative navigation error",
        "m",
        True,
        ("relative_error_H",),
        _itself("relative_error_H"),
    ),
    BudgetedError(
        "servicer_navigation",
        "Navigation error of the servicer",
        "m",
        True,
        ("servicer_error_H",),
        _itself("servicer_error_H"),
    ),
    BudgetedError(
        "target_navigation", "Navigation error of the target", "m", True, ("target_error_H",), _itself("target_error_H")
    ),
    BudgetedError(
        "target_attitude",
        "Attitude error of the target",
        "deg",
        True,
        ("target_attitude_error_T_deg", "target_attitude_known"),
        lambda history, _: np.where(
            np.asarray(history["target_attitude_known"], dtype=bool)[:, None],
            history["target_attitude_error_T_deg"],
            np.nan,
        ),
    ),
)
"""Errors that histories hold: of performance (actual minus desired) and of knowledge (estimated minus actual)."""


@dataclass(frozen=True)
class BudgetPlacement:
    """Where the windows of a budget lie in a run: first tick that counts, windows in ticks, and the tick [s]."""

    first: int
    windows: BudgetWindows
    tick_s: float

    def content(self) -> dict[str, float]:
        """Times in report.json [s]."""
        begin = self.first * self.tick_s
        return {
            "from_s": begin,
            "to_s": begin + 2 * self.windows.period * self.tick_s,
            "window_s": self.windows.window * self.tick_s,
            "drift_s": self.windows.drift * self.tick_s,
            "period_s": self.windows.period * self.tick_s,
            "tick_s": self.tick_s,
        }


def placement(time_s: np.ndarray) -> BudgetPlacement | None:
    """Two observation periods in the settled part of a run with samples at times (ticks,); None if it is too short.

    The settled part begins at 1000 s, or after a third of a shorter run, as in the metrics.
    """
    if len(time_s) < 2:
        return None
    step = _step_s({"time_s": time_s})
    first = int(np.searchsorted(time_s, min(1000.0, float(time_s[-1]) / 3.0) - 1e-6 * step))
    period = (len(time_s) - first) // 2
    window = max(1, min(round(_WINDOW_S / step), period // 8))
    count = period // window
    return (
        BudgetPlacement(first, BudgetWindows(window, count // 2 * window, count * window), step) if count > 1 else None
    )


def _step_s(history: History) -> float:
    return float(np.median(np.diff(history["time_s"])))


def content(campaign: CampaignResults) -> dict[str, Any] | None:
    """Part of report.json: windows, runs, and of each error the sizes that hold; None without histories to make it of.

    Only runs count that reached their end and whose history does not depend on results: failures and worst runs that
    keep one are no sample of the campaign.
    """
    kept = _runs_kept_regardless(campaign)
    ended = set(campaign.run_ids[campaign.reached_end].tolist())
    members = [run for run in kept if run in ended][:_MOST_RUNS]
    first = placement(np.asarray(campaign.history(members[0], 0)["time_s"])) if members else None
    if first is None:
        return None
    names = list(campaign.servicer_names) or [""]
    sizes: dict[tuple[str, str], Sizes] = {}
    for run in members:
        tables = drawn_scenarios.drawn_tables(campaign, run)
        for number, servicer in enumerate(names):
            _add_sizes(sizes, servicer, campaign.history(run, number), tables[number], first)
    independent = runs_are_independent(campaign)
    errors = [
        _entry(error, servicer, sizes[error.name, servicer], independent)
        for servicer in names
        for error in ERRORS
        if (error.name, servicer) in sizes
    ]
    if not errors:
        return None
    return {
        "probability": PROBABILITY,
        "confidence": CONFIDENCE,
        "runs": len(members),
        "of_runs": len(campaign.run_ids),
        "stopped_early": len(set(kept) - ended),
        "runs_for_bound": runs_for_bound(PROBABILITY, CONFIDENCE),
        **first.content(),
        "errors": errors,
    }


def _runs_kept_regardless(campaign: CampaignResults) -> list[int]:
    """Numbers of the runs with a history that they keep whatever their results are."""
    stored, record = set(campaign.history_ids), campaign.info.get("histories")
    if record is not None:
        runs = int(campaign.info.get("runs", len(campaign.run_ids)))
        retention = Retention.from_record(record)
        stored &= retention.unconditional_run_ids(int(campaign.info.get("first_run", 0)), runs)
    return sorted(stored & set(campaign.run_ids.tolist()))


def _add_sizes(
    sizes: dict[tuple[str, str], Sizes], servicer: str, history: History, tables: Tables, place: BudgetPlacement
) -> None:
    """Adds the sizes of all errors of a run."""
    for error in ERRORS:
        value = error.value(history, tables) if set(error.channels) <= history.keys() else None
        if value is None:
            continue
        counted = np.asarray(value, dtype=np.float64)[place.first : place.first + 2 * place.windows.period]
        of_error = sizes.setdefault((error.name, servicer), {name: [] for name in INDICES})
        for name, found in error_indices(counted, place.windows).items():
            of_error[name].append(found.astype(np.float32))


def _entry(error: BudgetedError, servicer: str, sizes: Sizes, independent: bool) -> dict[str, Any]:
    names = KNOWLEDGE if error.is_knowledge else PERFORMANCE
    return {
        "name": error.name,
        "title": error.title,
        "unit": error.unit,
        "servicer": servicer,
        "kind": "knowledge" if error.is_knowledge else "performance",
        "indices": [
            {
                "index": names[index],
                "of": index,
                **asdict(budget_line(sizes[index], PROBABILITY, CONFIDENCE, independent)),
            }
            for index in INDICES
        ],
    }


@dataclass(frozen=True)
class BudgetTable:
    """Table of one error: its title with the unit, and rows of an index with its meaning, and cells."""

    title: str
    rows: list[tuple[str, list[str]]]


def budget_tables(budgets: Mapping[str, Any] | None) -> list[BudgetTable]:
    """Tables of the errors; empty without budgets."""
    return [
        BudgetTable(
            f"{entry['title']}{', ' if entry['servicer'] else ''}{entry['servicer']} [{entry['unit']}]",
            [
                (
                    f"{line['index']}, {line['of']}",
                    [format_number(line[key], 3) for key in ("temporal", "ensemble", "ensemble_bound", "mixed")],
                )
                for line in entry["indices"]
            ],
        )
        for entry in (budgets["errors"] if budgets else ())
    ]


def windows_text(budgets: Mapping[str, Any] | None) -> str:
    """Windows, runs and what was left out, in sentences; empty without budgets."""
    if budgets is None:
        return ""
    times = {
        key: format_number(budgets[key]) for key in ("from_s", "to_s", "window_s", "drift_s", "period_s", "tick_s")
    }
    text = (
        f"From {times['from_s']} to {times['to_s']} s, sampled every {times['tick_s']} s: means over windows of "
        f"{times['window_s']} s; drift between windows {times['drift_s']} s apart; two observation periods of "
        f"{times['period_s']} s. {budgets['runs']} of {budgets['of_runs']} runs count, of those whose history is kept "
        "whatever their results are."
    )
    if budgets["stopped_early"]:
        text += f" Left out: {budgets['stopped_early']} that stopped early."
    return text


def histories_wanted(budgets: Mapping[str, Any] | None) -> int | None:
    """Number of histories that a bound of the ensemble takes; None if there are as many."""
    return budgets["runs_for_bound"] if budgets and budgets["runs"] < budgets["runs_for_bound"] else None


def finding(budgets: Mapping[str, Any] | None) -> str:
    """What one would find in the section, in one line."""
    if budgets is None:
        return "No history is kept whatever the results are"
    parts = [
        f"{entry['title'] if entry is budgets['errors'][0] else entry['title'].lower()} "
        f"{format_number(line['mixed'], 3)} {entry['unit']} "
        f"({line['index']})"
        for entry in budgets["errors"][:3]
        for line in entry["indices"][:1]
        if line["mixed"] is not None
    ]
    return ", ".join(parts) + f" at {100.0 * budgets['probability']:g} %" if parts else "No error is defined"
