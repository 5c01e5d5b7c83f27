"""Campaign results as the report needs them, however they are stored: protocol, design, dispersions, key metrics."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np

from rpojax.analysis.statistics.intervals import clopper_pearson_interval
from rpojax.metrics.time_windows import MetricWindow
from rpojax.physics.plant_options import is_category
from rpojax.report.labels import in_display_order
from rpojax.scenario.dispersed_numbers.values_by_run import values_of_runs
from rpojax.scenario.parameter_keys import component_columns
from rpojax.simulation.outcomes.outcome_events import OutcomeEvent

_PHRASES = {
    "latin_hypercube": "a Latin hypercube",
    "sobol": "a Sobol sequence",
    "table": "a table of given values",
    "grid": "a grid of given values",
}
_DEFAULT_METRICS = {"formation_error_rms_m", "nav_relative_position_error_rms_m", "delta_v_m_s", "min_range_m"}
_MIN_RUNS = 10
_MAX_METRICS = 8


@runtime_checkable
class CampaignResults(Protocol):
    """Results of a campaign as host arrays: one row per run, NaN where a value is undefined."""

    @property
    def directory(self) -> Path:
        """Folder of the campaign, where the report is written."""
        ...

    @property
    def info(self) -> Mapping[str, Any]:
        """Name, scenario, seed, versions and further provenance of the results."""
        ...

    @property
    def run_ids(self) -> np.ndarray:
        """(runs,) run number of each row."""
        ...

    @property
    def metrics(self) -> Mapping[str, np.ndarray]:
        """Metric name, of one servicer `NAME/SERVICER` -> (runs,), in the unit of `rpojax.metrics.metric_catalogue`."""
        ...

    @property
    def completed(self) -> np.ndarray:
        """(runs,) bool: the run did what it should: its outcome is `completed`."""
        ...

    @property
    def failed(self) -> np.ndarray:
        """(runs,) bool: the run failed: its outcome is neither `completed` nor `not_judged`."""
        ...

    @property
    def outcomes(self) -> np.ndarray:
        """(runs,) of str: how the run ended, such as `completed` or `lost`."""
        ...

    @property
    def reached_end(self) -> np.ndarray:
        """(runs,) bool: the run was simulated to its end, in whatever state, and so has metrics."""
        ...

    @property
    def is_judged(self) -> np.ndarray:
        """(runs,) bool: all outcomes were judged; older versions recorded only why a run was frozen."""
        ...

    @property
    def events(self) -> Sequence[OutcomeEvent]:
        """Flags of failure that were raised in the runs, and cleared in those that recovered."""
        ...

    @property
    def failed_at_s(self) -> np.ndarray:
        """(runs,) time since which a failed run has been in its final state [s], NaN for a run that did not fail."""
        ...

    @property
    def failure_reason(self) -> np.ndarray:
        """(runs,) of str, empty for a run that did not fail."""
        ...

    @property
    def drawn(self) -> Mapping[str, np.ndarray]:
        """Dispersion key -> (runs,) or (runs, k) drawn values in the unit of the key."""
        ...

    @property
    def trace_time_s(self) -> np.ndarray:
        """(m,) time of the traces [s]."""
        ...

    @property
    def traces(self) -> Mapping[str, np.ndarray]:
        """Channel -> (runs, m), NaN after the run was frozen."""
        ...

    @property
    def phases(self) -> Mapping[str, np.ndarray]:
        """Arrays of `rpojax.simulation.metrics.phase_records.evaluate` of the runs; empty without phases."""
        ...

    @property
    def signs(self) -> Mapping[str, np.ndarray]:
        """Arrays of `rpojax.simulation.metrics.failure_signs.evaluate` of the runs; empty in older folders."""
        ...

    @property
    def phase_names(self) -> Sequence[str]:
        """Names of the phases in the order of those arrays, the two built-in ones last."""
        ...

    @property
    def coverage(self) -> Mapping[str, np.ndarray]:
        """`lit_samples` and `seen_samples` (runs, facets) of the target's surface; empty without coverage."""
        ...

    @property
    def surface(self) -> Mapping[str, np.ndarray]:
        """Facets of the target's surface: arrays of `rpojax.vision.surface.facets.Facets`; empty without coverage."""
        ...

    @property
    def history_ids(self) -> Sequence[int]:
        """Numbers of the runs with a stored full history."""
        ...

    def history(self, run_id: int, servicer: int | None = None) -> Mapping[str, np.ndarray]:
        """Full history of one of `history_ids`: channel -> array, time first; of all servicers of a team, or of one."""
        ...

    @property
    def servicer_names(self) -> Sequence[str]:
        """Names of the servicers of a team; empty for one alone."""
        ...

    def servicers(self, group: str) -> Mapping[str, np.ndarray]:
        """Arrays (runs, servicers, ...) of a group, such as `status`, of a team; empty without a team."""
        ...


class ChangedResults:
    """Results of another campaign, except for the members in `changes` and those that a subclass defines."""

    def __init__(self, campaign: CampaignResults, **changes: Any) -> None:
        self._campaign, self._changes = campaign, changes


def _member(name: str) -> property:
    return property(
        lambda results: results._changes[name] if name in results._changes else getattr(results._campaign, name)
    )


# Members, not `__getattr__`: a check against the protocol looks for them without calling anything.
for _name in vars(CampaignResults):
    if not _name.startswith("_"):
        setattr(ChangedResults, _name, _member(_name))


def design_kind(campaign: CampaignResults) -> str:
    """Kind of the scenario's design; without one, every run is drawn independently."""
    return str((campaign.info.get("scenario", {}).get("design") or {}).get("kind", "independent"))


def runs_are_independent(campaign: CampaignResults) -> bool:
    """Whether the runs are independent, which exact intervals, p-values and verdicts require."""
    return design_kind(campaign) == "independent"


def probability_interval(campaign: CampaignResults, count: int, total: int) -> list[float] | None:
    """95 % interval of a probability from `count` of `total` runs; None without runs and for dependent runs."""
    return list(clopper_pearson_interval(count, total)) if total and runs_are_independent(campaign) else None


def design_content(campaign: CampaignResults) -> dict[str, Any]:
    """Part of report.json: kind of the design, and whether its runs are independent."""
    return {"kind": design_kind(campaign), "independent": runs_are_independent(campaign)}


def design_phrase(campaign: CampaignResults) -> str:
    """The design as a noun phrase."""
    found = design_kind(campaign)
    return _PHRASES.get(found, f"the design {found!r}")


def dispersed_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Every dispersed scalar (runs,); a vector has one entry per component, named `key[0]`, `key[1]`, ..."""
    return component_columns({key: np.asarray(values, dtype=np.float64) for key, values in campaign.drawn.items()})


def keep_out_radii(campaign: CampaignResults) -> np.ndarray | None:
    """Radius of every run's keep-out sphere [m], (runs,), or (1,) where all have the same; None without one.

    Of a team (..., servicers): each servicer keeps out of a sphere of its own.
    """
    each = [
        values_of_runs(campaign.drawn, f"limits.keep_out_m{end}", radius) for end, radius in _nominal_radii(campaign)
    ]
    if not each or not all(radii.size for radii in each):
        return None
    return np.stack(np.broadcast_arrays(*each), axis=-1) if campaign.servicer_names else each[0]


def nominal_keep_out_radii(campaign: CampaignResults) -> list[float]:
    """Radii of the keep-out spheres of the servicers in the scenario [m], each once, the least first; none without."""
    return sorted({radius for _, radius in _nominal_radii(campaign)})


def _nominal_radii(campaign: CampaignResults) -> list[tuple[str, float]]:
    """End of the drawn key, and radius in the scenario [m], of each servicer; none where the scenario has no radius."""
    scenario = campaign.info.get("scenario", {})
    changes = {each.get("name"): each.get("limits") or {} for each in scenario.get("servicers", [])}
    ends = {f"/{name}": changes.get(name, {}) for name in campaign.servicer_names} or {"": {}}
    common = scenario.get("limits", {})
    radii = {end: own.get("keep_out_m", common.get("keep_out_m")) for end, own in ends.items()}
    return [(end, float(radius)) for end, radius in radii.items() if radius is not None]


def rankable_scalars(campaign: CampaignResults) -> dict[str, np.ndarray]:
    """Dispersed scalars (runs,) that can be ranked: all but the categorical ones, such as kinds of fault."""
    return {key: values for key, values in dispersed_scalars(campaign).items() if not is_categorical(key)}


def is_categorical(key: str) -> bool:
    """Whether the numbers of a dispersed key, such as `faults.first.kind/second`, are codes without an order."""
    return is_category(key.partition("/")[0])


def select_key_metrics(campaign: CampaignResults) -> list[str]:
    """Names of at most eight metrics that vary over ten runs or more: those with requirements, then the defaults."""
    required = {_metric_name(entry) for entry in campaign.info.get("scenario", {}).get("requirements") or []}
    found = [name for name in in_display_order(campaign.metrics) if has_variation(campaign.metrics[name])]
    chosen = [name for name in found if name in required][:_MAX_METRICS]
    chosen += [name for name in found if name in _DEFAULT_METRICS - required][: _MAX_METRICS - len(chosen)]
    return in_display_order(chosen)


def _metric_name(requirement: Mapping[str, Any]) -> str:
    window = MetricWindow(*(requirement.get(key) for key in ("phase", "at", "from_s", "to_s")))
    return f"{requirement['metric']}{window.suffix}"


def has_variation(values: np.ndarray) -> bool:
    """Whether a metric is defined in enough runs and not equal in all of them."""
    defined = values[np.isfinite(values)]
    return len(defined) >= _MIN_RUNS and float(np.ptp(defined)) > 0.0
