"""The contents of the page's sections as plain records; the template only lays them out."""

import json
import shlex
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from rpojax.analysis.consistency import mean_nees_interval
from rpojax.analysis.proportions import proportion_interval
from rpojax.report.charts import Chart, envelope, histogram, reference_lines
from rpojax.report.labels import CHANNELS, Channel, metric, number, ordered
from rpojax.report.results import Results

_MOST_FAILURES = 50
_LONGEST_LINE = 4000
_NEES_COMPONENTS = 12
_NOMINAL_COVERAGE = 0.9973


@dataclass(frozen=True)
class Tile:
    """One headline number; `alert` marks one that needs attention."""

    title: str
    value: str
    unit: str
    note: str
    alert: bool = False


@dataclass(frozen=True)
class MetricRow:
    """One line of the metric table; `cells` are mean, sd, min, p50, p95, p99, bound of p99 and max.

    Where a low value is the bad one, p5, p1 and the bound of p1 stand in place of p95, p99 and its bound, and say so.
    """

    name: str
    title: str
    meaning: str
    unit: str
    cells: list[str]
    defined: int
    worst_run: int | None


def identity(campaign: Results, summary: Mapping[str, Any]) -> list[tuple[str, str]]:
    """Label and text of what identifies the campaign."""
    info, runs = campaign.info, summary["runs"]
    versions = ", ".join(f"{name} {version}" for name, version in info.get("versions", {}).items())
    missing = f", {runs['missing']} missing" if runs["missing"] else ""
    lines = [
        ("Scenario hash", info.get("scenario_hash")),
        ("Master seed", info.get("seed")),
        ("Runs", f"{runs['requested']} requested, {runs['completed']} completed, {runs['failed']} failed{missing}"),
        ("Replaced stages", _replaced(info.get("stages") or {})),
        ("Versions", versions),
        ("Device", " ".join(str(info[key]) for key in ("device", "dtype") if key in info)),
        ("Block size", info.get("block_size")),
        ("Created", info.get("created")),
        ("Timing", _timing(info.get("timing") or {})),
        ("Any run again", again(campaign, "I", "DIR")),
    ]
    return [(label, str(text)) for label, text in lines if text not in (None, "")]


def again(campaign: Results, run: int | str, out: str) -> str:
    """Command that flies one run again, bit for bit on the same kind of device; in Python if stages were replaced."""
    info, file = campaign.info, campaign.directory / "scenario.toml"
    seed, size = info.get("seed"), info.get("block_size")
    if info.get("stages"):
        return (
            f"rpojax.run_campaign(rpojax.load({str(file)!r}), 1, {out!r}, {seed}, first_run={run}, "
            f"block_size={size}, stages=...)"
        )
    return f"rpojax run {shlex.quote(str(file))} --seed {seed} --block-size {size} --run-id {run} --out {out}"


def _replaced(stages: Mapping[str, Any]) -> str:
    return "; ".join(
        f"{name} = {stage['function']}, source {stage['source_sha256'] or 'unknown'}" for name, stage in stages.items()
    )


def tiles(summary: Mapping[str, Any]) -> list[Tile]:
    """Headline numbers of the campaign."""
    metrics = summary["metrics"]
    coverage = _statistic(metrics, "sigma3_coverage", "mean")
    nees = _statistic(metrics, "nees_mean", "mean")
    return [
        _median_tile(metrics, "formation_error_rms_m"),
        _median_tile(metrics, "nav_relative_position_error_rms_m"),
        Tile("3-sigma coverage", number(coverage), "", f"mean; a normal error gives {_NOMINAL_COVERAGE}"),
        Tile("NEES / 12", number(None if nees is None else nees / _NEES_COMPONENTS, 3), "", "mean; 1 is consistent"),
        _median_tile(metrics, "delta_v_m_s"),
        _failure_tile(summary["runs"]),
    ]


def metric_rows(campaign: Results, summary: Mapping[str, Any]) -> list[MetricRow]:
    """Lines of the metric table in the order of report.json."""
    rows = []
    for name, entry in summary["metrics"].items():
        shown = metric(name)
        keys = ("mean", "std", "min", "p50", *shown.tail[:3], "max")
        cells = [_marked(key, number(entry[key])) for key in keys]
        row = _worst(campaign.metrics[name], shown.low_is_bad)
        worst = None if row is None else int(campaign.run_ids[row])
        rows.append(MetricRow(name, shown.title, shown.meaning, shown.unit, cells, entry["defined"], worst))
    return rows


def _marked(key: str, text: str) -> str:
    """Text of a statistic under a heading of the other side, with its own name."""
    return f"{key.partition('_')[0]} {text}" if key in ("p5", "p1", "p1_lower_95") else text


def envelopes(campaign: Results) -> dict[str, tuple[Channel, Chart]]:
    """Chart over time of every channel that holds a finite value, by the channel's name."""
    charts: dict[str, tuple[Channel, Chart]] = {}
    for channel in CHANNELS:
        values = campaign.traces.get(channel.name)
        if values is None:
            continue
        bound = campaign.traces.get("nav_relative_sigma3_m") if channel.name == "nav_relative_error_m" else None
        completed = np.asarray(campaign.completed, dtype=bool)
        chart = envelope(channel, campaign.trace_time_s, values, completed, bound, campaign.run_ids)
        if chart is not None:
            charts[channel.name] = (channel, chart)
    for name, levels in _levels(campaign.info.get("scenario", {})).items():
        if name in charts:
            channel, chart = charts[name]
            reference_lines(chart, channel.unit, levels)
    return charts


def histograms(campaign: Results, summary: Mapping[str, Any]) -> list[dict[str, Any]]:
    """Title, median, p99 (p1 where low is bad) and chart of every metric; no chart where runs agree or none has it."""
    shown = []
    for name, entry in summary["metrics"].items():
        values = campaign.metrics[name]
        defined = values[np.isfinite(values)]
        shown_as, tail = metric(name), metric(name).tail[1]
        varies = len(defined) > 1 and float(np.ptp(defined)) > 0.0
        shown.append(
            {
                "name": name,
                "metric": shown_as,
                "p50": number(entry["p50"]),
                "tail": f"{tail} {number(entry[tail])}",
                "defined": len(defined),
                "chart": histogram(shown_as, defined) if varies else None,
            }
        )
    return shown


def consistency(campaign: Results, summary: Mapping[str, Any]) -> list[tuple[str, str, str]]:
    """Quantity, value found and value expected of a filter whose covariance tells the truth."""
    metrics = summary["metrics"]
    rows = [
        ("3-sigma coverage, mean over runs", number(_statistic(metrics, "sigma3_coverage", "mean")), "0.9973"),
        ("NEES of both spacecraft, mean over runs", number(_statistic(metrics, "nees_mean", "mean")), "12"),
        ("NEES of the relative state, mean over runs", number(_statistic(metrics, "nees_relative_mean", "mean")), "6"),
    ]
    inside = _share_inside(campaign)
    if inside is not None:
        share, low, high = inside
        quantity = f"Instants at which the mean NEES over runs lies in [{low:.2f}, {high:.2f}]"
        rows.append((quantity, f"{100.0 * share:.1f} %", "95 %"))
    return rows


def failures(summary: Mapping[str, Any]) -> dict[str, Any]:
    """Count of each reason, the first failed runs, and how many more there are."""
    rows = summary["failures"]
    return {
        "reasons": Counter(row["reason"] for row in rows).most_common(),
        "rows": [{**row, "at_s": number(row["at_s"])} for row in rows[:_MOST_FAILURES]],
        "more": max(0, len(rows) - _MOST_FAILURES),
    }


def chosen_metrics(campaign: Results, run_id: int) -> list[tuple[str, str, str]]:
    """Title, value and unit of every metric of one run."""
    rows = np.flatnonzero(campaign.run_ids == run_id)
    metrics = campaign.metrics
    return [
        (metric(name).title, number(float(value)), metric(name).unit)
        for name in ordered(metrics)
        for value in metrics[name][rows]
    ]


def scenario_lines(campaign: Results) -> list[str]:
    """The resolved scenario as `section.key = value` lines, the form in which one value can be set from outside.

    Long lines, such as columns of a design's table, are cut short.
    """
    lines = _flatten(campaign.info.get("scenario", {}), "")
    return [line if len(line) <= _LONGEST_LINE else f"{line[:_LONGEST_LINE]} ..." for line in lines]


def limits(campaign: Results, summary: Mapping[str, Any]) -> list[str]:
    """Sentences that say how far the results reach."""
    scenario, runs = campaign.info.get("scenario", {}), summary["runs"]
    sentences = [_camera_limit(scenario.get("camera"))]
    if "duration_s" in scenario:
        duration = number(float(scenario["duration_s"]))
        sentences.append(f"Each run lasts {duration} s; nothing is said about later times.")
    sentences.append(
        "From run to run vary the quantities under Dispersions, the error of the hand-over, the execution errors of "
        "burns, and the noise and slowly varying errors of the sensors; nothing else does. "
        "A model error that simulation and flight software share does not show."
    )
    if (kind := scenario.get("design", {}).get("kind", "independent")) != "independent":
        sentences.append(
            f"The runs are a design ({kind}), not independent draws: intervals, bounds and order statistics, which "
            "count on such draws, are descriptions of these runs only."
        )
    if runs["missing"]:
        sentences.append(f"{runs['missing']} of {runs['requested']} runs are missing; nothing here is about them.")
    if runs["completed"] < 299:
        sentences.append(
            f"{runs['completed']} completed runs cannot bound a 99th percentile without assuming a distribution "
            "(299 are needed for 95 % confidence); p99 is then a description of these runs only."
        )
    if runs["failed"]:
        sentences.append(
            "Metrics leave out runs in which they are undefined, as after a failure: "
            "they describe the survivors and must be read together with the failures. "
            "Only the bounds of p99 and p1 count failed runs, as worse than any other."
        )
    sentences.append("Intervals and bounds take the runs as independent: each with its own random draws.")
    if not summary["requirements"]:
        sentences.append("The campaign states no requirements, so this report gives no verdict.")
    return sentences


def _timing(timing: Mapping[str, Any]) -> str:
    parts = [
        ("compile_s", "{} s compiling"),
        ("run_s", "{} s running"),
        ("run_seconds_per_s", "{} simulated seconds per second"),
        ("devices", "{} device(s)"),
    ]
    return ", ".join(text.format(number(float(timing[key]), 3)) for key, text in parts if key in timing)


def _statistic(metrics: Mapping[str, Any], name: str, key: str) -> float | None:
    return metrics[name][key] if name in metrics else None


def _median_tile(metrics: Mapping[str, Any], name: str) -> Tile:
    shown = metric(name)
    tail = shown.tail[1]
    note = f"median; {tail} {number(_statistic(metrics, name, tail), 3)} {shown.unit}"
    return Tile(shown.title, number(_statistic(metrics, name, "p50"), 3), shown.unit, note)


def _failure_tile(runs: Mapping[str, int]) -> Tile:
    failed, total = runs["failed"], runs["failed"] + runs["completed"]
    if total == 0:
        return Tile("Failed runs", "0", "", "no run has ended yet")
    low, high = proportion_interval(failed, total)
    note = f"95 % interval of the rate: {100.0 * low:.2g} to {100.0 * high:.2g} %"
    return Tile("Failed runs", str(failed), f"of {total}", note, alert=failed > 0)


def _worst(values: np.ndarray, low_is_bad: bool) -> int | None:
    defined = np.flatnonzero(np.isfinite(values))
    if len(defined) < 2 or float(np.ptp(values[defined])) == 0.0:
        return None
    return int(defined[np.argmin(values[defined]) if low_is_bad else np.argmax(values[defined])])


def _share_inside(campaign: Results) -> tuple[float, float, float] | None:
    """Share of the settled instants whose mean NEES over completed runs is in its 95 % interval, and the interval."""
    completed = np.asarray(campaign.completed, dtype=bool)
    values = campaign.traces.get("nees")
    if values is None or not completed.any():
        return None
    time = campaign.trace_time_s
    settled = time >= min(1000.0, float(time[-1]) / 3.0)
    means = np.asarray(values[completed][:, settled], dtype=np.float64).mean(axis=0)
    mean = means[np.isfinite(means)]
    if len(mean) == 0:
        return None
    low, high = mean_nees_interval(_NEES_COMPONENTS, int(completed.sum()))
    return float(np.mean((mean >= low) & (mean <= high))), low, high


def _levels(scenario: Mapping[str, Any]) -> dict[str, list[tuple[float, str]]]:
    low, high = mean_nees_interval(_NEES_COMPONENTS, 1, 0.9)
    levels = {"nees": [(low, "consistent filter, 5 %"), (12.0, "mean"), (high, "95 %")]}
    keep_out = scenario.get("limits", {}).get("keep_out_m")
    if keep_out is not None:
        levels["range_m"] = [(float(keep_out), "keep-out sphere")]
    return levels


def _flatten(value: Any, path: str) -> list[str]:
    if isinstance(value, Mapping) and value:
        return [line for key, item in value.items() for line in _flatten(item, f"{path}.{key}" if path else str(key))]
    if isinstance(value, list) and value and all(isinstance(item, Mapping) for item in value):
        return [f"{path}[{index}] = {json.dumps(item, default=str)}" for index, item in enumerate(value)]
    return [f"{path} = {json.dumps(value, default=str)}"] if path else []


def _camera_limit(camera: Any) -> str:
    model = camera.get("model") if isinstance(camera, Mapping) else None
    texts = {
        "geometric": "boxes are computed from the geometry of the target with modelled errors. No image is rendered "
        "and no detector runs, so nothing is said about appearance, exposure or clutter",
        "statistical": "boxes are drawn from an error model of the detector. No image is rendered, so nothing is said "
        "about images unlike those from which the model was made",
        "rendered": "images are rendered and a trained detector finds the boxes. Results hold as far as the rendered "
        "images are like real ones",
    }
    if model not in texts:
        return "The scenario names no known camera model; how boxes were made must be looked up in the scenario."
    return f"The camera model is {model}: {texts[model]}."
