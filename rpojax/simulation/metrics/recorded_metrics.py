"""Metrics of runs from their recorded channels; an undefined metric is NaN, and null in a report."""

from collections.abc import Mapping
from typing import Final

import numpy as np
from numpy.typing import NDArray

from rpojax.flight.guidance.pointing_modes import Mode
from rpojax.metrics.metric_catalogue import METRICS
from rpojax.metrics.metric_definition import Floats, Metric, RunTiming
from rpojax.metrics.recorded_reduction import reduce_in_window, reduce_records
from rpojax.metrics.time_windows import MetricWindow
from rpojax.scenario import metric_needs
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.plugins import plugin_registry
from rpojax.scenario.schema import ScenarioFile

Records = Mapping[str, np.ndarray]
Values = Mapping[str, np.ndarray]

_DERIVED: Final = {"desired_position_H", "is_settled", "is_arrival", "approach_axis_H"}
"""Inputs of metrics that are no channels."""


MISSION_CHANNELS: Final = ("rho_desired_H", "phase", "phase_entered_by", "abort_reason", "unmet_conditions")
"""Channels of scenarios with phases that metrics and outcomes read."""


def _of_records() -> list[Metric]:
    return [metric for metric in METRICS.values() if metric.source == "records"]


def _inputs(are_of_all: bool) -> set[str]:
    """Channels that metrics of all scenarios read, or those of some."""
    return {name for each in _of_records() if (each.needs is None) is are_of_all for name in each.inputs} - _DERIVED


REQUIRED_CHANNELS: Final = tuple(sorted({"mode"} | _inputs(are_of_all=True)))
"""Channels of all scenarios that the metrics read."""
OPTIONAL_CHANNELS: Final = tuple(sorted(_inputs(are_of_all=False) - set(REQUIRED_CHANNELS)))
"""Those of scenarios with what some metrics need: plumes on the target, isolation valves, landmarks."""


def evaluate(file: ScenarioFile, records: Records, varied: Values) -> dict[str, Floats]:
    """Metrics (runs,) from channels at the camera rate.

    Args:
        file: the scenario
        records: channels (runs, ticks) or (runs, ticks, components)
        varied: values of the runs (runs, ...) by key, of the keys that vary
    """
    quantities, timing = _quantities(file, records, varied), _timing(file)
    metrics = [metric for metric in _of_records() if metric_needs.lacks(file, metric) is None]
    found = {metric.name: reduce_records(metric, quantities, timing) for metric in metrics}
    return found | _custom(file, quantities, timing)


def _custom(file: ScenarioFile, quantities: Records, timing: RunTiming) -> dict[str, Floats]:
    """Metrics (runs,) of the scenario's plugin; NaN where they are not finite."""
    found = {name: reduce_records(each, quantities, timing) for name, each in plugin_registry.metrics_of(file).items()}
    return {name: np.where(np.isfinite(values), values, np.nan) for name, values in found.items()}


def _metric_of(file: ScenarioFile, name: str) -> Metric | None:
    return plugin_registry.catalogue_of(file).get(name)


def evaluate_windows(file: ScenarioFile, records: Records, varied: Values) -> dict[str, Floats]:
    """Metrics (runs,) in the windows of the scenario's requirements, and when runs were there, as `evaluate`.

    A run that was frozen in a window has no metric of it; `records` hold `running` too.
    """
    required = {each.metric_name: each for each in file.requirements if each.window.suffix}
    if not required:
        return {}
    quantities, timing = _quantities(file, records, varied), _timing(file)
    running, found = records["running"], dict[str, Floats]()
    for name, requirement in required.items():
        window, metric = requirement.window, _metric_of(file, requirement.metric)
        ticks = window_ticks(file, window, records)
        within = ticks & running
        if metric is not None and metric.source in ("records", "plugin"):
            values = reduce_in_window(metric, quantities, within, timing, is_event=window.at is not None)
            found[name] = np.where((ticks & ~running).any(axis=1), np.nan, values)
        if window.at is not None:
            found[window.presence_name] = np.where(within.any(axis=1), within.argmax(axis=1) * timing.tick_s, np.nan)
        elif window.phase is not None:
            found[window.presence_name] = within.sum(axis=1) * timing.tick_s
    return found


def window_ticks(file: ScenarioFile, window: MetricWindow, records: Records) -> NDArray[np.bool_]:
    """Flags (runs, ticks) of a window, the time after a run was frozen included; `records` hold `running` too."""
    shape = records["running"].shape
    if window.phase is None:
        return np.broadcast_to(window.between_times(shape[1], 1.0 / file.rates.camera_hz), shape)
    phases = records["phase"]
    return window.within(phases == file.phase_names.index(window.phase), phases < len(file.phases))


def _timing(file: ScenarioFile) -> RunTiming:
    tick_s = 1.0 / file.rates.camera_hz
    return RunTiming(tick_s, decision_ticks=round(file.rates.formation_period_s / tick_s))


def _quantities(file: ScenarioFile, records: Records, varied: Values) -> Records:
    """Inputs of metrics: channels, and what is made of them."""
    settle_time_s = values_of_runs(varied, "pointing.settle_time_s", file.pointing.settle_time_s)
    desired = desired_position_H(file, records, varied)
    time_s = np.arange(records["mode"].shape[1]) / file.rates.camera_hz
    return {
        "time_s": np.broadcast_to(time_s, records["mode"].shape),
        "rho_desired_H": desired,
        **records,
        **(_arrival(file, records, varied, desired) if file.phases else {}),
        "desired_position_H": desired,
        "is_settled": is_settled(records["mode"], np.round(settle_time_s / (1.0 / file.rates.camera_hz))),
    }


def _arrival(file: ScenarioFile, records: Records, varied: Values, desired: Floats) -> dict[str, np.ndarray]:
    """Flags (runs, ticks) of ticks at which the last phase begins, and axis (runs, ticks, 3) of the approach to it."""
    last = file.phases[-1]
    in_last = records["phase"] == len(file.phases) - 1
    arrival = in_last.copy()
    arrival[:, 1:] &= ~in_last[:, :-1]
    if last.corridor is None or file.ends_at_port:
        # In the axes of a target that turns the corridor has no lasting direction in H.
        return {"is_arrival": arrival, "approach_axis_H": desired}
    axis = values_of_runs(varied, f"phases.{last.name}.corridor.axis", np.asarray(last.corridor.axis))
    return {"is_arrival": arrival, "approach_axis_H": np.broadcast_to(axis[:, None], desired.shape)}


def outside_sigmas(records: Records) -> NDArray[np.bool_]:
    """Flags (runs, ticks, 3) of seconds and Hill axes with a relative position error outside of 3 sigma."""
    return np.abs(records["relative_error_H"]) > 3.0 * records["relative_sigma_H"]


def desired_position_H(file: ScenarioFile, records: Records, varied: Values) -> Floats:
    """Desired relative position (runs, ticks, 3) of each run [m]: its station, or the reference of its phases."""
    if MISSION_CHANNELS[0] in records:
        return records[MISSION_CHANNELS[0]]
    desired = values_of_runs(varied, "formation.desired_position_m", file.formation.desired_position_m)
    return np.broadcast_to(desired[:, None], records["rho_H"].shape)


def is_settled(mode: NDArray[np.integer], settle_ticks: Floats) -> NDArray[np.bool_]:
    """Whether the camera has pointed at the target for its settling time (runs,), or since the start (runs, ticks)."""
    looking = mode == Mode.LOOK
    tick = np.arange(mode.shape[1], dtype=np.int32)
    since_start = np.iinfo(np.int32).min // 2
    turned_away = np.maximum.accumulate(np.where(looking, since_start, tick), axis=1)
    return looking & (tick - turned_away > settle_ticks[:, None])
